"""Noise budget: how much mean and variance of the digital numbers change without each source of noise.

The samples of expected.py are taken with everything and without one source, by the same random numbers: all other
sources keep theirs, and the difference is what the source does. Clipped pixels do not count. A source in front of the
count is taken out of mean electrons, so that the shot noise of its electrons counts as shot noise.
"""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..core import Array, Frame
from ..core.types import Float64Array
from ..sensor.run import strips_of
from ..sensor.threads import for_each
from ..stages.stage import ElectronCounter, Stage, converter_of, place_of, sample
from .expected import Expectation, as_values, ideal_code, is_clipped, passed_on, signals
from .notebook import budget_html
from .report import error_of_root

ROUNDING, ROUNDING_DN2 = 1e-6, 1e-9
"""Variances below this share of the total, or below this, are rounding of float32 [DN²]."""
LEAST_MEAN_DN = 5e-4
"""A source of no variance and a smaller mean has no effect [DN]."""
ERRORS = 3.0
"""Standard errors that a variance is from 0 to be shown as a number."""
REST, TOTAL = "sources together", "total"
HEADINGS = ("source", "mean [DN]", "temporal σ [DN]", "spatial σ [DN]", "% of total")
COLUMNS = (
    "mean: what the source adds to the digital numbers; temporal σ: its noise from frame to frame; spatial σ: its "
    "fixed pattern, from pixel to pixel, each with its standard error; <: not seen, with the largest that it may be; "
    "%: of the variance of the digital numbers"
)
OF_REST = f"{REST}: what the sources do not do each by itself, because they change each other"
LESS_NOISE = "below zero: the source takes away noise of the others"


class BudgetRow(NamedTuple):
    """One source, or the total, with standard errors.

    mean_dn : what it adds to the digital numbers.  temporal_dn2, spatial_dn2 : to the two variances; negative where it
        takes noise away.  share : of the total variance.
    """

    source: str
    mean_dn: float
    temporal_dn2: float
    spatial_dn2: float
    share: float
    mean_error_dn: float = 0.0
    temporal_error_dn2: float = 0.0
    spatial_error_dn2: float = 0.0

    @property
    def takes_noise(self) -> bool:
        """Whether one of its variances is negative beyond chance."""
        return (
            self.temporal_dn2 < -ERRORS * self.temporal_error_dn2 - ROUNDING_DN2
            or self.spatial_dn2 < -ERRORS * self.spatial_error_dn2 - ROUNDING_DN2
        )

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Mean, σ and share as text; – for no noise."""
        share = f"{100 * self.share:.1f}"
        if not (self.temporal_dn2 or self.spatial_dn2):
            share = "–"
        elif abs(self.share) < 5e-4:
            share = "<0.1"
        return (
            "0" if float(f"{self.mean_dn:.3f}") == 0 else f"{self.mean_dn:.3f}",
            _sigma_text(self.temporal_dn2, self.temporal_error_dn2),
            _sigma_text(self.spatial_dn2, self.spatial_error_dn2),
            share,
        )


@dataclass(frozen=True, eq=False)
class Contribution:
    """What one source contributes to the pixels that are not clipped.

    mean_dn, rms_dn : what it changes on average, and the standard deviation of that over pixels and frames, which for
        the light is that of the image [DN].
    temporal_dn2, spatial_dn2 : what it adds to the two variances [DN²]; negative where it reduces noise.
    errors : standard errors of mean [DN], temporal and spatial variance [DN²].
    """

    source: str
    mean_dn: float
    rms_dn: float
    temporal_dn2: float
    spatial_dn2: float
    errors: tuple[float, float, float]
    _stage: Stage
    _share: float
    _budget: NoiseBudget

    def __repr__(self) -> str:
        variances = f"{self.temporal_dn2:.4g} temporal, {self.spatial_dn2:.4g} spatial DN²"
        return f"<Contribution: {self.source}, mean {self.mean_dn:.4g} DN, {variances}>"

    @cached_property
    def dn(self) -> Float64Array:
        """What it changes in every pixel of the first frame, (H, W) [DN]; computed when it is asked for."""
        return self._share * self._budget.change_of(self._stage)

    @property
    def is_idle(self) -> bool:
        """Whether it changes neither signal nor noise."""
        variances_dn2 = abs(self.temporal_dn2), abs(self.spatial_dn2)
        return max(variances_dn2) < ROUNDING_DN2 and abs(self.mean_dn) < LEAST_MEAN_DN


@dataclass(frozen=True, eq=False)
class NoiseBudget:
    """The contributions of all sources to frames.

    The first source is the light, whose mean is that of its electrons by the nominal gains; the last one is the
    converter: black level, rounding, unequal steps.

    theory : of the frames, whose samples are taken.
    """

    theory: Expectation

    def __repr__(self) -> str:
        rows, columns = self.theory.frame.window.shape
        return f"<NoiseBudget: {len(self.theory.stages)} sources, {rows} × {columns} pixels; print(….explain())>"

    @cached_property
    def entries(self) -> tuple[Contribution, ...]:
        """One per source, in the order of the chain."""
        found = []
        averages, all_errors = self._sums
        least_dn2 = max(ROUNDING * float(averages[-1, 1:3].sum()), ROUNDING_DN2)
        for stage, shares, values, errors in zip(
            self.theory.stages, self._shares, averages[:-2], all_errors[:-2], strict=True
        ):
            mean, temporal, spatial, square = values.tolist()
            temporal, spatial = (0.0 if abs(x) < least_dn2 else x for x in (temporal, spatial))
            errors = np.where([mean != 0, temporal != 0, spatial != 0, True], errors, 0.0)
            rms = math.sqrt(max(square - mean**2, 0.0))
            for source, share in shares.items():
                parts = share * mean, math.sqrt(share) * rms, share * temporal, share * spatial
                three = tuple((share * errors[:3]).tolist())
                found.append(Contribution(source, *parts, three, stage, share, self))
        return tuple(found)

    @property
    def rows(self) -> list[BudgetRow]:
        """What :meth:`explain` prints: the sources that have an effect, what they do together, and the total."""
        (*_, rest, total_dn), (*_, rest_error, total_error) = self._sums
        whole = float(total_dn[1] + total_dn[2]) or 1.0
        lines = [
            (one.source, (one.mean_dn, one.temporal_dn2, one.spatial_dn2), one.errors)
            for one in self.entries
            if not one.is_idle
        ]
        if np.any(np.abs(rest[1:3]) > ERRORS * rest_error[1:3] + ROUNDING_DN2):
            lines.append((REST, rest.tolist(), rest_error.tolist()))
        lines.append((TOTAL, total_dn.tolist(), total_error.tolist()))
        return [
            BudgetRow(source, *values[:3], (values[1] + values[2]) / whole, *errors[:3])
            for source, values, errors in lines
        ]

    @property
    def clipped(self) -> float:
        """Share of the pixels that are clipped, which do not count."""
        kept = float(self._windows[0].sum())
        return 1 - kept / self.theory.pixels

    @property
    def remarks(self) -> list[str]:
        """Sentences below the rows."""
        found, rows = [], self.rows
        if self.clipped:
            found.append(f"{_percent(self.clipped)} of the pixels are clipped and do not count")
        found.append(COLUMNS)
        if any(row.source == REST for row in rows):
            found.append(OF_REST)
        if any(row.takes_noise for row in rows[:-1]):
            found.append(LESS_NOISE)
        idle = [one.source for one in self.entries if one.is_idle]
        if idle and self.clipped < 1:
            found.append(f"without effect here: {', '.join(idle)}")
        return found

    def explain(self) -> str:
        """A table for people: σ and share of the variance of each source, and their total."""
        rows = self.rows
        lines = [HEADINGS, *((row.source, *row.cells) for row in rows)]
        first = max(len(row.source) for row in rows) + 1
        widths = [max(len(name) + 2, 11) for name in HEADINGS[1:]]
        text = []
        for name, *cells in lines:
            columns = (f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
            text.append(f"{name:<{first}}{''.join(columns)}")
        below = (textwrap.fill(remark, first + sum(widths)) for remark in self.remarks)
        return "\n".join([*text, *below])

    def _repr_html_(self) -> str:
        return budget_html(self, HEADINGS)

    def change_of(self, stage: Stage) -> Float64Array:
        """What a stage changes in every pixel of the first frame, (H, W) [DN]."""
        theory = self.theory
        whole, found = theory.frame, np.empty(theory.frame.window.shape)
        for strip in strips_of(theory.stages, whole.window):
            frame = replace(whole, window=whole.window.crop_rows(strip.around), _blocks={})
            light = theory.light.crop_rows(strip.around).signal
            behind = list(signals(theory.stages, light, frame))
            number = place_of(stage, theory.stages)
            one, other = self._with_and_without(number, behind, frame)
            found[strip.rows] = (one - other)[strip.inside]
        return found

    # -- samples -----------------------------------------------------------------------------------------------------

    @cached_property
    def _windows(self) -> tuple[Float64Array, Float64Array]:
        """Of each window: pixels that count, (W,); mean, temporal and spatial variance, mean square of what each stage
        changes, and of all, (W, S + 1, 4)."""
        count = len(self.theory.windows)
        kept, found = np.zeros(count), np.zeros((count, len(self.theory.stages) + 1, 4))

        def write(number: int) -> None:
            kept[number], found[number] = self._window(number)

        for_each(write, range(count))
        return kept, found

    def _window(self, number: int) -> tuple[int, Float64Array]:
        theory, inside = self.theory, self.theory.windows[number].inside
        light = theory.light_of(number)
        codes, swings, changes, keep = [], [], [], np.ones((1, 1), bool)
        for frame in (one for sensor in theory.frames_of(number) for one in sensor):
            behind = list(signals(theory.stages, light, frame))
            keep = keep & ~is_clipped(theory.stages, behind, frame)[inside]
            codes.append(as_values(behind[-1], frame)[inside])
            pairs = [self._with_and_without(k, behind, frame) for k in range(len(behind))]
            swings.append([one[inside] for one, _ in pairs])
            changes.append([one[inside] - other[inside] for one, other in pairs])
        pixels = int(keep.sum())
        if not pixels:
            return 0, np.zeros((len(theory.stages) + 1, 4))
        code, swing, change = (
            np.moveaxis(np.array(x)[..., keep].reshape(2, 2, -1, pixels), 2, 0)
            for x in (codes, swings, changes)
        )
        rows = []
        for k, (whole, own) in enumerate(zip(swing, change, strict=True)):
            variances = _variances(whole) - _variances(whole - own) if k else np.zeros(2)
            rows.append([own.mean(), *variances, (own**2).mean()])
        rows.append([code.mean(), *_variances(code[0]), (code**2).mean()])
        return pixels, np.array(rows)

    def _with_and_without(
        self, number: int, behind: list[Array], frame: Frame
    ) -> tuple[Float64Array, Float64Array]:
        """The digital numbers of one frame with and without stage ``number``, before rounding and clips [DN].

        behind : the signals behind every stage. The light is against darkness, the converter against its codes without
        black level, rounding and unequal steps.
        """
        stages, count = self.theory.stages, self._count
        if number == 0:
            light_dn = self._dn_per_e * as_values(behind[0], frame)
            return light_dn, np.zeros(light_dn.shape)
        whole = ideal_code(stages, behind[-2], frame)
        if number == len(stages) - 1:
            code = as_values(behind[-1], frame)
            return code, whole - converter_of(stages).black_level_dn
        signal = passed_on(stages[number], behind[number - 1], frame)
        if _is_same(signal, behind[number], frame):
            return whole, whole
        if number >= count:
            return whole, self._carried(number, signal, frame)
        last = sample(stages[number + 1 : count], signal, frame)
        return self._carried(count, behind[count - 1], frame), self._carried(count, last, frame)

    def _carried(self, number: int, signal: Array, frame: Frame) -> Float64Array:
        """The digital numbers before rounding and clips, of a signal in place of that behind stage ``number``."""
        stages = self.theory.stages
        signal = passed_on(stages[number], signal, frame) if number == self._count else signal
        return ideal_code(stages, sample(stages[number + 1 : -1], signal, frame), frame)

    @cached_property
    def _count(self) -> int:
        """Number of the stage that counts electrons; 0 without one."""
        return next((k for k, one in enumerate(self.theory.stages) if one.counts_electrons), 0)

    @cached_property
    def _dn_per_e(self) -> float:
        """Nominal gain from electrons to digital numbers."""
        return math.prod(stage.nominal_gain for stage in self.theory.stages[1:])

    @cached_property
    def _sums(self) -> tuple[Float64Array, Float64Array]:
        """Averages over the windows and their standard errors, (S + 2, 4): each stage, the rest, the total."""
        kept, found = self._windows
        rest = found[:, -1:] - found[:, :-1].sum(axis=1, keepdims=True)
        values = np.concatenate([found[:, :-1], rest, found[:, -1:]], axis=1)
        return self.theory.errors_of(values, kept)

    @cached_property
    def _shares(self) -> list[dict[str, float]]:
        """Sources of each stage, and their shares of what it does: as the variances that they state."""
        theory, found = self.theory, list[dict[str, float]]()
        middle = len(theory.windows) // 2
        frame = theory.frames_of(middle)[0][0]
        behind = list(signals(theory.stages, theory.light_of(middle), frame))
        for k, stage in enumerate(theory.stages):
            variances = (
                stage.variances(behind[k - 1]) if isinstance(stage, ElectronCounter) else {}
            )
            stated = {name: float(np.mean(x)) for name, x in variances.items()}
            whole = sum(stated.values())
            if not whole:
                stated = dict.fromkeys(stated or [stage.label], 1.0)
            whole = sum(stated.values())
            found.append({name: variance / whole for name, variance in stated.items()})
        return found


def _variances(x: Float64Array) -> Float64Array:
    """Temporal and spatial variance of samples, (2, 2, P)."""
    temporal = ((x[:, 0] - x[:, 1]) ** 2).mean() / 2
    spatial = ((x[0, 0] - x[1, 0]) * (x[0, 1] - x[1, 1])).mean() / 2
    return np.array([temporal, spatial])


def _is_same(one: Array, other: Array, frame: Frame) -> bool:
    """Whether two signals have the same values."""
    if one is other:
        return True
    return np.array_equal(as_values(one, frame), as_values(other, frame))


def _sigma_text(variance_dn2: float, error_dn2: float) -> str:
    """The root of a variance with its sign and its standard error; a bound where it was not seen."""
    if abs(variance_dn2) < ROUNDING_DN2 and error_dn2 < ROUNDING_DN2:
        return "–"
    if abs(variance_dn2) <= ERRORS * error_dn2:
        return f"<{math.sqrt(max(variance_dn2, 0.0) + 2 * error_dn2):.2g}"
    sigma = math.copysign(math.sqrt(abs(variance_dn2)), variance_dn2)
    error = error_of_root(abs(variance_dn2), error_dn2)
    return f"{sigma:.4g}±{error:.1g}" if error > 1e-4 * abs(sigma) else f"{sigma:.4g}"


def _percent(share: float) -> str:
    return "less than 0.1 %" if share < 1e-3 else f"{100 * share:.3g} %"
