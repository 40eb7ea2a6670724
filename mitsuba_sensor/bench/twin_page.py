"""The page of ``fit``: figures of a twin, and its frames next to frames that the fit did not use."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

import mitsuba_sensor as ms

from ..core.types import Float64Array
from ..lab.frames.bench import Bench
from ..lab.frames.stack import Stack
from ..lab.frames.temporal import temporal
from ..lab.measure.correlation import correlation
from ..lab.measure.distance import (
    SIGNIFICANCE,
    Distance,
    FigureDistance,
    figure_distances,
    frame_distances,
)
from ..lab.measure.line_noise import line_noise
from ..lab.quantity import Quantity
from ..lab.statistics.estimators import z_limit
from ..lab.twin import Twin
from ..lab.twin.fit import HELD_OUT_OF_MIN
from ..pages.page import Drawing, Mark, MarkedRow, Plot, Section, Study, line, study_of, table

DEFAULT_TEMPERATURE_K = 298.15
"""Temperature of frames that do not state theirs, as in a camera file."""
NOT_COMPARED = f"not compared with held-out frames; needs {HELD_OUT_OF_MIN} in a stack"
SEED = 1288
STACKS_MAX = 4
"""Held-out stacks that are compared: the shortest and the longest dark, and the flats with most frames."""
WINDOW_PX = 256
"""Side of the window in which the variances of all flat fields are compared."""
SIGNAL_MAX = 0.9
"""Brightest compared frames over the largest signal."""
LAGS = 3
Report = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class Simulated:
    """Takes frames of a twin.  camera : from its tables.  maps : measured maps."""

    twin: Twin
    camera: ms.Camera
    maps: Mapping[str, Float64Array]

    def like(self, real: Stack, number: int) -> Stack:
        """Take as many frames with the same exposure; the light gives the real mean under each filter.

        number : of the stack; seeds its noise.
        """
        wavelength_nm = self.twin.wavelength_nm or self.camera.quantum_efficiency.reference_nm
        wavelengths = [wavelength_nm or sum(self.camera.band_nm) / 2]
        frames = ms.expose(
            self._photons(real, wavelengths)[..., None],
            self.camera,
            ms.Exposure(real.exposure_s, real.temperature_k or DEFAULT_TEMPERATURE_K),
            wavelengths_nm=wavelengths,
            maps=self.maps,
            frames=len(real),
            seed=SEED + number,
        )
        return replace(real, frames=frames.digital, source=f"twin of {real.source}")

    def _photons(self, real: Stack, wavelengths_nm: list[float]) -> Float64Array:
        """Return the mean photons per pixel, (H, W): the real electrons of each filter over its quantum efficiency."""
        photons, base = np.zeros(real.shape), self.twin.base
        if real.dark:
            return photons
        efficiency = self.camera.qe(wavelengths_nm)[:, 0]
        index = self.camera.filter_index(real.shape)
        signal = real.mean - base.dark.expected_frame(real.exposure_s)
        for number, name in enumerate(self.camera.filter_names):
            pixels = index == number
            response = base.responses.get(name) or base.brightest
            level_dn = response.straight(np.array([max(float(signal[pixels].mean()), 0.0)]))[0]
            electrons = level_dn / base.gain.quantity.value
            photons[pixels] = electrons / max(float(efficiency[number]), 1e-6)
        return photons


class Compared(NamedTuple):
    """A real stack and the twin's: distances between their values, and figures measured in both."""

    name: str
    distances: Sequence[Distance]
    figures: Sequence[FigureDistance]


def twin_study(
    twin: Twin,
    camera: ms.Camera,
    benches: tuple[Bench, Bench],
    report: Report = lambda done, total, now: None,
    **about: object,
) -> Study:
    """Return the figures of a twin and its distance from the camera.

    camera : from the twin's tables.  benches : the frames of the fit and the held-out frames from
    ``lab.twin.held_out``, both at the twin's base gain setting.  about : further facts for the data.
    """
    simulated = Simulated(twin, camera, twin.maps)
    lit = tuple(flat for flat in benches[1].flats if is_below_end(flat, twin))
    held_out = chosen_stacks(replace(benches[1], flats=lit))
    compared, total = [], len(held_out) + 1
    for number, real in enumerate(held_out):
        report(number, total, f"twin of {real.source}")
        compared.append(compare_stacks(real, simulated.like(real, number)))
    report(len(held_out), total, "photon transfer of the twin")
    residuals = list(variance_residuals(benches[0].flats, simulated))
    sections = [
        figures_section(twin),
        distances_section(compared),
        transfer_section(twin, residuals),
    ]
    data = {
        "figures": {
            name: figure.quantity.to_dict() | {"frames": figure.frames}
            for name, figure in twin.figures().items()
        },
        "distances": [
            {"stack": one.name, **distance._asdict()}
            for one in compared
            for distance in one.distances
        ],
        "residuals": residuals,
        "notes": list(twin.notes),
    }
    title = f"Twin of a camera: {camera.name}"
    return study_of("twin", title, sections, camera=camera.name, **data, **about)


def readouts_study(studies: Mapping[str, Study], camera: ms.Camera, **about: object) -> Study:
    """Join the studies of each readout's twin.  camera : with all readouts.  about : further facts for the data."""
    sections = []
    for name, study in studies.items():
        findings = tuple(f"{name}: {finding}" for finding in study.findings)
        parts = tuple(replace(part, title=f"{name}: {part.title}") for part in study.parts)
        failed = tuple(f"{name}: {check}" for check in study.failed)
        omitted = study.omitted
        sections.append(Section(findings, study.passed, parts, failed=failed, omitted=omitted))
    data = {name: study.data for name, study in studies.items()}
    title = f"Twin of a camera with several readouts: {camera.name}"
    return study_of("twin", title, sections, camera=camera.name, readouts=data, **about)


def chosen_stacks(held_out: Bench) -> list[Stack]:
    """Return the shortest and the longest dark, and the flats with most frames."""
    darks = sorted(
        (*held_out.biases, *held_out.darks),
        key=lambda one: (one.exposure_s, one.temperature_k or 0.0),
    )
    flats = sorted(held_out.flats, key=len, reverse=True)
    ends = darks[:: len(darks) - 1] if len(darks) > 1 else darks
    return [*ends, *flats[: STACKS_MAX - len(ends)]]


def compare_stacks(real: Stack, twin: Stack) -> Compared:
    """Return the distances of two stacks: of all pixels in the dark, of one filter's pixels in light."""
    stacks = alike_pixels(real), alike_pixels(twin)
    figures = figure_distances(*map(line_figures, stacks))
    name = f"{'dark' if real.dark else 'flat'}, {real.exposure_s:g} s"
    return Compared(name, frame_distances(*stacks), figures)


def alike_pixels(stack: Stack) -> Stack:
    """Return all pixels of a dark stack, or the first filter's pixels of a flat field."""
    if stack.dark or not stack.tile:
        return replace(stack, tile=())
    return next(iter(stack.of_filters().values()))


def line_figures(stack: Stack) -> list[Quantity]:
    """Return row and column noise and correlations between frames, if there are enough frames."""
    figures = list(line_noise(stack).quantities) if len(stack) > 1 else []
    if len(stack) > 2:
        figures += correlation(stack, LAGS).temporal
    return [figure for figure in figures if math.isfinite(figure.value)]


def variance_residuals(
    flats: Sequence[Stack], simulated: Simulated
) -> Iterator[dict[str, float]]:
    """Yield the temporal variance of every flat field and of the twin's, in the middle of the frames."""
    twin, base = simulated.twin, simulated.twin.base
    tile = flats[0].tile or ((),)
    rows = middle_window(flats[0].shape[0], len(tile))
    columns = middle_window(flats[0].shape[1], max(len(tile[0]), 1))
    size = {
        "sensor.rows": rows.stop - rows.start,
        "sensor.columns": columns.stop - columns.start,
    }
    window_twin = replace(twin, settings=(replace(base, dark=base.dark.window(rows, columns)),))
    maps = {
        name: values[
            rows if values.shape[0] > 1 else slice(None),
            columns if values.shape[1] > 1 else slice(None),
        ]
        for name, values in simulated.maps.items()  # some have one row or one column
    }
    window = Simulated(window_twin, simulated.camera.replace(**size), maps)
    for number, flat in enumerate(flats):
        real = flat.window(rows, columns)
        if len(flat) < 2 or not is_below_end(real, twin):
            continue
        measured = temporal(alike_pixels(real))
        expected = temporal(alike_pixels(window.like(real, 100 + number)))
        error = math.hypot(measured.variance_error, expected.variance_error)
        difference_dn2 = expected.variance - measured.variance
        yield {
            "mean_dn": float(alike_pixels(real).mean.mean()),
            "real_dn2": measured.variance,
            "twin_dn2": expected.variance,
            "z": difference_dn2 / error if error else 0.0,
        }


def is_below_end(flat: Stack, twin: Twin) -> bool:
    """Return True if a flat field is below saturation; a saturated flat does not show its light."""
    level_dn = float(flat.mean.mean()) - twin.base.dark.black.quantity.value
    return level_dn <= SIGNAL_MAX * twin.base.brightest.end.quantity.value


def middle_window(size: int, step: int) -> slice:
    """Return the middle of this many rows or columns, from the first pixel of a tile."""
    length = min(size, WINDOW_PX) // step * step
    first = (size - length) // 2 // step * step
    return slice(first, first + length)


def figures_section(twin: Twin) -> Section:
    """Return all figures with their intervals, at every gain setting."""
    rows: list[MarkedRow] = []
    for setting in twin.settings:
        prefix = f"{setting.name}: " if len(twin.settings) > 1 else ""
        for name, figure in replace(twin, settings=(setting,)).figures().items():
            quantity = figure.quantity
            interval = quantity.value, quantity.low, quantity.high
            cells = (f"{prefix}{name}", quantity.name, *interval, quantity.unit, figure.frames)
            rows.append(("", cells))
    headings = "symbol | name | value | from | to | unit | frames"
    gain = twin.base.gain.quantity
    found = f"K is {gain.value:.4g} ({gain.low:.4g} to {gain.high:.4g}) DN/e-"
    parts = (table("Figures", headings, rows, "95 % intervals."),)
    return Section((found, *twin.notes), True, parts)


def distances_section(compared: Sequence[Compared]) -> Section:
    """Return Kolmogorov–Smirnov tests; all tests together fail 1 % of exact twins."""
    tests = [(one.name, distance) for one in compared for distance in one.distances]
    if not tests:
        none = (
            "no set of equal frames has 8 or more, so no frames were held out for a comparison"
        )
        return Section((none,), True, (), omitted=(NOT_COMPARED,))
    limit = SIGNIFICANCE / len(tests)
    rows, failed = list[MarkedRow](), list[str]()
    for name, test in tests:
        mark: Mark = "good" if test.probability >= limit else "bad"
        rows.append((mark, (name, test.name, test.statistic, test.probability, test.detail)))
        failed += [f"{name}: {test.name}"] if mark == "bad" else []
    verdict = f"failed: {'; '.join(failed)}" if failed else "all passed"
    text = f"{len(tests)} Kolmogorov–Smirnov tests of the twin against frames that the fit did not use: {verdict}"
    title = "Frames that the fit did not use, and the twin's"
    shown = table(title, "stack | quantity | D [1] | p [1] | compared", rows)
    figures = [(one.name, figure) for one in compared for figure in one.figures]
    most = z_limit(max(len(figures), 1))
    beside: list[MarkedRow] = []
    for name, figure in figures:
        real, mark = figure.real, "bad" if abs(figure.z) > most else "good"
        values = real.value, figure.twin.value
        beside.append((mark, (name, real.symbol, *values, real.unit, figure.z)))
    both = table("Figures of both", "stack | symbol | camera | twin | unit | z [1]", beside)
    return Section((text,), not failed, (shown, both), failed=tuple(failed))


def transfer_section(twin: Twin, residuals: Sequence[Mapping[str, float]]) -> Section:
    """Return the photon transfer curve and the difference of the temporal variances."""
    name, response = next(iter(twin.base.responses.items()))
    curve = Drawing(f"Photon transfer {name}".strip(), response.linear.photon_transfer.plot)
    if not residuals:
        return Section((), True, (curve,))
    most = z_limit(len(residuals))
    worst = max(residuals, key=lambda one: abs(one["z"]))
    place = f"{worst['mean_dn']:.4g} DN"
    text = (
        f"the photon transfer curves of twin and camera differ most at {place}, by {worst['z']:.2g} standard errors "
        f"({len(residuals)} levels; chance exceeds {most:.2g} in 1 of 100 exact twins)"
    )
    points = [(one["mean_dn"], one["z"]) for one in residuals]
    shown = Plot(
        "Temporal variance of the twin minus the camera's",
        "mean [DN]",
        "difference [standard errors]",
        (line("flat fields", points, joined=False),),
        log_x=False,
        log_y=False,
        levels={"no difference": 0.0},
    )
    failed: tuple[str, ...] = ()
    if abs(worst["z"]) > most:
        failed = (f"photon transfer ({worst['z']:.2g} σ at {place})",)
    return Section((text,), not failed, (curve, shown), failed=failed)
