"""Frames of one scene at one camera setting, simulated or real, with statistics of each pixel."""

from __future__ import annotations

import math
import mmap
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import InputError, finite_numbers, refuse_masked, require
from ...core.checks import require_finite
from ...core.errors import require_count
from ...core.exposure import TIME_MAX_S
from ...core.types import Float64Array
from .clipping import Clipping

BITS_MAX = 32
STRIP_VALUES = 2**17
"""Values converted to float64 at once: 1 MiB, which fits in processor caches, whatever the size of the stack."""
ROUNDING_DN2 = 1 / 12
"""Variance of rounding to whole codes (EMVA 1288 R4 2.2)."""
COARSE_DN2 = 0.24
"""Temporal variance below which rounding hides temporal noise; EMVA 1288 R4 2.2 then gives bounds instead of values."""
ONE_FRAME = "one frame does not separate temporal from spatial noise, pass at least 2"
NUMBER = re.compile(r"[-+]?\d[\d.,]*(?:e[-+]?\d+)?")


def coarse_note(variance_dn2: float, span_dn: float = math.inf) -> str:
    """Return why frames of whole codes show no temporal figure, or an empty text.

    variance_dn2 : σ_y² [DN²].  span_dn : largest minus smallest code.
    """
    if not variance_dn2 < COARSE_DN2 and span_dn > 1:
        return ""
    limit = f"below {COARSE_DN2} DN²" if variance_dn2 < COARSE_DN2 else "with two codes"
    return (
        f"not measurable: the temporal variance is {variance_dn2:.2g} DN², and {limit} rounding hides the noise (EMVA "
        "1288 R4 2.2); use a higher gain"
    )


def rounding_shift_dn(variance_dn2: float) -> float:
    """Return the standard deviation of the shift that rounding gives to a mean of codes with this variance [DN].

    The shift is 1/√12 DN without noise and falls as exp(−2π²σ²) (Widrow and Kollár 2008).
    """
    return math.exp(-2 * math.pi**2 * _least_dn2(variance_dn2)) * math.sqrt(ROUNDING_DN2)


def rounding_error_dn2(variance_dn2: float) -> float:
    """Return how far the variance of rounding may differ from 1/12 DN² at this variance of the codes [DN²]."""
    return min(ROUNDING_DN2, float(_rounding_error(np.array(_least_dn2(variance_dn2)))))


def _least_dn2(variance_dn2: float) -> float:
    """Return the smallest σ² [DN²] that gives this variance of the codes, at the worst position between two codes."""
    sigma_dn2 = np.linspace(0.0, 1.5, 301)
    most = sigma_dn2 + ROUNDING_DN2 + _rounding_error(sigma_dn2)
    return float(np.interp(variance_dn2, most, sigma_dn2))


def _rounding_error(sigma_dn2: Float64Array) -> Float64Array:
    """Return the largest difference from 1/12 DN² for normal noise, if all pixels have the same mean [DN²]."""
    return np.asarray((4 * sigma_dn2 + math.pi**-2) * np.exp(-2 * math.pi**2 * sigma_dn2))


def release(frames: NDArray[Any]) -> None:
    """Let the system reclaim the memory of frames that are mapped from disk.

    Frames mapped for writing are left alone, because their changes would be lost.
    """
    if getattr(frames, "mode", "") == "r" and hasattr(mmap, "MADV_DONTNEED"):
        frames._mmap.madvise(mmap.MADV_DONTNEED)  # type: ignore[attr-defined]


class Changes(NamedTuple):
    """Statistics from one pass over a stack, without what the pixels of a frame have in common.

    mean : mean of all values [DN].  of_means : variance of the pixel means over the pixels [DN²].
    variance, square : temporal variance of a pixel and its square, averaged over the pixels [DN², DN⁴].
    rows, columns : deviations of the line means of each frame from their temporal means, shape (N, lines) [DN].
    """

    mean: float
    of_means: float
    variance: float
    square: float
    rows: Float64Array
    columns: Float64Array


@dataclass(frozen=True, eq=False)
class Stack:
    """N frames of one scene at one setting, and what is known about them.

    ::

        dark = ms.expose(np.zeros((48, 64)), camera, exposure, frames=4).digital
        stack = ms.lab.Stack(dark, exposure.time_s, photons=0, bits=12)
        print(stack.mean.mean())

    frames : digital numbers, shape (N, H, W), integers or floats [DN]; not copied.
    exposure_s : exposure time [s], at least 0.
    photons : mean photons per pixel and exposure: a number for a flat field, 0 in the dark, shape (H, W) for another
        scene, None if unknown.
    temperature_k : sensor temperature [K], or None.  gain : name of the gain setting, e.g. an ISO speed.
    bits : bits of the ADC, or None to search the frames for the full-scale code.
    tile : rows of colour filter names, from the first pixel of these frames; empty for a monochrome camera.
    source : file or folder, for messages.

    Raises InputError for frames of another shape or type, values that are not finite, and impossible settings.
    """

    frames: NDArray[Any]
    exposure_s: float
    photons: float | Float64Array | None = None
    temperature_k: float | None = None
    gain: str = ""
    bits: int | None = None
    tile: tuple[tuple[str, ...], ...] = ()
    source: str = "the frames"

    def __repr__(self) -> str:
        size = " × ".join(map(str, self.frames.shape))
        return f"<Stack: {size}, {self.frames.dtype}, {self.exposure_s:g} s, {self.source}>"

    def __post_init__(self) -> None:
        frames, source = self.frames, self.source
        refuse_masked("frames", frames)
        are_numbers = isinstance(frames, np.ndarray) and frames.dtype.kind in "uif"
        if not are_numbers or frames.ndim != 3 or not frames.size:
            kind = getattr(frames, "dtype", type(frames).__name__)
            shape = getattr(frames, "shape", ())
            raise InputError(
                f"{source}: frames are {kind} of shape {shape}; pass numbers of shape (frames, rows, columns)."
            )
        if frames.dtype.kind == "f":
            require_finite(f"{source}: frames", frames, "digital numbers")
        require(f"{source}: exposure_s", self.exposure_s, 0.0, TIME_MAX_S, "seconds, e.g. 0.01")
        if self.photons is not None:
            wanted = "photons per pixel of 0 or more, a number or (rows, columns)"
            photons = finite_numbers(f"{source}: photons", self.photons, wanted)
            if photons.shape not in ((), self.shape) or photons.min() < 0:
                raise InputError(
                    f"{source}: photons has shape {photons.shape} and values from {photons.min():g}; pass {wanted}."
                )
        if self.bits is not None:
            require_count(f"{source}: bits", self.bits, 1, BITS_MAX, 12)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, (H, W)."""
        return self.frames.shape[1], self.frames.shape[2]

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def dark(self) -> bool:
        """Return True if no light fell on the sensor for certain."""
        return self.photons is not None and not np.any(self.photons)

    @cached_property
    def mean(self) -> Float64Array:
        """Temporal mean of each pixel, shape (H, W) [DN]."""
        return self._mean_over(0)

    @cached_property
    def variance(self) -> Float64Array:
        """Unbiased temporal variance of each pixel, shape (H, W) [DN²], from two passes; NaN for a single frame."""
        variance = np.full(self.shape, np.nan)
        if len(self) > 1:
            for rows in self.strips():
                rest = self.frames[:, rows] - self.mean[rows]
                variance[rows] = np.einsum("nij,nij->ij", rest, rest) / (len(self) - 1)
        return variance

    @cached_property
    def whole_codes(self) -> bool:
        """Return True if all values are whole numbers."""
        if self.frames.dtype.kind in "ui":
            return True
        return bool((self.frames == np.round(self.frames)).all())

    @cached_property
    def coarse(self) -> str:
        """Reason why rounding hides the temporal noise of these frames, or an empty text."""
        if len(self) == 1:
            return ""
        return self.coarse_at(self.changes.variance)

    def coarse_at(self, variance_dn2: float) -> str:
        """Return why rounding hides this temporal variance [DN²] of these frames, or an empty text."""
        span_dn = self.clipping.largest - self.clipping.lowest
        return coarse_note(variance_dn2, span_dn) if self.whole_codes else ""

    @property
    def temporal_note(self) -> str:
        """Reason why the temporal noise of these frames is unknown, or an empty text."""
        return ONE_FRAME if len(self) == 1 else self.coarse

    @cached_property
    def rounding_shift_dn(self) -> float:
        """Standard deviation of the pattern that rounding adds to the pixel means [DN]; 0 for frames with fractions."""
        if len(self) == 1 or not self.whole_codes:
            return 0.0
        sigma_dn2 = max(self.changes.variance - ROUNDING_DN2, 0.0)
        return math.exp(-2 * math.pi**2 * sigma_dn2) * math.sqrt(ROUNDING_DN2)

    @cached_property
    def changes(self) -> Changes:
        """Temporal statistics without the mean of each frame."""
        drift = self.frame_means - self.frame_means.mean()
        return self.changes_without(lambda rows: (drift[:, None, None], 1.0))

    def changes_without(
        self,
        common: Callable[[slice], tuple[Float64Array, float | Float64Array]],
        maps: tuple[Float64Array, Float64Array] | None = None,
    ) -> Changes:
        """Return temporal statistics without what pixels have in common, computed in strips of rows.

        common : returns for a strip of rows the deviations to subtract, broadcast to (N, rows, columns), and the
            factor that corrects the variances for this subtraction.
        maps : arrays (H, W) to fill with mean and variance of each pixel.
        """
        (height, width), frames = self.shape, len(self)
        rows, columns = np.empty((frames, height)), np.zeros((frames, width))
        level, sums = float(self.frame_means[0]), np.zeros(4)
        for strip in self.strips():
            block = np.asarray(self.frames[:, strip], np.float64, copy=True)
            mean = block.mean(axis=0)
            deviation, grown = common(strip)
            block -= mean
            block -= deviation
            rows[:, strip] = block @ np.full(width, 1 / width)
            columns += block.sum(axis=1) / height
            variance = np.einsum("nij,nij->ij", block, block) * grown / max(frames - 1, 1)
            if maps is not None:
                maps[0][strip], maps[1][strip] = mean, variance
            mean -= level
            sums += mean.sum(), np.vdot(mean, mean), variance.sum(), np.vdot(variance, variance)
        first, second, total, square = (sums / (height * width)).tolist()
        of_means = (second - first**2) * height * width / max(height * width - 1, 1)
        return Changes(level + first, max(of_means, 0.0), total, square, rows, columns)

    @cached_property
    def clipping(self) -> Clipping:
        """Fractions of the values at the ends of the range."""
        clipping = Clipping.measure(self.frames, self.bits)
        self.release()
        return clipping

    @cached_property
    def frame_means(self) -> Float64Array:
        """Mean of each frame, shape (N,) [DN], which shows drifting light."""
        return self._mean_over((1, 2))

    @cached_property
    def row_means(self) -> Float64Array:
        """Mean of each row of each frame, shape (N, H) [DN]."""
        return self._mean_over(2)

    @cached_property
    def column_means(self) -> Float64Array:
        """Mean of each column of each frame, shape (N, W) [DN]."""
        return self._mean_over(1)

    def _mean_over(self, axis: int | tuple[int, int]) -> Float64Array:
        means = np.asarray(self.frames.mean(axis=axis, dtype=np.float64))
        self.release()
        return means

    def strips(self) -> Iterator[slice]:
        """Yield slices of rows that are processed at once."""
        rows = self.shape[0]
        height = max(1, STRIP_VALUES // (len(self) * self.shape[1]))
        for top in range(0, rows, height):
            yield slice(top, min(top + height, rows))
        self.release()

    def release(self) -> None:
        """Let the system reclaim the memory of frames on disk, which are read again on demand."""
        release(self.frames)

    def require_one_filter(self) -> None:
        """Raise InputError for a colour mosaic."""
        if self.tile:
            raise InputError(
                f"{self.source}: a mosaic of {len(self.tile)} × {len(self.tile[0])} colour filters; pass each stack "
                "of Stack.of_filters() instead."
            )

    def window(self, rows: slice, columns: slice) -> Stack:
        """Return a view of some rows and columns of every frame; the window of a mosaic must begin at a whole tile."""
        photons = self.photons
        if isinstance(photons, np.ndarray):
            photons = photons[rows, columns]
        return replace(self, frames=self.frames[:, rows, columns], photons=photons)

    def centre(self, side: int) -> Stack:
        """Return the central rows and columns of the frames, at most this many."""
        rows, columns = (
            slice(begin, begin + min(size, side))
            for size in self.shape
            for begin in [max(0, (size - side) // 2)]
        )
        return self.window(rows, columns)

    def of_filters(self) -> dict[str, Stack]:
        """Return one stack for each position of the tile, by the name of its colour filter, as EMVA 1288 requires.

        A filter at several positions gives one stack each: ``G``, ``G (2)``. A monochrome stack is returned under an
        empty name.
        """
        if not self.tile:
            return {"": self}
        stacks: dict[str, Stack] = {}
        for row, names in enumerate(self.tile):
            for column, name in enumerate(names):
                again = sum(key.partition(" (")[0] == name for key in stacks)
                part = self.window(
                    slice(row, None, len(self.tile)), slice(column, None, len(names))
                )
                key = f"{name} ({again + 1})" if again else name
                stacks[key] = replace(part, tile=())
        return stacks


def merged(notes: Iterable[str]) -> list[str]:
    """Return notes, one for each group that differs only by numbers and by the stack before the colon.

    The first note of a group is kept and counts the other stacks.
    """
    groups: dict[str, list[str]] = {}
    for note in dict.fromkeys(notes):
        kind = NUMBER.sub("#", note.rpartition(": ")[2])
        groups.setdefault(kind, []).append(note)
    sentences: list[str] = []
    for first, *others in groups.values():
        if others:
            first += f" (and {len(others)} more stack{'s' * (len(others) > 1)} alike)"
        sentences.append(first)
    return sentences
