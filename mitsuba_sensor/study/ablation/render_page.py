"""The render's part of the page: what each of its features changes in the picture, and the seconds that it takes."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..page import Bars, Mark, Table
from ..side import Side
from .features import APERTURE, ERROR_BARS, TRUTH
from .stages_results import as_normal, z_limit

COLUMNS = (
    "left out", "mean, predicted [DN]", "measured", "±", "z", "worst 1 %, predicted [DN]", "measured", "±", "z",
    "rms [DN]", "±", "saved [s]", "saved [%]", "what is said of it",
)  # fmt: skip


SHOWN = 0.05
"""Share of a render's seconds from which on a sentence speaks of them: turns of one and the same differ by as much."""


@dataclass(frozen=True)
class Feature:
    """One feature, off. found : as :func:`ablation.render.change_without` gives it.  said : by the plan, or nothing."""

    name: str
    found: Mapping[str, Any]
    said: str

    @property
    def saved_s(self) -> float:
        """Seconds per render: the median over the turns, times the passes."""
        return float(self.found["passes"] * statistics.median(self._turns))

    @property
    def saved_share(self) -> float:
        """Of the render's seconds; of a pass of its own, which the render does not have, nothing."""
        return self.saved_s / (self.found["passes"] * statistics.median(self.found["seconds"]))

    @property
    def _turns(self) -> list[float]:
        return [x - y for x, y in zip(self.found["seconds"], self.found["seconds_without"], strict=True)]

    @property
    def changes(self) -> bool:
        """Whether the picture is seen to change: 3 standard errors of the mean, or as sure an rms."""
        rms_dn, mean_dn = self.found["rms_dn"] or 0.0, abs(self.found["mean_dn"])
        return rms_dn > 2 * (self.found["rms_error"] or 0.0) or mean_dn > 3 * self.found["mean_error"]

    @property
    def time(self) -> str:
        """What it costs, in words."""
        return f"for {self.saved_share:.0%} of the seconds" if self.saved_share > SHOWN else "at no cost that shows"

    def z(self, name: str) -> float | None:
        """How far the measurement is from theory, in standard errors; None where theory says nothing."""
        said = self.found["predicted"]
        return None if said is None else as_normal(said[name], self.found["passes"] - 1)


def page(
    features: Sequence[tuple[str, Mapping[str, Any]]], missing: Mapping[str, str],
    needs: Sequence[Mapping[str, Any]], tolerance_dn: float,
) -> Side:  # fmt: skip
    """What the render shows. features : by name, what was measured.  missing : what is not in this scene, and why.

    needs : of :func:`render.requirements.render_requirements`.  passed : theory and renders agree.
    """
    rows = [Feature(name, found, _said(name, found, needs, tolerance_dn)) for name, found in features]
    scores = [abs(z) for row in rows for name in ("z_mean", "z_worst") if (z := row.z(name)) is not None]
    limit = z_limit(len(scores))
    return Side(
        findings=tuple(_findings(rows, needs, scores)),
        passed=max(scores, default=0.0) <= limit,
        parts=(_table(rows, missing, limit), *_bars(rows)),
        data={
            "render": {
                "features": {row.name: {**row.found, "saved_s": row.saved_s, "said": row.said} for row in rows},
                "not_in_this_scene": dict(missing), "needs": [dict(need) for need in needs], "z_limit": limit,
            }
        },
    )  # fmt: skip


def _said(name: str, found: Mapping[str, Any], needs: Sequence[Mapping[str, Any]], tolerance_dn: float) -> str:
    """What the plan of the render says, in few words."""
    for need in needs:
        if need["what"] == name and name in (APERTURE, TRUTH):
            return f"{'kept' if need['kept'] else 'left out'}: {need['reason']}"
    if name == ERROR_BARS:
        return "kept: without them nobody knows how noisy the render is"
    if found["predicted"] is None or not name.endswith(("bands", "band")):
        return ""
    worst_dn = found["predicted"]["pixel_dn"]
    verdict = "would do" if worst_dn <= tolerance_dn else "too few"
    return f"{verdict}: a pixel moves by up to {worst_dn:.3g} DN"


def _findings(rows: Sequence[Feature], needs: Sequence[Mapping[str, Any]], scores: Sequence[float]) -> list[str]:
    found = []
    changing = [row for row in rows if row.changes]
    if changing:
        most = max(changing, key=lambda row: row.found["rms_dn"] or 0.0)
        found.append(
            f"Of the render, the picture depends most on what '{most.name}' leaves out: {most.found['rms_dn']:.3g} ± "
            f"{most.found['rms_error']:.2g} DN rms, {most.time}."
        )
    free = [row for row in rows if row not in changing and row.name not in (TRUTH, ERROR_BARS)]
    if free:
        best = max(free, key=lambda row: row.saved_share)
        found.append(
            f"What '{best.name}' changes cannot be told from noise in {best.found['passes']} passes (rms "
            f"{best.found['rms_dn']:.2g} ± {best.found['rms_error']:.2g} DN), and it saves {best.saved_share:.0%} of "
            "the render's seconds."
        )
    found += [f"Bands: {need['reason']} ({need['what']} now)." for need in needs if need["what"].endswith(" bands")]
    found += [_noise_in_bands(row) for row in free if row.found["predicted"] is not None][-1:]
    if scores:
        found.append(f"Where theory says what a render loses, renders agree: largest |z| {max(scores):.2f}.")
    return found


def _noise_in_bands(row: Feature) -> str:
    """The plan looks at the worst pixel of one render, whose bands are noisy."""
    most_dn = row.found["predicted"]["pixel_dn"]
    return (
        f"With {row.name} a pixel of this render moves by up to {most_dn:.3g} DN, but that is the noise of its "
        f"bands: freed of it, by {row.found['rms_dn']:.2g} ± {row.found['rms_error']:.2g} DN rms."
    )


def _table(rows: Sequence[Feature], missing: Mapping[str, str], limit: float) -> Table:
    lines, marks = [], []
    for row in rows:
        found, said = row.found, row.found["predicted"] or {}
        share = None if row.name == TRUTH else 100 * row.saved_share
        lines.append((
            row.name, said.get("mean_dn"), found["mean_dn"], found["mean_error"], row.z("z_mean"),
            said.get("worst_dn"), found["worst_dn"], found["worst_error"], row.z("z_worst"),
            found["rms_dn"], found["rms_error"], row.saved_s, share, row.said,
        ))  # fmt: skip
        marks.append(_mark(row, limit))
    note = (
        "Change of the mean signal in DN, cut at the full well; equal seeds, so that most of the noise is in both. ± "
        "is the standard error from pass to pass. The worst 1 % are the pixels that theory names, from these same "
        "passes and with their noise; where there is no theory, half of the passes name them and the others measure. "
        "rms is freed of the render's noise. Seconds are medians of interleaved passes, for all passes of a render."
    )
    if missing:
        note += " Not in this scene: " + "; ".join(f"{name} ({why})" for name, why in missing.items()) + "."
    return Table("What changes when the render leaves something out", COLUMNS, tuple(lines), tuple(marks), note)


def _mark(row: Feature, limit: float) -> Mark:
    scores = [abs(z) for name in ("z_mean", "z_worst") if (z := row.z(name)) is not None]
    if not scores:
        return ""
    return "bad" if max(scores) > limit else "good"


def _bars(rows: Sequence[Feature]) -> tuple[Bars, ...]:
    shown = [row for row in rows if row.found["rms_dn"]]
    labels = tuple(row.name for row in shown)
    if not shown:
        return ()
    changes = Bars(
        "Change of the picture", "rms over the pixels [DN]", labels,
        {"measured": tuple(row.found["rms_dn"] for row in shown)},
        {"measured": tuple(row.found["rms_error"] for row in shown)}, log_x=True,
    )  # fmt: skip
    timed = [row for row in rows if row.name != TRUTH]
    seconds = Bars(
        "Time of a render saved", "saved [s]", tuple(row.name for row in timed),
        {"saved": tuple(row.saved_s for row in timed)},
    )  # fmt: skip
    return changes, seconds
