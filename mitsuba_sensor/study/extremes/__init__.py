"""``study extremes``: every stage on every engine at the edge of what is allowed, and condition numbers.

A case says what is given, what must come of it and where that is from (a closed form, many decimal digits, a sampling
error); the tests run the same cases, one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from ..page import Progress, Study
from ..timing import Step, take_steps
from . import conditions, converter, counts, dark, door, light, volts, walks
from .case import ENGINES, ONCE, RENDERERS, Case, Engine, Got, Verdict, judge
from .conditions import NOTICED_DN, Sensitivity
from .tables import conditions_bars, conditions_table, grid, key_of, table

__all__ = ["ENGINES", "ONCE", "RENDERERS", "Case", "Engine", "Got", "Verdict", "extremes", "judge", "the_cases"]

ASKED = (ONCE, *ENGINES, *RENDERERS)
"""Columns of the grid."""

THEMES = (walks, counts, dark, volts, converter, light, door)

CONDITIONS_S = 2.5
"""How long the condition numbers take on two cores [s]."""


def the_cases() -> list[Case]:
    """All of them, theme by theme."""
    cases = [case for theme in THEMES for case in theme.cases()]
    order = list(dict.fromkeys(case.theme for case in cases))
    return sorted(cases, key=lambda case: order.index(case.theme))


def extremes(*, progress: Progress | None = None) -> Study:
    """Ask every case of every engine that is on this machine; those that are not are said to be not here.

    progress : called before every verdict.  The Mitsuba variant that was set is set again afterwards.
    """
    walks.walk.cache_clear()
    cases, done = the_cases(), dict[str, Any]()
    pairs = [(case, engine) for case in cases for engine in case.asked]
    steps = [
        Step(key_of(case, engine), case.seconds, f"{case.theme}: {case.stage}, {engine.name}",
             lambda case=case, engine=engine: judge(case, engine))
        for case, engine in pairs if engine.problem is None
    ]  # fmt: skip
    steps.append(Step("conditions", CONDITIONS_S, "condition numbers", conditions.sensitivities))
    take_steps(steps, done, progress or (lambda *_: None))
    verdicts = [
        done.get(key_of(case, engine)) or Verdict(case, engine, str(engine.problem), None) for case, engine in pairs
    ]
    return _study(cases, verdicts, done["conditions"])


def _study(cases: Sequence[Case], verdicts: Sequence[Verdict], found: Sequence[Sensitivity]) -> Study:
    themes = dict.fromkeys(case.theme for case in cases)
    findings = (*_held(cases, verdicts), *_film(verdicts), *_conditions(found))
    return Study(
        name="extremes",
        title="Stiff and extreme cases",
        findings=findings,
        passed=all(v.passed is not False for v in verdicts),
        parts=(
            grid(verdicts, ASKED), conditions_bars(found), conditions_table(found),
            *(table(theme, verdicts) for theme in themes),
        ),
        data={
            "engines": {engine.name: engine.problem or "here" for engine in ASKED},
            "cases": [_row(v) for v in verdicts],
            "conditions": [asdict(one) | {"condition_number": one.number} for one in found],
        },
    )  # fmt: skip


def _row(v: Verdict) -> dict[str, Any]:
    words = {name: getattr(v.case, name) for name in ("theme", "stage", "given", "expected")}
    return {**words, "engine": v.engine.name, "got": v.got, "passed": v.passed, "seconds": v.seconds}


def _held(cases: Sequence[Case], verdicts: Sequence[Verdict]) -> list[str]:
    """How many hold, which do not, and who was not asked."""
    asked = [v for v in verdicts if v.passed is not None]
    failed = [v for v in asked if not v.passed]
    broken = len({v.case.name for v in failed})
    engines = list(dict.fromkeys(v.engine.name for v in asked if v.engine is not ONCE))
    seconds = sum(v.seconds for v in asked)
    total = f"{len(cases) - broken} of {len(cases)} cases hold"
    return [
        f"{total} on {', '.join(engines)}: {len(asked)} verdicts in {seconds:.0f} s.",
        *(f"Fails: {v.case.name}, {v.engine.name}: {v.got}; expected {v.case.expected}." for v in failed[:5]),
        *(f"Not here: {engine.name} ({engine.problem})." for engine in ASKED if engine.problem),
    ]


def _film(verdicts: Sequence[Verdict]) -> list[str]:
    """What the million samples came to."""
    found = [v.got for v in verdicts if v.case.given == light.MILLION_WORDS and v.passed is not None]
    return [f"A million samples per pixel, relative error of the irradiance: {words}." for words in found]


def _conditions(found: Sequence[Sensitivity]) -> list[str]:
    """The worst of the shipped cameras, and of all."""
    from ...sensor.camera import list_cameras

    shipped = next(one for one in found if one.camera in list_cameras())
    worst, beyond = found[0], list(dict.fromkeys(one.camera for one in found if one.largest_dn > NOTICED_DN))
    only = f"only {' and '.join(beyond)} goes beyond {NOTICED_DN:g} DN" if beyond else f"none exceeds {NOTICED_DN:g} DN"
    return [
        f"One float32 step of an input moves an output of a shipped camera by {shipped.largest_dn:.2g} DN at most: "
        f"{_which(shipped)}; {only}, at most {worst.largest_dn:.2g} DN: {_which(worst)}."
    ]


def _which(one: Sensitivity) -> str:
    return f"{one.field} of {one.camera}, {one.time_s:g} s, light {one.level}"
