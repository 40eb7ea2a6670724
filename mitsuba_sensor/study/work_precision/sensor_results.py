"""What was measured of the sensor's frames, put together: errors beside times, and what must hold of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...sensor.precision import LARGEST_DN, SHARE
from ..frames import MOMENTS, QUANTITIES, in_dn
from ..kit import Spread, ratio, spread
from ..statistics import Array, pareto, t_limit
from . import sensor as measured
from .samplers import QUANTILE, REFERENCE, Setting
from .sensor import Sensor, theory_key

VARIATION, VARIATION_UP_TO = 2e-5, 1e4
"""The float32 Poisson law is as near as this to the exact one up to this mean [events]; its fit was accepted by it."""

LEAST_DN = 1e-5  # no change below this is told apart: 0 has no place on a logarithmic axis
FALSE_ALARM = 1e-3  # chance that some measured change of one setting passes its limit although the true one does not


@dataclass(frozen=True, eq=False)
class Change:
    """Of mean, temporal σ and spatial σ at every light level, (3, levels) [DN], with its standard errors.

    sensors : how many independent values the standard errors come from.
    """

    value_dn: Array
    error_dn: Array
    sensors: int

    @property
    def worst(self) -> tuple[float, float, str]:
        """The largest change, its standard error, and what it is of."""
        row, level = np.unravel_index(np.argmax(np.abs(self.value_dn)), self.value_dn.shape)
        of = f"{QUANTITIES[row]} of level {level + 1}"
        return float(abs(self.value_dn[row, level])), float(self.error_dn[row, level]), of

    @property
    def limit(self) -> float:
        """Standard errors that no change exceeds by chance, but in one of a thousand studies."""
        return t_limit(self.sensors - 1, FALSE_ALARM, self.value_dn.size)

    def within(self, tolerance_dn: float) -> bool:
        """Whether every change is at most the tolerance, as far as the sensors can tell."""
        return bool((np.abs(self.value_dn) <= tolerance_dn + self.limit * self.error_dn).all())


Levels = Mapping[str, Mapping[str, Any]]
"""By light level and moment: one value per sensor, or one in theory."""


def stacked(levels: Levels) -> Array:
    """(3, levels) or (3, levels, sensors)."""
    return np.array([[level[name] for level in levels.values()] for name in MOMENTS])


def change(found: Levels, other: Levels, theory: Levels, other_theory: Levels) -> Change:
    """found − other, of frames with equal random bits; ``other`` may be a theory, which has no error.

    √a − √b = (a − b)/(√a + √b), with the temporal variances that the frames show and the spatial ones of theory, which
    the frames know less well. Where a variance is not resolved, neither is its root: √a + √b is at least √|a − b| and
    the root of the standard error.
    """
    mine, theirs = stacked(found), stacked(other)
    off = mine - (theirs if theirs.ndim == 3 else theirs[..., None])
    value, error = off.mean(axis=2), off.std(axis=2, ddof=1) / np.sqrt(off.shape[2])
    temporal = [x[1].mean(axis=-1) if x.ndim == 3 else x[1] for x in (mine, theirs)]
    spatial = [stacked(one)[2] for one in (theory, other_theory)]
    roots = np.sqrt(np.maximum([temporal, spatial], 0.0)).sum(axis=1)
    least = np.sqrt(np.maximum(np.maximum(np.abs(value[1:]), error[1:]), np.finfo(float).tiny))
    unit = np.concatenate([np.ones_like(value[:1]), np.maximum(roots, least)])
    return Change(value / unit, error / unit, off.shape[2])


@dataclass(frozen=True, eq=False)
class Row:
    """One setting: its time and its errors.

    turns_ns : per pixel, in each turn.  first_s : until the first frame.
    pixels : one frame against the reference's; None where the random bits are not the same.
    change : from the reference.  of_plan : from the whole chain in the same precision.  theory : from the moments of
        its own stages. All three are those of NumPy's twin for a compiled engine.
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
        """How many times as fast as the other."""
        return ratio(other.turns_ns, self.turns_ns)

    @property
    def error_dn(self) -> float:
        """The largest change of mean, temporal σ and spatial σ, or what can be told where that is more [DN]."""
        return max(*self.change.worst[:2], LEAST_DN)


@dataclass(frozen=True, eq=False)
class Planned:
    """One plan. predicted : change of every level, (3, levels) [DN].  worst_pixel_dn : of any pixel, in theory."""

    tolerance_dn: float
    left_out: list[str]
    stages: int
    precision: str
    predicted: Array
    worst_pixel_dn: float


@dataclass(frozen=True)
class Requirement:
    """Something that must hold: what it is about, what was found, and the limit of that."""

    what: str
    found: float
    limit: float

    @property
    def held(self) -> bool:
        """Whether it does."""
        return self.found <= self.limit


class Results:
    """All rows, plans and laws. laws : name of a setting → mean → law.  absent : engine → why it is not here."""

    def __init__(self, sensor: Sensor) -> None:
        self._kit = kit = sensor.kit
        self.rows = tuple(self._row(setting) for setting in sensor.settings)
        self.plans = tuple(self._planned(float(dn)) for dn in sensor.tolerances_dn)
        self.laws: dict[str, dict[float, Mapping[str, Any]]] = {
            one.name: {mean: kit[f"Poisson law, mean {mean:g}: {one.name}"] for mean in measured.MEANS}
            for one in sensor.settings
            if one.tolerance_dn is None
        }
        self.absent: dict[str, str] = {engine: why for engine, why in kit["engines"].items() if why is not None}

    def _row(self, setting: Setting) -> Row:
        kit, whole = self._kit, replace(setting, tolerance_dn=None)
        turns = [kit[f"turn {k + 1} of {measured.TURNS}, frames of every setting"] for k in range(measured.TURNS)]
        frames, reference, uncut = (
            kit[f"moments: {replace(one, engine='numpy').name}"] for one in (setting, REFERENCE, whole)
        )
        theory, full = kit[theory_key(setting.tolerance_dn)]["levels"], kit[theory_key(None)]["levels"]
        pixels = measured.LARGE[0] * measured.LARGE[1]
        return Row(
            setting,
            tuple(1e9 * turn[setting.name] / pixels for turn in turns),
            kit[f"first frame: {setting.name}"],
            kit[key] if (key := f"pixels: {setting.name}") in kit.known else None,
            change(frames, reference, theory, full),
            change(frames, uncut, theory, full),
            change(frames, theory, theory, theory),
        )

    def _planned(self, tolerance_dn: float) -> Planned:
        theory, whole = self._kit[theory_key(tolerance_dn)], self._kit[theory_key(None)]
        predicted = in_dn(stacked(theory["levels"]), stacked(whole["levels"]))
        made = self._kit[f"plan: {tolerance_dn:g} DN"]
        return Planned(tolerance_dn, **made, predicted=predicted, worst_pixel_dn=theory["worst_pixel_dn"])

    def row(self, setting: Setting) -> Row:
        """That of a setting."""
        return next(row for row in self.rows if row.setting == setting)

    @cached_property
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
        """The fastest that the package offers whose frames keep within the tolerance.

        Of several that cannot be told from the fastest (its upper quartile is not reached) the nearest to the
        reference. The reference itself always keeps within it.
        """
        fit = [row for row in self.rows if self._keeps(row, plan)]
        fastest = min(fit, key=lambda row: row.ns.median)
        equal = [row for row in fit if row.ns.median <= fastest.ns.high]
        return min(equal, key=lambda row: (row.change.worst[0], row.ns.median))

    def _keeps(self, row: Row, plan: Planned) -> bool:
        """Whether the package makes frames so for that tolerance, and these keep within it."""
        setting = row.setting
        planned = setting.tolerance_dn is None or setting.tolerance_dn <= plan.tolerance_dn
        precise = setting.precision == "float64" or plan.precision == "float32"
        return setting.offered and planned and precise and row.change.within(plan.tolerance_dn)

    @cached_property
    def requirements(self) -> tuple[Requirement, ...]:
        """What the package says of itself, compared with what was measured."""
        return tuple(self._requirements())

    def _requirements(self) -> Iterator[Requirement]:
        for row in self.rows:
            setting = row.setting
            if setting.sampler == QUANTILE and setting.tolerance_dn is None:
                yield self._law(setting)
            if setting.engine == "drjit" and row.pixels:
                what = f"the bytes of NumPy float32, {setting.name}: share of pixels"
                yield Requirement(what, row.pixels["share_of_numpy"], 0.0)
        strictest = min(self.plans, key=lambda plan: plan.tolerance_dn, default=None)
        pixels = self.row(Setting("numpy", "float32", QUANTILE)).pixels
        if strictest is not None and strictest.precision == "float32" and pixels is not None:
            yield Requirement("share of pixels that float32 moves", pixels["share_of_pixels"], SHARE)
            yield Requirement("largest step that float32 makes [DN]", pixels["largest_dn"], LARGEST_DN)
        yield from map(self._change, self.plans)

    def _law(self, setting: Setting) -> Requirement:
        """At the mean where the law is farthest off, beyond what can be told apart."""
        laws = [law for mean, law in self.laws[setting.name].items() if mean <= VARIATION_UP_TO]
        worst = max(laws, key=lambda law: law["variation"] - law["resolution"])
        what = f"total variation up to a mean of {VARIATION_UP_TO:g}, {setting.name}"
        return Requirement(what, worst["variation"], VARIATION + worst["resolution"])

    def _change(self, plan: Planned) -> Requirement:
        """At the level where it is nearest to its limit, against the whole chain in the plan's own precision."""
        of_plan = next(row.of_plan for row in self.rows if row.setting.tolerance_dn == plan.tolerance_dn)
        margin = np.abs(of_plan.value_dn) - of_plan.limit * of_plan.error_dn
        place = np.unravel_index(np.argmax(margin), margin.shape)
        limit = plan.tolerance_dn + of_plan.limit * float(of_plan.error_dn[place])
        what = f"measured change that the plan for {plan.tolerance_dn:g} DN makes [DN]"
        return Requirement(what, float(abs(of_plan.value_dn[place])), limit)
