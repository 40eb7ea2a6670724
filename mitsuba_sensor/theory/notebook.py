"""What plan and noise budget show in a notebook: one table each."""

from __future__ import annotations

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
        "tolerance": f"{plan.tolerance_dn:g} DN for all that is left out",
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
            *(
                f"{x:.3g}"
                for x in (
                    one.mean_dn,
                    one.temporal_dn,
                    one.spatial_dn,
                    one.structure_dn,
                    one.pixels_beyond,
                )
            ),
            one.reason,
        )
        for one in plan.effects
    ]
    return fragment("Plan of an exposure", facts(head), table(names, rows))


LESS_NOISE = "negative variances: where a stage clips, as a full well does, it takes noise away"
"""Below a noise budget that has some."""


def budget_html(budget: NoiseBudget) -> str:
    """The contributions of all sources; bars show how much each adds to the two variances."""
    entries = budget.entries
    most = (
        max((max(abs(one.temporal_dn2), abs(one.spatial_dn2)) for one in entries), default=0.0)
        or 1.0
    )

    def variance(value: float) -> Bar:
        return bar(abs(value) / most, f"{value:.3g}")

    names = "source", "mean [DN]", "rms [DN]", "temporal [DN²]", "spatial [DN²]"
    rows = [
        (
            one.source,
            f"{one.mean_dn:.5g}",
            f"{one.rms_dn:.4g}",
            variance(one.temporal_dn2),
            variance(one.spatial_dn2),
        )
        for one in entries
    ]
    if budget.has_negative_variances:
        remarks = [LESS_NOISE]
    else:
        remarks = []
    if budget.theory.note:
        remarks.append(budget.theory.note)
    title = "Noise budget of one frame"
    if remarks:
        title += f" ({'; '.join(remarks)})"
    return fragment(title, table(names, rows))
