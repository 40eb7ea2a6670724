"""The public names and the modules that they are loaded from when they are first used."""

from . import lab as lab
from . import stages as stages
from .camera.camera import Camera as Camera
from .camera.camera_check import check_camera as check_camera
from .camera.camera_file import load_camera as load_camera
from .camera.shipped import list_cameras as list_cameras
from .capture import Capture as Capture
from .capture import capture as capture
from .core import Exposure as Exposure
from .core import InputError as InputError
from .core import Photons as Photons
from .core import SensorWarning as SensorWarning
from .dataset.read import Dataset as Dataset
from .dataset.sensor_noise import SensorNoise as SensorNoise
from .expose import Sensor as Sensor
from .expose import expose as expose
from .expose import stream as stream
from .files.tiff import write_tiff as write_tiff
from .gradient.gradient import differentiable as differentiable
from .optics.waveform import mains as mains
from .optics.waveform import pwm as pwm
from .optics.waveform import sine as sine
from .output.frames import Frames as Frames
from .output.light_files import read_irradiance as read_irradiance
from .render.light.foreign_light import light_from_rgb as light_from_rgb
from .render.light.irradiance import Irradiance as Irradiance
from .render.light.photons import collect as collect
from .render.light.photons import gradient_light as gradient_light
from .render.light.photons import uniform_light as uniform_light
from .render.passes.prepared import render as render
from .render.plugins.digital import digital as digital
from .render.plugins.digital import raw_log_likelihood as raw_log_likelihood
from .render.plugins.plugin_hook import register_plugins as register_plugins
from .render_frames import render_frames as render_frames
from .sensor.auto_exposure import AutoExposure as AutoExposure
from .sensor.fpn_maps import fpn_maps as fpn_maps
from .sensor.metering import Metering as Metering
from .stages.stage import Stage as Stage
from .theory.plan import Plan as Plan
from .theory.plan import plan as plan
from .theory.snr_curve import snr_curve as snr_curve
from .theory.stage_check import check_stage as check_stage

__version__: str
__all__: list[str]
