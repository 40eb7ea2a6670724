"""Frames of one scene under one setting of a camera, simulated or real, with their statistics of each pixel."""

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

MOST_BITS = 32
STRIP_VALUES = 2**17
"""Values that are float64 at once: 1 MiB, which the caches of a processor hold, whatever the size of the stack."""
ROUNDING_DN2 = 1 / 12
"""Variance of rounding to whole codes, EMVA 1288 R4 2.2."""
COARSE_DN2 = 0.24
"""Temporal variance below which rounding hides temporal noise: EMVA 1288 R4 2.2 gives bounds instead of figures."""
ONE_FRAME = "one frame: temporal noise is not told from spatial, pass at least 2"
NUMBER = re.compile(r"[-+]?\d[\d.,]*(?:e[-+]?\d+)?")


def coarse_note(variance_dn2: float) -> str:
    """Why frames of whole codes show no temporal figure, or nothing.  variance_dn2 : σ_y² [DN²]."""
    if not variance_dn2 < COARSE_DN2:
        return ""
    return (
        f"not measurable: the temporal variance is {variance_dn2:.2g} DN², and below {COARSE_DN2} DN² rounding hides "
        "the noise (EMVA 1288 R4 2.2); use a higher gain"
    )


def rounding_shift_dn(variance_dn2: float) -> float:
    """Standard deviation of what rounding may add to a mean of whole codes with this variance [DN].

    It is 1/√12 DN without noise and decreases as exp(−2π²σ²) (Widrow and Kollár 2008).
    """
    return math.exp(-2 * math.pi**2 * _least_dn2(variance_dn2)) * math.sqrt(ROUNDING_DN2)


def rounding_error_dn2(variance_dn2: float) -> float:
    """By how much the variance of rounding may differ from 1/12 DN² at this variance of the codes [DN²]."""
    return min(ROUNDING_DN2, float(_rounding_error(np.array(_least_dn2(variance_dn2)))))


def _least_dn2(variance_dn2: float) -> float:
    """The smallest σ² that has this variance of the codes, at the least favourable place between two codes."""
    sigma_dn2 = np.linspace(0.0, 1.5, 301)
    most = sigma_dn2 + ROUNDING_DN2 + _rounding_error(sigma_dn2)
    return float(np.interp(variance_dn2, most, sigma_dn2))


def _rounding_error(sigma_dn2: Float64Array) -> Float64Array:
    """Largest difference from 1/12 DN² for normal noise, if the means of all pixels are equal [DN²]."""
    return np.asarray((4 * sigma_dn2 + math.pi**-2) * np.exp(-2 * math.pi**2 * sigma_dn2))


def release(frames: NDArray[Any]) -> None:
    """Let the system take back the memory of frames that lie on disk.

    Frames that are mapped to be changed are left alone: their changes would be lost.
    """
    if getattr(frames, "mode", "") == "r" and hasattr(mmap, "MADV_DONTNEED"):
        frames._mmap.madvise(mmap.MADV_DONTNEED)  # type: ignore[attr-defined]


class Changes(NamedTuple):
    """What one pass over a stack finds.

    mean : of all values [DN].  of_means : variance over the pixels of their means [DN²].
    variance, square : means over the pixels of their variance over the frames, without what is common to the pixels of
    a frame [DN²], and of its square [DN⁴].
    rows, columns : deviations of the lines' means from their means over the frames, without it, (N, lines) [DN].
    """

    mean: float
    of_means: float
    variance: float
    square: float
    rows: Float64Array
    columns: Float64Array


@dataclass(frozen=True, eq=False)
class Stack:
    """N frames of one scene with one setting, and what is known about them.

    ::

        dark = ms.expose(np.zeros((48, 64)), camera, exposure, frames=4).digital
        stack = ms.lab.Stack(dark, exposure.time_s, photons=0, bits=12)
        print(stack.mean.mean())

    frames : (N, H, W) digital numbers, integers or floats [DN]; they are not copied.
    exposure_s : exposure time [s], at least 0.
    photons : mean photons per pixel and exposure: a number for a flat field, 0 in the dark, (H, W) for another scene;
        None where nobody knows.
    temperature_k : of the sensor [K], or None.  gain : name of the gain setting, an ISO speed for example.
    bits : of the ADC, or None: its largest code is then looked for in the frames.
    tile : names of the colour filters as they lie in these frames, in rows; empty for a monochrome camera.
    source : the file or folder, for messages.

    Raises InputError for frames of another shape or type, values that are not finite, and unusable settings.
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
            require_count(f"{source}: bits", self.bits, 1, MOST_BITS, 12)

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W)."""
        return self.frames.shape[1], self.frames.shape[2]

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def dark(self) -> bool:
        """Whether it is known that no light fell on the sensor."""
        return self.photons is not None and not np.any(self.photons)

    @cached_property
    def mean(self) -> Float64Array:
        """Mean of each pixel over the frames, (H, W) [DN]."""
        return self._mean_over(0)

    @cached_property
    def variance(self) -> Float64Array:
        """Variance of each pixel over the frames, with N - 1, (H, W) [DN²]; NaN for a single frame.

        It is computed in two passes, in strips of rows.
        """
        variance = np.full(self.shape, np.nan)
        if len(self) > 1:
            for rows in self.strips():
                rest = self.frames[:, rows] - self.mean[rows]
                variance[rows] = np.einsum("nij,nij->ij", rest, rest) / (len(self) - 1)
        return variance

    @cached_property
    def whole_codes(self) -> bool:
        """Whether no value of the frames has a fraction."""
        if self.frames.dtype.kind in "ui":
            return True
        return bool((self.frames == np.round(self.frames)).all())

    @cached_property
    def coarse(self) -> str:
        """Why rounding hides the temporal noise of these frames, or nothing."""
        if len(self) == 1 or not self.whole_codes:
            return ""
        return coarse_note(self.changes.variance)

    @property
    def temporal_note(self) -> str:
        """Why the temporal noise of these frames is not known, or nothing."""
        return ONE_FRAME if len(self) == 1 else self.coarse

    @cached_property
    def rounding_shift_dn(self) -> float:
        """Standard deviation of the pattern that rounding adds to pixels and lines [DN]; 0 if that is not known."""
        if len(self) == 1 or not self.whole_codes:
            return 0.0
        sigma_dn2 = max(self.changes.variance - ROUNDING_DN2, 0.0)
        return math.exp(-2 * math.pi**2 * sigma_dn2) * math.sqrt(ROUNDING_DN2)

    @cached_property
    def changes(self) -> Changes:
        """What changes from frame to frame, without the frames' means."""
        drift = self.frame_means - self.frame_means.mean()
        return self.changes_without(lambda rows: (drift[:, None, None], 1.0))

    def changes_without(
        self,
        common: Callable[[slice], tuple[Float64Array, float | Float64Array]],
        maps: tuple[Float64Array, Float64Array] | None = None,
    ) -> Changes:
        """What changes from frame to frame without what pixels have in common, in strips of rows.

        common : deviations to be subtracted of some rows, (N, rows, columns) or broadcast to it, and the factor by
            which that makes variances too small.
        maps : filled with mean and variance of each pixel, (H, W).
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
        """Shares of the values at the ends of the range."""
        found = Clipping.measure(self.frames, self.bits)
        self.release()
        return found

    @cached_property
    def frame_means(self) -> Float64Array:
        """Mean of each frame over its pixels, (N,) [DN]: light that drifts shows here."""
        return self._mean_over((1, 2))

    @cached_property
    def row_means(self) -> Float64Array:
        """Mean of each row of each frame, (N, H) [DN]."""
        return self._mean_over(2)

    @cached_property
    def column_means(self) -> Float64Array:
        """Mean of each column of each frame, (N, W) [DN]."""
        return self._mean_over(1)

    def _mean_over(self, axis: int | tuple[int, int]) -> Float64Array:
        means = np.asarray(self.frames.mean(axis=axis, dtype=np.float64))
        self.release()
        return means

    def strips(self) -> Iterator[slice]:
        """Rows that are worked on at once."""
        rows = self.shape[0]
        height = max(1, STRIP_VALUES // (len(self) * self.shape[1]))
        for top in range(0, rows, height):
            yield slice(top, min(top + height, rows))
        self.release()

    def release(self) -> None:
        """Let the system take back the memory of frames that lie on disk; they are read again where they are needed."""
        release(self.frames)

    def require_one_filter(self) -> None:
        """Raises InputError for a mosaic, whose pixels differ by their colour filters."""
        if self.tile:
            raise InputError(
                f"{self.source}: pixels behind {len(self.tile) * len(self.tile[0])} colour filters differ by more than "
                "their noise; pass each stack of Stack.of_filters() instead."
            )

    def window(self, rows: slice, columns: slice) -> Stack:
        """Some rows and columns of every frame (a view); a mosaic must begin at a whole tile."""
        photons = self.photons
        if isinstance(photons, np.ndarray):
            photons = photons[rows, columns]
        return replace(self, frames=self.frames[:, rows, columns], photons=photons)

    def centre(self, side: int) -> Stack:
        """So many rows and columns about the centre of the frames, at most as many as there are."""
        rows, columns = (
            slice(begin, begin + min(size, side))
            for size in self.shape
            for begin in [max(0, (size - side) // 2)]
        )
        return self.window(rows, columns)

    def of_filters(self) -> dict[str, Stack]:
        """The pixels behind each place of the tile apart, by the name of its colour filter, as EMVA 1288 asks.

        A filter that occurs at several places of the tile gives one stack each: ``G``, ``G (2)``. A monochrome stack
        is the only one, under an empty name.
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
    """Notes without those that differ from an earlier one by numbers and by the stack before the colon alone.

    What is left is the first one's, and says how many more stacks it is of.
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
