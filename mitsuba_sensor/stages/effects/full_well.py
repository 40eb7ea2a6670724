"""Full well: a pixel holds at most its saturation capacity of electrons (EMVA 1288 μ_e.sat).

A photodiode that is nearly full loses electrons over the barrier to its drain. The current over a barrier falls with
its height as exp(−ΔE/k_BT), so at n electrons it is exp((n − W)/w) times the photocurrent, w = m·C·k_BT/q² (Pelamatti
et al. 2013 and Miyauchi et al. 2023 on pinned photodiodes: saturation grows with the logarithm of the light).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ...core import Array, Electrons, Frame, arrays
from ...core.types import Float64Array
from ..datasheet import FileTable, NotNegative, optional
from ..stage import Datasheet, Stage
from ..usual_range import THOUSANDS, Usual

KNEE_MAX = 0.07
"""Largest w over the full well: an empty well, which should lose nothing, then loses 6e-7 of w; at 0.1, 5e-5."""


class FullWellFields(FileTable):
    """Saturation capacity."""

    full_well_e: Annotated[
        float, Field(ge=1, le=1e30, strict=True), Usual.of(200, 1e8, THOUSANDS)
    ] = Field(description="saturation capacity [e-]", examples=[33000])
    full_well_knee_e: NotNegative = optional(
        "width of the knee of the response at saturation, at most 7 % of full_well_e; 0 is a "
        "hard clip [e-]",
        500.0,
        0.0,
        title="knee of the response at saturation, soft saturation",
    )

    @model_validator(mode="after")
    def _knee_below_the_well(self) -> Self:
        if self.full_well_knee_e > KNEE_MAX * self.full_well_e:
            raise ValueError(
                f"full_well_knee_e is {self.full_well_knee_e:g}; it must be at most 7 % of full_well_e, "
                f"{KNEE_MAX * self.full_well_e:g}: give the width of the knee, not its position"
            )
        return self


@dataclass(frozen=True)
class FullWell(Stage):
    """min(N, full well), before any read noise (paper, text after eq. 26).  full_well_e : saturation capacity [e-]."""

    full_well_e: float
    domain = "electrons"
    table = "pixel"
    fields = FullWellFields
    terms = "full well, saturation capacity μ_e.sat (E), S_FW (J), clipping"
    no_noise = "set pixel.full_well_e to a larger value"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Stage:
        """Return the full well of the datasheet, with a knee if given."""
        pixel = camera.pixel
        if pixel.full_well_knee_e:
            return SoftFullWell(pixel.full_well_e, pixel.full_well_knee_e)
        return cls(pixel.full_well_e)

    @property
    def saturation_e(self) -> float:
        """The full well [e-]."""
        return self.full_well_e

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return electrons with their sum clipped; the excess is taken from the photoelectrons."""
        capacity = frame.number(self.full_well_e)

        def beside(dark: Array, light: Array) -> Array:
            return arrays.minimum(light, capacity - dark)

        def parts(light: Array, dark: Array) -> tuple[Array, Array]:
            dark = arrays.minimum(dark, capacity)
            return beside(dark, light), dark

        return electrons.changed(partial(beside, 0.0), parts)

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Return the mask of full pixels."""
        return {"clipped_full_well": signal >= frame.number(self.full_well_e)}


@dataclass(frozen=True)
class SoftFullWell(Stage):
    """n = −w·ln(e^(−N/w) + e^(−W/w)) of N electrons, with the shot noise of the overflow.

    In constant light the charge follows dn/dN = p = 1 − e^((n − W)/w): the loss is the current over a barrier that n
    lowers. Electrons come and go one by one, so the variance v of n follows dv/dN = 2 − p + 2p′·v, whose solution for
    Poisson counts is v = p²·N + w·(1 − p)·(1 + 2p): p² times the shot noise, plus the noise of the overflow. A full
    well has the variance w.

    full_well_e : W, what a pixel holds in bright light.  knee_e : w.
    """

    full_well_e: float
    knee_e: float
    domain = "electrons"
    no_noise = "set pixel.full_well_knee_e to 0"

    @classmethod
    def key(cls) -> str:
        """Return the key of FullWell."""
        return FullWell.key()

    @property
    def saturation_e(self) -> float:
        """The full well [e-]."""
        return self.full_well_e

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return what the well holds; light and dark electrons lose the same fraction."""

        def left(count: Array) -> Array:
            well, knee = frame.number(self.full_well_e), frame.number(self.knee_e)
            kept, passes = _response(count, well, knee)
            own = knee * ((1 - passes) * (1 + 2 * passes))
            noisy = kept + arrays.sqrt(own) * frame.normal("overflow")
            return arrays.maximum(noisy, 0.0)

        def parts(light: Array, dark: Array) -> tuple[Array, Array]:
            count = light + dark
            fraction = arrays.ratio(left(count), count, 0.0)
            return light * fraction, dark * fraction

        return electrons.changed(left, parts)

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Return the mask of pixels in which more than half of the light overflows."""
        half_e = self.full_well_e - np.log(2.0) * self.knee_e
        return {"clipped_full_well": signal >= frame.number(half_e)}


def held_e(count_e: Float64Array, full_well_e: float, knee_e: float) -> Float64Array:
    """Return what a pixel holds of so many electrons, without noise."""
    if knee_e == 0:
        return np.minimum(count_e, full_well_e)
    return np.asarray(_response(count_e, full_well_e, knee_e)[0])


def _response(count: Array, well: Array, knee: Array) -> tuple[Array, Array]:
    """Return what the well holds of so many electrons, and p."""
    below = count < well
    fall = arrays.exp(-arrays.where(below, well - count, count - well) / knee)
    kept = arrays.minimum(count, well) - knee * arrays.log1p(fall)
    return kept, arrays.where(below, 1.0, fall) / (1.0 + fall)
