"""Verdicts and condition numbers as tables, one grid and bars."""

from __future__ import annotations

from collections.abc import Sequence

from ..page import Bars, Grid, Mark, Table
from .case import Case, Engine, Verdict
from .conditions import NOTICED_DN, Sensitivity, strongest

HOLDS, FAILS, NOT_HERE = "holds", "fails", "not here"

SHOWN, BARS = 5, 3
"""Condition numbers of each camera in the table and in the plot; all of them are in the data."""


def grid(verdicts: Sequence[Verdict], engines: Sequence[Engine]) -> Grid:
    """How many cases of each theme hold, engine by engine."""
    themes = tuple(dict.fromkeys(v.case.theme for v in verdicts))
    cells = [[_cell([v for v in verdicts if (v.case.theme, v.engine) == (t, e)]) for e in engines] for t in themes]
    return Grid(
        "How many cases hold",
        themes,
        tuple(engine.name.replace(" ", "\n") for engine in engines),
        tuple(tuple(mark for mark, _ in row) for row in cells),
        tuple(tuple(words for _, words in row) for row in cells),
        "No engine: formulas of single numbers, and what is refused before anybody computes. Not here: an engine that "
        "this machine does not have.",
    )


def _cell(verdicts: Sequence[Verdict]) -> tuple[Mark, str]:
    if not verdicts:
        return "", ""
    if any(v.passed is None for v in verdicts):
        return "dim", NOT_HERE
    held = sum(bool(v.passed) for v in verdicts)
    return ("good" if held == len(verdicts) else "bad"), f"{held}/{len(verdicts)}"


def table(theme: str, verdicts: Sequence[Verdict]) -> Table:
    """Input, expected, got, verdict of every case of a theme; engines that answer alike share a row."""
    rows: list[tuple[str, ...]] = []
    marks: list[Mark] = []
    for case in dict.fromkeys(v.case for v in verdicts if v.case.theme == theme):
        for engines, got, passed in _alike([v for v in verdicts if v.case is case and v.passed is not None]):
            rows.append((case.stage, case.given, case.expected, engines, got, HOLDS if passed else FAILS))
            marks.append("good" if passed else "bad")
    columns = ("stage", "input", "expected", "engine", "got", "verdict")
    return Table(theme.capitalize(), columns, tuple(rows), tuple(marks))


def _alike(verdicts: Sequence[Verdict]) -> list[tuple[str, str, bool]]:
    """(engines, got, passed), joined where got and passed are the same."""
    names: dict[tuple[str, bool], list[str]] = {}
    for v in verdicts:
        names.setdefault((v.got, bool(v.passed)), []).append(v.engine.name)
    return [(", ".join(engines), got, passed) for (got, passed), engines in names.items()]


def conditions_table(found: Sequence[Sensitivity]) -> Table:
    """The inputs that move each camera's output most."""
    rows = strongest(found, SHOWN)
    return Table(
        "Condition numbers: what one float32 step of an input does",
        (
            "camera", "time [s]", "light, share of well", "input", "value", "mean [DN]", "mean moves [DN]",
            "temporal σ moves [DN]", "fixed σ moves [DN]", "condition number of the mean",
            f"why above {NOTICED_DN:g} DN",
        ),
        tuple(
            (s.camera, s.time_s, s.level, s.field, s.value, s.mean_dn, *s.moved_dn, s.number, s.why) for s in rows
        ),
        tuple("bad" if s.largest_dn > NOTICED_DN else "" for s in rows),
        "The strongest inputs of each camera, at the exposure and level where they move most; float64 theory before "
        "rounding. Engines compute such numbers in float64 and round each once; only pixels are float32 all the way. "
        "The condition number is the relative change of the mean over that of the input.",
    )  # fmt: skip


def conditions_bars(found: Sequence[Sensitivity]) -> Bars:
    """The strongest of them."""
    rows = strongest(found, BARS)
    parts = zip(("mean", "temporal σ", "fixed σ"), zip(*(s.moved_dn for s in rows), strict=True), strict=True)
    return Bars(
        "What one float32 step of an input moves",
        "change [DN]",
        tuple(f"{s.camera}: {s.field}, {s.time_s:g} s, {s.level}" for s in rows),
        {name: tuple(x or None for x in values) for name, values in parts},
        log_x=True,
        level=(NOTICED_DN, f"{NOTICED_DN:g} DN"),
    )


def key_of(case: Case, engine: Engine) -> str:
    """The key of a verdict."""
    return f"{case.name} | {engine.name}"
