"""``study stress``: every stage on every engine at the edge of what is allowed; condition numbers of float32 steps.

cases.toml : the inputs.  case : what is compared, and the engines.  frames, renders : the cases.  sensitivity :
condition numbers.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np

from ...pages.page import Grid, Mark, MarkedRow, Section, Study, Table, study_of, table
from ..kit import Kit, Step
from . import frames, renders
from .case import ENGINES, NO_ENGINE, RENDERERS, Engine, Got, Row, Rows, problem_of
from .sensitivity import Sensitivity, cameras, condition_section, sensitivities

RECORDS: tuple[type, ...] = (Got, Row, Sensitivity)
"""Classes that its measurements consist of."""

COLUMNS = (NO_ENGINE, *ENGINES, *RENDERERS)


class Theme(NamedTuple):
    """What is driven to its edge.

    cases : on one engine.  engines : that are asked.  seconds : that it takes about.
    """

    name: str
    cases: Callable[[Engine], Rows]
    engines: tuple[Engine, ...] = ENGINES
    seconds: float = 0.3


THEMES = (
    *(
        Theme(name, partial(frames.conditions, name, camera))
        for name in ("light", "exposure time", "temperature")
        for camera in frames.EACH_KIND
    ),
    Theme("counts", frames.counts, seconds=1.0),
    Theme("special noise", frames.specials, seconds=1.0),
    Theme("corners", frames.corners, seconds=3.0),
    Theme("smallest divisors", frames.divisors),
    Theme("frame sizes", frames.sizes),
    Theme("refusals", frames.refusals, (NO_ENGINE,)),
    Theme("radiance", renders.radiances, RENDERERS, 1.5),
    Theme("samples per pixel", renders.samples, RENDERERS, 2.0),
)


def stress(kit: Kit) -> Study:
    """Ask every theme of every engine that is on this machine; those that are not are said to be not here."""
    asked = {}
    for engine in COLUMNS:
        for number, theme in enumerate(THEMES):
            if engine in theme.engines and problem_of(engine) is None:
                asked[f"{theme.name} {number}, {engine.name}"] = theme, engine
    steps = [
        Step(key, theme.seconds, partial(verdicts, theme, engine))
        for key, (theme, engine) in asked.items()
    ]
    conditions = {f"condition numbers of {name}": name for name in cameras()}
    steps += [Step(key, 1.0, partial(sensitivities, name)) for key, name in conditions.items()]
    kit.take(steps)
    answers: dict[str, list[tuple[str, Row]]] = {theme.name: [] for theme in THEMES}
    for key, (theme, engine) in asked.items():
        answers[theme.name] += [(engine.name, row) for row in kit[key]]
    sensitive = [one for key in conditions for one in kit[key]]
    tables = Section(
        (), True, tuple(theme_table(theme, told) for theme, told in answers.items())
    )
    sections = [verdict_section(answers, kit), condition_section(sensitive), tables]
    return study_of("stress", "Stiff and extreme cases", sections)


def verdicts(theme: Theme, engine: Engine) -> list[Row]:
    """All cases of a theme. A warning of NumPy is a NaN on its way, and an exception is no answer: both fail."""
    rows: list[Row] = []
    try:
        with warnings.catch_warnings(), np.errstate(divide="warn", over="warn", invalid="warn"):
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            rows.extend(theme.cases(engine))
    except (
        Exception
    ) as error:  # whatever it is, it is the answer of a case and must not end the study
        text = f"{type(error).__name__}: {error}"
        rows.append(
            Row(
                theme.name, "a case that ended with an exception", "an answer", Got(text, False)
            )
        )
    return rows


def verdict_section(answers: dict[str, list[tuple[str, Row]]], kit: Kit) -> Section:
    """How many cases have the expected result, which do not, and which engines are not here."""
    every = [(theme, engine, row) for theme, told in answers.items() for engine, row in told]
    failed = [one for one in every if not one[2].got.passed]
    engines = ", ".join(
        dict.fromkeys(engine for _, engine, _ in every if engine != NO_ENGINE.name)
    )
    findings = [
        f"{len(every) - len(failed)} of {len(every)} cases have the expected result on {engines}, "
        f"in {kit.seconds:.0f} s."
    ]
    for theme, engine, row in failed[:5]:
        findings.append(
            f"Not as expected: {theme}, {row.given}, {engine}: {row.got.text}; expected {row.expected}."
        )
    findings += [
        f"Not tested on this machine: {engine.name} ({str(problem_of(engine)).removesuffix('.')})."
        for engine in COLUMNS
        if problem_of(engine)
    ]
    return Section(tuple(findings), not failed, (verdict_grid(answers),))


def verdict_grid(answers: dict[str, list[tuple[str, Row]]]) -> Grid:
    """How many cases of each theme hold, engine by engine."""
    marks, texts = [], []
    for theme, told in answers.items():
        cells = [verdict_cell(theme, engine, told) for engine in COLUMNS]
        marks.append(tuple(mark for mark, _ in cells))
        texts.append(tuple(text for _, text in cells))
    names = tuple(engine.name.replace(" ", "\n") for engine in COLUMNS)
    note = "No engine: what is refused before any pixel. Not here: an engine that this machine does not have."
    return Grid(
        "Passed cases versus engine",
        tuple(answers),
        names,
        tuple(marks),
        tuple(texts),
        note,
    )


def verdict_cell(
    theme: str, engine: Engine, told: Iterable[tuple[str, Row]]
) -> tuple[Mark, str]:
    """Mark and text of one theme on one engine."""
    passed = [row.got.passed for name, row in told if name == engine.name]
    if passed:
        return ("good" if all(passed) else "bad"), f"{sum(passed)}/{len(passed)}"
    asked = any(engine in one.engines for one in THEMES if one.name == theme)
    if asked:
        return ("dim", "not here")
    return ("", "")


def theme_table(theme: str, told: Iterable[tuple[str, Row]]) -> Table:
    """The cases of one theme; engines that answer alike share a row."""
    engines: dict[Row, list[str]] = {}
    for engine, row in told:
        engines.setdefault(row, []).append(engine)
    rows: list[MarkedRow] = []
    for row, names in sorted(engines.items(), key=lambda one: (one[0].subject, one[0].given)):
        verdict = "fails"
        if row.got.passed:
            verdict = "holds"
        mark: Mark = "good" if row.got.passed else "bad"
        rows.append(
            (
                mark,
                (row.subject, row.given, row.expected, ", ".join(names), row.got.text, verdict),
            )
        )
    return table(
        theme.capitalize(), "subject | input | expected | engine | got | verdict", rows
    )
