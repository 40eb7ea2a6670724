"""How far a twin is from its camera: frames that the fit did not see beside frames that the twin takes of the same."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import mitsuba_sensor as ms

from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.frames.stack import Stack
from ...lab.frames.temporal import temporal
from ...lab.measure.correlation import correlation
from ...lab.measure.distance import SIGNIFICANCE, Distance, figure_distances, frame_distances
from ...lab.measure.line_noise import line_noise
from ...lab.quantity import Quantity
from ...lab.statistics.estimators import z_limit
from ...lab.twin import Twin
from ..page import Drawing, MarkedRow, Plot, Section, Study, line, study_of, table
from .simulated import Simulated

MOST_STACKS = 4
"""Held-out stacks that are compared: the shortest and the longest dark, and the flats with most frames."""
WINDOW = 256
"""Rows and columns of the part in which the variances of all flat fields are compared."""
BELOW_END = 0.9
"""Of the largest signal, up to which variances are compared."""
LAGS = 3
Report = Callable[[int, int, str], None]


class Compared(NamedTuple):
    """A real stack beside that of the twin: their distances, figures with z, and pictures."""

    name: str
    distances: tuple[Distance, ...]
    figures: tuple[tuple[Quantity, Quantity, float], ...]
    pictures: tuple[Plot, ...]


def twin_study(
    twin: Twin, camera: ms.Camera, benches: tuple[Bench, Bench], report: Report | None = None, **about: object
) -> Study:
    """Figures of a twin, and its distance from the camera.

    camera : of the twin's tables.  benches : the frames that it was fitted to, and those that were held out, as of
    ``lab.twin.held_out``, both of the twin's base gain setting.  about : for the data.
    """
    simulated = Simulated(twin, camera, twin.maps)
    chosen = _chosen(benches[1])
    compared = []
    for number, real in enumerate(chosen):
        if report is not None:
            report(number, len(chosen) + 1, f"twin of {real.source}")
        compared.append(_compared(real, simulated.like(real, number)))
    if report is not None:
        report(len(chosen), len(chosen) + 1, "photon transfer of the twin")
    residuals = list(_residuals(benches[0].flats, simulated))
    sections = [_figures(twin), _distances(compared), _transfer(twin, residuals), _pictures(compared)]
    data = {"figures": {name: one.quantity.to_dict() | {"frames": one.frames} for name, one in twin.figures().items()}}
    found = {
        "distances": [{"stack": one.name, **each._asdict()} for one in compared for each in one.distances],
        "residuals": residuals,
        "notes": list(twin.notes),
    }
    return study_of("twin", f"Twin of a camera: {camera.name}", sections, camera=camera.name, **data, **found, **about)


def _chosen(held: Bench) -> list[Stack]:
    darks = sorted((*held.biases, *held.darks), key=lambda one: (one.exposure_s, one.temperature_k or 0.0))
    flats = sorted(held.flats, key=len, reverse=True)
    ends = [darks[0], darks[-1]] if len(darks) > 1 else darks
    return [*ends, *flats[: MOST_STACKS - len(ends)]]


def _compared(real: Stack, twin: Stack) -> Compared:
    """In the dark all pixels together; in light the middle filter's, whose pixels are alike."""
    of_real, of_twin = _alike(real), _alike(twin)
    distances = frame_distances(of_real, of_twin)
    figures = figure_distances(_measured(of_real), _measured(of_twin))
    name = f"{'dark' if real.dark else 'flat'}, {real.exposure_s:g} s"
    shown = tuple((one.real, one.twin, one.z) for one in figures)
    both = {"camera": of_real, "twin": of_twin}
    pictures = _histogram(name, both), *([_spectrum(name, both)] if len(of_real) > 1 else [])
    return Compared(name, distances, shown, pictures)


def _alike(stack: Stack) -> Stack:
    if stack.dark or not stack.tile:
        return replace(stack, tile=())
    return next(iter(stack.of_filters().values()))


def _measured(stack: Stack) -> list[Quantity]:
    found = [one for one in line_noise(stack).quantities if math.isfinite(one.value)] if len(stack) > 1 else []
    if len(stack) > 2:
        found += [one for one in correlation(stack, LAGS).temporal if math.isfinite(one.value)]
    return found


def _residuals(flats: Sequence[Stack], simulated: Simulated) -> Iterator[dict[str, float]]:
    """Temporal variance of every flat field and of the twin's, in the middle of the frames."""
    height, width = flats[0].shape
    tile = (len(flats[0].tile) or 1, len(flats[0].tile[0]) if flats[0].tile else 1)
    rows, columns = (_middle(n, step) for n, step in zip((height, width), tile, strict=True))
    part = Simulated(simulated.twin, _cropped(simulated.camera, rows, columns), _cut(simulated.maps, rows, columns))
    for number, flat in enumerate(flats):
        base, real = simulated.twin.base, flat.window(rows, columns)
        level = float(real.mean.mean()) - base.dark.black.quantity.value
        if len(flat) < 2 or level > BELOW_END * base.brightest.end.quantity.value:
            continue  # the light of a level that is full does not show
        near = replace(simulated.twin, settings=(replace(base, dark=base.dark.of(rows, columns)),))
        one = _alike(real)
        other = _alike(replace(part, twin=near).like(real, 100 + number))
        both = [temporal(stack) for stack in (one, other)]
        error = math.hypot(*(each.variance_error for each in both))
        real_dn2, twin_dn2 = (float(each.variance.mean()) for each in both)
        yield {
            "mean_dn": float(one.mean.mean()),
            "real_dn2": real_dn2,
            "twin_dn2": twin_dn2,
            "z": (twin_dn2 - real_dn2) / error if error else 0.0,
        }


def _middle(size: int, step: int) -> slice:
    part = min(size, WINDOW) // step * step
    first = (size - part) // 2 // step * step
    return slice(first, first + part)


def _cropped(camera: ms.Camera, rows: slice, columns: slice) -> ms.Camera:
    return camera.replace(**{"sensor.rows": rows.stop - rows.start, "sensor.columns": columns.stop - columns.start})


def _cut(maps: Mapping[str, Float64Array], rows: slice, columns: slice) -> dict[str, Float64Array]:
    return {
        name: values[rows if values.shape[0] > 1 else slice(None), columns if values.shape[1] > 1 else slice(None)]
        for name, values in maps.items()
    }


def _figures(twin: Twin) -> Section:
    rows: list[MarkedRow] = []
    for setting in twin.settings:
        one = replace(twin, settings=(setting,))
        named = f"{setting.name}: " if len(twin.settings) > 1 else ""
        rows += [
            ("", (f"{named}{name}", q.name, q.value, q.low, q.high, q.unit or "1", figure.frames))
            for name, figure in one.figures().items()
            for q in [figure.quantity]
        ]
    shown = table("Figures", "symbol | name | value | from | to | unit | frames", rows, "95 % intervals.")
    gain = twin.base.gain.quantity
    return Section((f"K is {gain.value:.4g} ({gain.low:.4g} to {gain.high:.4g}) DN/e-", *twin.notes), True, (shown,))


def _distances(compared: Sequence[Compared]) -> Section:
    """Tests of Kolmogorov and Smirnov; all of them together fail 1 % of the exact twins."""
    tests = [(one.name, each) for one in compared for each in one.distances]
    if not tests:
        return Section(("no stack has 8 frames or more: nothing was held out to compare with",), True, ())
    limit = SIGNIFICANCE / len(tests)
    rows: list[MarkedRow] = [
        (
            "good" if each.probability >= limit else "bad",
            (name, each.name, each.statistic, each.probability, each.detail),
        )
        for name, each in tests
    ]
    failed = [f"{name}: {each.name}" for name, each in tests if each.probability < limit]
    text = f"{len(tests)} tests of Kolmogorov and Smirnov on held-out frames: "
    text += f"{len(failed)} fail: {'; '.join(failed)}" if failed else "all pass"
    shown = table("Held-out frames beside the twin's", "stack | of | D [1] | p [1] | compared", rows)
    figures = [(one.name, *each) for one in compared for each in one.figures]
    most = z_limit(max(len(figures), 1))
    more: list[MarkedRow] = [
        ("good" if not abs(z) > most else "bad", (name, real.symbol, real.value, twin.value, real.unit or "1", z))
        for name, real, twin, z in figures
    ]
    beside = table("Figures of both", "stack | symbol | camera | twin | unit | z [1]", more)
    return Section((text,), not failed, (shown, beside))


def _transfer(twin: Twin, residuals: Sequence[Mapping[str, float]]) -> Section:
    name, response = next(iter(twin.base.responses.items()))
    curve = Drawing(f"Photon transfer {name}".strip(), response.transfer.plot)
    if not residuals:
        return Section((), True, (curve,))
    most = z_limit(len(residuals))
    worst = max(residuals, key=lambda one: abs(one["z"]))
    text = (
        f"largest difference of the photon transfer is {worst['z']:.2g} standard errors, at {worst['mean_dn']:.4g} DN"
    )
    text += f" ({len(residuals)} levels; chance exceeds {most:.2g} once in 100)"
    points = [(one["mean_dn"], one["z"]) for one in residuals]
    shown = Plot(
        "Temporal variance of the twin less the camera's",
        "mean [DN]",
        "difference [standard errors]",
        (line("flat fields", points, joined=False),),
        log_x=False,
        log_y=False,
        level=(0.0, "no difference"),
    )
    return Section((text,), True, (curve, shown))


def _pictures(compared: Sequence[Compared]) -> Section:
    return Section((), True, tuple(plot for one in compared for plot in one.pictures))


def _histogram(name: str, both: Mapping[str, Stack]) -> Plot:
    """Share of the codes in both stacks, in at most 60 bins."""
    low, high = np.quantile(both["camera"].frames[:1], (0.0005, 0.9995))
    step = max(1.0, math.ceil((high - low) / 60))
    edges = np.arange(low - 3 * step, high + 4 * step, step) - 0.5
    middle = 0.5 * (edges[1:] + edges[:-1])
    lines = []
    for label, stack in both.items():
        share = np.histogram(stack.frames, edges)[0] / stack.frames.size
        points = [(float(x), float(y)) for x, y in zip(middle, share, strict=True) if y > 0]
        lines.append(line(label, points, dashed=label == "twin"))
    return Plot(f"Codes, {name}", "code [DN]", "share of the values [1]", tuple(lines), log_x=False)


def _spectrum(name: str, both: Mapping[str, Stack]) -> Plot:
    """Power of the row means over the spatial frequency, averaged over the frames."""
    lines = []
    for label, stack in both.items():
        rows = stack.row_means - stack.row_means.mean(axis=0)
        power = (np.abs(np.fft.rfft(rows, axis=1)) ** 2).mean(axis=0)[1:] / rows.shape[1]
        part = np.array_split(power, min(40, len(power)))
        points = [((k + 0.5) / len(part) / 2, float(some.mean())) for k, some in enumerate(part)]
        lines.append(line(label, points, dashed=label == "twin"))
    title = f"Spectrum of temporal row noise, {name}"
    return Plot(title, "frequency [cycles per row]", "power [DN²]", tuple(lines), log_x=False)
