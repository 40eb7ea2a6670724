"""What plan and noise budget show in a notebook: one table each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..core.html import Table, facts, fragment

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
    return fragment("Plan of an exposure", facts(head), Table(names, rows))


def budget_html(budget: NoiseBudget, headings: Sequence[str]) -> str:
    """The sources that have an effect, with their share in the variances."""
    lines = [(row.source, *row.cells) for row in budget.rows]
    title = f"Noise budget of one frame ({'; '.join(budget.remarks)})"
    return fragment(title, Table(headings, lines))
