"""Selection of stacks for an instrument: dark frames of a flat field, half-saturated flat field, series over time."""

from __future__ import annotations

from collections.abc import Sequence

from ...core import InputError
from .bench import Bench
from .clipping import ClippedError
from .stack import Stack

TEMPORAL_LEVELS_MIN = 5
"""Number of flat fields with few frames from which temporal figures use only them."""
SPATIAL_FRAMES_RATIO = 4
"""Ratio to the usual number of frames from which a stack is meant for spatial figures."""
HALF_SATURATION = 0.5
"""Fraction of saturation at which EMVA 1288 R4 8.2 measures PRNU."""


def darks_of(bench: Bench) -> tuple[Stack, ...]:
    """Return the bias and dark stacks. Raises InputError if there are none."""
    if not bench.unlit:
        raise InputError(
            "the bench has no bias or dark frames; take some with the lens capped."
        )
    return bench.unlit


def shortest_dark(bench: Bench) -> Stack:
    """Return the dark stack of the shortest exposure or, among several, the one with most frames."""
    return min(darks_of(bench), key=lambda stack: (stack.exposure_s, -len(stack)))


def longest_dark(bench: Bench) -> Stack:
    """Return the longest unclipped dark stack at the temperature with most exposure times.

    Raises ClippedError if all of them clip.
    """
    darks = dark_series(bench)
    usable = [stack for stack in darks if stack.clipping.usable]
    if not usable:
        notes = "; ".join(f"{stack.source}: {stack.clipping.note}" for stack in darks[:3])
        raise ClippedError(f"no dark stack is within the ADC's range ({notes}).")
    return usable[-1]


def black_level(bench: Bench) -> float:
    """Return the mean of the shortest dark stack [DN]. Raises ClippedError if its values are clipped."""
    shortest = shortest_dark(bench)
    if shortest.clipping.clipped:
        raise ClippedError(
            f"the black level is unknown ({shortest.source}: {shortest.clipping.note})."
        )
    return float(shortest.mean.mean())


def dark_series(bench: Bench) -> list[Stack]:
    """Return the dark stacks at the temperature with most exposure times, sorted by exposure time."""
    groups: dict[float | None, list[Stack]] = {}
    for stack in darks_of(bench):
        groups.setdefault(stack.temperature_k, []).append(stack)
    longest_series = max(groups.values(), key=count_exposure_times)
    return sorted(longest_series, key=lambda stack: stack.exposure_s)


def count_exposure_times(stacks: Sequence[Stack]) -> int:
    """Return the number of different exposure times."""
    return len({stack.exposure_s for stack in stacks})


def by_temperature(bench: Bench) -> dict[float, list[Stack]]:
    """Return the dark stacks by temperature, without those of unknown temperature."""
    darks: dict[float, list[Stack]] = {}
    for stack in darks_of(bench):
        if stack.temperature_k is not None:
            darks.setdefault(float(stack.temperature_k), []).append(stack)
    return dict(sorted(darks.items()))


def dark_for(bench: Bench, flat: Stack) -> Stack:
    """Return the dark stack of a flat field's exposure time, preferably of its temperature and with most frames.

    Raises InputError if there is none.
    """
    darks = [stack for stack in darks_of(bench) if stack.exposure_s == flat.exposure_s]
    if not darks:
        raise InputError(
            f"the bench has no dark frames of {flat.exposure_s:g} s, the exposure time of {flat.source}; take some."
        )
    return max(darks, key=lambda stack: (stack.temperature_k == flat.temperature_k, len(stack)))


def temporal_levels(flats: Sequence[Stack]) -> list[Stack]:
    """Return the flat fields for temporal figures: pairs (EMVA 1288 R4 6.5), or stacks of about equally many frames.

    Stacks for spatial figures have many more frames, and their small errors would dominate a fit although their light
    may be off. They are left out if enough others remain.
    """
    counts = sorted(map(len, flats))
    usual = counts[(len(counts) - 1) // 2]
    few = [flat for flat in flats if len(flat) < SPATIAL_FRAMES_RATIO * usual]
    return few if len(few) >= TEMPORAL_LEVELS_MIN else list(flats)


def half_saturated(bench: Bench, saturation_dn: float | None) -> Stack:
    """Return the flat field nearest to half saturation, among stacks with at least half of the largest frame count.

    saturation_dn : saturation signal above black [DN]; None for the signal of the brightest flat field.
    Raises InputError if no unclipped flat field lies between 10 and 90 % of saturation.
    """
    dark = float(shortest_dark(bench).frame_means.mean())
    usable = [stack for stack in bench.flats if stack.clipping.usable]
    signals = [float(stack.frame_means.mean()) - dark for stack in usable]
    whole = max(signals, default=0.0) if saturation_dn is None else saturation_dn
    shares = [signal / whole if whole > 0 else 0.0 for signal in signals]
    inside = [pair for pair in zip(usable, shares, strict=True) if 0.1 < pair[1] < 0.9]
    if not inside:
        raise _no_half_saturated(bench.flats, shares)
    most = max(len(stack) for stack, _ in inside)
    large = [(stack, level) for stack, level in inside if len(stack) >= most / 2]
    return min(large, key=lambda pair: abs(pair[1] - HALF_SATURATION))[0]


def _no_half_saturated(flats: Sequence[Stack], shares: Sequence[float]) -> InputError:
    """Return the error for flat fields outside 10 to 90 % of saturation, with their levels and which of them clip."""
    reasons = [", ".join(f"{100 * share:.3g} %" for share in shares)] if shares else []
    clipped = [stack for stack in flats if stack.clipping.clipped]
    reasons += [f"{stack.source}: {stack.clipping.note}" for stack in clipped[:3]]
    kind = ClippedError if clipped and not shares else InputError
    return kind(
        "no unclipped flat field lies between 10 and 90 % of saturation "
        f"({'; '.join(reasons) or 'there is none'}); take one at 50 %."
    )
