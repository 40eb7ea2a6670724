"""Raw frames of a camera, from a Mitsuba 3 scene and the camera's datasheet.

>>> import mitsuba_sensor as ms
>>> camera = ms.load_camera("konnik_table1")
>>> exposure = ms.Exposure(time_s=0.1)
>>> frames = ms.expose(27_500.0, camera, exposure)          # mean photons per pixel
>>> frames.digital.shape, frames.digital.dtype
((1, 1300, 1900), dtype('uint16'))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(
    __name__, __file__
)  # the public names: in __init__.pyi

from .core.llvm import guard_llvm  # noqa: E402, after lazy_loader, which keeps `render` the function
from .render.plugins.plugin_hook import watch  # noqa: E402

guard_llvm()  # before Mitsuba or Dr.Jit load LLVM
watch()  # <film type="photosensor"> and <sensor type="camera"> in plain Mitsuba

__version__ = "0.1.0"
