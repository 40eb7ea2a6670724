"""Stage: the base class of every effect; sample() computes one random frame of the chain.

Expectations follow from samples. The rest that the package needs to know of a stage it reads from the attributes
declared here. The first and the last stage have more.
"""

from __future__ import annotations

import inspect
import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from ..core import Array, Electrons, Frame, InputError, Photons, SensorWindow
from ..core.signals import Filters
from ..core.types import Float64Array
from .datasheet import FileTable

if TYPE_CHECKING:
    from ..camera.camera import Camera

Datasheet: TypeAlias = "Camera"  # whose tables the effects read
Domain = Literal["photons", "electrons", "volts", "DN"]
UNITS: dict[Domain, str] = {"photons": "photons", "electrons": "e-", "volts": "V", "DN": "DN"}


class Stage(ABC):
    """One effect of the signal chain; subclasses are frozen dataclasses of its parameters.

    ::

        @dataclass(frozen=True)
        class Hum(ms.Stage):
            sigma_v: float
            domain = "volts"

            def sample(self, swing, frame):
                return swing + frame.number(self.sigma_v) * frame.row_normal("hum")

        noisier = camera.with_stage(Hum(1e-4), after="reset_noise")

    domain : quantity of the output.  label : name in reports.
    terms : names and symbols in EMVA 1288 (E), Janesick (J) and Konnik & Welsh (K), for the glossary.
    table, fields : the table of the camera file and the fields there that belong to this effect.
    no_noise : for a stage that is no noise, the fields that change it; others can be switched off by their keys.
    """

    domain: ClassVar[Domain]
    table: ClassVar[str] = ""
    fields: ClassVar[type[FileTable] | None] = None
    terms: ClassVar[str] = ""
    label: ClassVar[str] = ""
    no_noise: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        """Set the label, by default ``line drift`` for ``LineDrift``.

        Raises InputError for a field that hides a member of Stage, a method instead of a property, and a value instead
        of a method.
        """
        another = cls.__name__.lower()
        for base in cls.__mro__[: cls.__mro__.index(Stage)]:  # mixins too
            for name, annotation in inspect.get_annotations(base).items():
                is_member = hasattr(Stage, name) or name in Stage.__annotations__
                if is_member and "ClassVar" not in str(annotation):
                    raise InputError(
                        f"{cls.__name__}.{name} is a field, but Stage has a member {name}; rename the field to "
                        f"{another}_{name}, or write {name} = … without a type to override the member."
                    )
            for name, value in vars(base).items():
                member = vars(Stage).get(name)
                if isinstance(member, property) and inspect.isfunction(value):
                    raise InputError(
                        f"{cls.__name__}.{name} is a method; add @property above it."
                    )
                if inspect.isroutine(member) and not callable(getattr(base, name)):
                    raise InputError(
                        f"{cls.__name__}.{name} is a value, but Stage has a method {name}; rename the value to "
                        f"{another}_{name}."
                    )
        if "label" not in vars(cls):
            cls.label = re.sub(r"(?<!^)(?=[A-Z])", " ", cls.__name__).lower()

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Stage | None:
        """Return the stage with this camera's parameters, or None if the camera does not have the effect."""
        return None

    @abstractmethod
    def sample(self, signal: Array, frame: Frame) -> Array:
        """Return the signal of one frame after this stage, (H, W)."""

    @property
    def reach_px(self) -> int:
        """Distance in rows and columns of the furthest neighbours that change the signal of a pixel."""
        return 0

    @property
    def reach_along_rows_px(self) -> int:
        """The same within a row, if less."""
        return self.reach_px

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """Return the fixed-pattern noise maps of this stage, by name."""
        return {}

    @classmethod
    def key(cls) -> str:
        """Return the name for ``Camera.with_stage(after=…)``: ``line_drift`` for ``LineDrift``."""
        return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    @property
    def nominal_gain(self) -> float:
        """Small-signal gain: output unit per input unit."""
        return 1.0

    @property
    def saturation_e(self) -> float | None:
        """Most electrons at the output; None if it does not clip."""
        return None

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Return masks of the pixels that the report of a frame counts, e.g. clipped ones.

        signal : after the stage.
        """
        return {}


class Detector(Stage):
    """The first stage: photons to mean electrons."""

    def filters(self, photons: Photons) -> Filters | None:
        """Return the filters of the pixels, if each pixel gets a fraction of one layer only."""
        return None

    @property
    def light_reach_px(self) -> int:
        """Distance in rows and columns of the furthest light that a pixel collects."""
        return 0

    @property
    def other_photodiodes(self) -> tuple[OtherPhotodiode, ...]:
        """Photodiodes of split pixels whose crosstalk differs from the first one's."""
        return ()


class OtherPhotodiode(NamedTuple):
    """A further photodiode of split pixels.

    name : of its first readout.  exposure_ratio : its exposure time over the exposure time of the frame.
    detection : the first stage for this photodiode, except for its sensitivity.
    """

    name: str
    exposure_ratio: float
    detection: Detector


class ElectronCounter(Stage):
    """Mean electrons to whole electrons.

    is_poisson : whether counts follow the Poisson distribution of their mean.
    """

    is_poisson: ClassVar[bool] = True


class ElectronMaps(Stage):
    """A stage with fixed-pattern noise maps in electrons."""

    @abstractmethod
    def gains_of_maps(self) -> dict[str, float]:
        """Return for each map the output of the stage per electron in the map."""


ROUNDING_MAX_DN = 1 / 32
"""Largest rounding that ``ideal`` compensates; at 16 bits two units in the last place of float32 are 0.016 DN."""


class Converter(Stage):
    """The last stage: volts to digital numbers.  gain_dn_per_v : A.  black_level_dn : the code of darkness [DN]."""

    domain = "DN"
    gain_dn_per_v: float
    black_level_dn: float

    @property
    @abstractmethod
    def highest(self) -> int:
        """The largest code."""

    @property
    def inl_lsb(self) -> Float64Array | None:
        """INL of the lower edges of the codes 1, 2, … [LSB]; None for equal steps."""
        return None

    def ideal(self, swing: Array, frame: Frame) -> Array:
        """Return the code before rounding and clipping [DN].

        It is two units in the last place too large, if that is at most ROUNDING_MAX_DN: whole electrons on a transition
        then get the upper code, whichever way the products before were rounded.
        """
        last = 2 * float(np.finfo(frame.window.backend.precision).eps)
        more = 1.0
        if last * self.highest < ROUNDING_MAX_DN:
            more = 1 + last
        return (
            frame.number(more * self.black_level_dn)
            + frame.number(more * self.gain_dn_per_v) * swing
        )

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Return the masks of pixels at either end of the code range."""
        return {
            "clipped_adc_low": signal <= 0,
            "clipped_adc_high": signal >= frame.number(self.highest),
        }


@dataclass(frozen=True)
class LinearGain(Stage):
    """An amplifier, S·gain, of the swing; darkness stays dark at any gain.  gain : [V/V]."""

    gain: float
    domain = "volts"

    @property
    def nominal_gain(self) -> float:
        """The gain [V/V]."""
        return self.gain

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing times the gain."""
        if self.gain == 1:
            return swing
        return frame.number(self.gain) * swing


Chain = tuple[Stage, ...]


def detector_of(stages: Chain) -> Detector:
    """Return the first stage of a chain."""
    first = stages[0]
    assert isinstance(first, Detector), first
    return first


def converter_of(stages: Chain) -> Converter:
    """Return the last stage of a chain."""
    last = stages[-1]
    assert isinstance(last, Converter), last
    return last


def place_of(stage: Stage, stages: Sequence[Stage]) -> int:
    """Return the number of this very stage in its chain; another may be equal."""
    return next(number for number, one in enumerate(stages) if one is stage)


def place_of_count(stages: Sequence[Stage]) -> int:
    """Return the number of the stage that counts electrons, 0 without one; before it signals are mean electrons."""
    places = (k for k, stage in enumerate(stages) if isinstance(stage, ElectronCounter))
    return next(places, 0)


def without(stages: Chain, out: Collection[Stage]) -> Chain:
    """Return the chain without these very stages; user stages may lack a hash."""
    return tuple(stage for stage in stages if not any(stage is other for other in out))


def sample(stages: Iterable[Stage], signal: Array, frame: Frame) -> Array:
    """Return one frame of a signal after these stages."""
    for stage in stages:
        signal = stage.sample(signal, frame)
    return signal


def total(signal: Array) -> Array:
    """Return a signal as one array: the sum of bands, or of photoelectrons and dark electrons."""
    if isinstance(signal, Photons | Electrons):
        return signal.total
    return signal


def cut_to_zero(stage: Stage, name: str, cv: float, window: SensorWindow) -> dict[str, Array]:
    """Return ``cut_to_zero_<name>``, the mask of pixels whose factor in a map is not positive."""
    flat = cv == 0 and name not in window.given
    return {f"cut_to_zero_{name}": False if flat else stage.fpn_maps(window)[name] <= 0}
