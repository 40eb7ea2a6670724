"""Temporal noise in the dark: read noise of the pixels and its spread over them, row noise, column noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...core.types import Float64Array
from ..frames.rounding import ROUNDING_DN2, has_whole_codes
from ..frames.series import COARSE_DN2
from ..frames.stack import Stack
from ..measure.dark_noise import dark_noise
from ..measure.line_noise import LineNoise, line_noise
from ..quantity import TWO_SIDED, Quantity, no_value, unknown
from .coarse_dark import CoarseDark
from .dark import Dark
from .evidence import Fitted, frames_of
from .hidden_spread import HiddenSpread, Mixed, NoisyPixels, hidden_spread, noisy_pixels
from .noise_law import NoiseLaw, Pixels, noise_law

READ = no_value("σ_read", "read noise of the pixels, rms", "DN", "fit")
UNSEEN = Pixels(math.nan, 0.0, 0.0, True)
CV = no_value("cv_read", "spread of the read noise over pixels", "", "fit")
NOISY = no_value("noisy", "share of noisy pixels", "", "fit")
FACTOR = no_value("σ_noisy/σ", "read noise of noisy pixels over that of the others", "", "fit")


ROUNDED_AWAY = "hidden by rounding"


@dataclass(frozen=True, eq=False)
class ReadNoise:
    """read : σ of a pixel alone, rms over the pixels [DN].  cv : of σ over the pixels.  row, column : σ [DN].

    law : of the read noise.  shape : of that law, unknown of a normal one.
    pixels : σ of each pixel [relative to their rms], (H, W), or None where its spread is not told from 0.
    noisy, factor : share of noisy pixels, and their σ over that of the others; without values where there are none.
    """

    read: Fitted
    cv: Fitted
    row: Fitted
    column: Fitted
    law: NoiseLaw
    pixels: Float64Array | None
    noisy: Fitted
    factor: Fitted

    @property
    def shape(self) -> Fitted:
        """λ or ν."""
        return self.read.known_as(self.law.shape)


def read_noise(dark: Dark, gain: Quantity, coarse: CoarseDark | None = None) -> ReadNoise:
    """Noise of the shortest dark stack.

    Shot noise of the dark current and rounding are subtracted in the likelihood.
    coarse : the numbers of that stack, where rounding is coarse and they are known.
    """
    stack, frames = dark.quiet, frames_of(dark.quiet)
    lines = line_noise(stack)
    row, column = Fitted(lines.row, frames), Fitted(lines.column, frames)
    whole = has_whole_codes(stack)
    shot_dn2, unsure = _shot_noise(dark, gain)
    if whole and float(stack.variance.mean()) < COARSE_DN2 + ROUNDING_DN2:
        return ReadNoise(
            read=Fitted(_coarse_noise(stack, lines, shot_dn2, coarse), frames),
            cv=Fitted(unknown(CV, ROUNDED_AWAY), frames),
            row=row,
            column=column,
            law=noise_law(stack, UNSEEN, ROUNDED_AWAY),
            pixels=None,
            noisy=Fitted(unknown(NOISY, ROUNDED_AWAY), frames),
            factor=Fitted(unknown(FACTOR, ROUNDED_AWAY), frames),
        )
    floor = (ROUNDING_DN2 if whole else 0.0) + shot_dn2
    variances, shared = residual_variance(stack)
    mixed = Mixed(floor, 1 - shared, shared)
    spread = hidden_spread(variances.ravel(), len(stack) - 1, mixed)
    noisy = None
    pixels = Pixels(
        sigma=math.sqrt(spread.variance[0]),
        cv=spread.cv[0],
        normal=shot_dn2 + _line_variance(lines) + float(stack.frame_means.var(ddof=1)),
        rounded=whole,
        mean=float(stack.mean.mean()),
        offsets=dark.offsets.spread()["all"][0],
    )
    law = noise_law(stack, pixels, ROUNDED_AWAY if pixels.hidden else "")
    if law.distribution is not None:
        spread = _spread_of_tails(variances, law, pixels, len(stack), floor)
        pixels = pixels._replace(sigma=math.sqrt(spread.variance[0]), cv=spread.cv[0])
        law = noise_law(stack, pixels)
    else:
        noisy = noisy_pixels(variances.ravel(), len(stack) - 1, mixed, spread)
    if noisy is not None:
        spread = spread.beside(noisy)
    m, least, most = spread.variance
    low = m - math.hypot(m - least, unsure)
    high = m + math.hypot(most - m, unsure)
    read = replace(
        READ,
        value=math.sqrt(m),
        low=math.sqrt(max(low, 0.0)),
        high=math.sqrt(max(high, 0.0)),
        note="; ".join(dark.notes),
    )
    cv = replace(CV, value=spread.cv[0], low=spread.cv[1], high=spread.cv[2])
    sigmas = None
    if cv.low > 0 or noisy is not None:
        sigmas = _relative_sigmas(variances - floor, cv.value, noisy)
    if not cv.low > 0:
        cv = cv.noted("not told from 0")
    share, factor = _noisy_figures(noisy)
    return ReadNoise(
        read=Fitted(read, frames),
        cv=Fitted(cv, frames),
        row=row,
        column=column,
        law=law,
        pixels=sigmas,
        noisy=Fitted(share, frames),
        factor=Fitted(factor, frames),
    )


def _noisy_figures(noisy: NoisyPixels | None) -> tuple[Quantity, Quantity]:
    """Share and factor of the noisy pixels, without values where there are none."""
    if noisy is None:
        why = "no second group of pixels is told from a log-normal spread"
        return unknown(NOISY, why), unknown(FACTOR, why)
    (share, *of_share), (factor, *of_factor) = noisy.share, noisy.factor
    return (
        replace(NOISY, value=share, low=of_share[0], high=of_share[1]),
        replace(FACTOR, value=factor, low=of_factor[0], high=of_factor[1]),
    )


def _spread_of_tails(
    variances: Float64Array, law: NoiseLaw, pixels: Pixels, frames: int, floor: float
) -> HiddenSpread:
    """Mean variance and cv where the noise is not normal.

    Sample variances then follow no chi-square law, but their mean is right all the same.
    """
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
    squares = np.zeros(stack.shape)
    for frame, shift, by_row, by_column in zip(stack.frames, drift, rows, columns, strict=True):
        for part in stack.strips():
            rest = frame[part] - stack.mean[part]
            rest += by_row[part, None] - shift
            rest += by_column
            squares[part] += rest * rest
    shared = 1 / height + 1 / width
    return squares / (len(stack) - 1) / ((1 - 1 / height) * (1 - 1 / width)), shared


def _coarse_noise(
    stack: Stack, lines: LineNoise, shot_dn2: float, coarse: CoarseDark | None
) -> Quantity:
    """Read noise where rounding is coarse: σ of the codes, less that of frames, rows, columns and dark current."""
    total = dark_noise([stack]).analogue
    if coarse is not None:
        value = coarse.sigma
        total = replace(
            total, value=value, low=min(total.low, value), high=max(total.high, value)
        )
    if math.isnan(total.value):
        return unknown(READ, total.note)
    less = _line_variance(lines) + shot_dn2
    if coarse is not None:
        less += float(stack.frame_means.var(ddof=1)) / coarse.slope**2
    value, low, high = (
        math.sqrt(max(sigma**2 - less, 0.0)) for sigma in (total.value, total.low, total.high)
    )
    return replace(READ, value=value, low=low, high=high, note=total.note)


def _line_variance(lines: LineNoise) -> float:
    """Variance of row and column noise [DN²]; what is not known counts nothing."""
    sigmas = (lines.row.value, lines.column.value)
    return sum(sigma**2 for sigma in sigmas if math.isfinite(sigma))


def _relative_sigmas(
    variances: Float64Array, cv: float, noisy: NoisyPixels | None
) -> Float64Array:
    """σ of each pixel over their rms: sample variances scatter by chance too, so that their logarithms are scaled down
    to the spread without it, those of the noisiest pixels by themselves."""
    logarithms = 0.5 * np.log(np.maximum(variances, 1e-3 * variances.mean()))
    s = math.sqrt(math.log1p(cv**2))
    groups = [np.ones(variances.shape, bool)]
    steps = [0.0]
    if noisy is not None:
        loud = variances > np.quantile(variances, 1 - noisy.share[0])
        groups, steps = [~loud, loud], [0.0, math.log(noisy.factor[0])]
    for group, step in zip(groups, steps, strict=True):
        own = logarithms[group] - logarithms[group].mean()
        width = float(own.std()) or 1.0
        logarithms[group] = step + own * min(1.0, s / width)
    sigma = np.exp(logarithms)
    return np.asarray(sigma / math.sqrt(float(np.square(sigma).mean())))
