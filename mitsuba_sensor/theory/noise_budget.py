"""Noise budget: change of mean and variance of the digital numbers without each noise source.

The chain of expected.py is sampled with all sources and without one source, with the same random numbers: the other
sources keep theirs, so the difference is the effect of the source. Clipped pixels do not count. A source before shot
noise is removed from mean electrons, so the shot noise of its electrons counts as shot noise.
"""

from __future__ import annotations

import math
import textwrap
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core import Array, Electrons, Frame
from ..core.html import Table, fragment
from ..core.plots import labelled_axes
from ..core.types import Float64Array
from ..sensor.run import strips_of
from ..sensor.threads import for_each
from ..stages.stage import converter_of, place_of_count, sample
from .expected import (
    Expectation,
    as_values,
    ideal_code,
    is_clipped,
    passed_on,
    signals,
    variances_of,
)
from .report import error_of_root

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROUNDING, ROUNDING_DN2 = 1e-6, 1e-9
"""Variances below this fraction of the total, or below this value [DN²], are rounding of float32."""
MEAN_MIN_DN = 5e-4
"""A source without variance and with a smaller mean has no effect [DN]."""
ERRORS = 3.0
"""A variance is shown as a number if it differs from 0 by more than this many standard errors."""
REST, TOTAL = "sources together", "total"
HEADINGS = ("source", "mean [DN]", "temporal σ [DN]", "spatial σ [DN]", "% of total")
COLUMNS = (
    "mean: what the source adds to the digital numbers; temporal σ: its noise from frame to frame; spatial σ: its "
    "fixed pattern from pixel to pixel, both with standard error; <: upper limit of an effect that was not seen; "
    "%: of the variance of the digital numbers"
)
OF_REST = f"{REST}: the effect of sources on each other"
LESS_NOISE = "below zero: the source reduces the noise of other sources"


class Contribution(NamedTuple):
    """Contribution of one source, or of all, to the unclipped pixels, with standard errors.

    mean_dn : change of the mean [DN].
    temporal_dn2, spatial_dn2 : change of the variances [DN²], negative if the source reduces noise.
    share : fraction of the total variance.
    rms_dn : standard deviation of the change over pixels and frames [DN]; for the light, that of the image.
    """

    source: str
    mean_dn: float
    temporal_dn2: float
    spatial_dn2: float
    share: float
    mean_error_dn: float
    temporal_error_dn2: float
    spatial_error_dn2: float
    rms_dn: float

    def __repr__(self) -> str:
        variances = f"temporal {self.temporal_dn2:.4g}, spatial {self.spatial_dn2:.4g} DN²"
        return f"<Contribution: {self.source}, mean {self.mean_dn:.4g} DN, {variances}>"

    @property
    def takes_noise(self) -> bool:
        """True if one of the variances is significantly negative."""
        return (
            self.temporal_dn2 < -ERRORS * self.temporal_error_dn2 - ROUNDING_DN2
            or self.spatial_dn2 < -ERRORS * self.spatial_error_dn2 - ROUNDING_DN2
        )

    def shown_sigma_dn(self, name: str) -> float:
        """Return the temporal or spatial σ [DN], 0 for a variance within its errors of 0."""
        variance, error = getattr(self, f"{name}_dn2"), getattr(self, f"{name}_error_dn2")
        return math.sqrt(variance) if variance > ERRORS * error else 0.0

    @property
    def is_idle(self) -> bool:
        """True if the source changes neither signal nor noise."""
        variances_dn2 = abs(self.temporal_dn2), abs(self.spatial_dn2)
        return max(variances_dn2) < ROUNDING_DN2 and abs(self.mean_dn) < MEAN_MIN_DN

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Mean, both σ and share as text; – for no noise."""
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
class NoiseBudget:
    """Contributions of all noise sources to frames.

    The first source is the light; its mean is that of its electrons, by the nominal gains. The last source is the ADC:
    black level, rounding, unequal steps.

    theory : expectation of the frames, which takes the samples.
    """

    theory: Expectation

    def __repr__(self) -> str:
        rows, columns = self.theory.frame.window.shape
        return f"<NoiseBudget: {len(self.theory.stages)} sources, {rows} × {columns} pixels; print(….explain())>"

    @cached_property
    def entries(self) -> tuple[Contribution, ...]:
        """One contribution per source, in the order of the chain."""
        *of_stages, _, _ = self._contributions
        return tuple(of_stages)

    @property
    def rows(self) -> list[Contribution]:
        """The rows of :meth:`explain`: sources with an effect, their effect on each other, and the total."""
        *entries, rest, whole = self._contributions
        shown = [one for one in entries if not one.is_idle]
        temporal, spatial = abs(rest.temporal_dn2), abs(rest.spatial_dn2)
        if (
            temporal > ERRORS * rest.temporal_error_dn2 + ROUNDING_DN2
            or spatial > ERRORS * rest.spatial_error_dn2 + ROUNDING_DN2
        ):
            shown.append(rest)
        return [*shown, whole]

    @property
    def clipped(self) -> float:
        """Fraction of the pixels that are clipped and do not count."""
        return 1 - float(self._windows[0].sum()) / self.theory.pixels

    @property
    def remarks(self) -> list[str]:
        """Sentences below the rows."""
        found, rows = [], self.rows
        if self.clipped:
            share = "less than 0.1 %" if self.clipped < 1e-3 else f"{100 * self.clipped:.3g} %"
            found.append(f"{share} of the pixels are clipped and do not count")
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
        """Return a table for people: σ and fraction of the variance of each source, and the total."""
        rows = self.rows
        first = max(len(row.source) for row in rows) + 1
        widths = [max(len(name) + 2, 11) for name in HEADINGS[1:]]
        text = []
        for name, *cells in (HEADINGS, *((row.source, *row.cells) for row in rows)):
            columns = (f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
            text.append(f"{name:<{first}}{''.join(columns)}")
        below = (textwrap.fill(remark, first + sum(widths)) for remark in self.remarks)
        return "\n".join([*text, *below])

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw temporal and spatial σ of each source as bars with Matplotlib; return the axes."""
        shown = self.rows[::-1]
        drawn = labelled_axes(axes, "Noise budget of one frame", "σ [DN]", "")
        places = np.arange(len(shown))
        for name, offset in (("temporal", 0.2), ("spatial", -0.2)):
            sigma_dn = [row.shown_sigma_dn(name) for row in shown]
            drawn.barh(places + offset, sigma_dn, 0.4, label=f"{name} noise")
        drawn.set_yticks(places, [row.source for row in shown])
        drawn.legend()
        return drawn

    def _repr_html_(self) -> str:
        lines = [(row.source, *row.cells) for row in self.rows]
        title = f"Noise budget of one frame ({'; '.join(self.remarks)})"
        return fragment(title, Table(HEADINGS, lines))

    def change_of(self, source: str) -> Float64Array:
        """Return the change by a source in every pixel of the first frame, shape (H, W) [DN]."""
        theory = self.theory
        number, share = next(
            (k, of_stage[source])
            for k, of_stage in enumerate(self._shares)
            if source in of_stage
        )
        whole, found = theory.frame, np.empty(theory.frame.window.shape)
        for strip in strips_of(theory.stages, whole.window):
            frame = replace(whole, window=whole.window.crop_rows(strip.around), _blocks={})
            light = theory.light.crop_rows(strip.around).signal
            outputs = list(signals(theory.stages, light, frame))
            one, other = self._with_and_without(number, outputs, frame)
            found[strip.rows] = (one - other)[strip.inside]
        return share * found

    # -- samples -----------------------------------------------------------------------------------------------------

    @cached_property
    def _contributions(self) -> list[Contribution]:
        """Contributions of each source, of the sources on each other, and of all."""
        kept, found = self._windows
        rest = found[:, -1:] - found[:, :-1].sum(axis=1, keepdims=True)
        values = np.concatenate([found[:, :-1], rest, found[:, -1:]], axis=1)
        averages, all_errors = self.theory.errors_of(values, kept)
        whole_dn2 = float(averages[-1, 1:3].sum())
        least_dn2 = max(ROUNDING * whole_dn2, ROUNDING_DN2)
        contributions = []
        for sources, row, errors in zip(
            [*self._shares, {REST: 1.0}, {TOTAL: 1.0}], averages, all_errors, strict=True
        ):
            if REST not in sources and TOTAL not in sources:
                row[1:3][np.abs(row[1:3]) < least_dn2] = 0.0
                errors = np.where(row != 0, errors, 0.0)
            mean, temporal, spatial, square = row.tolist()
            rms = math.sqrt(max(square - mean**2, 0.0))
            for source, part in sources.items():
                mean_dn, temporal_dn2, spatial_dn2 = (
                    part * np.array([mean, temporal, spatial])
                ).tolist()
                of_total = part * (temporal + spatial) / (whole_dn2 or 1.0)
                first, second, third = (part * errors[:3]).tolist()
                contribution = Contribution(
                    source, mean_dn, temporal_dn2, spatial_dn2, of_total, first, second, third,
                    math.sqrt(part) * rms,
                )  # fmt: skip
                contributions.append(contribution)
        return contributions

    @cached_property
    def _windows(self) -> tuple[Float64Array, Float64Array]:
        """Unclipped pixels of each window, shape (W,), and its statistics, shape (W, S + 1, 4).

        The statistics of each stage's change, and of the codes: mean, temporal and spatial variance, mean square.
        """
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
            outputs = list(signals(theory.stages, light, frame))
            keep = keep & ~is_clipped(theory.stages, outputs, frame)[inside]
            codes.append(as_values(outputs[-1], frame)[inside])
            pairs = [self._with_and_without(k, outputs, frame) for k in range(len(outputs))]
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
            variances = np.zeros(2)
            if k:
                variances = np.subtract(variances_of(whole), variances_of(whole - own))
            rows.append([own.mean(), *variances, (own**2).mean()])
        rows.append([code.mean(), *variances_of(code[0]), (code**2).mean()])
        return pixels, np.array(rows)

    def _with_and_without(
        self, number: int, outputs: list[Array], frame: Frame
    ) -> tuple[Float64Array, Float64Array]:
        """Return the digital numbers of one frame with and without a stage, before rounding and clipping [DN].

        outputs : the signals after every stage. Without light it is dark; without the ADC there is no black level,
        rounding or unequal step.
        """
        stages, count = self.theory.stages, self._count
        if number == 0:
            gain = math.prod(stage.nominal_gain for stage in stages[1:])
            light_dn = gain * as_values(outputs[0], frame)
            return light_dn, np.zeros(light_dn.shape)
        whole = ideal_code(stages, outputs[-2], frame)
        if number == len(stages) - 1:
            return as_values(outputs[-1], frame), whole - converter_of(stages).black_level_dn
        signal = passed_on(stages[number], outputs[number - 1], frame)
        is_same = signal is outputs[number] or np.array_equal(
            as_values(signal, frame), as_values(outputs[number], frame)
        )
        if is_same:
            return whole, whole
        if number >= count:
            return whole, self._carried(number, signal, frame)
        last = sample(stages[number + 1 : count], signal, frame)
        return self._carried(count, outputs[count - 1], frame), self._carried(
            count, last, frame
        )

    def _carried(self, number: int, signal: Array, frame: Frame) -> Float64Array:
        """Return the digital numbers before rounding and clipping for this signal after stage ``number``."""
        stages = self.theory.stages
        signal = passed_on(stages[number], signal, frame) if number == self._count else signal
        return ideal_code(stages, sample(stages[number + 1 : -1], signal, frame), frame)

    @cached_property
    def _count(self) -> int:
        return place_of_count(self.theory.stages)

    @cached_property
    def _shares(self) -> list[dict[str, float]]:
        """Sources of each stage with their fractions of its effect: shot noise of photons and of dark electrons."""
        theory, middle = self.theory, len(self.theory.windows) // 2
        found = [{stage.label: 1.0} for stage in theory.stages]
        if self._count:
            frame, light = theory.frames_of(middle)[0][0], theory.light_of(middle)
            mean: Electrons = sample(theory.stages[1 : self._count], light, frame)
            total = float(np.mean(mean.total))
            dark = float(np.mean(mean.dark)) / total if total else 1.0
            found[self._count] = {"photon shot noise": 1 - dark, "dark shot noise": dark}
        return found


def _sigma_text(variance_dn2: float, error_dn2: float) -> str:
    """Return the signed root of a variance with its standard error, or an upper limit if it was not seen."""
    if abs(variance_dn2) < ROUNDING_DN2 and error_dn2 < ROUNDING_DN2:
        return "–"
    if abs(variance_dn2) <= ERRORS * error_dn2:
        return f"<{math.sqrt(max(variance_dn2, 0.0) + 2 * error_dn2):.2g}"
    sigma = math.copysign(math.sqrt(abs(variance_dn2)), variance_dn2)
    error = error_of_root(abs(variance_dn2), error_dn2)
    return f"{sigma:.4g}±{error:.1g}" if error > 1e-4 * abs(sigma) else f"{sigma:.4g}"
