"""The page of ``fit``: figures of a twin, and frames that its fit did not see beside frames that the twin takes."""

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
from ..pages.page import Drawing, Mark, MarkedRow, Plot, Section, Study, line, study_of, table

ASSUMED_K = 298.15
"""Temperature where frames do not say it, as of the camera file."""
SEED = 1288
MOST_STACKS = 4
"""Held-out stacks that are compared: the shortest and the longest dark, and the flats with most frames."""

WINDOW = 256
"""Rows and columns of the part in which the variances of all flat fields are compared."""

BELOW_END = 0.9
"""Of the largest signal, up to which frames are compared."""

LAGS = 3
Report = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class Simulated:
    """Takes frames of a twin.  camera : from its tables.  maps : measured ones."""

    twin: Twin
    camera: ms.Camera
    maps: Mapping[str, Float64Array]

    def like(self, real: Stack, number: int) -> Stack:
        """As many frames of the same light, exposure time and temperature.  number : of the stack; seeds its noise.

        The light is such that the mean of each filter is the real one.
        """
        wavelength_nm = self.twin.wavelength_nm or self.camera.quantum_efficiency.reference_nm
        wavelengths = [wavelength_nm or sum(self.camera.band_nm) / 2]
        exposure = ms.Exposure(real.exposure_s, real.temperature_k or ASSUMED_K)
        taken = ms.expose(
            self._photons(real, wavelengths)[..., None],
            self.camera,
            exposure,
            wavelengths_nm=wavelengths,
            maps=self.maps,
            frames=len(real),
            seed=SEED + number,
        )
        return replace(real, frames=taken.digital, source=f"twin of {real.source}")

    def _photons(self, real: Stack, wavelengths_nm: list[float]) -> Float64Array:
        """Mean photons per pixel, (H, W): the real signal of each filter in electrons over its quantum efficiency."""
        if real.dark:
            return np.zeros(real.shape)
        names, efficiency = self.camera.filter_names, self.camera.qe(wavelengths_nm)[:, 0]
        index = self.camera.filter_index(real.shape)
        signal = real.mean - self.twin.base.dark.expected_frame(real.exposure_s)
        found = np.zeros(real.shape)
        for number, name in enumerate(names):
            pixels = index == number
            response = self.twin.base.responses.get(name) or self.twin.base.brightest
            level = response.straight(np.array([max(float(signal[pixels].mean()), 0.0)]))[0]
            found[pixels] = (
                level
                / self.twin.base.gain.quantity.value
                / max(float(efficiency[number]), 1e-6)
            )
        return found


class Compared(NamedTuple):
    """A real stack beside that of the twin: distances of their values, and of figures measured in both."""

    name: str
    distances: Sequence[Distance]
    figures: Sequence[FigureDistance]


def twin_study(
    twin: Twin,
    camera: ms.Camera,
    benches: tuple[Bench, Bench],
    report: Report | None = None,
    **about: object,
) -> Study:
    """Figures of a twin, and its distance from the camera.

    camera : of the twin's tables.  benches : the frames that it was fitted to, and those that were held out, as of
    ``lab.twin.held_out``, both of the twin's base gain setting.  about : for the data.
    """
    simulated = Simulated(twin, camera, twin.maps)
    lit = tuple(flat for flat in benches[1].flats if is_below_end(flat, twin))
    held_out = chosen_stacks(replace(benches[1], flats=lit))
    compared = []
    for number, real in enumerate(held_out):
        if report is not None:
            report(number, len(held_out) + 1, f"twin of {real.source}")
        compared.append(compare_stacks(real, simulated.like(real, number)))
    if report is not None:
        report(len(held_out), len(held_out) + 1, "photon transfer of the twin")
    residuals = list(variance_residuals(benches[0].flats, simulated))
    sections = [
        figures_section(twin),
        distances_section(compared),
        transfer_section(twin, residuals),
    ]
    data = {
        "figures": {
            name: one.quantity.to_dict() | {"frames": one.frames}
            for name, one in twin.figures().items()
        },
        "distances": [
            {"stack": one.name, **distance._asdict()}
            for one in compared
            for distance in one.distances
        ],
        "residuals": residuals,
        "notes": list(twin.notes),
    }
    return study_of(
        "twin",
        f"Twin of a camera: {camera.name}",
        sections,
        camera=camera.name,
        **data,
        **about,
    )


def readouts_study(studies: Mapping[str, Study], camera: ms.Camera, **about: object) -> Study:
    """The studies of the twin of each read-out as one.

    camera : of all of them.  about : for the data.
    """
    sections = []
    for name, study in studies.items():
        findings = tuple(f"{name}: {finding}" for finding in study.findings)
        parts = tuple(replace(part, title=f"{name}: {part.title}") for part in study.parts)
        failed = tuple(f"{name}: {one}" for one in study.failed)
        sections.append(Section(findings, study.passed, parts, failed=failed))
    data = {name: study.data for name, study in studies.items()}
    title = f"Twin of a camera with several read-outs: {camera.name}"
    return study_of("twin", title, sections, camera=camera.name, readouts=data, **about)


def chosen_stacks(held_out: Bench) -> list[Stack]:
    """The shortest and the longest dark, and the flats with most frames."""
    darks = sorted(
        (*held_out.biases, *held_out.darks),
        key=lambda one: (one.exposure_s, one.temperature_k or 0.0),
    )
    flats = sorted(held_out.flats, key=len, reverse=True)
    ends = darks[:: len(darks) - 1] if len(darks) > 1 else darks
    return [*ends, *flats[: MOST_STACKS - len(ends)]]


def compare_stacks(real: Stack, twin: Stack) -> Compared:
    """Distances of two stacks: in the dark of all pixels together, in light of those behind one filter."""
    of_real, of_twin = alike_pixels(real), alike_pixels(twin)
    figures = figure_distances(line_figures(of_real), line_figures(of_twin))
    name = f"{'dark' if real.dark else 'flat'}, {real.exposure_s:g} s"
    return Compared(name, frame_distances(of_real, of_twin), figures)


def alike_pixels(stack: Stack) -> Stack:
    """All pixels of a dark stack, those behind the first filter of a flat field."""
    if stack.dark or not stack.tile:
        return replace(stack, tile=())
    return next(iter(stack.of_filters().values()))


def line_figures(stack: Stack) -> list[Quantity]:
    """Noise of rows and columns and correlations from frame to frame, where there are enough frames for them."""
    figures = list(line_noise(stack).quantities) if len(stack) > 1 else []
    if len(stack) > 2:
        figures += correlation(stack, LAGS).temporal
    return [figure for figure in figures if math.isfinite(figure.value)]


def variance_residuals(
    flats: Sequence[Stack], simulated: Simulated
) -> Iterator[dict[str, float]]:
    """Temporal variance of every flat field and of the twin's, in the middle of the frames."""
    twin, tile = simulated.twin, flats[0].tile
    base = twin.base
    rows = middle_part(flats[0].shape[0], len(tile) or 1)
    columns = middle_part(flats[0].shape[1], len(tile[0]) if tile else 1)
    size = {
        "sensor.rows": rows.stop - rows.start,
        "sensor.columns": columns.stop - columns.start,
    }
    part_twin = replace(twin, settings=(replace(base, dark=base.dark.window(rows, columns)),))
    part = Simulated(
        part_twin, simulated.camera.replace(**size), cut_maps(simulated.maps, rows, columns)
    )
    for number, flat in enumerate(flats):
        real = flat.window(rows, columns)
        if len(flat) < 2 or not is_below_end(real, twin):
            continue
        measured = temporal(alike_pixels(real))
        expected = temporal(alike_pixels(part.like(real, 100 + number)))
        error = math.hypot(measured.variance_error, expected.variance_error)
        real_dn2, twin_dn2 = measured.variance, expected.variance
        yield {
            "mean_dn": float(alike_pixels(real).mean.mean()),
            "real_dn2": real_dn2,
            "twin_dn2": twin_dn2,
            "z": (twin_dn2 - real_dn2) / error if error else 0.0,
        }


def is_below_end(flat: Stack, twin: Twin) -> bool:
    """Whether a flat field is below saturation; the light of one that is full does not show."""
    level_dn = float(flat.mean.mean()) - twin.base.dark.black.quantity.value
    return level_dn <= BELOW_END * twin.base.brightest.end.quantity.value


def middle_part(size: int, step: int) -> slice:
    """The middle of so many rows or columns, from the beginning of a tile on."""
    part = min(size, WINDOW) // step * step
    first = (size - part) // 2 // step * step
    return slice(first, first + part)


def cut_maps(
    maps: Mapping[str, Float64Array], rows: slice, columns: slice
) -> dict[str, Float64Array]:
    """These rows and columns of maps, of which some have one row or one column."""
    cut = {}
    for name, values in maps.items():
        height, width = values.shape
        cut[name] = values[
            rows if height > 1 else slice(None), columns if width > 1 else slice(None)
        ]
    return cut


def figures_section(twin: Twin) -> Section:
    """All figures with their intervals, of every gain setting."""
    rows: list[MarkedRow] = []
    for setting in twin.settings:
        prefix = f"{setting.name}: " if len(twin.settings) > 1 else ""
        for name, figure in replace(twin, settings=(setting,)).figures().items():
            quantity = figure.quantity
            interval = quantity.value, quantity.low, quantity.high
            rows.append(
                (
                    "",
                    (
                        f"{prefix}{name}",
                        quantity.name,
                        *interval,
                        quantity.unit,
                        figure.frames,
                    ),
                )
            )
    shown = table(
        "Figures", "symbol | name | value | from | to | unit | frames", rows, "95 % intervals."
    )
    gain = twin.base.gain.quantity
    return Section(
        (f"K is {gain.value:.4g} ({gain.low:.4g} to {gain.high:.4g}) DN/e-", *twin.notes),
        True,
        (shown,),
    )


def distances_section(compared: Sequence[Compared]) -> Section:
    """Tests of Kolmogorov and Smirnov; all of them together fail 1 % of the exact twins."""
    tests = [(one.name, distance) for one in compared for distance in one.distances]
    if not tests:
        return Section(
            ("no set of equal frames has 8 or more: none were left to compare the twin with",),
            True,
            (),
        )
    limit = SIGNIFICANCE / len(tests)
    rows: list[MarkedRow] = []
    failed = []
    for name, test in tests:
        mark: Mark = "good" if test.probability >= limit else "bad"
        rows.append((mark, (name, test.name, test.statistic, test.probability, test.detail)))
        failed += [f"{name}: {test.name}"] if mark == "bad" else []
    verdict = f"not passed: {'; '.join(failed)}" if failed else "all pass"
    against = "of the twin's frames against frames that the fit did not use"
    text = f"{len(tests)} Kolmogorov-Smirnov tests {against}: {verdict}"
    shown = table(
        "Frames that the fit did not use beside the twin's",
        "stack | of | D [1] | p [1] | compared",
        rows,
    )
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
    """The photon transfer curve, and the difference of the temporal variances."""
    name, response = next(iter(twin.base.responses.items()))
    curve = Drawing(f"Photon transfer {name}".strip(), response.linear.photon_transfer.plot)
    if not residuals:
        return Section((), True, (curve,))
    most = z_limit(len(residuals))
    worst = max(residuals, key=lambda one: abs(one["z"]))
    text = (
        f"the photon transfer curves of twin and camera differ by {worst['z']:.2g} standard errors at most, at "
        f"{worst['mean_dn']:.4g} DN ({len(residuals)} levels; by chance 1 twin in 100 differs by more than {most:.2g})"
    )
    points = [(one["mean_dn"], one["z"]) for one in residuals]
    shown = Plot(
        "Temporal variance of the twin less the camera's",
        "mean [DN]",
        "difference [standard errors]",
        (line("flat fields", points, joined=False),),
        log_x=False,
        log_y=False,
        levels={"no difference": 0.0},
    )
    failed: tuple[str, ...] = ()
    if abs(worst["z"]) > most:
        failed = (f"photon transfer ({worst['z']:.2g} σ at {worst['mean_dn']:.4g} DN)",)
    return Section((text,), not failed, (curve, shown), failed=failed)
