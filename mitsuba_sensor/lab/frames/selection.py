"""Which stacks of a bench an instrument needs: the dark of a flat field, the half-saturated one, series over time."""

from __future__ import annotations

from collections.abc import Sequence

from ...core import InputError
from .bench import Bench
from .clipping import ClippedError
from .stack import Stack

FEWEST_LEVELS = 5
"""Levels of light that the stacks of few frames must be for temporal figures to be theirs alone."""
MANY = 4
"""Times the usual number of frames from which on a stack is one for spatial figures."""
HALF = 0.5
"""Of saturation: where EMVA 1288 R4 8.2 measures PRNU."""


def darks_of(bench: Bench) -> tuple[Stack, ...]:
    """Bias and dark stacks: all without light. Raises InputError where there is none."""
    darks = (*bench.biases, *bench.darks)
    if not darks:
        raise InputError("there are no bias or dark frames; take some with the lens capped.")
    return darks


def shortest_dark(bench: Bench) -> Stack:
    """The dark stack of the shortest exposure; of several the one with the most frames."""
    return min(darks_of(bench), key=lambda stack: (stack.exposure_s, -len(stack)))


def longest_dark(bench: Bench) -> Stack:
    """The longest dark stack that does not clip, of the temperature with the most exposure times.

    Raises ClippedError where all of them clip.
    """
    darks = dark_series(bench)
    usable = [stack for stack in darks if stack.clipping.usable]
    if not usable:
        notes = "; ".join(f"{stack.source}: {stack.clipping.note}" for stack in darks[:3])
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
    for stack in darks_of(bench):
        groups.setdefault(stack.temperature_k, []).append(stack)
    longest_series = max(groups.values(), key=count_exposure_times)
    return sorted(longest_series, key=lambda stack: stack.exposure_s)


def count_exposure_times(stacks: Sequence[Stack]) -> int:
    """Number of different exposure times."""
    return len({stack.exposure_s for stack in stacks})


def by_temperature(bench: Bench) -> dict[float, list[Stack]]:
    """Dark stacks by temperature, those of unknown temperature left out."""
    darks: dict[float, list[Stack]] = {}
    for stack in darks_of(bench):
        if stack.temperature_k is not None:
            darks.setdefault(float(stack.temperature_k), []).append(stack)
    return dict(sorted(darks.items()))


def dark_for(bench: Bench, flat: Stack) -> Stack:
    """The dark stack of a flat's exposure time, and of its temperature if there is one; that with the most frames.

    Raises InputError where there is none.
    """
    darks = [stack for stack in darks_of(bench) if stack.exposure_s == flat.exposure_s]
    if not darks:
        raise InputError(
            f"there are no dark frames of {flat.exposure_s:g} s, the time of {flat.source}; take some."
        )
    return max(darks, key=lambda stack: (stack.temperature_k == flat.temperature_k, len(stack)))


def temporal_levels(flats: Sequence[Stack]) -> list[Stack]:
    """The flat fields that temporal figures are from: the pairs that EMVA 1288 R4 6.5 asks for, or as many frames.

    Stacks of many more frames, which spatial figures need, would rule a fit with all others by their small errors,
    whatever light they had; they are left out where the others are enough.
    """
    counts = sorted(map(len, flats))
    few = [flat for flat in flats if len(flat) < MANY * counts[(len(counts) - 1) // 2]]
    return few if len(few) >= FEWEST_LEVELS else list(flats)


def half_saturated(bench: Bench, saturation_dn: float | None) -> Stack:
    """The flat field nearest to half of saturation, of the stacks that have at least half as many frames as any.

    saturation_dn : signal over the dark level [DN]; None: that of the brightest flat field.
    Raises InputError where no flat field without clipped values is between a tenth of it and nine.
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
    return min(large, key=lambda pair: abs(pair[1] - HALF))[0]


def _no_half_saturated(flats: Sequence[Stack], shares: Sequence[float]) -> InputError:
    """The error where no flat field is between 10 and 90 % of saturation: at which levels they are, which clip."""
    reasons = [", ".join(f"{100 * share:.3g} %" for share in shares)] if shares else []
    clipped = [stack for stack in flats if stack.clipping.clipped]
    reasons += [f"{stack.source}: {stack.clipping.note}" for stack in clipped[:3]]
    kind = ClippedError if clipped and not shares else InputError
    return kind(
        "no flat field without clipped values is between 10 and 90 % of saturation "
        f"({'; '.join(reasons) or 'none'}); take one at 50 %."
    )
