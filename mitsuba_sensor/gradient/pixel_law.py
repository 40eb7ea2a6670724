"""The law of the code of every pixel given its mean count, on Dr.Jit, and with derivatives.

A pixel collects N electrons, N of Poisson's law with mean λ, at most as many as its well holds. Behind the count the
code before rounding is normal about x(N) with standard deviation σ. The stages themselves say what λ, x and σ are, with
the FPN maps of the serial number; x is a parabola through three counts about λ. Then

* below FEW electrons all counts are added up: Σ_N P(N)·f(x(N), σ), with f the expected code or the chance of a code,
* above, N is normal with variance λ. The part of it that fills the well is counted as a full well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ..core import Array, Electrons, Frame, InputError
from ..core.differentiable import AttachedBackend
from ..core.types import DrJitModule
from ..stages.stage import Converter, Stage, sample
from .conditional_slope import ConditionalSlope, QuietFrame
from .normal_code import NormalCode, WithSlopes

FEW = 32.0
"""Mean electrons below which every count is looked at."""

REACH, MORE = 6.0, 8.0
"""Counts up to λ + 6√λ + 8 are added up: less than 1e-7 is left out."""

WELL_FULL = 8.0
"""A well that is further than so many σ from the mean count is not filled."""

CELL, CELL_SIGMA = 0.125, 0.1
"""Distance and σ of the cells of a count about a full well, in its σ: their sum is a normal law to 1e-5."""

DARK_STEP_E = 16.0
"""Electrons between which a curve is straight in the dark."""

TINY = 1e-30
"""Chances below this one are none in float32."""


@dataclass(frozen=True, eq=False)
class PixelLaw:
    """Of all pixels, with derivatives.

    rate : λ, the mean count.  counted : whether there is shot noise.  well_e : electrons of a full well, if any.
    signal, slope, bend : x(n) = signal + slope·(n − λ) + bend·(n − λ)², about the value of λ [DN].  sigma : σ [DN].
    """

    dr: DrJitModule
    highest: int
    rate: Array
    signal: Array
    slope: Array
    bend: Array
    sigma: Array
    well_e: Array | None = None
    counted: bool = True

    def expected(self) -> Array:
        """E[code]."""
        code = NormalCode(self.dr, self.highest)
        mean, sigma = self._as_normal()
        found = code.expected(self.dr.detach(mean), self.dr.detach(sigma))
        line = found.by_mean * mean + found.by_sigma * sigma
        whole = self.dr.replace_grad(found.value, line)
        return self._with_sums(
            whole, code.expected, lambda sums: (sums, self.dr.mask_t(sums)(True))
        )

    def log_likelihood(self, codes: Array) -> Array:
        """ln P(code)."""
        dr, code = self.dr, NormalCode(self.dr, self.highest)

        def logarithm(chance: Array) -> tuple[Array, Array]:
            seen = dr.detach(chance) > TINY  # else it is further off than float32 can say
            return dr.log(dr.select(seen, chance, 1.0)), seen

        whole = code.log_chance(codes, *self._as_normal())
        return self._with_sums(
            whole, lambda mean, sigma: code.chance(codes, mean, sigma), logarithm
        )

    def _with_sums(
        self,
        whole: Array,
        function: Callable[[Array, Array], WithSlopes],
        finish: Callable[[Array], tuple[Array, Array]],
    ) -> Array:
        """``whole``, and sums over counts where there are few electrons, or where the well is about to be filled."""
        if not self.counted:
            return whole
        parts = [(self._few, self._over_counts(function))]
        if self.well_e is not None:
            parts.append((self._near_well, self._over_cells(function)))
        for here, sums in parts:
            value, is_known = finish(sums)
            whole = self.dr.select(here & is_known, value, whole)
        return whole

    @property
    def _few(self) -> Array:
        return self.dr.detach(self.rate) < FEW

    @property
    def _near_well(self) -> Array:
        """Where some counts fill the well, and others do not."""
        rate, well_e = self.dr.detach(self.rate), self.dr.detach(self.well_e)
        return (rate >= FEW) & (self.dr.abs(well_e - rate) < REACH * self.dr.sqrt(rate))

    @property
    def _many_e(self) -> Array:
        """λ, or FEW where there are fewer electrons, so that no root has an infinite slope."""
        return self.dr.maximum(self.rate, 1e-6)

    def _signal_at(self, more: Array) -> Array:
        """x(λ + more), ``more`` counted from the value of λ."""
        return self.signal + self.slope * more + self.bend * more * more

    def _moved(self) -> Array:
        """λ minus its value: 0, with derivatives."""
        return self.rate - self.dr.detach(self.rate)

    def _as_normal(self) -> tuple[Array, Array]:
        """Mean and σ of the code before rounding, with shot noise and a full well [DN]."""
        dr, moved = self.dr, self._moved()
        if not self.counted:
            full = 0.0 if self.well_e is None else dr.minimum(self.well_e - self.rate, 0.0)
            return self._signal_at(moved + full), self.sigma
        root = dr.sqrt(self._many_e)
        off, variance_e2 = self._clipped(root)
        mean = self._signal_at(moved + off) + self.bend * variance_e2
        gain = self.slope + 2.0 * self.bend * (moved + off)
        variance = self.sigma * self.sigma + gain * gain * variance_e2
        return mean, dr.sqrt(dr.maximum(variance, 1e-12))

    def _clipped(self, root: Array) -> tuple[Array, Array]:
        """Mean less λ, and variance, of a normal count that ends at the well."""
        if self.well_e is None:
            return root * 0.0, root * root
        dr = self.dr
        u = dr.minimum((self.well_e - self.rate) / root, WELL_FULL)
        below, density = self._normal(dr.maximum(u, -WELL_FULL))
        off = u * (1.0 - below) - density
        variance = below - u * density + u * u * (1.0 - below) - off * off
        return root * off, root * root * dr.select(u > -REACH, dr.maximum(variance, 0.0), 0.0)

    def _normal(self, u: Array) -> tuple[Array, Array]:
        """Φ and φ."""
        density = self.dr.exp(-0.5 * u * u) * (1.0 / math.sqrt(2 * math.pi))
        return 0.5 + 0.5 * self.dr.erf(u * math.sqrt(0.5)), density

    def _over_counts(self, function: Callable[[Array, Array], WithSlopes]) -> Array:
        """Σ_n P(n)·f(x(n), σ) where there are few electrons, with derivatives; 0 elsewhere."""
        dr = self.dr
        with dr.suspend_grad():
            rate, signal, slope, bend, sigma = map(
                dr.detach, (self.rate, self.signal, self.slope, self.bend, self.sigma)
            )
            well_e = math.inf if self.well_e is None else dr.detach(self.well_e)
            last = dr.select(rate < FEW, rate + REACH * dr.sqrt(rate) + MORE, -1.0)

            def body(n: Array, chance: Array, before: Array, *sums: Array) -> tuple[Array, ...]:
                more = dr.minimum(n, well_e) - rate
                found = function(signal + slope * more + bend * more * more, sigma)
                by_mean = chance * found.by_mean
                terms = (
                    chance * found.value,
                    (before - chance) * found.value,
                    by_mean,
                    by_mean * more,
                    by_mean * more * more,
                    chance * found.by_sigma,
                )
                added = (x + term for x, term in zip(sums, terms, strict=True))
                return (n + 1.0, chance * rate / (n + 1.0), chance, *added)

            zero = dr.zeros(type(rate), dr.width(rate))
            start = (zero, dr.exp(-rate), zero, *(zero + 0.0 for _ in range(6)))
            *_, value, by_rate, by_signal, by_slope, by_bend, by_sigma = dr.while_loop(
                start, lambda n, *_: n <= last, body
            )
        line = (
            by_rate * self.rate
            + by_signal * self.signal
            + by_slope * self.slope
            + by_bend * self.bend
            + by_sigma * self.sigma
        )
        return dr.replace_grad(value, line)

    def _over_cells(self, function: Callable[[Array, Array], WithSlopes]) -> Array:
        """The mean of f over normal cells of the count, each of which ends at the well, if that is near; 0 elsewhere.

        A cell at n_j with σ_j = CELL_SIGMA·√λ has E[min(n, W)] electrons, whose derivative by n_j is Φ((W − n_j)/σ_j).
        """
        dr, rho = self.dr, math.sqrt(1 - CELL_SIGMA**2)
        with dr.suspend_grad():
            rate, well_e, signal, slope, bend, sigma = map(
                dr.detach,
                (self.rate, self.well_e, self.signal, self.slope, self.bend, self.sigma),
            )
            root = dr.sqrt(dr.maximum(rate, 1.0))
            width = CELL_SIGMA * root
            last = dr.select(self._near_well, REACH, -2 * REACH)

            def body(z: Array, *sums: Array) -> tuple[Array, ...]:
                chance = CELL / math.sqrt(2 * math.pi) * dr.exp(-0.5 * z * z)
                u = dr.clip((well_e - rate - rho * z * root) / width, -REACH, REACH)
                is_open, density = self._normal(u)
                below = u * (1.0 - is_open) - density
                square = is_open - u * density + u * u * (1.0 - is_open)
                off = dr.minimum(rho * z * root, well_e - rate + REACH * width) + width * below
                gain = slope + 2.0 * bend * off
                noise = gain * width
                rest = dr.maximum(square - below * below, 0.0)
                spread = dr.sqrt(dr.maximum(sigma * sigma + noise * noise * rest, 1e-12))
                found = function(signal + slope * off + bend * off * off, spread)
                by_mean = chance * found.by_mean
                moves = is_open * (1.0 + 0.5 * rho * z / root) - density * (
                    0.5 * CELL_SIGMA / root
                )
                terms = (
                    chance * found.value,
                    by_mean * gain * moves,
                    by_mean * gain * (1.0 - is_open),
                    by_mean,
                    by_mean * off,
                    by_mean * off * off,
                    chance * found.by_sigma * sigma / spread,
                )
                added = (x + term for x, term in zip(sums, terms, strict=True))
                return (z + CELL, *added)

            zero = dr.zeros(type(rate), dr.width(rate))
            start = (zero - REACH, *(zero + 0.0 for _ in range(7)))
            *_, value, by_rate, by_well, by_signal, by_slope, by_bend, by_sigma = dr.while_loop(
                start, lambda z, *_: z <= last, body
            )
        line = (
            by_rate * self.rate
            + by_well * self.well_e
            + by_signal * self.signal
            + by_slope * self.slope
            + by_bend * self.bend
            + by_sigma * self.sigma
        )
        return dr.replace_grad(value, line)


def pixel_law(slope: ConditionalSlope, start: Electrons, frame: Frame) -> PixelLaw:
    """The law behind the stages of a chain.  start : mean photoelectrons.

    Raises InputError for a chain whose pixels have no such law.
    """
    refuse_without_law(slope)
    backend = frame.window.backend
    assert isinstance(backend, AttachedBackend)
    dr = backend.dr
    mean = sample(slope.before, start, QuietFrame.of(frame))
    sample(slope.count, mean, frame)  # not computed: it goes past the numbers of these stages
    zeros = dr.zeros(backend.float, frame.window.shape[0] * frame.window.shape[1])
    rate = dr.maximum(backend.float(mean.total) + zeros, 0.0)
    behind, well_e = slope.behind, None
    if behind[0].saturation_e is not None:
        well_e = behind[0].sample(Electrons(zeros + 2.0 * behind[0].saturation_e), frame).total
        behind = behind[1:]
    signal = _Signal(behind, frame, backend, backend.place)
    at = dr.detach(rate)
    step = dr.maximum(2.0 * dr.sqrt(at), 1.0)
    here, above, below = (signal(at + step * k) for k in (0.0, 1.0, -1.0))
    slope_dn = (above - below) / (2.0 * step)
    sigma_dn, bend_dn = signal.dark_sigma(zeros), zeros
    if any(stage.curved for stage in behind):
        sigma_dn = sigma_dn * slope_dn / signal.dark_slope(zeros)
        bend_dn = (above - 2.0 * here + below) / (2.0 * step * step)
    return PixelLaw(
        dr,
        slope.converter.highest,
        rate,
        here,
        slope_dn,
        bend_dn,
        sigma_dn,
        well_e,
        counted=bool(slope.count),
    )


def refuse_without_law(slope: ConditionalSlope) -> None:
    """Raise InputError for stages whose pixels have no count of Poisson's law and no normal noise behind it."""
    way_out = "take sampled digital numbers (expected=False), or the camera without it"
    if len(slope.count) > 1:
        raise InputError(
            f"{slope.count[1].label} multiplies electrons, and the expected code of such a chain is not known here; "
            f"{way_out}."
        )
    if slope.converter.inl_lsb is not None:
        raise InputError(
            f"adc.dnl_lsb is given, and the expected code behind unequal steps is not known here; {way_out}."
        )
    for stage in slope.behind:
        if stage.saturation_e is not None and stage.curved:
            raise InputError(
                "pixel.full_well_knee_e is given, and the expected code behind a soft saturation is not known here; "
                f"{way_out}."
            )
    for stage in (*slope.before, *slope.behind):
        if type(stage).outcomes is not Stage.outcomes or stage.key() == "rtn_pixels":
            raise InputError(
                f"{stage.label} switch between two states, and the expected code of such a chain is not known here; "
                f"{way_out}."
            )


@dataclass(frozen=True, eq=False)
class _Signal:
    """What the converter rounds, as a function of the count.  place : of the numbers of these stages."""

    behind: tuple[Stage, ...]
    frame: Frame
    backend: AttachedBackend
    place: int

    def __call__(self, count: Array, frame: Frame | None = None) -> Array:
        """Without temporal noise, or in a frame that has some of it [DN]."""
        quiet = QuietFrame.of(self.frame) if frame is None else frame
        converter = self.behind[-1]
        assert isinstance(converter, Converter)
        with self.backend.again(self.place, derivatives=True):
            swing = sample(self.behind[:-1], Electrons(count), quiet)
            return converter.ideal(swing, quiet)

    def dark_sigma(self, zeros: Array) -> Array:
        """σ of the temporal noise behind no electrons [DN]; behind many, float32 has too few digits for it."""
        quiet = QuietFrame.of(self.frame)
        middle, variance = self(zeros, quiet), zeros
        for source in sorted(quiet.sources):
            step = self(zeros, QuietFrame.of(self.frame, source)) - middle
            variance = variance + step * step
        return self.backend.dr.sqrt(self.backend.dr.maximum(variance, 1e-12))

    def dark_slope(self, zeros: Array) -> Array:
        """x'(0) [DN/e-]."""
        return (self(zeros + DARK_STEP_E) - self(zeros)) / DARK_STEP_E
