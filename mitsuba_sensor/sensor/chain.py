"""The order of the signal chain: from photons to digital numbers."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from .effects.adc import Adc
from .effects.cds_gain import CdsGain
from .effects.dark_current import DarkCurrent
from .effects.dsnu import DsnuColumn, DsnuPixel, DsnuRow
from .effects.full_well import FullWell
from .effects.integral_nonlinearity import IntegralNonlinearity
from .effects.prnu import Prnu, PrnuColumn
from .effects.quantum_efficiency import QuantumEfficiency
from .effects.quantum_yield import QuantumYield
from .effects.reset_noise import ResetNoise
from .effects.rtn_pixels import RtnPixels
from .effects.rts_pixels import RtsPixels
from .effects.sense_node import SenseNode
from .effects.shot_noise import ShotNoise
from .effects.source_follower import SourceFollower
from .effects.source_follower_noise import SourceFollowerNoise
from .effects.temporal_line_noise import TemporalColumnNoise, TemporalRowNoise
from .stage import Chain, Converter, Stage

if TYPE_CHECKING:
    from .camera import Camera

ORDER: tuple[type[Stage], ...] = (
    QuantumEfficiency,
    Prnu,
    DarkCurrent,
    RtsPixels,
    ShotNoise,
    QuantumYield,
    FullWell,
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
    CdsGain,
    IntegralNonlinearity,
    Adc,
)
"""A stage of its own: one file in effects/, one line here."""


def chain(camera: Camera) -> Chain:
    """The stages of this camera, with those that :meth:`Camera.with_stage` added."""
    stages: Chain = ()
    for effect in ORDER:
        found = effect.from_camera(camera, stages)
        stages += (() if found is None else (found,)) + camera.added_after(effect.key())
    return stages


def black_level_dn(camera: Camera) -> float:
    """The code of darkness [DN], given or from the noise of a zero exposure."""
    last = chain(camera)[-1]
    assert isinstance(last, Converter)
    return last.black_level_dn


def stage_table() -> str:
    """The stages in their order as a Markdown table: what each does, equations, datasheet fields, file."""
    lines = ["| stage | what it does | paper | fields of a camera file | file |", "|---|---|---|---|---|"]
    for effect in ORDER:
        what = re.split(r" \(paper|\. |\.$|  ", (effect.__doc__ or "").partition("\n")[0])[0].rstrip(".")
        names = effect.fields.model_fields if effect.fields else ()
        fields = ", ".join(f"`{effect.table}.{name}`" for name in names)
        file = f"effects/{effect.__module__.rpartition('.')[2]}.py"
        lines.append(f"| `{effect.__name__}` | {what} | {effect.paper} | {fields} | `{file}` |")
    return "\n".join(lines)
