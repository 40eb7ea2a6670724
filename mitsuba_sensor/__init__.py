"""A Mitsuba 3 scene and a camera's datasheet in; the raw digital numbers that this camera would have delivered out.

>>> import mitsuba_sensor as ms
>>> camera = ms.load_camera("konnik_table1")
>>> exposure = ms.Exposure(time_s=0.1)
>>> frames = ms.expose(27_500.0, camera, exposure)          # mean photons per pixel, from anywhere
>>> frames.digital.shape, frames.digital.dtype
((1, 1300, 1900), dtype('uint16'))
"""

from .core import Exposure, InputError, Photons
from .pipeline import Capture, capture
from .render.irradiance import Irradiance
from .render.per_frame import render_frames
from .render.photons import collect, gradient_light, uniform_light
from .render.plugins import register as register_plugins
from .render.prepared import render
from .sensor.camera import Camera, list_cameras, load_camera
from .sensor.camera_check import check_camera
from .sensor.expose import Frames, expose, stream
from .sensor.fpn_maps import fpn_maps
from .sensor.gradient import differentiable
from .sensor.plan import Plan, plan
from .sensor.sensor import Sensor
from .sensor.stage import Stage

__version__ = "0.1.0"

__all__ = ["Camera", "Capture", "Exposure", "Frames", "InputError", "Irradiance", "Photons", "Plan", "Sensor", "Stage"]
__all__ += [
    "capture",
    "check_camera",
    "collect",
    "differentiable",
    "expose",
    "fpn_maps",
    "gradient_light",
    "list_cameras",
    "load_camera",
    "plan",
]
__all__ += ["register_plugins", "render", "render_frames", "stream", "uniform_light"]
