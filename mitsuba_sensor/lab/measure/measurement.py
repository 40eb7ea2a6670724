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
from ..frames.selection import (
    black_level,
    by_temperature,
    dark_for,
    dark_series,
    darks_of,
    half_saturated,
    longest_dark,
    most_frames,
    shortest_dark,
)
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


Found = TypeVar("Found")
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

    def run(self, title: str, instrument: Callable[[], Found]) -> Found | None:
        """What an instrument finds; None where it refuses."""
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
        return [one.symbol for one in self.figures.values() if one.clipped] + self.clipped

    def take(self, title: str, drawing: str, instrument: Callable[[], Instrument]) -> None:
        """Figures and drawing of an instrument; nothing where it refuses.  drawing : its title."""
        found = self.run(title, instrument)
        if found is not None:
            self.keep(found.quantities)
            self.drawings[drawing] = found.plot

    def keep(self, quantities: Iterable[Quantity]) -> None:
        """Figures of an instrument."""
        self.figures |= {one.symbol: one for one in quantities}


def measure(
    bench: Bench, report: Callable[[str], object] = lambda title: None
) -> tuple[Measurement, ...]:
    """Every instrument on the pixels behind each colour filter of a bench.

    report : called with the title of each instrument before it measures, from several threads.

    Raises InputError for a bench of several gain settings (see :meth:`Bench.at_gain`), and for one without stacks.
    """
    if len(bench.gains) != 1:
        found = ", ".join(bench.gains) or "no frames"
        raise InputError(
            f"the bench has the gain settings {found}; measure Bench.at_gain() of each."
        )
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        parts = [
            (Measurement(name, report=report), part)
            for name, part in bench.of_filters().items()
        ]
        return tuple(pool.map(lambda one: _measurement(*one), parts))


def _measurement(found: Measurement, bench: Bench) -> Measurement:
    linear = found.run("photon transfer", lambda: _linear(bench))
    if linear is not None:
        _keep_linear(found, linear)
    gain = found.figures.get("K")
    known = gain if gain is not None and gain.low > 0 else None
    _scene(found, bench)
    _temporal(found, bench, known)
    _spatial(found, bench, known, linear)
    _dark(found, bench, known)
    return found


def _linear(bench: Bench) -> EmvaLinear:
    """With the dark frames of the flat fields' own exposure times."""
    times = {one.exposure_s for one in bench.flats}
    darks = [
        dark_for(bench, next(one for one in bench.flats if one.exposure_s == time))
        for time in sorted(times)
    ]
    return emva_linear(darks, bench.flats)


def _keep_linear(found: Measurement, linear: EmvaLinear) -> None:
    found.keep(linear.quantities)
    found.notes += linear.notes
    found.drawings |= {
        "Radiometric function": linear.radiometric.plot,
        "Photon transfer, linear": linear.photon_transfer.plot,
        "Photon transfer, logarithmic": partial(linear.photon_transfer.plot, log=True),
        "Signal-to-noise ratio, linear": partial(linear.snr.plot, log=False),
        "Signal-to-noise ratio, logarithmic": linear.snr.plot,
        "Linearity": linear.radiometric.plot_deviation,
    }


def _scene(found: Measurement, bench: Bench) -> None:
    """The paper's photon transfer curve."""
    for scene in bench.scenes[:1]:
        transfer = found.run(
            "photon transfer of a scene", partial(photon_transfer_of_scene, scene)
        )
        if transfer is not None:
            found.keep(
                [
                    replace(
                        transfer.gain,
                        symbol="K_scene",
                        section="Konnik & Welsh 2014, section 4",
                    )
                ]
            )
            found.drawings["Photon transfer of a scene"] = transfer.plot


def _in_electrons(gain: Quantity | None, instrument: Callable[[], Scaled]) -> Scaled:
    """What an instrument finds, where K is known in electrons."""
    found = instrument()
    return found if gain is None else found.per_gain(gain)


def _temporal(found: Measurement, bench: Bench, gain: Quantity | None) -> None:
    """Row and column noise, and correlations, of the shortest dark frames."""
    lines = partial(_in_electrons, gain, lambda: line_noise(shortest_dark(bench)))
    found.take("row and column noise", "Temporal noise of rows and columns", lines)
    found.take(
        "correlation", "Correlation over frames", lambda: correlation(shortest_dark(bench))
    )


def _spatial(
    found: Measurement, bench: Bench, gain: Quantity | None, linear: EmvaLinear | None
) -> None:
    """Non-uniformity, profiles, spectrograms and defects of the half-saturated flat field and its dark frames."""
    largest = None if linear is None else float(linear.photon_transfer.peak.mean[0])
    half = found.run("non-uniformity", lambda: half_saturated(bench, largest))
    if half is None:
        return
    dark = found.run("non-uniformity", lambda: dark_for(bench, half))
    if dark is None:
        return
    uneven = partial(_in_electrons, gain, lambda: nonuniformity(dark, half))
    found.take("non-uniformity", "Photo response non-uniformity", uneven)
    for name, image in (("darkness", dark), ("half saturation", half)):
        for one in found.run(f"spectrogram, {name}", partial(spectrograms, image)) or ():
            found.keep([replace(one.non_whiteness, symbol=f"F_{one.direction}, {name}")])
            found.drawings[f"Spectrogram, {one.direction}, {name}"] = one.plot
    for profile in found.run("profiles", lambda: profiles(half, dark)) or ():
        found.drawings[f"Profile, {profile.direction}"] = profile.plot
    found.take("defect pixels", "Defect pixels", lambda: defects(dark, half))


def _dark(found: Measurement, bench: Bench, gain: Quantity | None) -> None:
    """Dark current over time and temperature, its distribution, RTS pixels."""
    current = partial(_in_electrons, gain, lambda: dark_current(dark_series(bench)))
    found.take("dark current", "Dark current", current)
    found.take(
        "dark current over temperature",
        "Dark current over temperature",
        lambda: _over_temperature(bench),
    )
    signal = found.run(
        "dark signal", lambda: dark_signal(longest_dark(bench), black_level(bench))
    )
    if signal is not None and signal.fits:
        found.notes.append(
            f"dark signal of {longest_dark(bench).exposure_s:g} s: {signal.best.name} fits best (BIC)"
        )
        found.drawings["Dark signal"] = signal.plot
        found.drawings["Dark signal, logarithmic"] = partial(signal.plot, log_counts=True)
    telegraph = found.run("RTS pixels", lambda: rts_pixels(most_frames(darks_of(bench))))
    if telegraph is not None:
        found.keep((telegraph.per_gain(gain.value) if gain else telegraph).quantities)
        if telegraph.steps.size:
            found.drawings["RTS pixels"] = telegraph.plot


def _over_temperature(bench: Bench) -> DarkTemperature:
    """Of the temperatures at which there are 2 exposure times or more."""
    series = {
        t: some
        for t, some in by_temperature(bench).items()
        if len({one.exposure_s for one in some}) > 1
    }
    return dark_temperature({t: dark_current(some).from_mean for t, some in series.items()})
