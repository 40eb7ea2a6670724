"""What plan and noise budget show in a notebook: one table each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..core.html import Bar, bar, facts, fragment, table

if TYPE_CHECKING:
    from .noise_budget import NoiseBudget
    from .plan import Plan


def plan_html(plan: Plan) -> str:
    """The stages of a plan, what each moves, and why it is kept or left out."""
    held = plan.range
    head = {
        "camera": plan.camera,
        "tolerance": f"{plan.tolerance_dn:g} DN in every sampled pixel, for all that is left out",
        "clipped": f"{100 * plan.clipped:.3g} % of {plan.pixels} sampled pixels",
        "light": f"{held.darkest_e:.4g} … {held.brightest_e:.4g} mean photoelectrons per pixel",
        "exposure": f"{held.exposure.time_s:g} s at {held.exposure.temperature_k:g} K",
        "precision": plan.float32.explain(),
    }
    names = (
        "stage",
        "",
        "mean [DN]",
        "temporal [DN]",
        "spatial [DN]",
        "lines [DN]",
        "pixels",
        "why",
    )
    rows = [
        (
            one.stage,
            "kept" if one.kept else "left out",
            *(f"{x:.3g}" for x in one.columns),
            one.reason,
        )
        for one in plan.effects
    ]
    return fragment("Plan of an exposure", facts(head), table(names, rows))


def budget_html(budget: NoiseBudget, headings: Sequence[str]) -> str:
    """The sources that have an effect; bars show the share of each in the variances."""
    rows = budget.rows
    most = max(
        (abs(v) for row in rows[:-1] for v in (row.temporal_dn2, row.spatial_dn2)), default=0
    )

    def sigma(variance_dn2: float, text: str) -> Bar:
        return bar(min(abs(variance_dn2) / (most or 1.0), 1.0), text)

    lines = []
    for row in rows:
        mean, temporal, spatial, share = row.cells
        sigmas = sigma(row.temporal_dn2, temporal), sigma(row.spatial_dn2, spatial)
        lines.append((row.source, mean, *sigmas, share))
    title = f"Noise budget of one frame ({'; '.join(budget.remarks)})"
    return fragment(title, table(headings, lines))
