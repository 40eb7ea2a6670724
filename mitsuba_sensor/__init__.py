"""A Mitsuba 3 scene and a camera's datasheet in; the raw digital numbers that this camera would have delivered out.

>>> import mitsuba_sensor as ms
>>> camera = ms.load_camera("konnik_table1")
>>> exposure = ms.Exposure(time_s=0.1)
>>> frames = ms.expose(27_500.0, camera, exposure)          # mean photons per pixel, from anywhere
>>> frames.digital.shape, frames.digital.dtype
((1, 1300, 1900), dtype('uint16'))
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .engine.errors import InputError
from .engine.frame import Exposure
from .engine.quantities import Photons
from .light.photons import collect, gradient_light, uniform_light
from .sensor.camera import Camera, list_cameras, load_camera
from .sensor.exposing import Frames, expose, patterns, stream
from .sensor.plan import Plan, plan

if TYPE_CHECKING:
    from .light.irradiance import Irradiance, render
    from .light.plugins import register as register_plugins
    from .light.shooting import shoot

__version__ = "0.1.0"

__all__ = [
    "Camera",
    "Exposure",
    "Frames",
    "InputError",
    "Irradiance",
    "Photons",
    "Plan",
    "collect",
    "expose",
    "gradient_light",
    "list_cameras",
    "load_camera",
    "patterns",
    "plan",
    "register_plugins",
    "render",
    "shoot",
    "stream",
    "uniform_light",
]


LAZY = {
    "Irradiance": ("light.irradiance", "Irradiance"),
    "register_plugins": ("light.plugins", "register"),
    "render": ("light.irradiance", "render"),
    "shoot": ("light.shooting", "shoot"),
}


def __getattr__(name: str) -> Any:
    """What renders loads Mitsuba on first use; everything else works without it."""
    if name in LAZY:
        module, real_name = LAZY[name]
        return getattr(import_module(f"{__name__}.{module}"), real_name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
