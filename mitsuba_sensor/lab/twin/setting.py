"""Everything that the frames of one gain setting show of a camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.bench import Bench
from ..frames.selection import by_temperature, dark_series, darks_of, half_saturated
from ..frames.stack import Stack
from ..measure.dark_current import dark_temperature
from ..quantity import Quantity, normal_interval, unknown
from .dark import Dark, dark_over_time, usable
from .evidence import Fitted, frames_of
from .gain_map import GainMap, gain_map
from .noise import ReadNoise, read_noise
from .response import Response, response
from .telegraph import Telegraph, telegraph

Found = TypeVar("Found")
FEWEST_PIXELS = 8
"""Rows, and columns, of a frame behind each filter."""
DIFFERENT = 1e-3
"""Probability of a larger scatter, below which filters are said to differ."""


@dataclass(eq=False)
class Setting:
    """One gain setting.

    name : of the setting.  shape : rows and columns.  bits : of the ADC.  tile : of the colour filters, or empty.
    responses, gains : by filter.  doubling : temperature step that doubles the dark current, or None.
    notes : what could not be measured, and why.
    """

    name: str
    shape: tuple[int, int]
    bits: int
    bits_known: bool
    tile: tuple[tuple[str, ...], ...]
    dark: Dark
    noise: ReadNoise
    responses: dict[str, Response]
    gains: dict[str, GainMap]
    telegraph: Telegraph | None
    doubling: Fitted | None
    temperature_k: float | None
    notes: list[str] = field(default_factory=list)

    @property
    def gain(self) -> Fitted:
        """K [DN/e-], of all filters together."""
        return weighted_mean([one.gain for one in self.responses.values()])

    @property
    def brightest(self) -> Response:
        """Of the filter whose response reaches furthest."""
        return max(
            self.responses.values(),
            key=lambda one: (one.limited_by != "not reached", one.end.quantity.value),
        )

    def prnu(self, part: str) -> Fitted:
        """``pixel``, ``row`` or ``column``, of all filters together."""
        found = [getattr(one, part) for one in self.gains.values()]
        nothing = Quantity(
            f"PRNU_{part}",
            "photo response non-uniformity",
            math.nan,
            math.nan,
            math.nan,
            "",
            "fit",
        )
        rows, columns = tile_shape(self.tile)
        return (
            root_mean_square(found, {"column": rows, "row": columns}.get(part, 1))
            if found
            else Fitted(nothing, "")
        )

    def electrons(self, one: Fitted, unit: str = "e-") -> Fitted:
        """A figure in DN, in electrons."""
        return (
            one.known_as(one.quantity.divided(self.gain.quantity, unit)) if one.known else one
        )


def fit_setting(bench: Bench) -> Setting:
    """Of a bench of one gain setting. Raises InputError where it lacks what every camera file needs."""
    darks = [
        replace(one, tile=()) for one in darks_of(bench)
    ]  # which filter a pixel has does not matter in the dark
    _check(bench, darks)
    blind = replace(bench, biases=(), darks=tuple(darks), flats=(), scenes=())
    series = dark_series(blind)
    usable(series)
    responses = {name: _response(part) for name, part in bench.of_filters().items()}
    found = weighted_mean([one.gain for one in responses.values()])
    if not (found.known and found.quantity.low > 0):
        why = "; ".join(dict.fromkeys(one.gain.quantity.note for one in responses.values()))
        why = why or "its interval reaches 0"
        raise InputError(f"K cannot be measured: {why}. Take flat fields of 5 or more levels.")
    curvature = max(responses.values(), key=lambda one: one.end.quantity.value).curvature
    dark = dark_over_time(series, curvature)
    notes = [*dark.notes, *(note for one in responses.values() for note in one.notes)]
    notes += _spaced(bench)
    traps = _tried(
        lambda: telegraph(max(series, key=lambda one: (one.exposure_s, len(one)))), notes
    )
    bits, known = _bits(bench)
    return Setting(
        bench.gains[0],
        bench.stacks[0].shape,
        bits,
        known,
        bench.stacks[0].tile,
        dark,
        read_noise(dark, found.quantity),
        responses,
        _gains(bench, dark, responses, notes),
        traps,
        _doubling(blind, dark, notes),
        dark.quiet.temperature_k,
        list(dict.fromkeys(notes)),
    )


def _check(bench: Bench, darks: Sequence[Stack]) -> None:
    if not darks or not bench.flats:
        lack = "bias or dark frames" if not darks else "flat fields"
        raise InputError(
            f"there are no {lack}; a twin needs dark frames and flat fields, 2 frames or more of each."
        )
    shapes = {one.shape: one.source for one in bench.stacks}
    if len(shapes) > 1:
        found = "; ".join(f"{source} is {h} × {w}" for (h, w), source in shapes.items())
        raise InputError(
            f"the frames differ in size: {found}. Put frames of one size into a folder."
        )
    (height, width), (rows, columns) = bench.stacks[0].shape, tile_shape(bench.stacks[0].tile)
    smallest = min(height // rows, width // columns)
    if smallest < FEWEST_PIXELS:
        raise InputError(
            f"{bench.stacks[0].source}: {smallest} rows or columns per filter; {FEWEST_PIXELS} are needed."
        )


def _response(bench: Bench) -> Response:
    """With the dark frames of the flat fields' own exposure times, where there are any."""
    many = [one for one in bench.flats if len(one) > 1]
    darks: dict[int, Stack] = {}
    for flat in many:
        nearest = min(
            (one for one in darks_of(bench) if len(one) > 1), key=lambda one: _apart(one, flat)
        )
        darks[id(nearest)] = nearest
    if not many or not darks:
        raise InputError(
            "all flat fields are single frames; K needs 2 frames or more of each level."
        )
    return response(list(darks.values()), many)


def _apart(dark: Stack, flat: Stack) -> tuple[float, float, int]:
    """Dark frames of the same time and temperature come first, and of these the one with most frames."""
    warmer = abs(
        (dark.temperature_k or 0.0) - (flat.temperature_k or dark.temperature_k or 0.0)
    )
    return abs(dark.exposure_s - flat.exposure_s), warmer, -len(dark)


def _gains(
    bench: Bench, dark: Dark, responses: dict[str, Response], notes: list[str]
) -> dict[str, GainMap]:
    """PRNU of each filter; none where no flat field suits."""
    rows, columns = tile_shape(bench.stacks[0].tile)
    found: dict[str, GainMap] = {}
    for number, (name, part) in enumerate(bench.of_filters().items()):
        place = slice(number // columns, None, rows), slice(number % columns, None, columns)
        end = responses[name].end.quantity.value
        instrument = partial(_half_saturated_gains, part, end, dark.of(*place), responses[name])
        gains = _tried(instrument, notes)
        if gains is not None:
            found[name] = gains
    return found if len(found) == len(responses) else {}


def _half_saturated_gains(
    bench: Bench, saturation_dn: float | None, dark: Dark, response: Response
) -> GainMap:
    """PRNU of the flat field that is nearest to half of saturation."""
    return gain_map(half_saturated(bench, saturation_dn), dark, response)


def _doubling(bench: Bench, dark: Dark, notes: list[str]) -> Fitted | None:
    """From the dark currents of 2 temperatures or more, each with the shortest stack of all as its black level."""
    groups = by_temperature(bench)
    if len(groups) < 2:
        return None
    currents: dict[float, Quantity] = {}
    for kelvin, stacks in groups.items():
        black = replace(dark.quiet, temperature_k=kelvin)
        some = stacks if len({one.exposure_s for one in stacks}) > 1 else [black, *stacks]
        one = _tried(lambda: dark_over_time(some).rate.quantity, notes)  # noqa: B023
        if one is not None and math.isfinite(one.value):
            currents[kelvin] = one
    used = frames_of(*(one for stacks in groups.values() for one in stacks))
    found = _tried(lambda: dark_temperature(currents).doubling, notes)
    return None if found is None or not math.isfinite(found.value) else Fitted(found, used)


def _tried(instrument: Callable[[], Found], notes: list[str]) -> Found | None:
    """What an instrument finds; where it refuses None, and its sentence among the notes."""
    try:
        return instrument()
    except InputError as error:
        notes.append(str(error))
        return None


def _bits(bench: Bench) -> tuple[int, bool]:
    """Of the ADC, or the fewest that hold the largest code."""
    given = [one.bits for one in bench.stacks if one.bits]
    if given:
        return max(given), True
    largest = max(float(one.frames.max()) for one in bench.stacks)
    return max(1, math.ceil(math.log2(largest + 1))), False


def _spaced(bench: Bench) -> list[str]:
    """A note where all codes are multiples of a number, as 12 bits in the upper ones of 16 are."""
    codes = bench.stacks[0].frames[0]
    step = int(np.gcd.reduce(codes, axis=None)) if codes.dtype.kind in "ui" else 1
    if step < 2:
        return []
    return [
        f"all codes are multiples of {step}: the twin delivers the codes between too; divide the frames by {step}"
    ]


def tile_shape(tile: tuple[tuple[str, ...], ...]) -> tuple[int, int]:
    """Rows and columns of a mosaic's tile; (1, 1) without one."""
    return (len(tile), len(tile[0])) if tile else (1, 1)


def assembled(setting: Setting, of_filter: Callable[[GainMap], Float64Array]) -> Float64Array:
    """A map of the whole sensor from those of its filters."""
    rows, columns = tile_shape(setting.tile)
    found = np.zeros(setting.shape)
    for number, one in enumerate(setting.gains.values()):
        found[number // columns :: rows, number % columns :: columns] = of_filter(one)
    return found


def weighted_mean(found: Sequence[Fitted]) -> Fitted:
    """By the width of their intervals; wider where they differ by more than these allow."""
    some = [one for one in found if one.known and math.isfinite(one.quantity.high)]
    if len(some) < 2:
        return some[0] if some else found[0]
    values = np.array([one.quantity.value for one in some])
    errors = np.array([one.quantity.standard_error for one in some])
    errors = np.maximum(errors, 1e-12 * np.abs(values).max() + 1e-300)
    weights = errors**-2 / (errors**-2).sum()
    mean = float(weights @ values)
    scatter = float((((values - mean) / errors) ** 2).sum())
    differ = float(scipy.special.chdtrc(len(values) - 1, scatter)) < DIFFERENT
    error = float((errors**-2).sum()) ** -0.5 * (
        math.sqrt(scatter / (len(values) - 1)) if differ else 1.0
    )
    value, low, high = normal_interval(mean, error)
    one = replace(some[0].quantity, value=value, low=low, high=high)
    one = one.noted("the filters differ by more than noise explains") if differ else one
    return Fitted(one, _frames(some))


def root_mean_square(found: Sequence[Fitted], alike: int = 1) -> Fitted:
    """Of standard deviations of equally many pixels each; distances to the ends of the intervals in quadrature.

    alike : how many of them are of the same lines, which makes the whole less certain.
    """
    if len(found) == 1:
        return found[0]
    if not all(one.known for one in found):
        return Fitted(unknown(found[0].quantity, "not known of every filter"), _frames(found))
    squares = [
        tuple(x**2 for x in (q.value, q.low, q.high)) for q in (one.quantity for one in found)
    ]
    value = sum(one[0] for one in squares) / len(squares)
    down = math.sqrt(alike * sum((one[0] - one[1]) ** 2 for one in squares)) / len(squares)
    up = math.sqrt(alike * sum((one[2] - one[0]) ** 2 for one in squares)) / len(squares)
    middle, low, high = (math.sqrt(max(one, 0.0)) for one in (value, value - down, value + up))
    return Fitted(replace(found[0].quantity, value=middle, low=low, high=high), _frames(found))


def _frames(some: Sequence[Fitted]) -> str:
    """Filters of one mosaic come from the same files."""
    return "; ".join(dict.fromkeys(one.frames for one in some))
