"""What the sensor side has measured, put together from its journal: errors beside times, and what must hold."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...sensor.precision import LARGEST_DN, SHARE
from ..fits import pareto
from ..timing import Spread, spread
from .changes import Array, Change, between, change, from_theory
from .frames import LARGE, REFERENCE
from .samplers import QUANTILE, Setting

PIXELS = LARGE[0] * LARGE[1]

ENGINES_KEY = "sensor/engines"

VARIATION, VARIATION_UP_TO = 2e-5, 1e4
"""The float32 Poisson law is as near as this to the exact one up to this mean [events]; its fit was judged by it."""

LEAST_DN = 1e-5
"""No change below this is told apart: 0 has no place on a logarithmic axis."""


def plan_key(tolerance_dn: float) -> str:
    """Keys of the journal name all that decides a measurement, within one scene, camera and exposure."""
    return f"sensor/plan/{tolerance_dn:g} DN"


def first_key(setting: Setting) -> str:
    return f"sensor/first frame/{setting.name}"


def turn_key(turn: int, settings: Sequence[Setting]) -> str:
    return f"sensor/turn {turn}/{'; '.join(setting.name for setting in settings)}"


def theory_key(tolerance_dn: float | None) -> str:
    return "sensor/theory/" + ("whole chain" if tolerance_dn is None else f"plan {tolerance_dn:g} DN")


def difference_key(setting: Setting) -> str:
    return f"sensor/pixels/{setting.name}"


def moments_key(setting: Setting) -> str:
    return f"sensor/moments/{setting.name}"


def law_key(setting: Setting, mean: float) -> str:
    return f"sensor/law/{setting.name}/{mean:g}"


@dataclass(frozen=True, eq=False)
class Row:
    """One setting: its time and its errors.

    turns_ns : per pixel, in each turn.  first_s : until the first frame.
    pixels : as ``frames.difference`` gives it; None where the words are not the same.
    change : from the reference.  of_plan : from the whole chain in the same precision.  theory : from moments() of its
        own stages. All three are those of NumPy's twin for a compiled engine.
    """

    setting: Setting
    turns_ns: tuple[float, ...]
    first_s: float
    pixels: Mapping[str, float] | None
    change: Change
    of_plan: Change
    theory: Change

    @property
    def ns(self) -> Spread:
        """Per pixel."""
        return spread(self.turns_ns)

    def times_faster(self, other: Row) -> float:
        """How many times as fast as the other: median over the turns, whose times lie next to each other."""
        return statistics.median(theirs / mine for mine, theirs in zip(self.turns_ns, other.turns_ns, strict=True))

    @property
    def error_dn(self) -> float:
        """The largest change of mean, temporal σ and fixed σ, or what can be told where that is more [DN]."""
        value, error, _ = self.change.worst
        return max(value, error, LEAST_DN)


@dataclass(frozen=True, eq=False)
class Planned:
    """One plan. predicted : change of every level, (3, levels) [DN].  worst_pixel_dn : of any pixel, in theory."""

    tolerance_dn: float
    left_out: tuple[str, ...]
    stages: int
    precision: str
    predicted: Array
    worst_pixel_dn: float


@dataclass(frozen=True, eq=False)
class Results:
    """Everything. laws : name of a setting → mean → law.  absent : engine → why it is not on this machine."""

    rows: tuple[Row, ...]
    plans: tuple[Planned, ...]
    laws: dict[str, dict[float, Mapping[str, Any]]]
    absent: dict[str, str]

    def row(self, setting: Setting) -> Row:
        """That of a setting."""
        return next(row for row in self.rows if row.setting == setting)

    @property
    def front(self) -> tuple[int, ...]:
        """Rows that no other beats in time and error."""
        return pareto([(row.ns.median, row.error_dn) for row in self.rows])

    @property
    def reference(self) -> Row:
        """The whole chain, exact."""
        return self.row(REFERENCE)

    def saved(self, row: Row) -> Spread:
        """Share of the whole chain's time on the same engine that a plan saves, over the turns."""
        whole = self.row(replace(row.setting, tolerance_dn=None))
        return spread(1 - mine / all_ for mine, all_ in zip(row.turns_ns, whole.turns_ns, strict=True))

    def recommended(self, plan: Planned) -> Row:
        """The fastest that the product offers whose frames keep within the tolerance.

        Of several that cannot be told from the fastest (its upper quartile is not reached) the nearest to the
        reference. The reference itself always keeps within it.
        """
        fit = [row for row in self.rows if self._keeps(row, plan)]
        fastest = min(fit, key=lambda row: row.ns.median)
        equal = [row for row in fit if row.ns.median <= fastest.ns.high]
        return min(equal, key=lambda row: (row.change.worst[0], row.ns.median))

    def _keeps(self, row: Row, plan: Planned) -> bool:
        """Whether the product makes frames so for that tolerance, and these keep within it."""
        setting = row.setting
        planned = setting.tolerance_dn is None or setting.tolerance_dn <= plan.tolerance_dn
        precise = setting.precision == "float64" or plan.precision == "float32"
        return setting.offered and planned and precise and row.change.within(plan.tolerance_dn)


@dataclass(frozen=True)
class Promise:
    """Something that must hold: in words, what was found, the limit, whether it holds."""

    words: str
    found: float
    limit: float
    held: bool


def gather(
    done: Mapping[str, Any], settings: Sequence[Setting], tolerances_dn: Sequence[float], means: Sequence[float],
    turns: int,
) -> Results:  # fmt: skip
    """From the journal alone."""
    seconds = [done[turn_key(turn, settings)] for turn in range(turns)]
    whole = [setting for setting in settings if setting.tolerance_dn is None]
    return Results(
        tuple(_row(done, setting, seconds) for setting in settings),
        tuple(_planned(done, tolerance_dn) for tolerance_dn in tolerances_dn),
        {setting.name: {mean: done[law_key(setting, mean)] for mean in means} for setting in whole},
        {engine: problem for engine, problem in done[ENGINES_KEY].items() if problem is not None},
    )


def _row(done: Mapping[str, Any], setting: Setting, seconds: Sequence[Mapping[str, float]]) -> Row:
    twin = replace(setting, engine="numpy")
    frames, reference, whole = (done[moments_key(one)] for one in (twin, REFERENCE, replace(twin, tolerance_dn=None)))
    theory = done[theory_key(setting.tolerance_dn)]
    spatial_dn2 = theory["spatial_dn2"], done[theory_key(None)]["spatial_dn2"]
    return Row(
        setting,
        tuple(1e9 * turn[setting.name] / PIXELS for turn in seconds),
        done[first_key(setting)],
        done.get(difference_key(setting)),
        change(frames, reference, spatial_dn2),
        change(frames, whole, spatial_dn2),
        from_theory(frames, theory),
    )


def _planned(done: Mapping[str, Any], tolerance_dn: float) -> Planned:
    plan, theory = done[plan_key(tolerance_dn)], done[theory_key(tolerance_dn)]
    return Planned(
        tolerance_dn, tuple(plan["left_out"]), plan["stages"], plan["precision"],
        between(theory, done[theory_key(None)]), max(theory["worst_pixel_dn"].values()),
    )  # fmt: skip


def promises(results: Results) -> Iterator[Promise]:
    """What the product says of itself, held against what was measured."""
    for row in results.rows:
        setting = row.setting
        if setting.sampler == QUANTILE and setting.tolerance_dn is None:
            yield _law_promise(setting, results.laws[setting.name])
        if setting.engine == "drjit" and row.pixels:
            found = row.pixels["share_of_numpy"]
            yield Promise(f"the bytes of NumPy float32, {setting.name}: share of pixels", found, 0.0, found == 0)
    yield from _float32_promises(results)
    yield from (_plan_promise(results, plan) for plan in results.plans)


def _law_promise(setting: Setting, laws: Mapping[float, Mapping[str, Any]]) -> Promise:
    """At the mean where the law is farthest off, beyond what can be told apart."""
    judged = [law for mean, law in laws.items() if mean <= VARIATION_UP_TO]
    worst = max(judged, key=lambda law: law["variation"] - law["resolution"])
    limit = VARIATION + worst["resolution"]
    words = f"total variation up to a mean of {VARIATION_UP_TO:g}, {setting.name}"
    return Promise(words, worst["variation"], limit, worst["variation"] <= limit)


def _float32_promises(results: Results) -> Iterator[Promise]:
    """Of the whole chain, where the strictest plan says that float32 is enough."""
    strictest = min(results.plans, key=lambda plan: plan.tolerance_dn, default=None)
    pixels = results.row(Setting("numpy", "float32", QUANTILE)).pixels
    if strictest is None or strictest.precision == "float64" or pixels is None:
        return
    share, largest_dn = pixels["share_of_pixels"], pixels["largest_dn"]
    yield Promise("share of pixels that float32 moves", share, SHARE, share <= SHARE)
    yield Promise("largest step that float32 makes [DN]", largest_dn, LARGEST_DN, largest_dn <= LARGEST_DN)


def _plan_promise(results: Results, plan: Planned) -> Promise:
    """Against the whole chain in the plan's own precision: what float32 moves is another matter."""
    of_plan = next(row.of_plan for row in results.rows if row.setting.tolerance_dn == plan.tolerance_dn)
    value, error, _ = of_plan.worst
    limit = plan.tolerance_dn + of_plan.limit * error
    words = f"measured change that the plan for {plan.tolerance_dn:g} DN makes [DN]"
    return Promise(words, value, limit, of_plan.within(plan.tolerance_dn))
