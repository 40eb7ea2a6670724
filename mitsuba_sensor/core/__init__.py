"""What every stage is computed with: units, signals, arrays, random numbers, backends, moments, frames, errors."""

from .checks import check_types, first_given, numbers
from .errors import DiskFull, InputError, closest, nearest, require, require_seed
from .exposure import Exposure
from .frame import Frame
from .moments import Moments
from .sensor_window import SensorWindow
from .signals import CountedElectrons, Electrons, Photons, PhotonsOfBands
from .types import Array, Float32Array, Float64Array, NumpyArray

__all__ = ["Array", "CountedElectrons", "DiskFull", "Electrons", "Exposure", "Float32Array", "Float64Array", "Frame"]
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
__all__ += ["closest", "first_given", "nearest", "numbers", "require", "require_seed"]
