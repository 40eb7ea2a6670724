"""The order of the signal chain, from photons to digital numbers, and the check of a stage that a user adds to it."""

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from ..core import Array, Electrons, Exposure, InputError, Photons, SensorWindow
from ..core.backend import NUMPY_FLOAT32
from .effects.adc import Adc
from .effects.blooming import Blooming
from .effects.cds_gain import CdsGain
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
from .effects.source_follower import SourceFollower
from .effects.source_follower_noise import SourceFollowerNoise
from .effects.temporal_line_noise import (
    TemporalColumnNoise,
    TemporalFrameNoise,
    TemporalRowNoise,
)
from .recorder import RecordingFrame
from .stage import Chain, Stage, total, without

if TYPE_CHECKING:
    from ..camera.camera import Camera

ORDER: tuple[type[Stage], ...] = (  # a stage of its own: one file in effects/, one line here
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
    """The stages of this camera but the noise sources that are switched off (``sensor.without``).

    Those left are the stages of the whole chain: black level and gains are those of the whole camera.
    """
    if camera.readouts:
        combined = camera.combined_readouts
        detection = QuantumEfficiency.from_camera(camera, ())
        return detection.with_photodiodes(combined.readouts), combined
    return _chain(camera, camera.sensor.without)


def whole_chain(camera: "Camera") -> Chain:
    """All stages of this camera, with those that :meth:`Camera.with_stage` added."""
    if camera.readouts:
        return chain(camera)
    return _chain(camera, ())


def _chain(camera: "Camera", off: Collection[str]) -> Chain:
    stages: Chain = ()
    out: Chain = ()
    for effect in ORDER:
        found = effect.from_camera(camera, stages)
        own = () if found is None else (found,)
        stages += own + camera.added_after(effect.key())
        out += own if effect.key() in off else ()
    return without(stages, out)


def check_added(stages: Chain, added: Stage, wavelength_nm: float) -> None:
    """Expose a window of 8 × 8 pixels to light of this wavelength and look at what ``added`` does.

    Raises InputError where it draws from the noise source of another stage, whose noise would be the same numbers,
    where it turns float32 into float64, which a compiled engine does not have, and where it adds up Electrons.
    """
    signal: Array = Photons(np.full((8, 8, 1), 1e3), np.array([wavelength_nm]))
    users: dict[str, int] = {}
    for place, stage in enumerate(stages):
        frame = RecordingFrame(Exposure(1.0), SensorWindow(0, (8, 8), backend=NUMPY_FLOAT32))
        before, signal = signal, stage.sample(signal, frame)
        entered, left = (getattr(total(x), "dtype", None) for x in (before, signal))
        if stage is added and entered == np.float32 != left:
            raise InputError(
                f"{type(stage).__name__} makes {left} of float32, and the engines would differ; "
                "take numbers from frame.number(…), which keeps the precision of the signal."
            )
        if (
            stage is added
            and isinstance(before, Electrons)
            and not isinstance(signal, Electrons)
        ):
            raise InputError(
                f"{type(stage).__name__} returns a {type(signal).__name__}, and the stage behind it takes "
                "photoelectrons and dark electrons apart; return Electrons, e.g. dataclasses.replace(signal, light=…)."
            )
        for source in frame.sources:
            first = users.setdefault(source, place)
            if first != place and (stage is added or stages[first] is added):
                raise InputError(
                    f"{type(added).__name__} draws from the noise source {source!r}, as another stage of this camera "
                    "does, and both would have the same noise; give it a source of a name of its own."
                )


def stage_table() -> str:
    """The stages in their order as a Markdown table: what each does, equations, datasheet fields, file."""
    lines = [
        "| stage | what it does | paper | fields of a camera file | file |",
        "|---|---|---|---|---|",
    ]
    for effect in ORDER:
        names = effect.fields.model_fields if effect.fields else ()
        fields = ", ".join(f"`{effect.table}.{name}`" for name in names)
        file = f"effects/{effect.__module__.rpartition('.')[2]}.py"
        cells = f"`{effect.__name__}`", effect.what_it_does(), effect.paper, fields, f"`{file}`"
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
