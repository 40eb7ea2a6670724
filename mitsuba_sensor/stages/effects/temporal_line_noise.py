"""Temporal row and column noise (EMVA 1288 σ_row, σ_col), black-level jitter: offsets that change with each frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from ...core import Array, Frame
from ..datasheet import FileTable, NotNegative, optional
from ..gains import sense_gain_v_per_e
from ..stage import Datasheet, Stage


class TemporalRowNoiseFields(FileTable):
    """Noise common to the pixels of a row."""

    row_noise_e: NotNegative = optional("temporal row noise σ_row [e- rms]", 0.3, 0.0)


class TemporalColumnNoiseFields(FileTable):
    """Noise common to the pixels of a column."""

    column_noise_e: NotNegative = optional("temporal column noise σ_col [e- rms]", 0.2, 0.0)


class TemporalFrameNoiseFields(FileTable):
    """Noise common to all pixels of a frame."""

    frame_noise_e: NotNegative = optional(
        "jitter of the black level: σ of a random offset of each frame [e- rms]",
        0.3,
        0.0,
        title="jitter of the black level, frame-to-frame offset",
    )


@dataclass(frozen=True)
class TemporalLineNoise(Stage):
    """Adds σ·gain·z, in each frame one z for each line or for all pixels.

    sigma_e : σ as electrons at the sense node [e- rms].  gain_v_per_e : one electron at this stage [V/e-].
    draw : method of Frame that draws one normal number for each line, or one for all.
    """

    sigma_e: float
    gain_v_per_e: float
    domain = "volts"
    table = "readout"
    fields: ClassVar[type[FileTable]]
    draw: ClassVar[str]

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Self | None:
        """Return None if the stage's one field is 0."""
        (field,) = cls.fields.model_fields
        sigma_e = getattr(camera.readout, field)
        if not sigma_e:
            return None
        return cls(sigma_e, sense_gain_v_per_e(camera) * camera.source_follower.gain)

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing with the offsets of this frame."""
        if self.sigma_e == 0:
            return swing
        return swing + frame.number(self.sigma_e * self.gain_v_per_e) * getattr(
            frame, self.draw
        )(self.key())


@dataclass(frozen=True)
class TemporalRowNoise(TemporalLineNoise):
    """Each row has a random offset in each frame: horizontal stripes that move."""

    fields = TemporalRowNoiseFields
    terms = "temporal row noise σ_row (E)"
    draw = "row_normal"


@dataclass(frozen=True)
class TemporalColumnNoise(TemporalLineNoise):
    """Each column has a random offset in each frame: vertical stripes that move."""

    fields = TemporalColumnNoiseFields
    terms = "temporal column noise σ_col (E)"
    draw = "column_normal"


@dataclass(frozen=True)
class TemporalFrameNoise(TemporalLineNoise):
    """All pixels have one random offset in each frame: the black level jitters.

    Noise of a clamp or a reference makes the means of dark frames vary far more than the noise of their pixels.
    """

    fields = TemporalFrameNoiseFields
    terms = "jitter of the black level"
    draw = "frame_normal"
