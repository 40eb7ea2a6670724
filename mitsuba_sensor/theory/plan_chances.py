"""What a chain makes of the pixels that a plan compares."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from ..core.types import Float64Array
from ..stages.stage import Chain, converter_of
from .pixel_moments import PixelStrip
from .pixel_swing import Codes
from .plan_sample import PlanSample

NO_CODES: Codes = (np.zeros((0, 0)), np.zeros((0, 0)))


class PlanChances(NamedTuple):
    """Means and variances of the pixels of a plan, (P, L) each.

    swing : mean and temporal variance in front of rounding and clips of the converter, without black level [DN, DN²].
    own_dn2 : the part of that variance that is added behind the count.
    count_e, count_e2 : mean and variance of the count.
    codes : mean and temporal variance of the codes [DN, DN²], where they are known.
    """

    swing: Codes
    own_dn2: Float64Array
    count_e: Float64Array
    count_e2: Float64Array
    codes: Codes = NO_CODES

    @classmethod
    def of(cls, stages: Chain, sample: PlanSample) -> Self:
        """What a chain makes of these pixels, without the codes, which take longer."""
        strip, shape = _strip(stages, sample), sample.frame.window.shape
        last, counted = len(stages) - 1, strip.split - 1
        behind = strip.behind(sorted({counted, last - 1}))
        gain = converter_of(stages).gain_dn_per_v
        count_e, count_e2 = (x.reshape(shape) for x in behind[counted])
        swing_v, swing_v2 = (x.reshape(shape) for x in behind[last - 1])
        swing = gain * swing_v, gain**2 * swing_v2
        per_e = math.prod(stage.nominal_gain for stage in stages[counted + 1 :])
        return cls(swing, np.maximum(swing[1] - per_e**2 * count_e2, 0.0), count_e, count_e2)

    def with_codes(self, stages: Chain, sample: PlanSample) -> Self:
        """The same with the codes of this chain."""
        mean, variance = (
            x.reshape(sample.frame.window.shape) for x in _strip(stages, sample).codes()
        )
        return self._replace(codes=(mean, variance))

    @property
    def has_codes(self) -> bool:
        """Whether the codes are known."""
        return self.codes is not NO_CODES


def _strip(stages: Chain, sample: PlanSample) -> PixelStrip:
    window = replace(sample.frame.window, _maps={})
    return PixelStrip(stages, sample.light, replace(sample.frame, window=window))
