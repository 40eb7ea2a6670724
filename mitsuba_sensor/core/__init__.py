"""What every stage is computed with: units, signals, arrays, random numbers, backends, moments, frames, errors."""

from .checks import check_types, first_given, numbers, refuse_masked
from .errors import DiskFull, InputError, closest, nearest, require, require_seed
from .exposure import Exposure
from .frame import Frame
from .moments import Moments
from .notes import Doubt, SensorWarning, SourceOfLight, warn_of
from .sensor_window import SensorWindow
from .signals import CountedElectrons, Electrons, Photons, PhotonsOfBands
from .types import Array, Float32Array, Float64Array, NumpyArray

__all__ = [
    "Array",
    "CountedElectrons",
    "DiskFull",
    "Electrons",
    "Exposure",
    "Float32Array",
    "Float64Array",
    "Frame",
]
__all__ += [
    "InputError",
    "Moments",
    "NumpyArray",
    "Photons",
    "PhotonsOfBands",
    "SensorWindow",
    "check_types",
    "closest",
]
__all__ += [
    "Doubt",
    "SensorWarning",
    "SourceOfLight",
    "closest",
    "first_given",
    "nearest",
    "numbers",
]
__all__ += ["refuse_masked", "require", "require_seed", "warn_of"]
