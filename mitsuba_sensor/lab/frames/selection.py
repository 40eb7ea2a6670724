"""Which stacks of a bench an instrument needs: the dark of a flat field, the half-saturated one, series over time."""

from __future__ import annotations

from collections.abc import Sequence

from ...core import InputError
from .bench import Bench
from .clipping import ClippedError
from .stack import Stack

HALF = 0.5
"""Of saturation: where EMVA 1288 R4 8.2 measures PRNU."""


def darks_of(bench: Bench) -> tuple[Stack, ...]:
    """Bias and dark stacks: all without light."""
    return (*bench.biases, *bench.darks)


def shortest_dark(bench: Bench) -> Stack:
    """Of the shortest exposure; of several the one with the most frames. Raises InputError where there is none."""
    return min(_some(darks_of(bench)), key=lambda stack: (stack.exposure_s, -len(stack)))


def most_frames(darks: Sequence[Stack]) -> Stack:
    """The stack that has most. Raises InputError where there is none."""
    return max(_some(darks), key=len)


def _some(darks: Sequence[Stack]) -> Sequence[Stack]:
    if not darks:
        raise InputError("there are no bias or dark frames; take some with the lens capped.")
    return darks


def longest_dark(bench: Bench) -> Stack:
    """Of the longest exposure at the most usual temperature that does not clip."""
    usable = [one for one in dark_series(bench) if one.clipping.usable]
    if not usable:
        notes = "; ".join(
            f"{one.source}: {one.clipping.note}" for one in dark_series(bench)[:3]
        )
        raise ClippedError(f"no dark stack is inside of the ADC's range ({notes}).")
    return usable[-1]


def black_level(bench: Bench) -> float:
    """Mean of the shortest dark stack [DN]. Raises ClippedError where its values are clipped."""
    shortest = shortest_dark(bench)
    if shortest.clipping.clipped:
        raise ClippedError(
            f"the black level is not known ({shortest.source}: {shortest.clipping.note})."
        )
    return float(shortest.mean.mean())


def dark_series(bench: Bench) -> list[Stack]:
    """Dark stacks of the temperature at which there are most exposure times, by exposure time."""
    groups: dict[float | None, list[Stack]] = {}
    for stack in _some(darks_of(bench)):
        groups.setdefault(stack.temperature_k, []).append(stack)
    most = max(groups.values(), key=lambda some: len({one.exposure_s for one in some}))
    return sorted(most, key=lambda one: one.exposure_s)


def by_temperature(bench: Bench) -> dict[float, list[Stack]]:
    """Dark stacks by temperature; the shortest ones of any temperature stand for the black level of all."""
    known = [stack for stack in darks_of(bench) if stack.temperature_k is not None]
    found: dict[float, list[Stack]] = {}
    for stack in known:
        found.setdefault(float(stack.temperature_k or 0.0), []).append(stack)
    return dict(sorted(found.items()))


def dark_for(bench: Bench, flat: Stack) -> Stack:
    """Of the flat's exposure time and temperature. Raises InputError where there is none."""
    same = [one for one in darks_of(bench) if one.exposure_s == flat.exposure_s]
    same = [
        one
        for one in same
        if flat.temperature_k is None or one.temperature_k == flat.temperature_k
    ] or same
    if not same:
        raise InputError(
            f"there are no dark frames of {flat.exposure_s:g} s, the time of {flat.source}; take some."
        )
    return max(same, key=len)


def half_saturated(bench: Bench, saturation_dn: float | None) -> Stack:
    """The flat field nearest to half of saturation, of the stacks that have at least half as many frames as any.

    saturation_dn : signal over the dark level [DN]; None: that of the brightest flat field.
    Raises InputError where no flat field without clipped values is between a tenth of it and nine.
    """
    dark = float(shortest_dark(bench).frame_means.mean())
    signals = [
        (one, float(one.frame_means.mean()) - dark)
        for one in bench.flats
        if one.clipping.usable
    ]
    whole = (
        max((signal for _, signal in signals), default=0.0)
        if saturation_dn is None
        else saturation_dn
    )
    inside = [
        (one, signal / whole) for one, signal in signals if 0.1 * whole < signal < 0.9 * whole
    ]
    if not inside:
        found = (
            ", ".join(f"{100 * signal / whole:.3g} %" for _, signal in signals)
            if whole > 0
            else ""
        )
        clipped = [
            f"{one.source}: {one.clipping.note}" for one in bench.flats if one.clipping.clipped
        ]
        kind = ClippedError if clipped and not signals else InputError
        why = "; ".join(filter(None, (found, *clipped[:3]))) or "none"
        raise kind(
            f"no flat field without clipped values is between 10 and 90 % of saturation ({why}); take one at 50 %."
        )
    most = max(len(one) for one, _ in inside)
    return min(
        ((one, level) for one, level in inside if len(one) >= most / 2),
        key=lambda pair: abs(pair[1] - HALF),
    )[0]
