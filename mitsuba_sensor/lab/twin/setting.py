"""Parameters of a camera from the frames of one gain setting, measured by the instruments of the laboratory."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import scipy

from ...core import InputError
from ...core.types import Float64Array
from ..frames.bench import Bench
from ..frames.selection import dark_series
from ..frames.soundness import sound
from ..frames.stack import Stack
from ..measure.emva_linear import EmvaLinear
from ..measure.line_noise import line_noise
from ..measure.measurement import linear_of, over_temperature, uniformity_of
from ..measure.nonuniformity import Nonuniformity
from ..measure.radiometric import TOO_EFFICIENT
from ..quantity import (
    Quantity,
    no_value,
    normal_interval,
)
from .dark import SECTION, Dark, dark_over_time, frame_noise, read_noise
from .evidence import Fitted, frames_of, parts_of, scaled_to
from .read_law import read_law

Result = TypeVar("Result")
LINES_MIN = 8
"""Smallest number of rows, and of columns, of each filter."""
DIFFERENCE_ALARM = 1e-3
"""Probability of a larger scatter below which filters are said to differ."""
PLATEAU = 0.2
"""Fraction of the largest variance below which a level is saturated."""
PIXEL_GAIN_MIN = 1e-3
"""Smallest gain of a pixel in the map; dead pixels have none."""
NO_RATIO = no_value("γ", "gain at full well over gain at zero", "", SECTION)
NO_END = no_value("µ_y.end", "largest linear signal", "DN", SECTION)


@dataclass(frozen=True, eq=False)
class Response:
    """Response of one filter.

    linear : figures of EMVA 1288 Linear.  ratio : γ, gain at the end over gain at zero.
    end : largest linear signal [DN], with an infinite ``high`` if no level is saturated.
    uniformity : PRNU, or None if no flat field is suitable.
    """

    linear: EmvaLinear
    ratio: Fitted
    end: Fitted
    uniformity: Nonuniformity | None

    @property
    def gain(self) -> Fitted:
        """K of small signals [DN/e-]."""
        return self.end.known_as(self.linear["K"])

    @property
    def limited_by(self) -> str:
        """Limit of the range: "well", "ADC" or "not reached"."""
        return self.linear.photon_transfer.peak.limited_by

    def straight(self, signal: Float64Array) -> Float64Array:
        """Return the linear signal for a signal [DN]."""
        return self.linear.curve.straight(signal)


@dataclass(eq=False)
class Setting:
    """Parameters at one gain setting.

    name : of the setting.  shape : rows and columns.  bits : of the ADC.  tile : of the colour filters, or empty.
    read, row, column : temporal noise of pixels, rows and columns [DN].  law : λ of the read noise, unknown if normal.
    frame : jitter of the black level [DN].  responses : response of each filter.
    doubling : temperature step that doubles the dark current, or None.  notes : what could not be measured, and why.
    """

    name: str
    shape: tuple[int, int]
    bits: int
    bits_known: bool
    tile: tuple[tuple[str, ...], ...]
    dark: Dark
    read: Fitted
    row: Fitted
    column: Fitted
    law: Quantity
    frame: Fitted
    responses: dict[str, Response]
    doubling: Fitted | None
    notes: list[str] = field(default_factory=list)

    @property
    def gain(self) -> Fitted:
        """K [DN/e-] from all filters together."""
        return weighted_mean([response.gain for response in self.responses.values()])

    @property
    def brightest(self) -> Response:
        """Response of the filter with the largest signal."""
        return max(
            self.responses.values(),
            key=lambda response: (
                response.limited_by != "not reached",
                response.end.quantity.value,
            ),
        )

    def prnu(self, part: str) -> Fitted:
        """Return PRNU of ``pixel``, ``row`` or ``col`` from all filters together."""
        figures: list[Quantity] = []
        for response in self.responses.values():
            if response.uniformity is None:
                nothing = no_value(f"PRNU_{part}", "photo response non-uniformity", "", SECTION)
                return response.end.known_as(nothing)
            figures.append(getattr(response.uniformity, f"prnu_{part}").scaled(0.01, ""))
        rows, columns = tile_shape(self.tile)
        alike = {"col": rows, "row": columns}.get(part, 1)
        prnu = replace(root_mean_square(figures, alike), symbol=f"PRNU_{part}")
        return self.brightest.end.known_as(prnu)

    def electrons(self, figure: Fitted) -> Fitted:
        """Return a figure in DN converted to electrons."""
        return figure.known_as(figure.quantity.in_electrons(self.gain.quantity))

    @property
    def maps(self) -> dict[str, Float64Array]:
        """Maps by the names of ``ms.expose(…, maps=)``: ``prnu``, ``prnu_col``, offsets [e-] and ``dark_fpn``."""
        gain = self.gain.quantity.value
        maps = {
            f"dsnu_{name}_e": part / gain for name, part in self.dark.offsets.parts().items()
        }
        if all(response.uniformity for response in self.responses.values()):
            maps |= self._gain_maps()
        if self.dark.rates is not None and self.dark.cv.known:
            image = self.dark.rates.image
            mean = float(image.mean())
            sigma = self.dark.cv.quantity.value * mean
            factors = np.maximum(1 + scaled_to(image - mean, sigma) / mean, 0.0)
            maps["dark_fpn"] = factors / factors.mean()
        return maps

    def _gain_maps(self) -> dict[str, Float64Array]:
        """Return the gains of pixels and columns; in a mosaic, column gains are part of the pixel map."""
        (height, width), (rows, columns) = self.shape, tile_shape(self.tile)
        pixels, of_columns = np.zeros((height, width)), np.zeros((1, width))
        for number, response in enumerate(self.responses.values()):
            uniformity = response.uniformity
            assert uniformity is not None
            gains = uniformity.difference / uniformity.difference.mean()
            sigmas = {
                part: 0.01 * getattr(uniformity, f"prnu_{part}").value
                for part in ("row", "col", "pixel")
            }
            parts = parts_of(gains, sigmas)
            rest = parts["pixel"] + parts["row"]
            if self.tile:
                rest = rest + parts["col"]
            else:
                of_columns = parts["col"]
            pixels[number // columns :: rows, number % columns :: columns] = rest
        return {"prnu": np.maximum(1 + pixels, PIXEL_GAIN_MIN), "prnu_col": 1 + of_columns}


def fit_setting(bench: Bench) -> Setting:
    """Fit all parameters that a bench of one gain setting shows. Raises InputError without K or a dark level."""
    _check(bench)
    bench, remarks = sound(bench)
    # In the dark, the colour filter of a pixel has no effect.
    darks = tuple(replace(stack, tile=()) for stack in bench.unlit)
    blind = replace(bench, biases=(), darks=darks, flats=(), scenes=())
    used, notes = _usable(dark_series(blind))
    notes = [*bench.notes, *remarks, *notes]
    responses = {
        name: _response(part, name, notes) for name, part in bench.of_filters().items()
    }
    gain = weighted_mean([response.gain for response in responses.values()]).quantity
    if not math.isfinite(gain.value) or not gain.low > 0:
        reasons = dict.fromkeys(response.gain.quantity.note for response in responses.values())
        why = "; ".join(reasons) or "its interval includes 0"
        raise InputError(f"K cannot be measured: {why}; take flat fields at 5 or more levels.")
    dark = dark_over_time(used)
    lines, frames = line_noise(dark.quiet), frames_of(dark.quiet)
    temperature = _try(lambda: over_temperature(blind), [])
    doubling = None
    if temperature is not None and math.isfinite(temperature.doubling.value):
        doubling = Fitted(temperature.doubling, frames_of(*darks))
    known_bits = [stack.bits for stack in bench.stacks if stack.bits]
    largest = max(stack.clipping.largest for stack in bench.stacks)
    return Setting(
        name=bench.gains[0],
        shape=bench.stacks[0].shape,
        bits=max(known_bits, default=max(1, math.ceil(math.log2(largest + 1)))),
        bits_known=bool(known_bits),
        tile=bench.stacks[0].tile,
        dark=dark,
        read=Fitted(read_noise(dark, lines.pixel, gain), frames),
        row=Fitted(lines.row, frames),
        column=Fitted(lines.column, frames),
        law=read_law(dark.quiet),
        frame=frame_noise(used),
        responses=responses,
        doubling=doubling,
        notes=list(dict.fromkeys(notes)),
    )


def _check(bench: Bench) -> None:
    """Raise InputError if stacks are missing, differ in size, or have too few pixels of each filter."""
    if not bench.unlit or not bench.flats:
        lack = "flat fields" if bench.unlit else "bias or dark frames"
        raise InputError(
            f"the bench has no {lack}; give dark frames and flat fields, at least 2 frames of each."
        )
    sources = {stack.shape: stack.source for stack in bench.stacks}
    if len(sources) > 1:
        sizes = "; ".join(f"{source} is {h} × {w}" for (h, w), source in sources.items())
        raise InputError(
            f"the frames differ in size: {sizes}; put frames of one size into a folder."
        )
    (height, width), (rows, columns) = bench.stacks[0].shape, tile_shape(bench.stacks[0].tile)
    smallest = min(height // rows, width // columns)
    if smallest < LINES_MIN:
        raise InputError(
            f"{bench.stacks[0].source}: {smallest} rows or columns of each filter; give at least {LINES_MIN}."
        )


def _usable(stacks: Sequence[Stack]) -> tuple[list[Stack], list[str]]:
    """Return unclipped stacks with at least 2 frames, and notes on the others. Raises InputError if there are none."""
    inside: list[Stack] = []
    reasons: list[str] = []
    for stack in stacks:
        if len(stack) > 1 and stack.clipping.usable:
            inside.append(stack)
        else:
            reasons.append(f"{stack.source}: {stack.clipping.note or f'{len(stack)} frame'}")
    if not inside:
        raise InputError(
            f"no dark stack has 2 frames or more within the ADC's range ({'; '.join(reasons[:3])}); take others."
        )
    return inside, [f"left out: {reason}" for reason in reasons]


def _response(bench: Bench, name: str, notes: list[str]) -> Response:
    """Measure the response of one filter. Raises InputError if the stated photons have another unit."""
    linear = linear_of(bench)
    efficiency = linear["η"]
    if TOO_EFFICIENT in efficiency.note:
        behind = f" of {name}" if name else ""
        raise InputError(
            f"the quantum efficiency{behind} cannot be measured: {efficiency.note}. Correct photons in the manifest, "
            "or omit them."
        )
    notes += linear.notes
    uniformity = _try(lambda: uniformity_of(bench, linear), notes)
    top, curve = _largest_signal(linear), linear.curve
    bends = NO_RATIO.with_interval((curve.kappa, curve.low, curve.high))
    frames = frames_of(*bench.flats)
    ratio = bends.mapped(lambda kappa: 1 + kappa * top.value)
    return Response(linear, Fitted(ratio, frames), Fitted(top, frames), uniformity)


def _largest_signal(linear: EmvaLinear) -> Quantity:
    """Return the linear mean of the brightest level if it is saturated; else a lower bound."""
    levels, end = linear.levels, linear.photon_transfer.peak
    best = int(np.argmax(levels.signal))
    value = float(linear.curve.straight(levels.signal)[best])
    full = levels.excess[best] < PLATEAU * levels.excess.max()
    if not full or end.limited_by == "not reached":
        note = "the brightest flat field is not saturated"
        return NO_END.with_interval((value, value, math.inf)).noted(note)
    error = math.hypot(levels.of_flats("mean_error")[best], levels.of_darks("mean_error")[best])
    return NO_END.with_interval(normal_interval(value, error))


def _try(instrument: Callable[[], Result], notes: list[str]) -> Result | None:
    """Return the result of an instrument, or None with its error among the notes."""
    try:
        return instrument()
    except InputError as error:
        notes.append(str(error))
        return None


def tile_shape(tile: tuple[tuple[str, ...], ...]) -> tuple[int, int]:
    """Return rows and columns of the tile of a mosaic; (1, 1) without one."""
    return (len(tile), len(tile[0])) if tile else (1, 1)


def weighted_mean(figures: Sequence[Fitted]) -> Fitted:
    """Return the mean weighted by the intervals, with a wider interval if the figures differ significantly."""
    known = [
        figure for figure in figures if figure.known and math.isfinite(figure.quantity.high)
    ]
    if len(known) < 2:
        return known[0] if known else figures[0]
    values = np.array([figure.quantity.value for figure in known])
    errors = np.array([figure.quantity.standard_error for figure in known])
    errors = np.maximum(errors, 1e-12 * np.abs(values).max() + 1e-300)
    weights = errors**-2 / (errors**-2).sum()
    mean = float(weights @ values)
    error = float((errors**-2).sum()) ** -0.5
    scatter = float((((values - mean) / errors) ** 2).sum())
    note = ""
    if float(scipy.special.chdtrc(len(values) - 1, scatter)) < DIFFERENCE_ALARM:
        error *= math.sqrt(scatter / (len(values) - 1))
        note = "the filters differ by more than noise explains"
    quantity = known[0].quantity.with_interval(normal_interval(mean, error))
    return known[0].known_as(quantity.noted(note))


def root_mean_square(figures: Sequence[Quantity], alike: int = 1) -> Quantity:
    """Return the root mean square of standard deviations of equally many pixels, with intervals added in quadrature.

    alike : how many of them share the same lines, which widens the interval.
    """
    if len(figures) == 1 or any(math.isnan(figure.value) for figure in figures):
        return min(figures, key=lambda figure: math.isfinite(figure.value))
    value, low, high = np.square([[x.value, x.low, x.high] for x in figures]).T
    count, mean = len(figures), float(value.mean())
    down = math.sqrt(alike * float(np.square(value - low).sum())) / count
    up = math.sqrt(alike * float(np.square(high - value).sum())) / count
    squares = figures[0].with_interval((mean, mean - down, mean + up))
    return squares.mapped(lambda square: math.sqrt(max(square, 0.0)))
