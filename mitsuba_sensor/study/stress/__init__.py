"""``study stress``: every stage on every engine at the edge of what is allowed, and condition numbers.

A case says what is given, what must come of it and where that is from (a closed form, many decimal digits, a sampling
error); the tests run the same cases, one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ...sensor.camera import list_cameras
from ..kit import Kit, Step
from ..page import Bars, Grid, Mark, Part, Section, Study, Table, study_of, table
from . import chains, electrons, light, volts, whole
from .case import ENGINES, ONCE, RENDERERS, Case, Engine, Verdict, verdict_of
from .conditions import NOTICED_DN, Sensitivity, sensitivities, strongest

ASKED = (ONCE, *ENGINES, *RENDERERS)  # columns of the grid
CONDITIONS_S = 2.5  # how long the condition numbers take on two cores [s]
SHOWN, BARS = 5, 3  # condition numbers of each camera in the table and in the plot
THEMES = (
    *(chains.chain_cases, electrons.counted_cases, electrons.dark_cases, volts.follower_cases),
    *(volts.node_and_column_cases, volts.converter_cases, light.light_cases, whole.refusal_cases, whole.frame_cases),
)


def stress_cases() -> list[Case]:
    """All of them, theme by theme."""
    cases = [case for theme in THEMES for case in theme()]
    order = list(dict.fromkeys(case.theme for case in cases))
    return sorted(cases, key=lambda case: order.index(case.theme))


def stress(kit: Kit) -> Study:
    """Ask every case of every engine that is on this machine; those that are not are said to be not here.

    The Mitsuba variant that was set is set again afterwards.
    """
    chains.seen_behind.cache_clear()
    pairs = [(case, engine) for case in stress_cases() for engine in case.asked]
    here = [(case, engine) for case, engine in pairs if engine.problem is None]
    steps = [Step(key_of(case, engine), case.seconds, partial(answer, case, engine)) for case, engine in here]
    kit.take([*steps, Step("condition numbers", CONDITIONS_S, sensitivities)])
    answers = {(case, engine): kit[key_of(case, engine)] for case, engine in here}
    verdicts = [Verdict(case, engine, *answers.get((case, engine), ("", None, 0.0))) for case, engine in pairs]
    found: list[Sensitivity] = kit["condition numbers"]
    themes = dict.fromkeys(case.theme for case, _ in pairs)
    tables = [table_of(theme, verdicts) for theme in themes]
    parts: tuple[Part, ...] = (grid(verdicts), conditions_bars(found), conditions_table(found), *tables)
    passed = all(v.passed is not False for v in verdicts)
    return study_of("stress", "Stiff and extreme cases", [Section((*findings(verdicts), which(found)), passed, parts)])


def key_of(case: Case, engine: Engine) -> str:
    """The key of a verdict."""
    return f"{case.name} | {engine.name}"


def answer(case: Case, engine: Engine) -> tuple[str, bool | None, float]:
    """What a kit keeps of a verdict."""
    verdict = verdict_of(case, engine)
    return verdict.got, verdict.passed, verdict.seconds


def findings(verdicts: Sequence[Verdict]) -> list[str]:
    """How many hold, which do not, who was not asked, and what the million samples came to."""
    asked = [v for v in verdicts if v.passed is not None]
    failed = [v for v in asked if not v.passed]
    cases, broken = len({v.case.name for v in verdicts}), len({v.case.name for v in failed})
    engines = dict.fromkeys(v.engine.name for v in asked if v.engine is not ONCE)
    total = f"{cases - broken} of {cases} cases hold on {', '.join(engines)}"
    million = [v.got for v in asked if v.case.given == light.MILLION_SAMPLES]
    return [
        f"{total}: {len(asked)} verdicts in {sum(v.seconds for v in asked):.0f} s.",
        *(f"Fails: {v.case.name}, {v.engine.name}: {v.got}; expected {v.case.expected}." for v in failed[:5]),
        *(f"Not here: {engine.name} ({engine.problem})." for engine in ASKED if engine.problem),
        *(f"A million samples per pixel, relative error of the irradiance: {got}." for got in million),
    ]


def which(found: Sequence[Sensitivity]) -> str:
    """The strongest input of the shipped cameras, and of all."""

    def of(one: Sensitivity) -> str:
        return f"{one.field} of {one.camera}, {one.time_s:g} s, light {one.level}"

    shipped = next(one for one in found if one.camera in list_cameras())
    worst, beyond = found[0], list(dict.fromkeys(one.camera for one in found if one.largest_dn > NOTICED_DN))
    only = f"only {' and '.join(beyond)} goes beyond {NOTICED_DN:g} DN" if beyond else f"none exceeds {NOTICED_DN:g} DN"
    return (
        f"One float32 step of an input moves an output of a shipped camera by {shipped.largest_dn:.2g} DN at most: "
        f"{of(shipped)}; {only}, at most {worst.largest_dn:.2g} DN: {of(worst)}."
    )


def grid(verdicts: Sequence[Verdict]) -> Grid:
    """How many cases of each theme hold, engine by engine."""
    themes = tuple(dict.fromkeys(v.case.theme for v in verdicts))
    by = {(t, e): [v for v in verdicts if (v.case.theme, v.engine) == (t, e)] for t in themes for e in ASKED}
    cells = {at: cell(found) for at, found in by.items()}
    return Grid(
        "How many cases hold",
        themes,
        tuple(engine.name.replace(" ", "\n") for engine in ASKED),
        tuple(tuple(cells[theme, engine][0] for engine in ASKED) for theme in themes),
        tuple(tuple(cells[theme, engine][1] for engine in ASKED) for theme in themes),
        "No engine: formulas of single numbers, and what is refused before anybody computes. Not here: an engine that "
        "this machine does not have.",
    )


def cell(verdicts: Sequence[Verdict]) -> tuple[Mark, str]:
    """One cell of the grid."""
    if not verdicts:
        return "", ""
    if any(v.passed is None for v in verdicts):
        return "dim", "not here"
    held = sum(bool(v.passed) for v in verdicts)
    return ("good" if held == len(verdicts) else "bad"), f"{held}/{len(verdicts)}"


def table_of(theme: str, verdicts: Sequence[Verdict]) -> Table:
    """Input, expected, got, verdict of every case of a theme; engines that answer alike share a row."""
    alike: dict[tuple[Case, str, bool], list[str]] = {}
    for v in verdicts:
        if v.case.theme == theme and v.passed is not None:
            alike.setdefault((v.case, v.got, v.passed), []).append(v.engine.name)
    marks: dict[bool, Mark] = {True: "good", False: "bad"}
    rows = (
        (marks[ok], (case.stage, case.given, case.expected, ", ".join(names), got, "holds" if ok else "fails"))
        for (case, got, ok), names in alike.items()
    )
    return table(theme.capitalize(), "stage | input | expected | engine | got | verdict", rows)


def conditions_table(found: Sequence[Sensitivity]) -> Table:
    """The inputs that move each camera's output most."""
    return table(
        "Condition numbers: what one float32 step of an input does",
        "camera | time [s] | light, share of well | input | value | mean [DN] | mean moves [DN] | "
        "temporal σ moves [DN] | spatial σ moves [DN] | condition number of the mean | "
        f"why above {NOTICED_DN:g} DN",
        (
            (
                "bad" if s.largest_dn > NOTICED_DN else "",
                (s.camera, s.time_s, s.level, s.field, s.value, s.mean_dn, *s.moved_dn, s.number, s.why),
            )
            for s in strongest(found, SHOWN)
        ),
        "The strongest inputs of each camera, at the exposure and level where they move most; float64 theory before "
        "rounding. Engines compute such numbers in float64 and round each once; only pixels are float32 all the way. "
        "The condition number is the relative change of the mean over that of the input.",
    )


def conditions_bars(found: Sequence[Sensitivity]) -> Bars:
    """The strongest of them."""
    rows = strongest(found, BARS)
    labels = tuple(f"{s.camera}: {s.field}, {s.time_s:g} s, {s.level}" for s in rows)
    names = ("mean", "temporal σ", "spatial σ")
    moved = {name: tuple(s.moved_dn[k] or None for s in rows) for k, name in enumerate(names)}
    level = (NOTICED_DN, f"{NOTICED_DN:g} DN")
    return Bars("What one float32 step of an input moves", "change [DN]", labels, moved, log_x=True, level=level)
