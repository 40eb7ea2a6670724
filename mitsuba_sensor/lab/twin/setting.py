"""Everything that the frames of one gain setting show of a camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, TypeVar

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.bench import Bench
from ..frames.selection import (
    by_temperature,
    count_exposure_times,
    dark_series,
    darks_of,
    half_saturated,
    temporal_levels,
)
from ..frames.stack import Stack
from ..frames.stuck_lines import with_lines_filled
from ..measure.dark_current import dark_temperature
from ..measure.radiometric import TOO_EFFICIENT
from ..quantity import Quantity, no_value, normal_interval, unknown
from .coarse_dark import coarse_of, dark_noise_dn2
from .dark import Dark, dark_over_time, usable
from .evidence import Fitted, frames_of
from .frame_noise import frame_noise
from .gain_map import GainMap, gain_map
from .noise import ReadNoise, read_noise
from .response import Response, response
from .telegraph import Telegraph, telegraph

Result = TypeVar("Result")
FEWEST_PIXELS = 8
"""Rows, and columns, of a frame behind each filter."""
KNEE_FIGURES = {
    "full_well": ("µ_e.well", "full well in bright light"),
    "knee": ("w", "width of the knee of the full well"),
}
"""Symbol and name of what a knee has."""
DIFFERENT = 1e-3
"""Probability of a larger scatter, below which filters are said to differ."""


@dataclass(eq=False)
class Setting:
    """One gain setting.

    name : of the setting.  shape : rows and columns.  bits : of the ADC.  tile : of the colour filters, or empty.
    frame : jitter of the black level.  responses, gains : by filter.
    doubling : temperature step that doubles the dark current, or None.
    notes : what could not be measured, and why.
    """

    name: str
    shape: tuple[int, int]
    bits: int
    bits_known: bool
    tile: tuple[tuple[str, ...], ...]
    dark: Dark
    noise: ReadNoise
    frame: Fitted
    responses: dict[str, Response]
    gains: dict[str, GainMap]
    telegraph: Telegraph | None
    doubling: Fitted | None
    temperature_k: float | None
    notes: list[str] = field(default_factory=list)

    @property
    def gain(self) -> Fitted:
        """K [DN/e-], of all filters together."""
        return weighted_mean([response.gain for response in self.responses.values()])

    @property
    def brightest(self) -> Response:
        """The response of the filter that reaches furthest."""
        return max(self.responses.values(), key=_reach)

    def prnu(self, part: str) -> Fitted:
        """``pixel``, ``row`` or ``column``, of all filters together."""
        name = "photo response non-uniformity"
        if not self.gains:
            return Fitted(no_value(f"PRNU_{part}", name, "", "fit"), "")
        rows, columns = tile_shape(self.tile)
        alike = {"column": rows, "row": columns}.get(part, 1)
        figures: list[Fitted] = [getattr(gains, part) for gains in self.gains.values()]
        return root_mean_square(figures, alike)

    def knee_figure(self, which: Literal["full_well", "knee"]) -> Fitted:
        """Full well or width of its knee of the brightest filter [e-]; without a value where there is no knee."""
        symbol, name = KNEE_FIGURES[which]
        brightest = self.brightest
        figure = no_value(symbol, name, "e-", "fit")
        if brightest.knee is not None:
            ends = brightest.knee.well_e
            if which == "knee":
                ends = brightest.knee.width_e
            figure = replace(figure, value=ends[0], low=ends[1], high=ends[2])
        return brightest.end.known_as(figure)

    def electrons(self, figure: Fitted, unit: str = "e-") -> Fitted:
        """A figure in DN, in electrons."""
        if not figure.known:
            return figure
        return figure.known_as(figure.quantity.divided(self.gain.quantity, unit))


def _reach(response: Response) -> tuple[bool, float]:
    """Sorts responses by whether they reach the end of the range, and by the largest signal."""
    return response.limited_by != "not reached", response.end.quantity.value


def fit_setting(bench: Bench) -> Setting:
    """Everything that a bench of one gain setting shows.

    Raises InputError where it lacks what every camera file needs.
    """
    _check(bench)
    bench, stuck = with_lines_filled(bench)
    # Which filter a pixel has does not matter in the dark.
    darks = tuple(replace(stack, tile=()) for stack in darks_of(bench))
    blind = replace(bench, biases=(), darks=darks, flats=(), scenes=())
    series = dark_series(blind)
    usable(series)
    responses: dict[str, Response] = {}
    for name, part in bench.of_filters().items():
        responses[name] = _measure_response(part)
    _check_efficiency(responses)
    gain = weighted_mean([response.gain for response in responses.values()])
    if not gain.known or not gain.quantity.low > 0:
        reasons = dict.fromkeys(response.gain.quantity.note for response in responses.values())
        why = "; ".join(reasons) or "its interval reaches 0"
        raise InputError(f"K cannot be measured: {why}. Take flat fields of 5 or more levels.")
    furthest = max(responses.values(), key=lambda response: response.end.quantity.value)
    dark = dark_over_time(series, furthest.curvature)
    notes = [*bench.notes, *filter(None, (stuck,)), *dark.notes]
    for of_filter in responses.values():
        notes += of_filter.notes
    notes += _note_spaced_codes(bench)
    longest = max(series, key=lambda stack: (stack.exposure_s, len(stack)))
    traps = _try(lambda: telegraph(longest), notes)
    coarse = coarse_of(dark.quiet)
    if coarse is not None:
        dark = coarse.applied(dark)
    noise_dn2 = dark_noise_dn2(dark.quiet, coarse)
    responses = {name: one.by_noise(noise_dn2) for name, one in responses.items()}
    gain = weighted_mean([response.gain for response in responses.values()])
    noise = read_noise(dark, gain.quantity, coarse)
    slope = 1.0
    if coarse is not None:
        slope = coarse.slope
    gains = _gains(bench, dark, responses, notes)
    doubling = _doubling(blind, dark, notes)
    bits, bits_known = _bits(bench)
    return Setting(
        name=bench.gains[0],
        shape=bench.stacks[0].shape,
        bits=bits,
        bits_known=bits_known,
        tile=bench.stacks[0].tile,
        dark=dark,
        noise=noise,
        frame=frame_noise(series, slope),
        responses=responses,
        gains=gains,
        telegraph=traps,
        doubling=doubling,
        temperature_k=dark.quiet.temperature_k,
        notes=list(dict.fromkeys(notes)),
    )


def _check(bench: Bench) -> None:
    """Raises InputError where stacks are missing, differ in size, or have too few pixels of each filter."""
    if not darks_of(bench) or not bench.flats:
        lack = "bias or dark frames"
        if darks_of(bench):
            lack = "flat fields"
        raise InputError(
            f"there are no {lack}; a twin needs dark frames and flat fields, 2 frames or more of each."
        )
    sources = {stack.shape: stack.source for stack in bench.stacks}
    if len(sources) > 1:
        sizes = "; ".join(f"{source} is {h} × {w}" for (h, w), source in sources.items())
        raise InputError(
            f"the frames differ in size: {sizes}. Put frames of one size into a folder."
        )
    (height, width), (rows, columns) = bench.stacks[0].shape, tile_shape(bench.stacks[0].tile)
    smallest = min(height // rows, width // columns)
    if smallest < FEWEST_PIXELS:
        raise InputError(
            f"{bench.stacks[0].source}: {smallest} rows or columns per filter; {FEWEST_PIXELS} are needed."
        )


def _check_efficiency(responses: dict[str, Response]) -> None:
    """Raises InputError where the photons that are stated have another unit: a twin of them is no camera."""
    for name, measured in responses.items():
        efficiency = measured.efficiency
        if efficiency is not None and TOO_EFFICIENT in efficiency.note:
            behind = f" of {name}" if name else ""
            raise InputError(
                f"the quantum efficiency{behind} cannot be measured: {efficiency.note}. Correct photons in the "
                "manifest, or leave them out."
            )


def _measure_response(bench: Bench) -> Response:
    """Response with the dark frames of the flat fields' own exposure times, where there are any."""
    flats = temporal_levels([stack for stack in bench.flats if len(stack) > 1])
    darks = [stack for stack in darks_of(bench) if len(stack) > 1]
    if not flats or not darks:
        raise InputError(
            "all flat fields are single frames; K needs 2 frames or more of each level."
        )
    needed: dict[int, Stack] = {}
    for flat in flats:
        nearest = min(darks, key=partial(_distance, flat))
        needed[id(nearest)] = nearest
    return response(list(needed.values()), flats)


def _distance(flat: Stack, dark: Stack) -> tuple[float, float, int]:
    """Dark frames of the same time and temperature come first, and of these the one with most frames."""
    dark_k = dark.temperature_k or 0.0
    warmer = abs(dark_k - (flat.temperature_k or dark_k))
    return abs(dark.exposure_s - flat.exposure_s), warmer, -len(dark)


def _gains(
    bench: Bench, dark: Dark, responses: dict[str, Response], notes: list[str]
) -> dict[str, GainMap]:
    """PRNU of each filter; none where no flat field suits."""
    rows, columns = tile_shape(bench.stacks[0].tile)
    maps: dict[str, GainMap] = {}
    for number, (name, part) in enumerate(bench.of_filters().items()):
        behind = dark.window(
            slice(number // columns, None, rows), slice(number % columns, None, columns)
        )
        gains = _try(partial(_half_saturated_gains, part, behind, responses[name]), notes)
        if gains is not None:
            maps[name] = gains
    if len(maps) == len(responses):
        return maps
    return {}


def _half_saturated_gains(bench: Bench, dark: Dark, response: Response) -> GainMap:
    """PRNU of the flat field that is nearest to half of saturation."""
    flat = half_saturated(bench, response.end.quantity.value)
    return gain_map(flat, dark, response)


def _doubling(bench: Bench, dark: Dark, notes: list[str]) -> Fitted | None:
    """Doubling temperature from the dark currents of 2 temperatures or more.

    The shortest stack of all is the black level of those that have one exposure time.
    """
    groups = by_temperature(bench)
    if len(groups) < 2:
        return None
    used: list[Stack] = []
    currents: dict[float, Quantity] = {}
    for kelvin, stacks in groups.items():
        used += stacks
        series = stacks
        if count_exposure_times(stacks) == 1:
            series = [replace(dark.quiet, temperature_k=kelvin), *stacks]
        line = _try(partial(dark_over_time, series), notes)
        if line is not None and line.rate.known:
            currents[kelvin] = line.rate.quantity
    temperature = _try(lambda: dark_temperature(currents), notes)
    if temperature is None or not math.isfinite(temperature.doubling.value):
        return None
    return Fitted(temperature.doubling, frames_of(*used))


def _try(instrument: Callable[[], Result], notes: list[str]) -> Result | None:
    """Result of an instrument; where it refuses None, and its sentence among the notes."""
    try:
        return instrument()
    except InputError as error:
        notes.append(str(error))
        return None


def _bits(bench: Bench) -> tuple[int, bool]:
    """(bits, whether they are known) of the ADC; else the fewest that hold the largest code."""
    known = [stack.bits for stack in bench.stacks if stack.bits]
    if known:
        return max(known), True
    largest = max(float(stack.frames.max()) for stack in bench.stacks)
    return max(1, math.ceil(math.log2(largest + 1))), False


def _note_spaced_codes(bench: Bench) -> list[str]:
    """A note where all codes are multiples of a number, as 12 bits in the upper ones of 16 are."""
    codes = bench.stacks[0].frames[0]
    if codes.dtype.kind not in "ui":
        return []
    step = int(np.gcd.reduce(codes, axis=None))
    if step < 2:
        return []
    return [
        f"all codes are multiples of {step}: the twin delivers the codes between too; divide the frames by {step}"
    ]


def tile_shape(tile: tuple[tuple[str, ...], ...]) -> tuple[int, int]:
    """Rows and columns of a mosaic's tile; (1, 1) without one."""
    if tile:
        return (len(tile), len(tile[0]))
    return (1, 1)


def assembled(setting: Setting, of_filter: Callable[[GainMap], Float64Array]) -> Float64Array:
    """A map of the whole sensor from those of its filters."""
    rows, columns = tile_shape(setting.tile)
    whole = np.zeros(setting.shape)
    for number, gains in enumerate(setting.gains.values()):
        whole[number // columns :: rows, number % columns :: columns] = of_filter(gains)
    return whole


def weighted_mean(figures: Sequence[Fitted]) -> Fitted:
    """Mean by the width of the intervals; wider where the figures differ by more than these allow."""
    known = [
        figure for figure in figures if figure.known and math.isfinite(figure.quantity.high)
    ]
    if not known:
        return figures[0]
    if len(known) == 1:
        return known[0]
    values = np.array([figure.quantity.value for figure in known])
    errors = np.array([figure.quantity.standard_error for figure in known])
    errors = np.maximum(errors, 1e-12 * np.abs(values).max() + 1e-300)
    weights = errors**-2 / (errors**-2).sum()
    mean = float(weights @ values)
    error = float((errors**-2).sum()) ** -0.5
    scatter = float((((values - mean) / errors) ** 2).sum())
    note = ""
    if float(scipy.special.chdtrc(len(values) - 1, scatter)) < DIFFERENT:
        error *= math.sqrt(scatter / (len(values) - 1))
        note = "the filters differ by more than noise explains"
    value, low, high = normal_interval(mean, error)
    quantity = replace(known[0].quantity, value=value, low=low, high=high)
    return Fitted(quantity.noted(note), _name_frames(known))


def root_mean_square(figures: Sequence[Fitted], alike: int = 1) -> Fitted:
    """Of standard deviations of equally many pixels each; distances to the ends of the intervals in quadrature.

    alike : how many of them are of the same lines, which makes the whole less certain.
    """
    first = figures[0]
    if len(figures) == 1:
        return first
    if not all(figure.known for figure in figures):
        nothing = unknown(first.quantity, "not known of every filter")
        return Fitted(nothing, _name_frames(figures))
    count = len(figures)
    squares = [figure.quantity.value**2 for figure in figures]
    below = sum((f.quantity.value**2 - f.quantity.low**2) ** 2 for f in figures)
    above = sum((f.quantity.high**2 - f.quantity.value**2) ** 2 for f in figures)
    value = sum(squares) / count
    low = value - math.sqrt(alike * below) / count
    high = value + math.sqrt(alike * above) / count
    sigma = replace(
        first.quantity,
        value=math.sqrt(max(value, 0.0)),
        low=math.sqrt(max(low, 0.0)),
        high=math.sqrt(max(high, 0.0)),
    )
    return Fitted(sigma, _name_frames(figures))


def _name_frames(figures: Sequence[Fitted]) -> str:
    """The frames of all figures, each once: filters of one mosaic come from the same files."""
    return "; ".join(dict.fromkeys(figure.frames for figure in figures))
