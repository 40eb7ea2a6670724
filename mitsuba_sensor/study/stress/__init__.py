"""``study stress``: every stage on every engine at the edge of what is allowed, and condition numbers.

A theme is a function that yields cases: what is given, what must come of it (by a closed form, many decimal digits, a
sampling error), and what came. The tests run the same themes.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ... import list_cameras
from ..kit import Kit, Step
from ..page import Bars, Grid, Mark, Part, Section, Study, Table, study_of, table
from . import chains, electrons, light, volts, whole
from .case import ENGINES, NO_ENGINE, RENDERERS, SCALAR, Engine, Rows
from .conditions import NOTICED_DN, Sensitivity, sensitivities, strongest

ASKED = (NO_ENGINE, *ENGINES, *RENDERERS)  # columns of the grid
CONDITIONS_S = 2.5  # how long the condition numbers take on two cores [s]
MILLION = "A million samples per pixel, relative error of the irradiance"
SHOWN, BARS = 5, 3  # condition numbers of each camera in the table and in the plot


class Theme(NamedTuple):
    """What is driven to its edge; its cases on one engine; which engines are asked; about how long one takes [s]."""

    name: str
    cases: Callable[[Engine], Rows]
    asked: tuple[Engine, ...] = ENGINES
    seconds: float = 0.1


class Verdict(NamedTuple):
    """What came of a case (theme, stage, input, what must come) on an engine, and whether it is what must come."""

    case: tuple[str, str, str, str]
    engine: str
    got: str
    passed: bool

    @property
    def name(self) -> str:
        """No other case has it."""
        return " | ".join(self.case[:3])


THEMES = (
    Theme("light", chains.lights, seconds=1.2),
    Theme("light", whole.renderers_values, (NO_ENGINE,)),
    Theme("light", whole.infinite_light),
    Theme("exposure time", chains.times, seconds=0.7),
    Theme("temperature", chains.temperatures, seconds=0.7),
    Theme("Poisson means", electrons.poisson, seconds=1.0),
    Theme("full well", electrons.full_well),
    Theme("full well", whole.no_exact_count, (NO_ENGINE,)),
    Theme("dark current", electrons.dark_current, (NO_ENGINE,)),
    Theme("fixed patterns", electrons.fixed_patterns, seconds=1.0),
    Theme("source follower", volts.follower_formulas, (NO_ENGINE,)),
    Theme("source follower", volts.follower_in_camera),
    Theme("sense node", volts.sense_node),
    Theme("coupled columns", volts.column_formulas, (NO_ENGINE,)),
    Theme("coupled columns", volts.columns),
    Theme("converter", volts.converter_refused, (NO_ENGINE,)),
    Theme("converter", volts.converter),
    Theme("converter", volts.converter_curve),
    Theme("radiance", light.radiances, RENDERERS, 1.5),
    Theme("samples per pixel", light.samples, RENDERERS, 2.0),
    Theme("bands", light.bands, (SCALAR,), 0.6),
    Theme("wavelength", light.wavelength_formulas, (NO_ENGINE,)),
    Theme("wavelength", light.wavelengths),
    Theme("refusals", whole.refusals, (NO_ENGINE,)),
    Theme("whole frames", whole.whole_frames, seconds=1.5),
    Theme("whole frames", whole.published_frames, (NO_ENGINE,)),
    Theme("frame sizes", whole.frame_sizes, seconds=2.0),
)


def verdicts_of(theme: Theme, engine: Engine) -> list[Verdict]:
    """All cases of a theme. A warning of NumPy is a NaN on its way and an exception is no answer: both fail."""
    found: list[Verdict] = []
    try:
        with warnings.catch_warnings(), np.errstate(divide="warn", over="warn", invalid="warn"):
            warnings.simplefilter("error", RuntimeWarning)
            for stage, given, expected, got in theme.cases(engine):
                found.append(Verdict((theme.name, stage, given, expected), engine.name, *got))
    except Exception as error:  # whatever it is, it is the answer of a case and must not end the study
        behind = f"behind {found[-1].name}" if found else "first case"
        text = f"{type(error).__name__}: {error}"
        found.append(Verdict((theme.name, "", behind, "an answer"), engine.name, text, False))
    return found


def stress(kit: Kit) -> Study:
    """Ask every theme of every engine that is on this machine; those that are not are said to be not here."""
    pairs = {
        f"{k}: {theme.name} | {engine.name}": (theme, engine)
        for k, theme in enumerate(THEMES)
        for engine in theme.asked
    }
    here = {key: pair for key, pair in pairs.items() if pair[1].problem is None}
    steps = [Step(key, theme.seconds, partial(verdicts_of, theme, engine)) for key, (theme, engine) in here.items()]
    kit.take([*steps, Step("condition numbers", CONDITIONS_S, sensitivities)])
    verdicts: list[Verdict] = [verdict for key in here for verdict in kit[key]]
    found: list[Sensitivity] = kit["condition numbers"]
    themes = tuple(dict.fromkeys(theme.name for theme in THEMES))
    tables = [table_of(theme, [v for v in verdicts if v.case[0] == theme]) for theme in themes]
    parts: tuple[Part, ...] = (grid(themes, verdicts), conditions_bars(found), conditions_table(found), *tables)
    sentences = (*findings(verdicts, kit.seconds), which(found))
    section = Section(sentences, all(v.passed for v in verdicts), parts)
    return study_of("stress", "Stiff and extreme cases", [section])


def findings(verdicts: Sequence[Verdict], seconds: float) -> list[str]:
    """How many hold, which do not, who was not asked, and what the million samples came to."""
    failed = [v for v in verdicts if not v.passed]
    cases, broken = len({v.name for v in verdicts}), len({v.name for v in failed})
    engines = dict.fromkeys(v.engine for v in verdicts if v.engine != NO_ENGINE.name)
    return [
        f"{cases - broken} of {cases} cases hold on {', '.join(engines)}: {len(verdicts)} verdicts in {seconds:.0f} s.",
        *(f"Fails: {v.name}, {v.engine}: {v.got}; expected {v.case[3]}." for v in failed[:5]),
        *(f"Not here: {engine.name} ({engine.problem})." for engine in ASKED if engine.problem),
        *(f"{MILLION}: {v.got}." for v in verdicts if v.case[2] == light.MILLION_SAMPLES),
    ]


def which(found: Sequence[Sensitivity]) -> str:
    """The strongest input of the shipped cameras, and of all."""
    shipped, worst = next(one for one in found if one.camera in list_cameras()), found[0]
    beyond = " and ".join(dict.fromkeys(one.camera for one in found if one.largest_dn > NOTICED_DN))
    only = f"only {beyond} goes beyond {NOTICED_DN:g} DN" if beyond else f"none exceeds {NOTICED_DN:g} DN"
    of, at = (f"{one.field} of {one.camera}, {one.time_s:g} s, light {one.level}" for one in (shipped, worst))
    return (
        f"One float32 step of an input moves an output of a shipped camera by {shipped.largest_dn:.2g} DN at most: "
        f"{of}; {only}, at most {worst.largest_dn:.2g} DN: {at}."
    )


def grid(themes: tuple[str, ...], verdicts: Sequence[Verdict]) -> Grid:
    """How many cases of each theme hold, engine by engine."""
    cells = [[cell(theme, engine, verdicts) for engine in ASKED] for theme in themes]
    marks = tuple(tuple(mark for mark, _ in row) for row in cells)
    texts = tuple(tuple(text for _, text in row) for row in cells)
    columns = tuple(engine.name.replace(" ", "\n") for engine in ASKED)
    note = (
        "No engine: formulas of single numbers, and what is refused before anybody computes. Not here: an engine that "
    )
    return Grid("How many cases hold", themes, columns, marks, texts, note + "this machine does not have.")


def cell(theme: str, engine: Engine, verdicts: Sequence[Verdict]) -> tuple[Mark, str]:
    """One cell of the grid."""
    if not any(engine in one.asked for one in THEMES if one.name == theme):
        return "", ""
    passed = [v.passed for v in verdicts if (v.case[0], v.engine) == (theme, engine.name)]
    return ("good" if all(passed) else "bad", f"{sum(passed)}/{len(passed)}") if passed else ("dim", "not here")


def table_of(theme: str, verdicts: Sequence[Verdict]) -> Table:
    """Input, expected, got, verdict of every case of a theme; engines that answer alike share a row."""
    alike: dict[tuple[str, ...], dict[tuple[str, bool], list[str]]] = {}
    for v in verdicts:
        alike.setdefault(v.case[1:], {}).setdefault((v.got, v.passed), []).append(v.engine)
    rows: list[tuple[Mark, tuple[str, ...]]] = [
        ("good" if passed else "bad", (*case, ", ".join(names), got, "holds" if passed else "fails"))
        for case, answers in alike.items()
        for (got, passed), names in answers.items()
    ]
    return table(theme.capitalize(), "stage | input | expected | engine | got | verdict", rows)


def conditions_table(found: Sequence[Sensitivity]) -> Table:
    """The inputs that move each camera's output most."""
    marks: dict[bool, Mark] = {True: "bad", False: ""}
    return table(
        "Condition numbers: what one float32 step of an input does",
        "camera | time [s] | light, share of well | input | value | mean [DN] | mean moves [DN] | "
        "temporal σ moves [DN] | spatial σ moves [DN] | condition number of the mean | "
        f"why above {NOTICED_DN:g} DN",
        [(marks[bool(s.why)], (*s[:6], *s.moved_dn, s.number, s.why)) for s in strongest(found, SHOWN)],
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
