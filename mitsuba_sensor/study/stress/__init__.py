"""``study stress``: every stage on every engine at the edge of what is allowed; condition numbers of float32 steps."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from functools import partial
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from ... import Camera, Exposure, InputError, Photons, list_cameras, load_camera
from ...core import Array
from ...sensor.datasheet_errors import fields_of
from ..frames import QUANTITIES, expected_moments, in_dn
from ..kit import Kit, Step
from ..page import Bars, Grid, Mark, Section, Study, Table, study_of, table
from . import light, moments, volts, whole
from .case import CASES as TABLES
from .case import ENGINES, NO_ENGINE, RENDERERS, SCALAR, Engine, Got, Rows, table1

ASKED = (NO_ENGINE, *ENGINES, *RENDERERS)  # columns of the grid
GRID_NOTE = "No engine: formulas of single numbers, and what is refused before anybody computes. Not here: an engine "
GRID_NOTE += "that this machine does not have."
SHOWN, BARS = 5, 3  # condition numbers of each camera in the table and in the plot
NOTICED_DN = 0.1  # A change of a mean that a careful measurement shows: a tenth of a code
LEVELS = {"dark": 0.0, "10 %": 0.1, "50 %": 0.5, "90 %": 0.9}  # shares of the full well of the most sensitive filter
EXPOSURES = (Exposure(0.1), Exposure(10.0))  # at 25 °C; the longer one lets the dark current fill a good part of a well
UNUSED = ("name", "description", "sources", "lens", "sensor")  # by the chain: the lens is in the photons already


class Theme(NamedTuple):
    """What is driven to its edge; its cases on one engine; which engines are asked; about how long one takes [s]."""

    name: str
    cases: Callable[[Engine], Rows]
    asked: tuple[Engine, ...] = ENGINES
    seconds: float = 0.1


Case = tuple[str, str, str, str]  # theme, stage, input, what must come; no two have the first three in common
Verdicts = dict[Case, dict[str, Got]]  # case → engine → what came
Nudged = tuple[str, float | None, Camera, Photons, Exposure]  # input, its value, and everything with another input
NOBODY, COMPILED = (NO_ENGINE,), tuple(engine for engine in ENGINES if engine.compiler != "scalar")
CASES: dict[str, list[tuple[Any, ...]]] = {  # of a theme; who is asked, and the seconds that one takes
    "light": [(whole.lights, ENGINES, 1.2), (whole.renderers_values, NOBODY), (whole.infinite_light,)],
    "exposure time": [(whole.times, ENGINES, 0.7)],
    "temperature": [(whole.temperatures, ENGINES, 0.7)],
    "Poisson means": [(light.poisson, ENGINES, 1.0)],
    "full well": [(light.full_well,), (whole.no_exact_count, NOBODY), (moments.well_theory, NOBODY, 6.0)],
    "dark current": [(light.dark_current, NOBODY)],
    "fixed patterns": [(light.fixed_patterns, ENGINES, 1.0)],
    "source follower": [(volts.follower_formulas, NOBODY), (moments.noted, NOBODY), (volts.follower_in_camera,)],
    "sense node": [(volts.sense_node,)],
    "coupled columns": [(volts.column_formulas, NOBODY), (partial(moments.refused, "dsnu"), NOBODY), (volts.columns,)],
    "converter": [(partial(moments.refused, "converter"), NOBODY), (volts.converter,), (volts.converter_curve,)],
    "radiance": [(light.radiances, RENDERERS, 1.5)],
    "samples per pixel": [(light.samples, RENDERERS, 2.0)],
    "bands": [(light.bands, (SCALAR,), 0.6), (moments.merged_bands, (SCALAR,), 0.5)],
    "wavelength": [(light.wavelength_formulas, NOBODY), (light.wavelengths,)],
    "refusals": [(whole.refusals, NOBODY), (partial(moments.refused, "refusals"), NOBODY), (moments.strangers, NOBODY)],
    "edges and clips": [(moments.shots, ENGINES, 3.0), (moments.ends,)],
    "defects": [(moments.defects,)],
    "derivatives": [(moments.slopes, COMPILED, 5.0)],
    "whole frames": [(whole.whole_frames, ENGINES), (whole.plans, NOBODY, 10.0), (whole.published_frames, NOBODY)],
    "frame sizes": [(whole.frame_sizes, ENGINES, 2.0)],
}
THEMES = tuple(Theme(name, *one) for name, some in CASES.items() for one in some)


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
    pairs = [(k, theme, engine) for k, theme in enumerate(THEMES) for engine in theme.asked if engine.problem is None]
    here = {f"{k}: {theme.name} | {engine.name}": (theme, engine) for k, theme, engine in pairs}
    steps = [Step(key, pair[0].seconds, partial(verdicts_of, *pair)) for key, pair in here.items()]
    kit.take([*steps, Step("condition numbers", 2.5, sensitivities)])
    verdicts: Verdicts = {}
    for key, (_, engine) in here.items():
        for case, got in kit[key]:
            verdicts.setdefault(case, {})[engine.name] = got
    themes = tuple(dict.fromkeys(theme.name for theme in THEMES))
    passed = all(got.passed for answers in verdicts.values() for got in answers.values())
    first = Section(tuple(findings(verdicts, kit.seconds)), passed, (grid(themes, verdicts),))
    tables = Section((), passed, tuple(table_of(theme, verdicts) for theme in themes))
    return study_of("stress", "Stiff and extreme cases", [first, conditions(kit["condition numbers"]), tables])


def findings(verdicts: Verdicts, seconds: float) -> list[str]:
    """How many hold, which do not, who was not asked, and what the million samples came to."""
    rows = [(case, engine, got) for case, answers in verdicts.items() for engine, got in answers.items()]
    failed = [(case, engine, got) for case, engine, got in rows if not got.passed]
    held, engines = len(verdicts) - len({case for case, _, _ in failed}), dict.fromkeys(engine for _, engine, _ in rows)
    names = ", ".join(engine for engine in engines if engine != NO_ENGINE.name)
    million = "A million samples per pixel, relative error of the irradiance"
    return [
        f"{held} of {len(verdicts)} cases hold on {names}: {len(rows)} verdicts in {seconds:.0f} s.",
        *(f"Fails: {' | '.join(case[:3])}, {e}: {got.text}; expected {case[3]}." for case, e, got in failed[:5]),
        *(f"Not here: {engine.name} ({engine.problem})." for engine in ASKED if engine.problem),
        *(f"{million}: {got.text}." for case, _, got in rows if case[2] == light.MILLION_SAMPLES),
    ]


def grid(themes: tuple[str, ...], verdicts: Verdicts) -> Grid:
    """How many cases of each theme hold, engine by engine."""
    asked = {(theme.name, engine) for theme in THEMES for engine in theme.asked}

    def cell(theme: str, engine: Engine) -> tuple[Mark, str]:
        passed = [got[engine.name].passed for case, got in verdicts.items() if case[0] == theme and engine.name in got]
        if not passed:
            return ("dim", "not here") if (theme, engine) in asked else ("", "")
        return "good" if all(passed) else "bad", f"{sum(passed)}/{len(passed)}"

    marks, texts = zip(*(zip(*(cell(theme, engine) for engine in ASKED), strict=True) for theme in themes), strict=True)
    return Grid("How many cases hold", themes, tuple(e.name.replace(" ", "\n") for e in ASKED), marks, texts, GRID_NOTE)


def table_of(theme: str, verdicts: Verdicts) -> Table:
    """Input, expected, got, verdict of every case of a theme; engines that answer alike share a row."""
    rows: list[tuple[Mark, tuple[str, ...]]] = []
    for case, answers in verdicts.items():
        for got in dict.fromkeys(answers.values()) if case[0] == theme else ():
            names = ", ".join(engine for engine, other in answers.items() if other == got)
            told = (*case[1:], names, got.text, "holds" if got.passed else "fails")
            rows.append(("good" if got.passed else "bad", told))
    return table(theme.capitalize(), "stage | input | expected | engine | got | verdict", rows)


class Sensitivity(NamedTuple):
    """What one float32 step of one input does at one light level."""

    camera: str
    time_s: float
    level: str
    field: str
    value: float | None  # None where the input is many numbers
    mean_dn: float
    moved_dn: tuple[float, ...]  # mean, temporal σ and spatial σ

    @property
    def largest_dn(self) -> float:
        """The largest of the three."""
        return max(self.moved_dn)

    @property
    def number(self) -> float | None:
        """The condition number of the mean: its relative change over that of the input."""
        return self.moved_dn[0] / self.mean_dn * self.value / ulp(self.value) if self.mean_dn and self.value else None

    @property
    def why(self) -> str:
        """A sentence where the change shows, else nothing."""
        if self.largest_dn <= NOTICED_DN:
            return ""
        if self.number and self.number > 2:
            return f"the mean, {self.mean_dn:.0f} DN, follows this input with power {self.number:.0f}"
        if self.moved_dn[0] == self.largest_dn:
            return f"the mean, {self.mean_dn:.0f} DN, has float32 steps of {ulp(self.mean_dn):g} DN itself"
        return "a spread follows this input more than the mean does"


RECORDS: tuple[type, ...] = (Got, Sensitivity)
"""Classes that its measurements consist of."""


def sensitivities() -> list[Sensitivity]:
    """Every shipped camera, and Table 1 with all curves and with 24 bits; the strongest input first."""
    cameras = {name: load_camera(name) for name in list_cameras()}
    cameras |= {
        "table 1, 16 bit, curved": table1(adc__bits=16).replace(**TABLES["curved"]),
        "table 1, 24 bit": table1(adc__bits=24),
    }
    found = [one for name, camera in cameras.items() for e in EXPOSURES for one in of_camera(name, camera, e)]
    return sorted(found, key=lambda one: -one.largest_dn)


def of_camera(name: str, camera: Camera, exposure: Exposure) -> Iterator[Sensitivity]:
    """One camera and exposure, seen in a window with one tile of colour filters for each level, side by side."""
    rows, columns = np.shape(camera.tile)
    photons = np.array([*LEVELS.values()]) * camera.pixel.full_well_e / whole.reference_qe(camera).max()
    light = Photons(np.tile(np.repeat(photons, columns), (rows, 1)))
    here = expected_moments(camera.stages, light, exposure, rounded=False)
    for field, value, changed, shone, exposed in nudges(camera, light, exposure):
        moved = np.abs(in_dn(expected_moments(changed.stages, shone, exposed, rounded=False), here))
        for k, level in enumerate(LEVELS):
            tile = np.s_[:, :, k * columns : (k + 1) * columns]
            moved_dn, mean_dn = moved[tile].reshape(3, -1), here[tile][0].ravel()
            if moved_dn.any():
                number = float(photons[k]) if field == "photons" else value
                largest, mean = tuple(moved_dn.max(axis=1).tolist()), float(mean_dn[moved_dn[0].argmax()])
                yield Sensitivity(name, exposure.time_s, level, field, number, mean, largest)


def nudges(camera: Camera, light: Photons, exposure: Exposure) -> Iterator[Nudged]:
    """Every input, its value where that is one number, and everything with that input one float32 step away."""
    yield "photons", None, camera, replace(light, mean=light.mean + ulp(light.mean) * (light.mean > 0)), exposure
    for name, value in asdict(exposure).items():
        yield name, value, camera, light, replace(exposure, **{name: nudged(value, 1)})
    for field in (name for name in fields_of(Camera) if name.split(".")[0] not in UNUSED):
        value = attrgetter(field)(camera)
        if nudged(value, 1) == value:  # a table of fields, a switch, a text
            continue
        try:
            there = camera.replace(**{field: nudged(value, 1)})
        except InputError:  # the upper end of its range
            there = camera.replace(**{field: nudged(value, -1)})
        yield field, value if isinstance(value, float) else None, there, light, exposure


def ulp(value: Array) -> Array:
    """Distance to the next float32."""
    return np.spacing(np.abs(value).astype(np.float32)).astype(np.float64)


def nudged(value: Any, direction: int) -> Any:
    """Every float in it one float32 step away, but for zeros, which are switches; all else as it is."""
    match value:
        case float():
            return float(value + direction * ulp(value)) if value else value
        case tuple():
            return tuple(nudged(x, direction) for x in value)
        case dict():
            return {name: nudged(x, direction) for name, x in value.items()}
    return value


def strongest(found: Sequence[Sensitivity], each: int) -> list[Sensitivity]:
    """The inputs that move a camera most, so many of each camera, at the exposure and level where they do."""
    first: dict[tuple[str, str], Sensitivity] = {}
    for one in found:
        if sum(camera == one.camera for camera, _ in first) < each:
            first.setdefault((one.camera, one.field), one)
    return list(first.values())


def conditions(found: Sequence[Sensitivity]) -> Section:
    """The inputs that move each camera's output most: in a sentence, as bars and in a table."""
    shipped, worst = next(one for one in found if one.camera in list_cameras()), found[0]
    beyond = " and ".join(dict.fromkeys(one.camera for one in found if one.largest_dn > NOTICED_DN))
    only = f"only {beyond} can exceed {NOTICED_DN:g} DN" if beyond else f"none exceeds {NOTICED_DN:g} DN"
    of, at = (f"{one.field} of {one.camera}, {one.time_s:g} s, light {one.level}" for one in (shipped, worst))
    which = (
        f"One float32 step of an input moves an output of a shipped camera by {shipped.largest_dn:.2g} DN at most: "
        f"{of}; {only}, at most {worst.largest_dn:.2g} DN: {at}."
    )
    rows, most, level = strongest(found, BARS), strongest(found, SHOWN), (NOTICED_DN, f"{NOTICED_DN:g} DN")
    labels = tuple(f"{s.camera}: {s.field}, {s.time_s:g} s, {s.level}" for s in rows)
    moved = {name: tuple(s.moved_dn[k] or None for s in rows) for k, name in enumerate(QUANTITIES)}
    bars = Bars("What one float32 step of an input moves", "change [DN]", labels, moved, log_x=True, level=level)
    numbers = table(
        "Condition numbers: what one float32 step of an input does",
        "camera | time [s] | light, share of well | input | value [as in a camera file] | mean [DN] | mean moves [DN] "
        "| temporal σ moves [DN] | spatial σ moves [DN] | condition number of the mean [1] | "
        f"why above {NOTICED_DN:g} DN",
        (("bad" if s.why else "", (*s[:4], s.value or "", s.mean_dn, *s.moved_dn, s.number, s.why)) for s in most),
        "The strongest inputs of each camera, at the exposure and level where they move most; float64 theory before "
        "rounding. Engines compute such numbers in float64 and round each once; only pixels are float32 all the way. "
        "The condition number is the relative change of the mean over that of the input.",
    )
    return Section((which,), True, (bars, numbers))
