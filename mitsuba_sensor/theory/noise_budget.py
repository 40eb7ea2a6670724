"""Noise budget: what every source contributes to the pixels of one frame, and to the variances, in digital numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core import Array, CountedElectrons, Electrons, Frame
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.run import Strip, strips_of
from ..sensor.threads import processors
from ..stages.stage import Chain, total
from .budget_rows import BudgetRow, budget_rows, idle_sources, remarks_on, table_text
from .frame_theory import FrameTheory
from .notebook import budget_html

Contributions = list[dict[str, tuple[Float64Array, Array]]]
"""By stage: source → its contribution to every pixel of a strip, and the variance that it states [DN, DN²]."""


@dataclass(frozen=True, eq=False)
class Contribution:
    """What one source contributes to a frame.

    mean_dn, rms_dn : its average over the pixels of this frame, and their standard deviation about that (root mean
        square), which for the light is that of the picture [DN].
    temporal_dn2, spatial_dn2 : what it adds to the two variances on average [DN²]; negative where a clip reduces noise.
    """

    source: str
    mean_dn: float
    rms_dn: float
    temporal_dn2: float
    spatial_dn2: float
    _budget: NoiseBudget

    def __repr__(self) -> str:
        variances = f"{self.temporal_dn2:.4g} temporal, {self.spatial_dn2:.4g} spatial DN²"
        return f"<Contribution: {self.source}, mean {self.mean_dn:.4g} DN, {variances}>"

    @cached_property
    def dn(self) -> Float64Array:
        """Its contribution to every pixel, (H, W) [DN]; computed when it is asked for."""
        return np.concatenate([found[self.source] for _, found in self._budget.strips()])


@dataclass(frozen=True, eq=False)
class NoiseBudget:
    """The contributions of all sources: they add up to the digital numbers, the variances to those of the theory.

    A contribution is the change that a stage makes, carried to DN by the nominal gains of the stages behind it. The
    frame is computed strip by strip: no more than a few strips are in memory at a time.

    stages, light, frame : of one frame.  theory : of its pixels.
    """

    stages: Chain
    light: Detected
    frame: Frame
    theory: FrameTheory

    def __repr__(self) -> str:
        rows, columns = self.frame.window.shape
        return f"<NoiseBudget: {len(self.stages)} sources, {rows} × {columns} pixels; print(….explain())>"

    @cached_property
    def entries(self) -> tuple[Contribution, ...]:
        """One per source, in the order of the chain."""
        with ThreadPoolExecutor(processors()) as pool:
            strips = list(pool.map(lambda strip: _sums(self._strip(strip)), self._strips))
        pixels = self.frame.window.shape[0] * self.frame.window.shape[1]
        entries, was = [], (0.0, 0.0)
        for number, (stage, to_dn) in enumerate(zip(self.stages, self._to_dn, strict=True)):
            expected = self.theory.averages(stage)
            now = expected.temporal * to_dn**2, expected.spatial * to_dn**2
            sums = {
                source: np.sum([s[number][source] for s in strips], axis=0) / pixels
                for source in strips[0][number]
            }
            stated = sum(variance for _, _, variance in sums.values())
            for source, (mean, square, variance) in sums.items():
                share, rms = (
                    variance / stated if stated else 1 / len(sums),
                    math.sqrt(max(square - mean**2, 0.0)),
                )
                temporal, spatial = (
                    share * (new - old) for new, old in zip(now, was, strict=True)
                )
                entries.append(Contribution(source, float(mean), rms, temporal, spatial, self))
            was = now
        return tuple(entries)

    def strips(self) -> Iterator[tuple[slice, dict[str, Float64Array]]]:
        """Rows of the window, and the contribution of every source to their pixels [DN]."""
        for strip in self._strips:
            yield (
                strip.rows,
                {
                    source: values
                    for stage in self._strip(strip)
                    for source, (values, _) in stage.items()
                },
            )

    @property
    def total(self) -> Float64Array:
        """The sum of all contributions: the frame itself, (H, W) [DN]."""
        return np.concatenate(
            [np.sum(list(found.values()), axis=0) for _, found in self.strips()]
        )

    @property
    def rows(self) -> list[BudgetRow]:
        """What :meth:`explain` prints: the sources that have an effect, and their sum."""
        return budget_rows(self.entries)

    @property
    def remarks(self) -> list[str]:
        """Sentences below the rows: sources without effect, what the columns are, how the theory was found."""
        notes = [self.theory.note] if self.theory.note else []
        return [*remarks_on(self.rows, idle_sources(self.entries)), *notes]

    def explain(self) -> str:
        """A table for people: σ and share of the variance of each source, and their total."""
        return table_text(self.rows, self.remarks)

    def _repr_html_(self) -> str:
        return budget_html(self)

    @property
    def _strips(self) -> list[Strip]:
        return strips_of(self.stages, self.frame.window)

    def _strip(self, strip: Strip) -> Contributions:
        window = self.frame.window.crop_rows(strip.around)
        frame = replace(self.frame, window=window, _blocks={})
        found: Contributions = []
        light = self.light.crop_rows(strip.around)
        signal: Array = light.photons
        before = np.zeros(window.shape)
        for stage, to_dn in zip(self.stages, self._to_dn, strict=True):
            entering, signal = signal, stage.sample(signal, frame) if found else light.signal
            after = to_dn * np.broadcast_to(_float64(signal), before.shape)
            parts = stage.noise_sources(entering, signal)
            apart = {
                name: (to_dn * np.broadcast_to(x, before.shape), variance)
                for name, (x, variance) in parts.items()
            }
            by_source = _adding_up_to(after - before, apart) or {
                stage.label: (after - before, 0.0)
            }
            found.append(_inside(strip, by_source, window.shape))
            before = after
        return found

    @cached_property
    def _to_dn(self) -> list[float]:
        """Nominal gain from behind each stage to digital numbers."""
        gains = [stage.nominal_gain for stage in self.stages]
        return [float(np.prod(gains[k + 1 :])) for k in range(len(gains))]


def _adding_up_to(
    change: Float64Array, by_source: dict[str, tuple[Float64Array, Array]]
) -> dict[str, tuple[Float64Array, Array]]:
    """Contributions with the first one such that their sum is this change.

    Float32 has whole electrons up to 1.7e7 only: of more, the parts of a count do not add up to the count.
    """
    if not by_source:
        return {}
    (first, (_, variance)), *others = by_source.items()
    rest: Float64Array = change - sum(values for _, (values, _) in others)
    return {first: (rest, variance), **dict(others)}


def _inside(
    strip: Strip, by_source: dict[str, tuple[Float64Array, Array]], shape: tuple[int, int]
) -> dict[str, tuple[Float64Array, Array]]:
    """Contributions to the pixels that a strip delivers.  shape : of all that it computes."""
    return {
        source: (values[strip.inside], np.broadcast_to(variance, shape)[strip.inside])
        for source, (values, variance) in by_source.items()
    }


def _sums(strip: Contributions) -> list[dict[str, Float64Array]]:
    """Of every source the sums of its contribution, of its square, and of the variance that it states."""
    return [
        {
            source: np.array(
                [
                    x.sum(),
                    np.square(x).sum(),
                    np.broadcast_to(variance, x.shape).sum(dtype=np.float64),
                ]
            )
            for source, (x, variance) in stage.items()
        }
        for stage in strip
    ]


def _float64(signal: Array) -> Array:
    """The same in float64, so that the parts of a float32 frame add up too."""
    if isinstance(signal, Electrons) and not isinstance(signal, CountedElectrons):
        return np.add(signal.light, signal.dark, dtype=np.float64)
    return np.asarray(total(signal), dtype=np.float64)
