"""Temporal row and column noise (EMVA 1288 σ_row, σ_col), jitter of the black level: offsets new in each frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from ...core import Array, Frame
from ..datasheet import FileTable, NotNegative, optional
from ..gains import sense_gain_v_per_e
from ..stage import Datasheet, Stage


class TemporalRowNoiseFields(FileTable):
    """Noise that the pixels of a row share."""

    row_noise_e: NotNegative = optional("temporal row noise σ_row [e- rms]", 0.3, 0.0)


class TemporalColumnNoiseFields(FileTable):
    """Noise that the pixels of a column share."""

    column_noise_e: NotNegative = optional("temporal column noise σ_col [e- rms]", 0.2, 0.0)


class TemporalFrameNoiseFields(FileTable):
    """Noise that all pixels of a frame share."""

    frame_noise_e: NotNegative = optional(
        "jitter of the black level: σ of an offset of the whole frame, new in each frame [e- rms]",
        0.3,
        0.0,
        title="jitter of the black level, frame-to-frame offset",
    )


@dataclass(frozen=True)
class TemporalLineNoise(Stage):
    """Adds σ·gain·z, one z for each line, or one for all pixels, in each frame.

    sigma_e : σ as electrons at the sense node [e- rms].  gain_v_per_e : one electron at this stage [V/e-].
    draw : method of a frame that draws one normal number for each line, or one for all.
    """

    sigma_e: float
    gain_v_per_e: float
    domain = "volts"
    table = "readout"
    fields: ClassVar[type[FileTable]]
    draw: ClassVar[str]

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Self | None:
        """None where the datasheet has no such noise: the one field of the stage."""
        (field,) = cls.fields.model_fields
        sigma_e = getattr(camera.readout, field)
        if not sigma_e:
            return None
        return cls(sigma_e, sense_gain_v_per_e(camera) * camera.source_follower.gain)

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing with the offsets of this frame."""
        if self.sigma_e == 0:
            return swing
        return swing + frame.number(self.sigma_e * self.gain_v_per_e) * getattr(
            frame, self.draw
        )(self.key())


@dataclass(frozen=True)
class TemporalRowNoise(TemporalLineNoise):
    """Every row has an offset, new in each frame: horizontal stripes that move."""

    fields = TemporalRowNoiseFields
    terms = "temporal row noise σ_row (E)"
    draw = "row_normal"


@dataclass(frozen=True)
class TemporalColumnNoise(TemporalLineNoise):
    """Every column has an offset, new in each frame: vertical stripes that move."""

    fields = TemporalColumnNoiseFields
    terms = "temporal column noise σ_col (E)"
    draw = "column_normal"


@dataclass(frozen=True)
class TemporalFrameNoise(TemporalLineNoise):
    """All pixels have one offset, new in each frame: the black level jitters.

    Noise of a clamp or of a reference makes the means of dark frames scatter by far more than the
    noise of their pixels explains.
    """

    fields = TemporalFrameNoiseFields
    terms = "jitter of the black level"
    draw = "frame_normal"
