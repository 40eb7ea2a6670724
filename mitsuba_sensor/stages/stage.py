"""Stage: the base class of every effect; sample() takes a signal through a chain.

``sample`` computes one random frame; what is expected of frames follows from samples. Whatever else the package needs
to know of a stage, it reads from the attributes declared here. The first and the last stage have more.
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

    domain : what leaves the stage.  label : its name in reports.
    terms : its names and symbols in EMVA 1288 (E), Janesick (J) and Konnik & Welsh (K), for the glossary.
    table, fields : the table of the camera file and the fields there that belong to this effect.
    no_noise : of a stage that is no noise, the fields that change it; others can be switched off by their keys.
    """

    domain: ClassVar[Domain]
    table: ClassVar[str] = ""
    fields: ClassVar[type[FileTable] | None] = None
    terms: ClassVar[str] = ""
    label: ClassVar[str] = ""
    no_noise: ClassVar[str] = ""

    def __init_subclass__(cls) -> None:
        """``LineDrift`` gets the label ``line drift``, unless it has one of its own.

        Raises InputError for a field that hides a member of all stages, and for a method in place of a property or a
        value in place of a method: the rest of the package would read them.
        """
        another = cls.__name__.lower()
        for base in cls.__mro__[: cls.__mro__.index(Stage)]:  # mixins too
            for name, annotation in inspect.get_annotations(base).items():
                is_member = hasattr(Stage, name) or name in Stage.__annotations__
                if is_member and "ClassVar" not in str(annotation):
                    raise InputError(
                        f"{cls.__name__}.{name} is a field, and every stage has a member {name}; call the field "
                        f"{another}_{name}, or write {name} = … without a type to override the member."
                    )
            for name, value in vars(base).items():
                member = vars(Stage).get(name)
                if isinstance(member, property) and inspect.isfunction(value):
                    raise InputError(
                        f"{cls.__name__}.{name} is a method; write @property above it."
                    )
                if inspect.isroutine(member) and not callable(getattr(base, name)):
                    raise InputError(
                        f"{cls.__name__}.{name} is a value, and {name} is a method of every stage; call the value "
                        f"{another}_{name}."
                    )
        if "label" not in vars(cls):
            cls.label = re.sub(r"(?<!^)(?=[A-Z])", " ", cls.__name__).lower()

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Stage | None:
        """The stage with this camera's parameters, or None where the camera does not have the effect."""
        return None

    @abstractmethod
    def sample(self, signal: Array, frame: Frame) -> Array:
        """The signal of one frame behind this stage, (H, W)."""

    @property
    def reach_px(self) -> int:
        """How many rows and columns away the neighbours are that change the signal of a pixel."""
        return 0

    @property
    def reach_along_rows_px(self) -> int:
        """The same within a row, where that is less."""
        return self.reach_px

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """The fixed-pattern noise maps of this stage, by name."""
        return {}

    @classmethod
    def key(cls) -> str:
        """``LineDrift`` → ``line_drift``: the name by which ``Camera.with_stage(after=…)`` finds the stage."""
        return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    @property
    def nominal_gain(self) -> float:
        """Small-signal gain: unit behind the stage per unit in front of it."""
        return 1.0

    @property
    def saturation_e(self) -> float | None:
        """The most electrons that leave the stage; None where it does not clip."""
        return None

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Masks of the pixels whose number the report of a frame lists: clipped ones, for example.

        signal : behind the stage.
        """
        return {}


class Detector(Stage):
    """The first stage: photons become mean electrons."""

    def filters(self, photons: Photons) -> Filters | None:
        """The filters in front of the pixels, where each pixel gets a share of one layer only."""
        return None

    @property
    def light_reach_px(self) -> int:
        """How many rows and columns away the light falls that a pixel collects, too."""
        return 0

    @property
    def other_photodiodes(self) -> tuple[OtherPhotodiode, ...]:
        """Photodiodes of split pixels that collect from other neighbours than the first one."""
        return ()


class OtherPhotodiode(NamedTuple):
    """A photodiode of split pixels, beside the first one.

    name : of its first read-out.  exposure_ratio : its exposure time over that of the frame.
    detection : the first stage as it is for this photodiode, but for its sensitivity.
    """

    name: str
    exposure_ratio: float
    detection: Detector


class ElectronCounter(Stage):
    """Mean electrons enter and whole electrons leave.

    is_poisson : whether counts have the Poisson distribution of their mean.
    """

    is_poisson: ClassVar[bool] = True


class ElectronMaps(Stage):
    """Has fixed-pattern noise maps in electrons."""

    @abstractmethod
    def gains_of_maps(self) -> dict[str, float]:
        """Of each of its maps in electrons: what one electron there becomes behind the stage, in its unit."""


FAR_LESS = 1 / 32
"""Of a code; at 16 bits two units in the last place of float32 are 0.016 of one."""


class Converter(Stage):
    """The last stage: volts become digital numbers.  gain_dn_per_v : A.  black_level_dn : the code of darkness [DN]."""

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
        """The code of a converter with infinitely many bits [DN].

        It is two units in the last place larger, where that is far less than a code: whole electrons that lie on a
        transition have the code above, whichever way the products before were rounded.
        """
        last = 2 * float(np.finfo(frame.window.backend.precision).eps)
        more = 1.0
        if last * self.highest < FAR_LESS:
            more = 1 + last
        return (
            frame.number(more * self.black_level_dn)
            + frame.number(more * self.gain_dn_per_v) * swing
        )

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Pixels at either end of the code range."""
        return {
            "clipped_adc_low": signal <= 0,
            "clipped_adc_high": signal >= frame.number(self.highest),
        }


@dataclass(frozen=True)
class LinearGain(Stage):
    """An amplifier, S·gain. It acts on the swing, so darkness stays dark for every gain.  gain : [V/V]."""

    gain: float
    domain = "volts"

    @property
    def nominal_gain(self) -> float:
        """The gain [V/V]."""
        return self.gain

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing times the gain."""
        if self.gain == 1:
            return swing
        return frame.number(self.gain) * swing


Chain = tuple[Stage, ...]


def detector_of(stages: Chain) -> Detector:
    """The first stage of a chain."""
    first = stages[0]
    assert isinstance(first, Detector), first
    return first


def converter_of(stages: Chain) -> Converter:
    """The last stage of a chain."""
    last = stages[-1]
    assert isinstance(last, Converter), last
    return last


def place_of(stage: Stage, stages: Sequence[Stage]) -> int:
    """Number of a stage in its chain: that very stage, for there may be another that is equal."""
    return next(number for number, one in enumerate(stages) if one is stage)


def place_of_count(stages: Sequence[Stage]) -> int:
    """Number of the stage that counts electrons, before which signals are mean electrons; 0 without one."""
    places = (k for k, stage in enumerate(stages) if isinstance(stage, ElectronCounter))
    return next(places, 0)


def without(stages: Chain, out: Collection[Stage]) -> Chain:
    """The chain without these very stages. (Those of a user need no hash, and may hold arrays.)"""
    return tuple(stage for stage in stages if not any(stage is other for other in out))


def sample(stages: Iterable[Stage], signal: Array, frame: Frame) -> Array:
    """One frame of a signal behind these stages."""
    for stage in stages:
        signal = stage.sample(signal, frame)
    return signal


def total(signal: Array) -> Array:
    """A signal of any domain as an array: photons of all bands, photoelectrons and dark electrons together."""
    if isinstance(signal, Photons | Electrons):
        return signal.total
    return signal


def cut_to_zero(stage: Stage, name: str, cv: float, window: SensorWindow) -> dict[str, Array]:
    """``cut_to_zero_<name>``: the pixels in which a map of factors is not positive, as a normal law would have it."""
    flat = cv == 0 and name not in window.given
    return {f"cut_to_zero_{name}": False if flat else stage.fpn_maps(window)[name] <= 0}
