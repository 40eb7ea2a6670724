"""Public names and the modules that define them, loaded at first use."""

from .frames.bench import Bench as Bench
from .frames.bench import read_bench as read_bench
from .frames.stack import Stack as Stack
from .measure.automotive.contrast import contrast_detection as contrast_detection
from .measure.automotive.flicker import flicker as flicker
from .measure.colour_and_geometry.colour_chart import colour_chart as colour_chart
from .measure.colour_and_geometry.distortion import distortion as distortion
from .measure.colour_and_geometry.distortion import lateral_colour as lateral_colour
from .measure.colour_and_geometry.flat_field import flat_field as flat_field
from .measure.image_quality.dead_leaves import dead_leaves as dead_leaves
from .measure.image_quality.siemens_star import siemens_star as siemens_star
from .measure.image_quality.slanted_edge import slanted_edge as slanted_edge
from .measure.image_quality.step_chart import step_chart as step_chart
from .measure.measurement import INSTRUMENTS as INSTRUMENTS
from .measure.measurement import Instrument as Instrument
from .measure.measurement import measure_bench as measure_bench
from .measure.noise_distance import noise_divergence as noise_divergence
from .quantity import Quantity as Quantity
from .twin.fit import Twin as Twin
from .twin.fit import fit as fit
from .twin.readouts import ReadoutTwins as ReadoutTwins
from .twin.readouts import fit_readouts as fit_readouts

__all__: list[str]
