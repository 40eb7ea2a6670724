"""The table of a noise budget, as people read it: mean, σ and share of the variance of each source, and the total."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .noise_budget import Contribution

ROUNDING_DN2 = 1e-9
"""Variances below this are rounding [DN²]."""
LEAST_MEAN_DN = 5e-4
"""A source of no variance and a smaller mean has no effect [DN]."""
TOTAL = "total"
HEADINGS = ("source", "mean [DN]", "temporal σ [DN]", "spatial σ [DN]", "% of added")
COLUMNS = (
    "mean: what the source adds to the digital numbers of this frame; temporal σ: its noise from frame to frame; "
    "spatial σ: its fixed pattern, from pixel to pixel; %: of the variance that all sources add; the total is what "
    "is left of it"
)
LESS_NOISE = (
    "below zero: the stage takes away noise of those above it, as a full well or the end of a converter does where it "
    "clips"
)


class BudgetRow(NamedTuple):
    """One source, or the total.

    mean_dn : what it adds to the digital numbers.  temporal_dn2, spatial_dn2 : to the two variances; negative where it
        takes noise away.  share : of the sum of all variances that sources add.
    """

    source: str
    mean_dn: float
    temporal_dn2: float
    spatial_dn2: float
    share: float

    @property
    def takes_noise(self) -> bool:
        """Whether one of its variances is negative."""
        return min(self.temporal_dn2, self.spatial_dn2) < 0

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Mean, σ and share as text; – for no noise."""
        sigmas = _sigma_text(self.temporal_dn2), _sigma_text(self.spatial_dn2)
        return (_mean_text(self.mean_dn), *sigmas, _share_text(self.share))


def budget_rows(entries: Sequence[Contribution]) -> list[BudgetRow]:
    """A row for each source that has an effect, in the order of the chain, and the total."""
    active = [entry for entry in entries if not _is_idle(entry)]
    added_dn2 = sum(
        max(variance_dn2, 0.0)
        for entry in active
        for variance_dn2 in (_rounded(entry.temporal_dn2), _rounded(entry.spatial_dn2))
    )
    rows = []
    for entry in active:
        temporal_dn2, spatial_dn2 = _rounded(entry.temporal_dn2), _rounded(entry.spatial_dn2)
        share = (temporal_dn2 + spatial_dn2) / (added_dn2 or 1.0)
        rows.append(BudgetRow(entry.source, entry.mean_dn, temporal_dn2, spatial_dn2, share))
    mean_dn = sum(entry.mean_dn for entry in entries)
    temporal_dn2, spatial_dn2 = (
        _rounded(sum(variances_dn2))
        for variances_dn2 in ([r.temporal_dn2 for r in rows], [r.spatial_dn2 for r in rows])
    )
    share = (temporal_dn2 + spatial_dn2) / (added_dn2 or 1.0)
    return [*rows, BudgetRow(TOTAL, mean_dn, temporal_dn2, spatial_dn2, share)]


def idle_sources(entries: Sequence[Contribution]) -> list[str]:
    """Names of the sources that add neither signal nor noise."""
    return [entry.source for entry in entries if _is_idle(entry)]


def remarks_on(rows: Sequence[BudgetRow], idle: Sequence[str]) -> list[str]:
    """Sentences below the table."""
    remarks = [COLUMNS]
    if any(row.takes_noise for row in rows[:-1]):
        remarks.append(LESS_NOISE)
    if idle:
        remarks.append(f"without effect here: {', '.join(idle)}")
    return remarks


def table_text(rows: Sequence[BudgetRow], remarks: Sequence[str]) -> str:
    """Rows and remarks as plain text."""
    first = max(len(row.source) for row in rows) + 1
    widths = [max(len(name) + 2, 11) for name in HEADINGS[1:]]
    below = (textwrap.fill(remark, first + sum(widths)) for remark in remarks)
    return "\n".join([*_lines(rows, first, widths), *below])


def _lines(rows: Sequence[BudgetRow], first: int, widths: Sequence[int]) -> Iterator[str]:
    for name, *cells in (HEADINGS, *((row.source, *row.cells) for row in rows)):
        columns = (f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
        yield f"{name:<{first}}{''.join(columns)}"


def _is_idle(entry: Contribution) -> bool:
    variances_dn2 = abs(entry.temporal_dn2), abs(entry.spatial_dn2)
    return max(variances_dn2) < ROUNDING_DN2 and abs(entry.mean_dn) < LEAST_MEAN_DN


def _rounded(variance_dn2: float) -> float:
    if abs(variance_dn2) < ROUNDING_DN2:
        return 0.0
    return variance_dn2


def _mean_text(mean_dn: float) -> str:
    """Three decimals, as 0.000 of noise would say no more."""
    text = f"{mean_dn:.3f}"
    if float(text) == 0:
        return "0"
    return text


def _sigma_text(variance_dn2: float) -> str:
    """The root of a variance with its sign."""
    if variance_dn2 == 0:
        return "–"
    return f"{math.copysign(math.sqrt(abs(variance_dn2)), variance_dn2):.4g}"


def _share_text(share: float) -> str:
    if share == 0:
        return "–"
    if abs(share) < 5e-4:
        return "<0.1"
    return f"{100 * share:.1f}"
