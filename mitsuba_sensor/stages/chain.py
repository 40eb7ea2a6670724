"""Order of the signal chain from photons to digital numbers, and the check of a stage that a user adds."""

import re
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import Array, Electrons, Exposure, Frame, InputError, Photons, SensorWindow
from ..core.backend import NUMPY_FLOAT32
from .effects.adc import Adc
from .effects.blooming import Blooming
from .effects.dark_current import DarkCurrent
from .effects.dsnu import DsnuColumn, DsnuPixel, DsnuRow
from .effects.em_gain import EmGain
from .effects.full_well import FullWell
from .effects.integral_nonlinearity import IntegralNonlinearity
from .effects.inter_pixel_capacitance import InterPixelCapacitance
from .effects.overflow_dark_current import OverflowDarkCurrent
from .effects.prnu import Prnu, PrnuColumn
from .effects.quantum_efficiency import QuantumEfficiency
from .effects.quantum_yield import QuantumYield
from .effects.radiation_hits import RadiationHits
from .effects.reset_noise import ResetNoise
from .effects.rtn_pixels import RtnPixels
from .effects.rts_pixels import RtsPixels
from .effects.sense_node import SenseNode
from .effects.shot_noise import ShotNoise
from .effects.source_follower import CdsGain, SourceFollower
from .effects.source_follower_noise import SourceFollowerNoise
from .effects.temporal_line_noise import (
    TemporalColumnNoise,
    TemporalFrameNoise,
    TemporalRowNoise,
)
from .stage import Chain, Stage, total

if TYPE_CHECKING:
    from ..camera.camera import Camera

ORDER: tuple[type[Stage], ...] = (  # a new effect: one file in effects/, one line here
    QuantumEfficiency,
    Prnu,
    DarkCurrent,
    RtsPixels,
    ShotNoise,
    QuantumYield,
    OverflowDarkCurrent,
    Blooming,
    FullWell,
    RadiationHits,
    InterPixelCapacitance,
    EmGain,
    SenseNode,
    ResetNoise,
    SourceFollowerNoise,
    RtnPixels,
    SourceFollower,
    DsnuColumn,
    DsnuRow,
    DsnuPixel,
    PrnuColumn,
    TemporalRowNoise,
    TemporalColumnNoise,
    TemporalFrameNoise,
    CdsGain,
    IntegralNonlinearity,
    Adc,
)


def chain(camera: "Camera") -> Chain:
    """Return the stages of this camera without the switched-off noise sources (``sensor.without``).

    Black level and gains are those of the complete camera.
    """
    if camera.readouts:
        combined = camera.combined_readouts
        detection = QuantumEfficiency.from_camera(camera)
        return detection.with_photodiodes(combined.readouts), combined
    return _chain(camera, camera.sensor.without)


def whole_chain(camera: "Camera") -> Chain:
    """Return all stages of this camera, including switched-off noise sources and added stages."""
    if camera.readouts:
        return chain(camera)
    return _chain(camera, ())


def _chain(camera: "Camera", off: Collection[str]) -> Chain:
    stages: Chain = ()
    for effect in ORDER:
        found = None if effect.key() in off else effect.from_camera(camera)
        stages += (() if found is None else (found,)) + camera.added_after(effect.key())
    return stages


@dataclass(frozen=True, eq=False)
class RecordingFrame(Frame):
    """A frame that records which temporal noise sources are used."""

    sources: set[str] = field(default_factory=set)

    def random_bits(self, source: str) -> Array:
        """Return the random bits, and record their source."""
        self.sources.add(source)
        return super().random_bits(source)

    def random_bits_at(
        self, source: str, rows: ArrayLike, columns: ArrayLike, frame_index: int
    ) -> Array:
        """Return the random bits, and record their source."""
        self.sources.add(source)
        return super().random_bits_at(source, rows, columns, frame_index)


def check_added(stages: Chain, added: Stage, wavelength_nm: float) -> None:
    """Expose a window of 8 × 8 pixels to light of this wavelength and check the stage ``added``.

    Raises InputError if it uses the noise source of another stage, which would give both the same noise, if it turns
    float32 into float64, which compiled engines lack, or if it adds up Electrons.
    """
    signal: Array = Photons(np.full((8, 8, 1), 1e3), np.array([wavelength_nm]))
    users: dict[str, int] = {}
    for place, stage in enumerate(stages):
        frame = RecordingFrame(Exposure(1.0), SensorWindow(0, (8, 8), backend=NUMPY_FLOAT32))
        before, signal = signal, stage.sample(signal, frame)
        entered, left = (getattr(total(x), "dtype", None) for x in (before, signal))
        if stage is added and entered == np.float32 != left:
            raise InputError(
                f"{type(stage).__name__} turns float32 into {left}, so engines would differ; take numbers from "
                "frame.number(…), which keeps the precision of the signal."
            )
        if (
            stage is added
            and isinstance(before, Electrons)
            and not isinstance(signal, Electrons)
        ):
            raise InputError(
                f"{type(stage).__name__} returns a {type(signal).__name__}, but the next stage needs photoelectrons "
                "and dark electrons separately; return Electrons, e.g. dataclasses.replace(signal, light=…)."
            )
        for source in frame.sources:
            first = users.setdefault(source, place)
            if first != place and (stage is added or stages[first] is added):
                raise InputError(
                    f"{type(added).__name__} uses the noise source {source!r} of another stage of this camera, so both "
                    "would have the same noise; give it a source with a new name."
                )


def what_it_does(effect: type[Stage]) -> str:
    """Return the first sentence of the docstring, without equation numbers and parameters."""
    first_line = (effect.__doc__ or "").partition("\n")[0]
    return re.split(r" \(paper|\. |\.$|  ", first_line)[0].rstrip(".")
