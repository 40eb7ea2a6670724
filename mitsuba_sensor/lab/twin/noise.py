"""Temporal noise in the dark: read noise of the pixels and its spread over them, row noise, column noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...core.types import Float64Array
from ..frames.series import COARSE_DN2, ROUNDING_DN2
from ..frames.stack import Stack
from ..measure.dark_noise import dark_noise
from ..measure.line_noise import line_noise
from ..quantity import TWO_SIDED, Quantity, unknown
from .dark import Dark
from .evidence import Fitted, frames_of
from .hidden_spread import HiddenSpread, Mixed, hidden_spread
from .noise_law import NoiseLaw, Pixels, noise_law

READ = Quantity(
    "σ_read", "read noise of the pixels, rms", math.nan, math.nan, math.nan, "DN", "fit"
)
UNSEEN = Pixels(math.nan, 0.0, 0.0, True)
CV = Quantity(
    "cv_read", "spread of the read noise over pixels", math.nan, math.nan, math.nan, "", "fit"
)


@dataclass(frozen=True, eq=False)
class ReadNoise:
    """read : σ of a pixel alone, rms over the pixels [DN].  cv : of σ over the pixels.  row, column : σ [DN].

    law : of the read noise.  shape : of that law, unknown of a normal one.
    pixels : σ of each pixel [relative to their rms], (H, W), or None where its spread is not told from 0.
    """

    read: Fitted
    cv: Fitted
    row: Fitted
    column: Fitted
    law: NoiseLaw
    pixels: Float64Array | None

    @property
    def shape(self) -> Fitted:
        """λ or ν."""
        return self.read.known_as(self.law.shape)


def read_noise(dark: Dark, gain: Quantity) -> ReadNoise:
    """From the shortest dark stack; shot noise of the dark current and rounding are subtracted in the likelihood."""
    stack, frames = dark.quiet, frames_of(dark.quiet)
    lines = line_noise(stack)
    row, column = (Fitted(one, frames) for one in (lines.row, lines.column))
    whole = stack.frames.dtype.kind in "ui" or bool(
        (stack.frames == np.round(stack.frames)).all()
    )
    shot, unsure = _shot_noise(dark, gain)
    floor = (ROUNDING_DN2 if whole else 0.0) + shot
    total = float(stack.variance.mean())
    if whole and total < COARSE_DN2 + ROUNDING_DN2:
        read, law = (
            _coarse(stack, lines.row, lines.column, shot),
            noise_law(stack, UNSEEN, "hidden by rounding"),
        )
        return ReadNoise(
            Fitted(read, frames),
            Fitted(unknown(CV, "hidden by rounding"), frames),
            row,
            column,
            law,
            None,
        )
    variances, shared = residual_variance(stack)
    mixed = Mixed(floor, 1 - shared, shared)
    found = hidden_spread(variances.ravel(), len(stack) - 1, mixed)
    other = shot + _variance_of(lines.row, lines.column) + float(stack.frame_means.var(ddof=1))
    place = float(stack.mean.mean()), dark.offsets.spread()["all"][0]
    looked_at = Pixels(math.sqrt(found.variance[0]), found.cv[0], other, whole, *place)
    law = noise_law(stack, looked_at, "hidden by rounding" if looked_at.hidden else "")
    if law.distribution is not None:
        found = _of_tails(variances, law, looked_at, len(stack), floor)
        law = noise_law(
            stack, looked_at._replace(sigma=math.sqrt(found.variance[0]), cv=found.cv[0])
        )
    m, least, most = found.variance
    ends = m - math.hypot(m - least, unsure), m + math.hypot(most - m, unsure)
    low, high = (math.sqrt(max(one, 0.0)) for one in ends)
    read = replace(READ, value=math.sqrt(m), low=low, high=high, note="; ".join(dark.notes))
    cv = replace(CV, value=found.cv[0], low=found.cv[1], high=found.cv[2])
    pixels = None
    if cv.low > 0:
        pixels = _of_pixels(variances - floor, cv.value)
    else:
        cv = cv.noted("not told from 0")
    return ReadNoise(Fitted(read, frames), Fitted(cv, frames), row, column, law, pixels)


def _of_tails(
    variances: Float64Array, law: NoiseLaw, pixels: Pixels, frames: int, floor: float
) -> HiddenSpread:
    """Where the noise is not normal: sample variances follow no chi-square law, their mean is right all the same."""
    half = TWO_SIDED * float(variances.std()) / math.sqrt(variances.size)
    m = max(float(variances.mean()) - floor, 1e-9)
    return HiddenSpread(
        (m, max(m - half, 0.0), m + half), law.spread_over_pixels(frames, pixels)
    )


def _shot_noise(dark: Dark, gain: Quantity) -> tuple[float, float]:
    """Variance of the dark electrons in the shortest stack, K·µ_I·t, and half of its interval [DN²]."""
    if not dark.rate.known:
        return 0.0, 0.0
    rate, k = dark.rate.quantity, gain.value
    half = math.hypot(
        0.5 * (rate.high - rate.low) * k, 0.5 * (gain.high - gain.low) * rate.value
    )
    return k * rate.value * dark.quiet.exposure_s, half * dark.quiet.exposure_s


def residual_variance(stack: Stack) -> tuple[Float64Array, float]:
    """Temporal variance of each pixel without what its row, its column and the frame share, (H, W) [DN²], scaled to the
    mean variance of a pixel alone; and the share of other pixels' variance in it."""
    height, width = stack.shape
    drift = stack.frame_means - stack.mean.mean()
    rows = stack.frame_means[:, None] - stack.row_means
    columns = stack.frame_means[:, None] - stack.column_means
    rows, columns = rows - rows.mean(axis=0), columns - columns.mean(axis=0)
    found = np.zeros(stack.shape)
    for frame, shift, by_row, by_column in zip(stack.frames, drift, rows, columns, strict=True):
        for part in stack.strips():
            rest = frame[part] - stack.mean[part]
            rest += by_row[part, None] - shift
            rest += by_column
            found[part] += rest * rest
    shared = 1 / height + 1 / width
    return found / (len(stack) - 1) / ((1 - 1 / height) * (1 - 1 / width)), shared


def _coarse(stack: Stack, row: Quantity, column: Quantity, shot_dn2: float) -> Quantity:
    """Where rounding is coarse: most likely σ of the codes, less what rows, columns and dark current have."""
    total = dark_noise([stack]).analogue
    if math.isnan(total.value):
        return unknown(READ, total.note)
    less = _variance_of(row, column) + shot_dn2
    value, low, high = (
        math.sqrt(max(one**2 - less, 0.0)) for one in (total.value, total.low, total.high)
    )
    return replace(READ, value=value, low=low, high=high, note=total.note)


def _variance_of(*sigmas: Quantity) -> float:
    """Sum of their squares; what is not known counts nothing."""
    return sum(one.value**2 for one in sigmas if math.isfinite(one.value))


def _of_pixels(variances: Float64Array, cv: float) -> Float64Array:
    """σ of each pixel over their rms: sample variances scatter by chance too, so that their logarithms are scaled down
    to the spread without it."""
    logarithms = 0.5 * np.log(np.maximum(variances, 1e-3 * variances.mean()))
    logarithms -= logarithms.mean()
    s = math.sqrt(math.log1p(cv**2))
    sigma = np.exp(logarithms * min(1.0, s / float(logarithms.std())))
    return np.asarray(sigma / math.sqrt(float(np.square(sigma).mean())))
