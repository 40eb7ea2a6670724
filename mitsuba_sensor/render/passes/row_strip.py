"""Accumulated passes of a strip of rows, in which a picture is rendered."""

from __future__ import annotations

import math
import mmap
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from enum import Flag, auto
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array
from ...core.heap import trim_heap
from .passes import RunningMean, Welford

if TYPE_CHECKING:
    from io import BufferedRandom

CAN_SPILL = hasattr(mmap, "MADV_DONTNEED") and hasattr(mmap, "MAP_ANONYMOUS")  # Linux and macOS
LEAST_BYTES = 2**27  # less is not worth the file


class Kept(Flag):
    """What is kept of the passes: the spread of every band, and the half-sets that
    :meth:`renderer.Renderer.denoise` needs.

    Half-sets alone leave the bands of a render that is not denoised with error bars of one degree of freedom.
    """

    SPREAD = auto()
    HALVES = auto()

    @classmethod
    def of(cls, denoise: bool | None, raw_light: bool) -> Kept:
        """What these options of a render need."""
        if not denoise:
            return cls.SPREAD
        return cls.SPREAD | cls.HALVES if raw_light else cls.HALVES


class BandSums:
    """What is kept of the bands of a whole picture, (H, W, B) float32: the largest arrays of a render.

    mean : of the passes.  spread, even : see :class:`passes.Welford`, and the sum of the passes 0, 2, 4, …; None where
        not kept.
    """

    def __init__(self, shape: tuple[int, int, int], keep: Kept) -> None:
        self._arrays = [Spillable(shape) for _ in range(1 + len(keep))]
        self.mean, *others = (array.values for array in self._arrays)
        self.spread, self.even = (
            others.pop(0) if kind in keep else None for kind in (Kept.SPREAD, Kept.HALVES)
        )

    def of_rows(self, rows: slice) -> RunningMean:
        """The mean, or mean and variance, of some rows."""
        return (
            RunningMean(self.mean[rows])
            if self.spread is None
            else Welford(self.mean[rows], self.spread[rows])
        )

    def on_disk(self) -> AbstractContextManager[None]:
        """Large ones are in a temporary file meanwhile, so that something else can have the memory."""
        return on_disk(self._arrays)

    def reused(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Two of the arrays, to write bands and standard errors over them, strip by strip."""
        other = self.even if self.even is not None else self.spread
        assert other is not None
        return self.mean, other


class RowStrip:
    """Accumulated passes of some rows: per band, and as photoelectrons behind the filters, in float32.

    electrons : (H, W, F) behind every filter where half-sets are kept, else (H, W, 1) of each pixel's own.
    even, even_e : sums of the passes 0, 2, 4, … of bands and electrons, or None.
    brightest : largest photoelectrons of any pass behind the pixel's own filter, (H, W).
    """

    def __init__(self, rows: slice, sums: BandSums, filters: int) -> None:
        shape = (rows.stop - rows.start, sums.mean.shape[1])
        self.rows, self.ends = rows, (rows.start, rows.stop)
        of_filters = (*shape, filters)
        self.electrons = Welford(
            np.zeros(of_filters, np.float32), np.zeros(of_filters, np.float32)
        )
        self.bands, self.infinite = sums.of_rows(rows), np.zeros(shape, bool)
        self.brightest = np.zeros(shape, np.float32)
        self.even = None if sums.even is None else sums.even[rows]
        self.even_e = None if sums.even is None else np.zeros(of_filters, np.float32)

    def begin(self, passes: int) -> None:
        """What :meth:`add` is given from now on belongs to so many more passes."""
        self.bands.begin(passes)
        self.electrons.begin(passes)

    def add(
        self, first: int, irradiance: Float64Array, electrons: Float64Array, own: Float64Array
    ) -> None:
        """Add some rows of the passes that have begun; the arrays are written over.

        first : the first one's number in the strip.  irradiance, electrons, own : (passes, rows, W, B) of the bands,
        (passes, rows, W, F) behind the filters, (passes, rows, W) behind each pixel's own filter.
        """
        here = slice(first, first + own.shape[1])
        if self.even is not None and self.even_e is not None:
            even = slice((self.bands.count - len(own)) % 2, None, 2)
            self.even[here] += irradiance[even].sum(axis=0)
            self.even_e[here] += electrons[even].sum(axis=0)
        np.maximum(self.brightest[here], own.max(axis=0), out=self.brightest[here])
        self.bands.add_rows(irradiance, first)
        self.electrons.add_rows(electrons, first)

    def finish(self) -> None:
        """Forget what only further passes need, and the spread of the electrons."""
        self.electrons, self.even_e = Welford(self.electrons.mean, np.empty(0)), None
        self.brightest = np.empty(0)

    def half(self, odd: bool, rows: slice = slice(None)) -> Float64Array:
        """Means of the bands over the even or the odd passes, of two or more."""
        assert self.even is not None
        return self._half(odd, self.bands.mean[rows], self.even[rows])

    def spectra(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Of all pixels together, (B,) each: over all passes, the even and the odd ones."""
        assert self.even is not None
        mean, even = (
            bands.mean(axis=(0, 1), dtype=np.float64) for bands in (self.bands.mean, self.even)
        )
        return mean, self._half(False, mean, even), self._half(True, mean, even)

    def _half(
        self, odd: bool, mean: NDArray[np.floating], even: NDArray[np.floating]
    ) -> Float64Array:
        """Of the mean of all passes, and the sum of the even ones."""
        count, first = self.bands.count, (self.bands.count + 1) // 2
        if not odd:
            return np.asarray(np.divide(even, first, dtype=np.float64))
        found: Float64Array = np.multiply(mean, count, dtype=np.float64)
        found -= even
        found /= count - first
        return found

    def variance_of_bands(self) -> NDArray[np.floating]:
        """(H, W, B) of the mean of the passes; from the difference of the half-sets where nothing else is kept."""
        if isinstance(self.bands, Welford):
            return self.bands.variance_of_mean
        count, first = self.bands.count, (self.bands.count + 1) // 2
        if count < 2:
            return np.zeros_like(self.bands.mean)
        apart = self.half(odd=False)
        apart -= self.half(odd=True)
        return np.asarray(apart**2 / (count * (1 / first + 1 / (count - first))))


def mean_spectrum(strips: Sequence[RowStrip]) -> Float64Array:
    """Mean light of each band over the picture, (B,)."""
    means = [strip.bands.mean.mean(axis=(0, 1), dtype=np.float64) for strip in strips]
    return np.asarray(np.mean(means, axis=0))


class Spillable:
    """A float32 array of zeros whose memory is its own, so that it can be given back and filled again in place.

    values : the array; views of it stay valid.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        size = 4 * math.prod(shape)
        if not CAN_SPILL or not size:
            self.values = np.zeros(shape, np.float32)
            return
        self._memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        self.values = np.frombuffer(self._memory, np.float32).reshape(shape)

    def copy_to(self, file: BufferedRandom) -> None:
        """Write the values behind what is there."""
        file.write(self._memory)

    def give_back(self) -> None:
        """Give the memory back to the system; the values are 0 from now on."""
        self._memory.madvise(mmap.MADV_DONTNEED)

    def read_from(self, file: BufferedRandom) -> None:
        """The inverse of :meth:`copy_to`."""
        file.readinto(self._memory)


@contextmanager
def on_disk(arrays: Sequence[Spillable]) -> Iterator[None]:
    """In a temporary file meanwhile, if they are large; in memory still where the disk has no space for it.

    Nobody may read or write them until the end. Before they come back, what was freed is given back to the system.
    """
    with ExitStack() as stack:
        if CAN_SPILL and sum(array.values.nbytes for array in arrays) >= LEAST_BYTES:
            with suppress(OSError):  # a full disk
                file = stack.enter_context(tempfile.TemporaryFile())
                for array in arrays:
                    array.copy_to(file)
                file.flush()
                stack.callback(_read, arrays, file)
                for array in arrays:
                    array.give_back()
        yield


def _read(arrays: Sequence[Spillable], file: BufferedRandom) -> None:
    trim_heap()
    file.seek(0)
    for array in arrays:
        array.read_from(file)
