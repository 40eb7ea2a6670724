"""All instruments on the frames of one bench: what each colour filter's pixels show, and what could not be measured."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Protocol, TypeVar

from ...core import InputError
from ..frames.bench import Bench
from ..frames.clipping import ClippedError
from ..frames.notes import merged
from ..frames.selection import (
    black_level,
    by_temperature,
    count_exposure_times,
    dark_for,
    dark_series,
    darks_of,
    half_saturated,
    longest_dark,
    most_frames,
    shortest_dark,
)
from ..frames.series import Report
from ..frames.stack import Stack
from ..frames.stuck_lines import without_stuck_lines
from ..quantity import Quantity
from .correlation import correlation
from .dark_current import DarkCurrentOverTime, DarkTemperature, dark_current, dark_temperature
from .dark_signal import dark_signal
from .defects import defects
from .emva_linear import EmvaLinear, emva_linear
from .line_noise import LineNoise, line_noise
from .nonuniformity import Nonuniformity, nonuniformity
from .photon_transfer import photon_transfer_of_scene
from .profiles import profiles
from .rts_pixels import rts_pixels
from .spectrogram import spectrograms

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Instrument(Protocol):
    """Result of an instrument."""

    @property
    def quantities(self) -> Sequence[Quantity]:
        """Its figures."""

    def plot(self, ax: Axes, /) -> None:
        """Draws it."""


Scaled = TypeVar("Scaled", DarkCurrentOverTime, LineNoise, Nonuniformity)
INSTRUMENTS = 13
"""That measure each filter, for a progress bar."""


@dataclass(eq=False)
class Measurement:
    """Results of all instruments behind one colour filter.

    filter_name : of the filter, empty for a monochrome camera.
    figures : all quantities, by symbol, in the order of the instruments.
    drawings : what to draw, by title.  notes : what the instruments say about the frames.
    refused : the sentence of every instrument that could not measure, by its title.
    clipped : titles of the instruments that could not because values are clipped.
    report : told the title of every instrument when it begins; begun : those titles.
    """

    filter_name: str
    figures: dict[str, Quantity] = field(default_factory=dict)
    drawings: dict[str, Callable[[Axes], object]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    clipped: list[str] = field(default_factory=list)
    report: Callable[[str], object] = lambda title: None
    begun: list[str] = field(default_factory=list)

    def run(self, title: str, instrument: Callable[[], Result]) -> Result | None:
        """Result of an instrument; None where it refuses."""
        if title not in self.begun:
            self.begun.append(title)
            self.report(title)
        try:
            return instrument()
        except InputError as error:
            self.refused[title] = str(error)
            if isinstance(error, ClippedError):
                self.clipped.append(title)
            return None

    @property
    def hidden(self) -> list[str]:
        """What has no value because values of the frames are clipped: symbols, and titles of instruments."""
        symbols = [figure.symbol for figure in self.figures.values() if figure.clipped]
        return symbols + self.clipped

    def take(self, title: str, drawing: str, instrument: Callable[[], Instrument]) -> None:
        """Keep figures and drawing of an instrument; nothing where it refuses.  drawing : its title."""
        result = self.run(title, instrument)
        if result is not None:
            self.keep(result.quantities)
            self.drawings[drawing] = result.plot

    def keep(self, quantities: Iterable[Quantity]) -> None:
        """Keep the figures of an instrument."""
        for quantity in quantities:
            self.figures[quantity.symbol] = quantity


Result = TypeVar("Result")


def measure_bench(
    bench: Bench, report: Callable[[str], object] = lambda title: None
) -> tuple[Measurement, ...]:
    """Every instrument on the pixels behind each colour filter of a bench: K, QE, noise, saturation, dark current, …

    ::

        bench = ms.lab.read_bench("bench/")
        (measured,) = ms.lab.measure_bench(bench)
        print(measured.figures["K"])

    report : called with the title of each instrument before it measures, from several threads; with the title, a colon
        and how far it is while a long one measures.

    Raises InputError for a bench of several gain settings (see :meth:`Bench.at_gain`), and for one without stacks.
    """
    if len(bench.gains) != 1:
        gains = ", ".join(bench.gains) or "no frames"
        raise InputError(
            f"the bench has the gain settings {gains}; measure Bench.at_gain() of each."
        )

    def measure_filter(name: str, part: Bench) -> Measurement:
        responding, stuck = without_stuck_lines(part)
        notes = [note for note in (*bench.notes, stuck) if note]
        measurement = Measurement(name, notes=notes, report=report)
        _run_all(measurement, responding)
        measurement.notes = merged(measurement.notes)
        return measurement

    parts = bench.of_filters()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return tuple(pool.map(measure_filter, parts.keys(), parts.values()))


def _run_all(measurement: Measurement, bench: Bench) -> None:
    """Run every instrument on the pixels behind one filter."""

    def report(done: int, total: int) -> None:
        measurement.report(f"photon transfer: {done} of {total} levels")

    linear = measurement.run("photon transfer", lambda: _measure_linear(bench, report))
    if linear is not None:
        _keep_linear(measurement, linear)
    gain = measurement.figures.get("K")
    if gain is not None and not gain.low > 0:
        gain = None
    _measure_scene(measurement, bench)
    _measure_lines(measurement, bench, gain)
    _measure_uniformity(measurement, bench, gain, linear)
    _measure_dark(measurement, bench, gain)


def _measure_linear(bench: Bench, report: Report) -> EmvaLinear:
    """EMVA 1288 Linear with the dark frames of the flat fields' own exposure times."""
    flat_of_time: dict[float, Stack] = {}
    for flat in bench.flats:
        flat_of_time.setdefault(flat.exposure_s, flat)
    darks = [dark_for(bench, flat) for _, flat in sorted(flat_of_time.items())]
    return emva_linear(darks, bench.flats, report=report)


def _keep_linear(measurement: Measurement, linear: EmvaLinear) -> None:
    measurement.keep(linear.quantities)
    measurement.notes += linear.notes
    measurement.drawings |= {
        "Radiometric function": linear.radiometric.plot,
        "Photon transfer, linear": linear.photon_transfer.plot,
        "Photon transfer, logarithmic": partial(linear.photon_transfer.plot, log=True),
        "Signal-to-noise ratio, linear": partial(linear.snr.plot, log=False),
        "Signal-to-noise ratio, logarithmic": linear.snr.plot,
        "Linearity": linear.radiometric.plot_deviation,
    }


def _measure_scene(measurement: Measurement, bench: Bench) -> None:
    """The paper's photon transfer curve, of the first scene."""
    if not bench.scenes:
        return
    transfer = measurement.run(
        "photon transfer of a scene", lambda: photon_transfer_of_scene(bench.scenes[0])
    )
    if transfer is not None:
        section = "Konnik & Welsh 2014, section 4"
        measurement.keep([replace(transfer.gain, symbol="K_scene", section=section)])
        measurement.drawings["Photon transfer of a scene"] = transfer.plot


def _measure_in_electrons(gain: Quantity | None, instrument: Callable[[], Scaled]) -> Scaled:
    """Result of an instrument, in electrons where K is known."""
    result = instrument()
    if gain is None:
        return result
    return result.per_gain(gain)


def _measure_lines(measurement: Measurement, bench: Bench, gain: Quantity | None) -> None:
    """Row and column noise, and correlations, of the shortest dark frames."""
    lines = partial(_measure_in_electrons, gain, lambda: line_noise(shortest_dark(bench)))
    measurement.take("row and column noise", "Temporal noise of rows and columns", lines)
    measurement.take(
        "correlation", "Correlation over frames", lambda: correlation(shortest_dark(bench))
    )


def _measure_uniformity(
    measurement: Measurement, bench: Bench, gain: Quantity | None, linear: EmvaLinear | None
) -> None:
    """Non-uniformity, profiles, spectrograms and defects of the half-saturated flat field and its dark frames."""
    saturation_dn, curvatures = None, (0.0, 0.0)
    if linear is not None:
        curvatures = linear.curvature, linear.possible_curvature
        saturation_dn = float(linear.photon_transfer.peak.mean[0])
    half = measurement.run("non-uniformity", lambda: half_saturated(bench, saturation_dn))
    if half is None:
        return
    dark = measurement.run("non-uniformity", lambda: dark_for(bench, half))
    if dark is None:
        return
    uneven = partial(
        _measure_in_electrons, gain, lambda: nonuniformity(dark, half, False, *curvatures)
    )
    measurement.take("non-uniformity", "Photo response non-uniformity", uneven)
    for name, image in (("darkness", dark), ("half saturation", half)):
        both = measurement.run(f"spectrogram, {name}", partial(spectrograms, image))
        for spectrogram in both or ():
            direction = spectrogram.direction
            whiteness = replace(spectrogram.non_whiteness, symbol=f"F_{direction}, {name}")
            measurement.keep([whiteness])
            measurement.drawings[f"Spectrogram, {direction}, {name}"] = spectrogram.plot
    for profile in measurement.run("profiles", lambda: profiles(half, dark)) or ():
        measurement.drawings[f"Profile, {profile.direction}"] = profile.plot
    measurement.take("defect pixels", "Defect pixels", lambda: defects(dark, half))


def _measure_dark(measurement: Measurement, bench: Bench, gain: Quantity | None) -> None:
    """Dark current over time and temperature, its distribution, RTS pixels."""
    current = partial(_measure_in_electrons, gain, lambda: dark_current(dark_series(bench)))
    measurement.take("dark current", "Dark current", current)
    measurement.take(
        "dark current over temperature",
        "Dark current over temperature",
        lambda: _measure_over_temperature(bench),
    )
    signal = measurement.run(
        "dark signal", lambda: dark_signal(longest_dark(bench), black_level(bench))
    )
    if signal is not None and signal.fits:
        exposure_s = longest_dark(bench).exposure_s
        measurement.notes.append(
            f"distribution of the dark signal over the pixels, in {exposure_s:.4g} s: {signal.best.name} (of the "
            "fitted ones that with the lowest BIC)"
        )
        measurement.drawings["Dark signal"] = signal.plot
        measurement.drawings["Dark signal, logarithmic"] = partial(signal.plot, log_counts=True)
    telegraph = measurement.run("RTS pixels", lambda: rts_pixels(most_frames(darks_of(bench))))
    if telegraph is not None:
        if gain is not None:
            telegraph = telegraph.per_gain(gain.value)
        measurement.keep(telegraph.quantities)
        if telegraph.steps.size:
            measurement.drawings["RTS pixels"] = telegraph.plot


def _measure_over_temperature(bench: Bench) -> DarkTemperature:
    """Dark current of the temperatures at which there are 2 exposure times or more."""
    currents: dict[float, Quantity] = {}
    for temperature_k, stacks in by_temperature(bench).items():
        if count_exposure_times(stacks) > 1:
            currents[temperature_k] = dark_current(stacks).from_mean
    return dark_temperature(currents)
