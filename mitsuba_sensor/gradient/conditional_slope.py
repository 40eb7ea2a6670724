"""Derivatives of a frame whose noise does not hide the steps of the converter: those of E[code], given the counts.

The slope of a code at the sample itself is wrong there: a step is either in reach of the noise or it is not. Behind the
count a pixel is normal, about the signal that the stages give without temporal noise. So two slopes are computed:

* by all numbers behind the count, that of E[code] given the count (core/code_slope.py),
* by the mean λ of the count, the change of E[code] by one electron: d E[f(n)]/dλ = E[f(n + 1) − f(n)], half of which is
  taken forward and half, with the weight n/λ, backward. So the derivative of E[f²], the variance over counts, is right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from operator import add

import numpy as np
from numpy.typing import ArrayLike

from ..core import Array, Electrons, Frame, arrays
from ..core.code_slope import LARGEST_DN, ExpectedCode, per_variance
from ..core.differentiable import NEVER_COUNTED, DifferentiableBackend
from ..core.noise_distributions import NoiseDistribution
from ..stages.stage import Chain, Converter, converter_of, sample


@dataclass(frozen=True, eq=False)
class QuietFrame(Frame):
    """A frame whose normal temporal noise is 0, or of one source 1σ.

    sources : those that are drawn from are added here.
    """

    only: str = ""
    sources: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, frame: Frame, only: str = "") -> QuietFrame:
        """As this frame."""
        return cls(
            frame.exposure,
            frame.window,
            frame.seed,
            frame.index,
            frame.gain,
            frame._blocks,
            frame.charge,
            only,
        )

    def _constant(self, source: str) -> Array:
        self.sources.add(source)
        return self.window.backend.from_numpy(
            np.full((1, 1), float(source == self.only)), self.window
        )

    def normal(self, source: str) -> Array:
        return self._constant(source)

    def distributed(self, source: str, distribution: NoiseDistribution | None) -> Array:
        if (
            distribution is not None
        ):  # not computed: it goes past the numbers of the distribution
            super().distributed(source, distribution)
        return self._constant(source)

    def frame_normal(self, source: str) -> Array:
        return self._constant(source)

    def row_normal(self, source: str, rows: ArrayLike | None = None) -> Array:
        return self._constant(source) if rows is None else super().row_normal(source, rows)

    def column_normal(self, source: str, columns: ArrayLike | None = None) -> Array:
        return (
            self._constant(source)
            if columns is None
            else super().column_normal(source, columns)
        )


@dataclass(frozen=True, eq=False)
class ConditionalSlope:
    """Frames of a chain with the derivatives of the expected code.

    before : from the light to the count.  count : shot noise, and what multiplies electrons; none without shot noise.
    behind : the rest.
    """

    before: Chain
    count: Chain
    behind: Chain

    @classmethod
    def of(cls, stages: Chain) -> ConditionalSlope:
        """Of a chain whose first stage has been run."""
        counting = next((k for k, stage in enumerate(stages) if stage.counts_electrons), 0)
        after = ((k, stage) for k, stage in enumerate(stages) if k > counting)
        split = next(
            k
            for k, stage in after
            if stage.saturation_e is not None or stage.domain in ("volts", "DN")
        )
        count = counting or split  # without shot noise nothing is counted
        return cls(stages[1:count], stages[count:split], stages[split:])

    @property
    def converter(self) -> Converter:
        """The last stage."""
        return converter_of(self.behind)

    def sample(self, start: Electrons, frame: Frame) -> Array:
        """Digital numbers of one frame, (H·W)."""
        backend = frame.window.backend
        assert isinstance(backend, DifferentiableBackend)
        mean = sample(self.before, start, frame)
        counted = sample(self.count, mean, frame)
        return _Pixels(self, frame, backend, backend.place, counted).digital(mean)


@dataclass(frozen=True, eq=False)
class _Pixels:
    """One frame behind the count.  place : of the numbers of the stages there."""

    slope: ConditionalSlope
    frame: Frame
    backend: DifferentiableBackend
    place: int
    counted: Electrons

    def digital(self, mean: Electrons) -> Array:
        """mean : of the counts."""
        dr, expected = self.backend.dr, self.expected
        digital = self.slope.converter.sample(
            sample(self.slope.behind[:-1], self.counted, self.frame), self.frame
        )
        single = (
            len(self.slope.count) == 1 and mean.variance_e2 is None
        )  # else a count is more than one electron
        counts = self.fixed if single else self.counted
        sampled, (signal, sigma) = self.signal(self.frame, counts), self.law(counts)
        z = dr.detach((sampled - signal) / dr.maximum(sigma, 1e-30))
        middle, spread = dr.detach(signal), dr.detach(sigma)
        code = expected.code(middle)
        off = dr.detach(digital) - code
        by_signal, by_sigma = expected.weights(code, middle, spread, off)
        narrow = (
            by_signal * (sampled - z * sigma) + by_sigma * sigma
        )  # the sample knows the curvature of a response
        if single:
            narrow = (
                narrow
                + self.per_electron(dr.detach(mean.total), middle, spread, off) * mean.total
            )
        return dr.replace_grad(digital, dr.select(spread > LARGEST_DN, digital, narrow))

    @cached_property
    def expected(self) -> ExpectedCode:
        """E[code] of a normal signal."""
        return ExpectedCode(
            self.backend.dr, self.slope.converter.highest, self.slope.converter.inl_lsb
        )

    @cached_property
    def fixed(self) -> Electrons:
        """The counts without derivatives."""
        return self.counted.changed(
            arrays.detached, lambda *parts: tuple(map(arrays.detached, parts))
        )

    def law(self, counts: Electrons) -> tuple[Array, Array]:
        """Mean and σ of the signal given the count, with their derivatives [DN]."""
        quiet = QuietFrame.of(self.frame)
        signal, variance = self.signal(quiet, counts), self.backend.float(0.0)
        for source in sorted(quiet.sources):
            variance = (
                variance
                + (self.signal(QuietFrame.of(self.frame, source), counts) - signal) ** 2
            )
        return signal, arrays.sqrt(variance)

    def signal(self, frame: Frame, counts: Electrons, derivatives: bool = True) -> Array:
        """What the converter rounds [DN]."""
        with self.backend.again(self.place, derivatives):
            return self.slope.converter.ideal(
                sample(self.slope.behind[:-1], counts, frame), frame
            )

    def per_electron(self, mean: Array, signal: Array, sigma: Array, off: Array) -> Array:
        """Derivative of the code by the mean of the count: half of the change of E[code] by one electron forward, and
        half, with the weight n/λ, backward; and so for Var[code].
        """
        dr, quiet, moments = self.backend.dr, QuietFrame.of(self.frame), []
        for more in (0.0, 1.0, -1.0):
            counts = self.fixed.changed(partial(add, more), partial(_with_more, more))
            there = dr.detach(self.signal(quiet, counts, derivatives=False)) if more else signal
            code = self.expected.code(there)
            moments.append((code, *self.expected.moments(code, there, sigma)))
        here, after, before = moments
        counted = mean > NEVER_COUNTED
        ratio = arrays.where(counted, self.fixed.total / arrays.where(counted, mean, 1.0), 0.0)
        forward = arrays.where(counted, 0.5, 1.0)

        def change(of: Callable[[tuple[Array, ...], tuple[Array, ...]], Array]) -> Array:
            return forward * of(after, here) + 0.5 * ratio * of(here, before)

        share = per_variance(dr, off - here[1], here[2])
        return change(lambda x, y: (x[0] - y[0]) + (x[1] - y[1])) + 0.5 * share * change(
            lambda x, y: x[2] - y[2]
        )


def _with_more(more: float, light: Array, dark: Array) -> tuple[Array, Array]:
    """So many photoelectrons more."""
    return light + more, dark
