"""Diagrams and tables about the error of a render against its wall time."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..fits import Slope, pareto
from ..page import Line, Mark, Plot, Table
from .choice import Choice, choices
from .reference import difference
from .results import THEORY, WITHIN, Point, Result

SECONDS = "wall time of a render [s]"
FRAMES = {"plain": "render's noise on top", "spend": "render's noise spent", "denoised": "denoised"}
PIXELS = (
    "Over all pixels below full well, each relative to its own light, or to a tenth of the mean where it is darker."
)
SHOWN = "Pixels below full well, without the noisiest one in a hundred, at edges of lamps."


@dataclass(eq=False)
class Found:
    """All that was measured. results : the setting in the middle first.  references : by banding.

    usual : the variant that is taken by itself.  smooth : whether the denoiser is there.
    choices : words that reach the tolerance, the quickest first.
    checks : words that were rendered, and what came out; the last is what is recommended.
    """

    results: Sequence[Result]
    references: Mapping[str, Mapping[str, Any]]
    tolerance: float
    usual: str
    smooth: bool
    checks: list[tuple[Choice, Mapping[str, float]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.choices = choices(self.results, self.tolerance, self.usual)

    @property
    def reached(self) -> bool:
        """Whether the recommended words were rendered and kept the tolerance."""
        return bool(self.checks) and self.checks[-1][1]["error"] <= self.tolerance

    def curves(self, measure: str) -> list[Curve]:
        """Of all settings, and of what the denoiser makes of the one in the middle."""
        curves = [Curve(one.label, one.points(measure)) for one in self.results]
        curves.append(Curve("denoised", self.results[0].points(measure, "denoised"), dashed=True))
        return [curve for curve in curves if curve.points]

    def front(self, measure: str) -> list[tuple[int, int]]:
        """Places, (curve, point), of those that no other beats in seconds and error; the quickest first."""
        every = [(c, k, point) for c, curve in enumerate(self.curves(measure)) for k, point in enumerate(curve.points)]
        return [every[i][:2] for i in pareto([(point.seconds, point.error) for *_, point in every])]


@dataclass(frozen=True)
class Curve:
    """One line of a diagram."""

    label: str
    points: Sequence[Point]
    dashed: bool = False


def diagram(found: Found, measure: str, title: str, y_label: str) -> Plot:
    """Error against seconds; rings are on the front of all points together."""
    front = set(found.front(measure))
    lines = tuple(
        _line(curve.label, curve.points, curve.dashed, tuple(k for k in range(len(curve.points)) if (c, k) in front))
        for c, curve in enumerate(found.curves(measure))
    )
    level = (found.tolerance, f"tolerance {found.tolerance:.3g}") if measure == "electrons" else None
    pixels = "Over all pixels below full well." if measure == "dn" else PIXELS
    note = f"Rings: no other is as quick and as exact. {pixels} The reference's own error is taken off; bars are 1 σ."
    return Plot(title, SECONDS, y_label, lines, level=level, note=note)


def _line(label: str, points: Sequence[Point], dashed: bool, ringed: tuple[int, ...] = (), above: float = 0.0) -> Line:
    x, y, error = zip(*((point.seconds, above + point.error, point.spread) for point in points), strict=True)
    return Line(label, x, y, error, dashed=dashed, ringed=ringed)


def sigma_diagram(found: Found) -> Plot:
    """Temporal σ of frames over what it must be."""
    every = ((one, name, one.sigma(name)) for one in found.results for name in FRAMES)
    lines = tuple(
        _line(f"{one.label} at {one.framed.time_s:.2g} s: {FRAMES[name]}", points, name == "denoised", above=1.0)
        for one, name, points in every
        if one.framed and points
    )
    return Plot(
        "Temporal σ of the digital numbers", SECONDS, "σ of frames / σ of the camera", lines, log_y=False,
        level=(1.0, "right"), note=f"Every frame has a render of its own. {SHOWN} Bars are 1 σ.",
    )  # fmt: skip


def frames_table(found: Found) -> Table:
    """The same in numbers."""
    rows: list[tuple[Any, ...]] = []
    for one in found.results:
        if one.framed is None:
            continue
        by = {name: {point.passes: point for point in one.sigma(name)} for name in FRAMES}
        for passes, plain in by["plain"].items():
            values = [
                value
                for points in by.values()
                for value in ((points[passes].error, points[passes].spread) if passes in points else (None, None))
            ]
            compensable = "yes" if passes >= one.framed.compensable else "no"
            rows.append((one.label, one.framed.time_s, passes, plain.seconds, compensable, *values))
    return Table(
        "Temporal σ of frames, relative error",
        (
            "setting", "exposure [s]", "passes", "seconds", "compensable", "plain", "± σ", "spent", "± σ", "denoised",
            "± σ",
        ),
        tuple(rows),
        note=f"Spendable: the render's noise is as low as --render-noise compensated aims at. {SHOWN}",
    )  # fmt: skip


def settings_table(found: Found) -> Table:
    """What was compared."""
    columns = (
        "setting", "samples per pass", "first pass [s]", "pass [ms]", "passes", "seconds", "electrons", "irradiance",
        "mean [DN]", "slope, electrons", "±", "slope, irradiance", "±", "theory", "verdict",
    )  # fmt: skip
    rows, base = [], found.results[0].setting
    for result in found.results:
        ladder, top = result.ladder, result.rungs()[-1]
        rows.append(
            (
                result.label, ladder["samples_per_pass"], ladder["first_s"], 1e3 * result.pass_s, ladder["passes"],
                statistics.median(run["seconds"] for run in top),
                *(_last(result.points(measure)) for measure in ("electrons", "irradiance", "dn")),
                *_numbers(result.slope("electrons")), *_numbers(result.slope("irradiance")), THEORY,
                result.verdict or "below the reference",
            )
        )  # fmt: skip
    marks: dict[str, Mark] = {"holds": "good", "off": "bad", "": "dim"}
    note = (
        f"Errors after all passes. {PIXELS} Slopes of log error against log "
        f"seconds with 95 % intervals over {len(found.results[0].runs)} runs; they hold within {WITHIN:g} of theory. "
        "First pass: loading and compiling, or fetching what was compiled before. "
        f"As shipped: {base.variant}, {base.sampler}, {base.samples} samples per pass, all bands together."
    )
    return Table("Settings", columns, tuple(rows), tuple(marks[one.verdict] for one in found.results), note)


def _last(points: Sequence[Point]) -> float | None:
    return points[-1].error if points else None


def _numbers(slope: Slope | None) -> tuple[float | None, float | None]:
    return (None, None) if slope is None else (slope.value, slope.half_width)


def choice_table(found: Found) -> Table:
    """Words that reach the tolerance."""
    tried = {one.words: got for one, got in found.checks}
    every = {one.words: one for one in (*(one for one, _ in found.checks[::-1]), *found.choices)}
    rows = tuple(
        (words, one.seconds, one.error, *(tried.get(words, {}).get(name) for name in ("seconds", "error")))
        for words, one in every.items()
    )
    best: Mark = "best" if found.reached or not found.checks else "bad"
    return Table(
        f"What reaches {found.tolerance:.3g}",
        ("words", "seconds, predicted", "error, predicted", "seconds, rendered", "error, rendered"),
        rows,
        (best, *[""] * (len(rows) - 1)) if rows else (),
        "The fewest samples of each kind, the quickest first. Loading the scene and compiling come on top, once.",
    )


def reference_table(found: Found) -> Table:
    """What all was held against."""
    rows = []
    for kind, entry in found.references.items():
        bias = difference(entry, found.references["auto"]) if kind != "auto" else (None, None)
        errors = (math.sqrt(entry[name]) for name in ("electrons", "irradiance", "dn"))
        rows.append((kind, entry["passes"], entry["samples_per_pixel"], entry["seconds"], *errors, *bias))
    return Table(
        "References",
        (
            "bands", "passes", "samples per pixel", "seconds", "standard error, electrons", "irradiance", "mean [DN]",
            "electrons, difference to auto", "± σ",
        ),
        tuple(rows),
        note="Channels are held against a reference of their own: what it differs by is the error of bands of finite "
        "width, which no samples cure.",
    )  # fmt: skip
