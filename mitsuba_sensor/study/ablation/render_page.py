"""The render's part of the page: what each of its features changes in the picture, and the seconds that it takes."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..page import Bars, Mark, MarkedRow, Section, Table, table
from ..statistics import Known, as_normal, z_limit
from .features import AOVS, APERTURE, ERROR_BARS

SHOWN = 0.05
"""Share of a render's seconds from which on a sentence speaks of them: turns of one and the same differ by as much."""

Said = Sequence[Known]
"""What the plan of a render says: the requirements as plain values."""


@dataclass(frozen=True)
class Feature:
    """One feature, off. found : as :func:`render.change_without` gives it.  said : by the plan, or nothing."""

    name: str
    found: Known
    said: str

    @property
    def saved_s(self) -> float:
        """Seconds per render: the median over the turns, times the passes."""
        pairs = zip(self.found["seconds"], self.found["seconds_without"], strict=True)
        return float(self.found["passes"] * statistics.median(x - y for x, y in pairs))

    @property
    def saved_share(self) -> float:
        """Of the render's seconds; of a pass of its own, which the render does not have, nothing."""
        return self.saved_s / float(self.found["passes"] * statistics.median(self.found["seconds"]))

    @property
    def changes(self) -> bool:
        """Whether the picture is seen to change: 3 standard errors of the mean, or as sure an rms."""
        rms_dn, mean_dn = self.found["rms_dn"] or 0.0, abs(self.found["mean_dn"])
        return rms_dn > 2 * (self.found["rms_error"] or 0.0) or mean_dn > 3 * self.found["mean_error"]

    @property
    def z(self) -> tuple[float | None, float | None]:
        """How far mean and worst pixels are from theory, in standard errors; None where theory says nothing."""
        said = self.found["predicted"]
        if said is None:
            return None, None
        return as_normal(said["z_mean"], self.found["passes"] - 1), as_normal(said["z_worst"], self.found["passes"] - 1)

    @property
    def scores(self) -> list[float]:
        """The same without signs, and without what theory says nothing of."""
        return [abs(z) for z in self.z if z is not None]

    @property
    def rms(self) -> str:
        """With its standard error."""
        return f"{self.found['rms_dn']:.2g} ± {self.found['rms_error']:.2g} DN"


def render_section(
    features: Mapping[str, Known], missing: Mapping[str, str], said: Said, tolerance_dn: float
) -> Section:
    """What the render shows. features : by name, what was measured.  missing : what is not in this scene, and why.

    passed : theory and renders agree wherever theory says something.
    """
    rows = [Feature(name, found, _said(name, found, said, tolerance_dn)) for name, found in features.items()]
    scores = [score for row in rows for score in row.scores]
    limit = z_limit(len(scores))
    passed = max(scores, default=0.0) <= limit
    return Section(tuple(_findings(rows, said, scores)), passed, (_table(rows, missing, limit), *_bars(rows)))


def _said(name: str, found: Known, said: Said, tolerance_dn: float) -> str:
    """What the plan of the render says, in short."""
    for one in said:
        if one["what"] == name and name in (APERTURE, AOVS):
            return f"{'kept' if one['kept'] else 'left out'}: {one['reason']}"
    if name == ERROR_BARS:
        return "kept: without them nobody knows how noisy the render is"
    if found["predicted"] is None or not name.endswith(("bands", "band")):
        return ""
    worst_dn = found["predicted"]["pixel_dn"]
    return f"{'would do' if worst_dn <= tolerance_dn else 'too few'}: a pixel moves by up to {worst_dn:.3g} DN"


def _findings(rows: Sequence[Feature], said: Said, scores: Sequence[float]) -> list[str]:
    found = []
    changing = [row for row in rows if row.changes]
    if changing:
        most = max(changing, key=lambda row: row.found["rms_dn"] or 0.0)
        dear = most.saved_share > SHOWN
        cost = f"for {most.saved_share:.0%} of the seconds" if dear else "at no cost that shows"
        found.append(
            f"Of the render, the picture depends most on what '{most.name}' leaves out: {most.found['rms_dn']:.3g} ± "
            f"{most.found['rms_error']:.2g} DN rms, {cost}."
        )
    free = [row for row in rows if row not in changing and row.name not in (AOVS, ERROR_BARS)]
    if free:
        best = max(free, key=lambda row: row.saved_share)
        found.append(
            f"What '{best.name}' changes cannot be told from noise in {best.found['passes']} passes (rms {best.rms}), "
            f"and it saves {best.saved_share:.0%} of the render's seconds."
        )
    found += [f"Bands: {one['reason']} ({one['what']} now)." for one in said if one["what"].endswith(" bands")]
    noisy = [row for row in free if row.found["predicted"] is not None]
    if noisy:  # the plan looks at the worst pixel of one render, whose bands are noisy
        row = noisy[-1]
        found.append(
            f"With {row.name} a pixel of this render moves by up to {row.found['predicted']['pixel_dn']:.3g} DN, but "
            f"that is the noise of its bands: freed of it, by {row.rms} rms."
        )
    if scores:
        found.append(f"Where theory says what a render loses, renders agree: largest |z| {max(scores):.2f}.")
    return found


def _table(rows: Sequence[Feature], missing: Mapping[str, str], limit: float) -> Table:
    lines: list[MarkedRow] = []
    for row in rows:
        found, said, (z_mean, z_worst) = row.found, row.found["predicted"] or {}, row.z
        mean = said.get("mean_dn"), found["mean_dn"], found["mean_error"], z_mean
        worst = said.get("worst_dn"), found["worst_dn"], found["worst_error"], z_worst
        share = None if row.name == AOVS else 100 * row.saved_share
        mark: Mark = ("bad" if max(row.scores) > limit else "good") if row.scores else ""
        rms = found["rms_dn"], found["rms_error"]
        lines.append((mark, (row.name, *mean, *worst, *rms, row.saved_s, share, row.said)))
    note = (
        "Change of the mean signal in DN, cut at the full well; equal seeds, so that most of the noise is in both. ± "
        "is the standard error from pass to pass. The worst 1 % are the pixels that theory names, from these same "
        "passes and with their noise; where there is no theory, half of the passes name them and the others measure. "
        "rms is freed of the render's noise. Seconds are medians of interleaved passes, for all passes of a render."
    )
    if missing:
        note += " Not in this scene: " + "; ".join(f"{name} ({why})" for name, why in missing.items()) + "."
    return table(
        "What changes when the render leaves something out",
        "left out | mean, predicted [DN] | measured | ± | z | worst 1 %, predicted [DN] | measured | ± | z | "
        "rms [DN] | ± | saved [s] | saved [%] | what is said of it",
        lines,
        note,
    )


def _bars(rows: Sequence[Feature]) -> tuple[Bars, ...]:
    shown, timed = [row for row in rows if row.found["rms_dn"]], [row for row in rows if row.name != AOVS]
    if not shown:
        return ()
    rms, error = (tuple(row.found[name] for row in shown) for name in ("rms_dn", "rms_error"))
    labels, seconds = tuple(row.name for row in shown), {"saved": tuple(row.saved_s for row in timed)}
    title, x_label = "Change of the picture", "rms over the pixels [DN]"
    changes = Bars(title, x_label, labels, {"measured": rms}, {"measured": error}, log_x=True)
    return changes, Bars("Time of a render saved", "saved [s]", tuple(row.name for row in timed), seconds)
