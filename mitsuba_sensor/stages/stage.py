"""Stage: the base class of every effect; sample() takes a signal through a chain.

A stage has two methods: ``sample`` computes one random frame, ``moments`` the mean and the variances that this frame
must have. What a stage without ``moments`` makes of a frame is measured. Whatever the rest of the package needs to know
of a stage, it reads from the attributes declared here.
"""

from __future__ import annotations

import inspect
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from ..core import Array, Electrons, Frame, InputError, Moments, Photons, SensorWindow
from ..core.signals import Filters
from ..core.types import Float64Array
from .datasheet import FileTable

if TYPE_CHECKING:
    from ..camera.camera import Camera

Datasheet: TypeAlias = "Camera"  # whose tables the effects read
Domain = Literal["photons", "electrons", "volts", "DN"]
UNITS: dict[Domain, str] = {"photons": "photons", "electrons": "e-", "volts": "V", "DN": "DN"}


class PixelNoise(NamedTuple):
    """Temporal noise behind the shot noise that differs from pixel to pixel or is not normal, in the unit of its stage.

    states : chance, mean and variance of the normals that make it up, each scalar or (H, W).
    """

    states: tuple[tuple[Array, Array, Array], ...]


class OtherPhotodiode(NamedTuple):
    """A photodiode of split pixels, beside the first one.

    name : of its first read-out.  exposure_ratio : its exposure time over that of the frame.
    detection : the first stage as it is for this photodiode, but for its sensitivity.
    """

    name: str
    exposure_ratio: float
    detection: Stage


class Stage(ABC):
    """One effect of the signal chain; subclasses are frozen dataclasses of its parameters.

    ::

        @dataclass(frozen=True)
        class Hum(ms.Stage):
            sigma_v: float
            domain = "volts"

            def sample(self, swing, frame):
                return swing + frame.number(self.sigma_v) * frame.row_normal("hum")

            def moments(self, m):
                return m.add(temporal=self.sigma_v**2)

        noisier = camera.with_stage(Hum(1e-4), after="reset_noise")

    domain : what leaves the stage.  paper : equations of Konnik & Welsh 2014.
    terms : its names and symbols in EMVA 1288 (E), Janesick (J) and Konnik & Welsh (K), for the glossary.
    table, fields : the table of the camera file and the fields there that belong to this effect.
    required : whether the stage changes the unit of the signal, so that no plan can leave it out.
    counts_electrons : whether mean electrons enter and whole electrons leave; where a render has a known variance, the
        stage compensates it.
    compensates : whether a stage that counts electrons does so.
    frees_electrons : whether an interaction frees more than one electron, with a spread of its own.
    shared_by : "row" or "column" where all pixels of one have the same value, "frame" where all pixels have.
    curved : whether the response is not a straight line, so that its moments are of second order in the noise.
    reach_px : how many rows and columns away the neighbours are that change the signal of a pixel behind this stage; 0
        where each pixel is by itself. A chain with such a stage is measured by its samples.
    saturation_e : where the stage clips [e-], None where it does not.
    no_noise : of a stage that is no noise, the fields that change it; others can be switched off by their keys.
    """

    domain: ClassVar[Domain]
    table: ClassVar[str] = ""
    fields: ClassVar[type[FileTable] | None] = None
    paper: ClassVar[str] = "–"
    terms: ClassVar[str] = ""
    required: ClassVar[bool] = False
    counts_electrons: ClassVar[bool] = False
    compensates: ClassVar[bool] = True
    frees_electrons: ClassVar[bool] = False
    curved: ClassVar[bool] = False
    shared_by: ClassVar[Literal["row", "column", "frame"] | None] = None
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
    def from_camera(cls, camera: Datasheet, before: tuple[Stage, ...]) -> Stage | None:
        """The stage with this camera's parameters, or None where the camera does not have the effect.

        before : the stages in front of it.
        """
        return None

    @classmethod
    def notes(cls, camera: Datasheet) -> tuple[str, ...]:
        """Sentences about this camera's values of the effect that are allowed and may surprise."""
        return ()

    @abstractmethod
    def sample(self, signal: Array, frame: Frame) -> Array:
        """The signal of one frame behind this stage, (H, W)."""

    def filters(self, photons: Photons) -> Filters | None:
        """Of the first stage: the filters in front of the pixels, where each pixel gets a share of one layer only."""
        return None

    def moments(self, m: Moments) -> Moments:
        """Mean, temporal and spatial variance of the signal behind this stage.

        A stage may leave it out: what it does to a frame is then measured by its samples.
        """
        raise NotImplementedError(f"{type(self).__name__} has no moments")

    @property
    def reach_px(self) -> int:
        """How many rows and columns away the neighbours are that change the signal of a pixel."""
        return 0

    @property
    def reach_along_rows_px(self) -> int:
        """The same within a row, where that is less."""
        return self.reach_px

    @property
    def light_reach_px(self) -> int:
        """Of the first stage: how many rows and columns away the light falls that a pixel collects, too."""
        return 0

    @property
    def other_photodiodes(self) -> tuple[OtherPhotodiode, ...]:
        """Of the first stage: photodiodes of split pixels that collect from other neighbours than the first one."""
        return ()

    @property
    def has_moments(self) -> bool:
        """Whether the stage says what it does to mean and variances; one that couples neighbours: of a flat field."""
        return type(self).moments is not Stage.moments

    def pixel_noise(self, frame: Frame) -> PixelNoise | None:
        """The noise of every pixel, of a stage behind the shot noise whose noise differs among pixels or is not normal;
        None: by its moments."""
        return None

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """The fixed-pattern noise maps of this stage, by name."""
        return {}

    def gains_of_maps(self) -> dict[str, float]:
        """Of each of its maps in electrons: what one electron there becomes behind the stage, in its unit."""
        return {}

    @classmethod
    def key(cls) -> str:
        """``LineDrift`` → ``line_drift``: the name by which ``Camera.with_stage(after=…)`` finds the stage."""
        return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    @classmethod
    def what_it_does(cls) -> str:
        """The first sentence of the docstring, without equation numbers and parameters."""
        first_line = (cls.__doc__ or "").partition("\n")[0]
        return re.split(r" \(paper|\. |\.$|  ", first_line)[0].rstrip(".")

    @property
    def nominal_gain(self) -> float:
        """Small-signal gain: unit behind the stage per unit in front of it."""
        return 1.0

    @property
    def excess_noise(self) -> float:
        """Temporal variance of shot noise behind the stage, over that in front of it times the square of its gain."""
        return 1.0

    @property
    def saturation_e(self) -> float | None:
        """Where the stage clips [e-]."""
        return None

    @property
    def limits(self) -> tuple[float, float]:
        """The smallest and the largest signal behind the stage, in its unit."""
        return -math.inf, math.inf if self.saturation_e is None else self.saturation_e

    @property
    def straight_below_e(self) -> float | None:
        """Electrons below which a stage that clips takes nothing away [e-]."""
        return self.saturation_e

    def electrons_left(self, mean_e: float) -> float:
        """Electrons behind the stage of so many mean electrons, without noise, gain and full well."""
        return mean_e

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Masks of the pixels whose number the report of a frame lists: clipped ones, for example.

        signal : behind the stage.
        """
        return {}

    def noise_sources(self, before: Array, after: Array) -> dict[str, tuple[Array, Array]]:
        """Label → (contribution, temporal variance), (H, W) in the unit of the stage, where it has several sources.

        before, after : the signal on both sides.
        """
        return {}


FAR_LESS = 1 / 32
"""Of a code; at 16 bits two units in the last place of float32 are 0.016 of one."""


class Converter(Stage):
    """The last stage: volts become digital numbers.  gain_dn_per_v : A.  black_level_dn : the code of darkness [DN]."""

    domain = "DN"
    required = True
    gain_dn_per_v: float
    black_level_dn: float

    @property
    @abstractmethod
    def highest(self) -> int:
        """The largest code."""

    @property
    def limits(self) -> tuple[float, float]:
        """The smallest and the largest code."""
        return 0.0, float(self.highest)

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

    def moments(self, m: Moments) -> Moments:
        """Scaled by the gain."""
        return m.scale(self.gain)


Chain = tuple[Stage, ...]


def converter_of(stages: Chain) -> Converter:
    """The last stage of a chain."""
    last = stages[-1]
    assert isinstance(last, Converter), last
    return last


def place_of(stage: Stage, stages: Sequence[Stage]) -> int:
    """Number of a stage in its chain: that very stage, for there may be another that is equal."""
    return next(number for number, one in enumerate(stages) if one is stage)


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
