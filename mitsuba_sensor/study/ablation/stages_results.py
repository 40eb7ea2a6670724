"""Theory against frames: the same change twice, and whether the two agree."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri, stdtr

from ..timing import Spread, spread
from .seconds import DETECTION, seconds_key
from .stages import DEVICES, EQUAL_WORDS, NAMES, QUANTITIES, THEORY, WHOLE, Replicas

FALSE_ALARM = 0.01
"""Chance that right theory and right frames are found to disagree anywhere in a study."""

RARE = 2.0
"""Events that are the standard error where none was seen: of 3 · 2 expected, none is seen in 1 of 400 cases, 3 σ."""


def z_limit(count: int) -> float:
    """|z| that none of so many right comparisons exceeds, but in FALSE_ALARM of all studies."""
    return float(-ndtri(0.5 * (1 - (1 - FALSE_ALARM) ** (1 / max(count, 1)))))


@dataclass(frozen=True)
class Comparison:
    """One quantity of one chain, over all pixels or the worst, less that of the whole chain [DN].

    z : how many standard errors the measurement is from the prediction, as the normal law that is as unlikely counts
        them (Student's t has a wider tail); 0 where nothing changes in theory nor in frames.
    """

    case: str
    group: str
    quantity: str
    predicted_dn: float
    measured_dn: float
    error_dn: float
    z: float


@dataclass(frozen=True)
class Results:
    """All that was measured about the sensor, compared.

    changes : by chain, of mean, temporal and fixed σ over all pixels; of the whole chain these themselves.
    worst : by chain, of what it changes most, over the worst pixels.  theory, looked : what the journal has of them.
    whole_ns, saved_ns, saved_share : by engine, the last two by chain too, against the whole chain in the same turn.
    detection_ns : on NumPy.
    """

    changes: dict[str, tuple[Comparison, ...]]
    worst: dict[str, Comparison]
    theory: Mapping[str, Any]
    looked: Mapping[str, Any]
    whole_ns: dict[str, Spread]
    detection_ns: Spread | None
    saved_ns: dict[str, dict[str, Spread]]
    saved_share: dict[str, dict[str, Spread]]

    @property
    def compared(self) -> list[Comparison]:
        """All comparisons of chains that are not the whole one under another name."""
        every = [*(c for row in self.changes.values() for c in row), *self.worst.values()]
        return [one for one in every if one.error_dn > 0]

    @property
    def limit(self) -> float:
        """|z| that none of them should exceed."""
        return z_limit(len(self.compared))

    @property
    def furthest(self) -> Comparison:
        """The comparison with the largest |z|."""
        return max(self.compared, key=lambda one: abs(one.z))

    @property
    def left_out(self) -> list[str]:
        """Names of the stages that the plan leaves out."""
        return [effect["stage"] for effect in self.theory["plan"] if not effect["kept"]]


def is_whole(done: Mapping[str, Any], case: str) -> bool:
    """Whether theory and every frame that was looked at say that the chain is the whole one: nothing to measure."""
    return done[THEORY]["cases"][case]["worst_dn"] == 0 and done[EQUAL_WORDS][case]["share_of_pixels"] == 0


def gather(done: Mapping[str, Any], replicas: Replicas, engines: tuple[str, ...]) -> Results:
    """Everything from the journal."""
    theory = done[THEORY]
    changes, worst = {}, {}
    for case in theory["cases"]:
        changes[case] = tuple(_compare(done, replicas, case, WHOLE, k) for k in range(3))
        if case != WHOLE:
            worst[case] = _compare(done, replicas, case, case, QUANTITIES.index(theory["cases"][case]["of"]))
    timed = {engine: done[seconds_key(engine)] for engine in engines if done[seconds_key(engine)]}
    return Results(
        changes, worst, theory, done[EQUAL_WORDS],
        {engine: spread(turns[WHOLE]) for engine, turns in timed.items()},
        spread(timed["numpy"][DETECTION]) if "numpy" in timed else None,
        {engine: _saved(turns, lambda whole, other: whole - other) for engine, turns in timed.items()},
        {engine: _saved(turns, lambda whole, other: 1 - other / whole) for engine, turns in timed.items()},
    )  # fmt: skip


def _saved(turns: Mapping[str, list[float]], of: Any) -> dict[str, Spread]:
    return {
        case: spread(of(whole, other) for whole, other in zip(turns[WHOLE], values, strict=True))
        for case, values in turns.items()
        if case not in (WHOLE, DETECTION)
    }


def _compare(done: Mapping[str, Any], replicas: Replicas, case: str, group: str, row: int) -> Comparison:
    """Variances are compared, because they average; to DN they come by the predicted σ: Δσ = ΔV/(σ + σ′)."""
    theory, name = done[THEORY], NAMES[row]
    now = theory["cases"][case]["moments"][group][name]
    before = 0.0 if case == WHOLE else theory["cases"][WHOLE]["moments"][group][name]
    predicted_dn = now - before if row == 0 else math.sqrt(now) - math.sqrt(before)
    if case != WHOLE and is_whole(done, case):
        return Comparison(case, group, QUANTITIES[row], 0.0, 0.0, 0.0, 0.0)
    measured = done[replicas.key(case)][group]
    found, unseen = np.array(measured[name]), False
    if case != WHOLE:
        other = done[replicas.key(WHOLE)][group]
        found, unseen = found - np.array(other[name]), all(measured[one] == other[one] for one in NAMES[:2])
    error = float(found.std(ddof=1)) / math.sqrt(DEVICES)
    if unseen or error == 0:
        error = _least_error(theory, group, row)
    off = float(found.mean()) - (now - before)
    unit = 1.0 if row == 0 else _sum_of_roots(now, now if case == WHOLE else before, error)
    z = as_normal(off / error, DEVICES - 1)
    return Comparison(case, group, QUANTITIES[row], predicted_dn, predicted_dn + off / unit, error / unit, z)


def _sum_of_roots(now: float, before: float, error: float) -> float:
    """What a change of variance is divided by; where a variance is not resolved, neither is its root."""
    return max(math.sqrt(now) + math.sqrt(before), math.sqrt(error))


def _least_error(theory: Mapping[str, Any], group: str, row: int) -> float:
    """Standard error where no frame differs: the next event may be a whole line of a device, which shares a pattern."""
    pixels = theory["pixels"] if group == WHOLE else theory["cases"][group]["worst_pixels"]
    sigma = math.sqrt(sum(theory["cases"][WHOLE]["moments"][group][one] for one in NAMES[1:]))
    step = 1.0 if row == 0 else 1.0 + 2.0 * sigma  # what a pixel that reads one code more adds
    return RARE * step / (DEVICES * math.sqrt(pixels))


def as_normal(t: float, freedom: int) -> float:
    """The standard normal that is as unlikely as this Student's t."""
    return math.copysign(-float(ndtri(max(stdtr(freedom, -abs(t)), 1e-300))), t) if t else 0.0
