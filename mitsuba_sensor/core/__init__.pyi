"""The names that the stages are computed with, and the modules that they are loaded from when they are first used."""

from .checks import check_types as check_types
from .checks import first_given as first_given
from .checks import numbers as numbers
from .checks import refuse_masked as refuse_masked
from .errors import DiskFull as DiskFull
from .errors import InputError as InputError
from .errors import require as require
from .errors import require_seed as require_seed
from .exposure import Exposure as Exposure
from .frame import Frame as Frame
from .moments import Moments as Moments
from .near_names import closest as closest
from .near_names import nearest as nearest
from .notes import Doubt as Doubt
from .notes import SensorWarning as SensorWarning
from .notes import SourceOfLight as SourceOfLight
from .notes import warn_of as warn_of
from .sensor_window import SensorWindow as SensorWindow
from .signals import CountedElectrons as CountedElectrons
from .signals import Electrons as Electrons
from .signals import Photons as Photons
from .signals import PhotonsOfBands as PhotonsOfBands
from .types import Array as Array
from .types import Float32Array as Float32Array
from .types import Float64Array as Float64Array
from .types import NumpyArray as NumpyArray
