"""``study stress``: every stage on every engine at the edge of what is allowed, and condition numbers."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ... import list_cameras
from ..kit import Kit, Step
from ..page import Bars, Grid, Mark, Part, Section, Study, Table, study_of, table
from . import electrons, light, volts, whole
from .case import ENGINES, NO_ENGINE, RENDERERS, SCALAR, Engine, Got, Rows
from .conditions import NOTICED_DN, Sensitivity, sensitivities, strongest

ASKED = (NO_ENGINE, *ENGINES, *RENDERERS)  # columns of the grid
CONDITIONS_S = 2.5  # how long the condition numbers take on two cores [s]
MILLION = "A million samples per pixel, relative error of the irradiance"
GRID_NOTE = (
    "No engine: formulas of single numbers, and what is refused before anybody computes. Not here: an engine that this "
    "machine does not have."
)
SHOWN, BARS = 5, 3  # condition numbers of each camera in the table and in the plot


class Theme(NamedTuple):
    """What is driven to its edge; its cases on one engine; which engines are asked; about how long one takes [s]."""

    name: str
    cases: Callable[[Engine], Rows]
    asked: tuple[Engine, ...] = ENGINES
    seconds: float = 0.1


Case = tuple[str, str, str, str]
"""Theme, stage, input, and what must come; no two cases have the first three in common."""
Verdicts = dict[Case, dict[str, Got]]
"""Case → engine → what came."""
THEMES = (
    Theme("light", whole.lights, seconds=1.2),
    Theme("light", whole.renderers_values, (NO_ENGINE,)),
    Theme("light", whole.infinite_light),
    Theme("exposure time", whole.times, seconds=0.7),
    Theme("temperature", whole.temperatures, seconds=0.7),
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


def verdicts_of(theme: Theme, engine: Engine) -> list[tuple[Case, Got]]:
    """All cases of a theme. A warning of NumPy is a NaN on its way and an exception is no answer: both fail."""
    found: list[tuple[Case, Got]] = []
    try:
        with warnings.catch_warnings(), np.errstate(divide="warn", over="warn", invalid="warn"):
            warnings.simplefilter("error", RuntimeWarning)
            for stage, given, expected, got in theme.cases(engine):
                found.append(((theme.name, stage, given, expected), got))
    except Exception as error:  # whatever it is, it is the answer of a case and must not end the study
        behind = f"behind {found[-1][0][2]}" if found else "the first"
        found.append(((theme.name, "", behind, "an answer"), Got(f"{type(error).__name__}: {error}", False)))
    return found


def stress(kit: Kit) -> Study:
    """Ask every theme of every engine that is on this machine; those that are not are said to be not here."""
    pairs = {f"{k}: {theme.name} | {e.name}": (theme, e) for k, theme in enumerate(THEMES) for e in theme.asked}
    here = {key: pair for key, pair in pairs.items() if pair[1].problem is None}
    steps = [Step(key, theme.seconds, partial(verdicts_of, theme, engine)) for key, (theme, engine) in here.items()]
    kit.take([*steps, Step("condition numbers", CONDITIONS_S, sensitivities)])
    verdicts: Verdicts = {}
    for key, (_, engine) in here.items():
        for case, got in kit[key]:
            verdicts.setdefault(case, {})[engine.name] = got
    found: list[Sensitivity] = kit["condition numbers"]
    themes = tuple(dict.fromkeys(theme.name for theme in THEMES))
    numbers = conditions_bars(strongest(found, BARS)), conditions_table(strongest(found, SHOWN))
    parts: list[Part] = [grid(themes, verdicts), *numbers, *(table_of(theme, verdicts) for theme in themes)]
    passed = all(got.passed for answers in verdicts.values() for got in answers.values())
    section = Section((*findings(verdicts, kit.seconds), which(found)), passed, tuple(parts))
    return study_of("stress", "Stiff and extreme cases", [section])


def findings(verdicts: Verdicts, seconds: float) -> list[str]:
    """How many hold, which do not, who was not asked, and what the million samples came to."""
    rows = [(case, engine, got) for case, answers in verdicts.items() for engine, got in answers.items()]
    failed = [(case, engine, got) for case, engine, got in rows if not got.passed]
    held, engines = len(verdicts) - len({case for case, _, _ in failed}), dict.fromkeys(engine for _, engine, _ in rows)
    names = ", ".join(engine for engine in engines if engine != NO_ENGINE.name)
    return [
        f"{held} of {len(verdicts)} cases hold on {names}: {len(rows)} verdicts in {seconds:.0f} s.",
        *(f"Fails: {' | '.join(case[:3])}, {e}: {got.text}; expected {case[3]}." for case, e, got in failed[:5]),
        *(f"Not here: {engine.name} ({engine.problem})." for engine in ASKED if engine.problem),
        *(f"{MILLION}: {got.text}." for case, _, got in rows if case[2] == light.MILLION_SAMPLES),
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


def grid(themes: tuple[str, ...], verdicts: Verdicts) -> Grid:
    """How many cases of each theme hold, engine by engine."""

    def cell(theme: str, engine: Engine) -> tuple[Mark, str]:
        answers = [answers.get(engine.name) for case, answers in verdicts.items() if case[0] == theme]
        passed = [got.passed for got in answers if got]
        if not passed:
            return ("dim", "not here") if (theme, engine) in asked else ("", "")
        return "good" if all(passed) else "bad", f"{sum(passed)}/{len(passed)}"

    asked = {(theme.name, engine) for theme in THEMES for engine in theme.asked}
    cells = [[cell(theme, engine) for engine in ASKED] for theme in themes]
    marks = tuple(tuple(mark for mark, _ in row) for row in cells)
    texts = tuple(tuple(text for _, text in row) for row in cells)
    columns = tuple(engine.name.replace(" ", "\n") for engine in ASKED)
    return Grid("How many cases hold", themes, columns, marks, texts, GRID_NOTE)


def table_of(theme: str, verdicts: Verdicts) -> Table:
    """Input, expected, got, verdict of every case of a theme; engines that answer alike share a row."""
    rows: list[tuple[Mark, tuple[str, ...]]] = []
    for case, answers in verdicts.items():
        for got in dict.fromkeys(answers.values()) if case[0] == theme else ():
            names = ", ".join(engine for engine, other in answers.items() if other == got)
            told = (*case[1:], names, got.text, "holds" if got.passed else "fails")
            rows.append(("good" if got.passed else "bad", told))
    return table(theme.capitalize(), "stage | input | expected | engine | got | verdict", rows)


def conditions_table(found: Sequence[Sensitivity]) -> Table:
    """The inputs that move each camera's output most."""
    marks: dict[bool, Mark] = {True: "bad", False: ""}
    return table(
        "Condition numbers: what one float32 step of an input does",
        "camera | time [s] | light, share of well | input | value | mean [DN] | mean moves [DN] | "
        "temporal σ moves [DN] | spatial σ moves [DN] | condition number of the mean | "
        f"why above {NOTICED_DN:g} DN",
        [(marks[bool(s.why)], (*s[:4], s.value or "", s.mean_dn, *s.moved_dn, s.number, s.why)) for s in found],
        "The strongest inputs of each camera, at the exposure and level where they move most; float64 theory before "
        "rounding. Engines compute such numbers in float64 and round each once; only pixels are float32 all the way. "
        "The condition number is the relative change of the mean over that of the input.",
    )


def conditions_bars(rows: Sequence[Sensitivity]) -> Bars:
    """The strongest of them."""
    labels = tuple(f"{s.camera}: {s.field}, {s.time_s:g} s, {s.level}" for s in rows)
    names = ("mean", "temporal σ", "spatial σ")
    moved = {name: tuple(s.moved_dn[k] or None for s in rows) for k, name in enumerate(names)}
    level = (NOTICED_DN, f"{NOTICED_DN:g} DN")
    return Bars("What one float32 step of an input moves", "change [DN]", labels, moved, log_x=True, level=level)
