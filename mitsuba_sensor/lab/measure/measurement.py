"""All instruments on the frames of one bench: results for each colour filter, and what could not be measured."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from ...core import InputError
from ...core.html import Table, facts, fragment
from ..frames.bench import Bench
from ..frames.clipping import ClippedError
from ..frames.selection import (
    black_level,
    by_temperature,
    count_exposure_times,
    dark_for,
    dark_series,
    darks_of,
    half_saturated,
    longest_dark,
    shortest_dark,
)
from ..frames.soundness import sound
from ..frames.stack import Stack, merged
from ..quantity import Figures, Quantity
from .correlation import correlation
from .dark_current import DarkTemperature, dark_current, dark_temperature
from .dark_signal import dark_signal
from .defects import defects
from .emva_linear import EmvaLinear, emva_linear
from .line_noise import line_noise
from .nonuniformity import Nonuniformity, nonuniformity
from .photon_transfer import PhotonTransfer, photon_transfer_of_scene
from .profiles import profiles
from .rts_pixels import rts_pixels
from .spectrogram import spectrograms

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Instrument(NamedTuple):
    """A row of the table of instruments.

    ::

        def warmest(dark):
            return dark.mean.max(), dark.mean.min(), dark.mean.max()

        bench = ms.lab.read_bench("bench/")
        mine = ms.lab.Instrument("warmest pixel", lambda m: m.bench.darks[:1], warmest, "DN", "our own rule")
        ms.lab.measure_bench(bench, instruments=[*ms.lab.INSTRUMENTS, mine])

    title : of its results.  frames : returns the arguments of the function from the measurement so far.
    function : returns a Quantity, several, (value, low, high), or an object with ``quantities`` and a ``plot``, or
    ``plots`` by title, and ``notes``. An InputError means that the frames do not show the figures.
    unit : of its figures; "e-" divides figures in DN by K.  section : place of the definition.
    """

    title: str
    frames: Callable[[Measurement], Iterable[Any]]
    function: Callable[..., Any]
    unit: str
    section: str


@dataclass(eq=False)
class Measurement:
    """Results of all instruments for one colour filter.

    filter_name : of the filter, empty for a monochrome camera.  bench : frames of its pixels.
    figures : all quantities, by symbol, in the order of the instruments.  results : of the instruments, by title.
    drawings : plot functions by title.  notes : remarks of the instruments on the frames.
    refused : error of each instrument that could not measure, by its title.
    clipped : titles of the instruments that could not measure because values are clipped.
    report : called with the title of each instrument at its start, and with the progress of a long one.
    """

    filter_name: str
    bench: Bench
    figures: dict[str, Quantity] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    drawings: dict[str, Callable[[Axes], object]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    clipped: list[str] = field(default_factory=list)
    report: Callable[[str], object] = lambda title: None

    def __repr__(self) -> str:
        of_filter = f" of the {self.filter_name} filter" if self.filter_name else ""
        figures = f"{len(self.figures)} figures, {len(self.refused)} instruments refused"
        return f"<Measurement{of_filter}: {figures}, {len(self.notes)} notes>"

    def _repr_html_(self) -> str:
        rows = [
            (figure.symbol, figure.name, figure.shown, f"{figure.low:.4g} to {figure.high:.4g}")
            for figure in self.figures.values()
        ]
        table = Table(("symbol", "figure", "value", "95 % interval"), rows)
        return fragment("EMVA 1288 figures, measured", table, facts(self.refused))

    def run(self, instrument: Instrument) -> None:
        """Keep figures, plots and notes of an instrument, or its error."""
        title = instrument.title
        self.report(title)
        try:
            result = instrument.function(*instrument.frames(self))
            quantities = [*_quantities_of(result, instrument)]
        except InputError as error:
            self.refused[title] = str(error)
            if isinstance(error, ClippedError):
                self.clipped.append(title)
            return
        self.results[title] = result
        gain = self.figures.get("K")
        for quantity in quantities:
            figure = quantity.with_width()
            if instrument.unit == "e-" and gain is not None and gain.low > 0:
                figure = figure.in_electrons(gain)
            self.figures[quantity.symbol] = figure
        self.notes += getattr(result, "notes", ())
        if hasattr(result, "plots"):
            self.drawings |= result.plots
        elif hasattr(result, "plot"):
            self.drawings[f"{title[0].upper()}{title[1:]}"] = result.plot

    @property
    def hidden(self) -> list[str]:
        """Symbols and titles of instruments without a value because values of the frames are clipped."""
        symbols = [figure.symbol for figure in self.figures.values() if figure.clipped]
        return symbols + self.clipped


def _quantities_of(result: Any, instrument: Instrument) -> Iterator[Quantity]:
    """Yield the figures of a result."""
    title, _, _, unit, section = instrument
    if isinstance(result, Quantity):
        yield result
    elif hasattr(result, "quantities"):
        yield from result.quantities
    elif isinstance(result, tuple) and len(result) == 3 and not isinstance(result[0], Quantity):
        value, low, high = map(float, result)
        yield Quantity(title, title, value, low, high, unit, section)
    elif isinstance(result, Iterable):
        yield from result
    else:
        raise InputError(
            f"the instrument {title!r} returned {type(result).__name__}; let it return a Quantity, several of them, "
            "or (value, low, high)."
        )


def measure_bench(
    bench: Bench,
    report: Callable[[str], object] = lambda title: None,
    instruments: Sequence[Instrument] | None = None,
) -> tuple[Measurement, ...]:
    """Run all instruments on the pixels of each colour filter: K, QE, noise, saturation, dark current, …

    ::

        bench = ms.lab.read_bench("bench/")
        (measured,) = ms.lab.measure_bench(bench)
        print(measured.figures["K"])

    report : called from several threads with the title of each instrument at its start, and with the progress of a long
        one.
    instruments : None for ``ms.lab.INSTRUMENTS``.

    Raises InputError for a bench with several gain settings (see :meth:`Bench.at_gain`) or without stacks.
    """
    if len(bench.gains) != 1:
        gains = ", ".join(bench.gains) or "no frames"
        raise InputError(
            f"the bench has the gain settings {gains}; pass Bench.at_gain() of each."
        )
    rows = INSTRUMENTS if instruments is None else instruments
    bench, notes = sound(bench)

    def measure_filter(name: str, part: Bench) -> Measurement:
        measurement = Measurement(name, part, notes=[*bench.notes, *notes], report=report)
        for instrument in rows:
            measurement.run(instrument)
        measurement.notes = merged(measurement.notes)
        return measurement

    parts = bench.of_filters()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return tuple(pool.map(measure_filter, parts.keys(), parts.values()))


def linear_of(bench: Bench, report: Callable[[int, int], object] | None = None) -> EmvaLinear:
    """Run EMVA 1288 Linear on a bench, with the dark frames nearest to the flat fields in time and temperature.

    Raises InputError if no flat fields or no dark frames have two frames.
    """
    flats = [flat for flat in bench.flats if len(flat) > 1]
    darks = [stack for stack in bench.unlit if len(stack) > 1]
    if not flats or not darks:
        raise InputError(
            "K needs flat fields and dark frames, 2 frames or more of each; single frames have no temporal variance."
        )

    def distance(flat: Stack, dark: Stack) -> tuple[float, float, int]:
        dark_k = dark.temperature_k or 0.0
        warmer = abs(dark_k - (flat.temperature_k or dark_k))
        return abs(dark.exposure_s - flat.exposure_s), warmer, -len(dark)

    nearest = [min(darks, key=partial(distance, flat)) for flat in flats]
    return emva_linear(list({id(dark): dark for dark in nearest}.values()), flats, report)


def half_and_dark(bench: Bench, linear: EmvaLinear | None) -> tuple[Stack, Stack]:
    """Return the dark frames of the flat field nearest to half saturation, and this flat field."""
    saturation_dn = None if linear is None else float(linear.photon_transfer.peak.mean[0])
    half = half_saturated(bench, saturation_dn)
    return dark_for(bench, half), half


def uniformity_of(bench: Bench, linear: EmvaLinear | None) -> Nonuniformity:
    """Measure DSNU1288 and PRNU1288 of a bench, relative to the light if the response is curved."""
    return nonuniformity(
        *half_and_dark(bench, linear), None if linear is None else linear.curve
    )


def over_temperature(bench: Bench) -> DarkTemperature:
    """Measure dark current at each temperature; a single exposure time is compared with the shortest dark stack."""
    currents: dict[float, Quantity] = {}
    for temperature_k, stacks in by_temperature(bench).items():
        if count_exposure_times(stacks) == 1:
            stacks = [replace(shortest_dark(bench), temperature_k=temperature_k), *stacks]
        if count_exposure_times(stacks) > 1:
            currents[temperature_k] = dark_current(stacks).from_mean
    return dark_temperature(currents)


def _linear(measurement: Measurement) -> EmvaLinear | None:
    """Return the result of the first instrument, which others use."""
    linear: EmvaLinear | None = measurement.results.get("photon transfer")
    return linear


def _transfer_of_scene(*scenes: Stack) -> PhotonTransfer | tuple[()]:
    """Return the photon transfer curve of the first scene, as in the paper; nothing without a scene."""
    if not scenes:
        return ()
    transfer = photon_transfer_of_scene(scenes[0])
    section = "Konnik & Welsh 2014, section 4"
    return replace(transfer, gain=replace(transfer.gain, symbol="K_scene", section=section))


def _half(measurement: Measurement) -> tuple[Stack, Stack]:
    return half_and_dark(measurement.bench, _linear(measurement))


@dataclass(frozen=True, eq=False)
class _Drawn(Figures):
    """Figures and plot functions of several results."""

    figures: tuple[Quantity, ...]
    plots: dict[str, Callable[[Axes], object]]


def _spectrograms(dark: Stack, half: Stack) -> _Drawn:
    """Return horizontal and vertical spectrograms of dark frames and of a flat field."""
    stacks = {"darkness": dark, "half saturation": half}
    named = {
        f"{x.direction}, {at}": x for at, stack in stacks.items() for x in spectrograms(stack)
    }
    figures = [replace(x.non_whiteness, symbol=f"F_{name}") for name, x in named.items()]
    return _Drawn(tuple(figures), {f"Spectrogram, {name}": x.plot for name, x in named.items()})


def _profiles(dark: Stack, half: Stack) -> _Drawn:
    """Return plots of the profiles of a flat field."""
    return _Drawn((), {f"Profile, {x.direction}": x.plot for x in profiles(half, dark)})


INSTRUMENTS: tuple[Instrument, ...] = (
    Instrument(
        "photon transfer",
        lambda m: (
            m.bench,
            lambda done, total: m.report(f"photon transfer: {done} of {total} levels"),
        ),
        linear_of,
        "DN/e-",
        "EMVA 1288 R4 6.6",
    ),
    Instrument(
        "photon transfer of a scene",
        lambda m: m.bench.scenes[:1],
        _transfer_of_scene,
        "DN/e-",
        "Konnik & Welsh 2014",
    ),
    Instrument(
        "row and column noise",
        lambda m: (shortest_dark(m.bench),),
        line_noise,
        "e-",
        "analysis of variance over frames",
    ),
    Instrument(
        "correlation",
        lambda m: (shortest_dark(m.bench),),
        correlation,
        "",
        "autocorrelation of temporal noise",
    ),
    Instrument(
        "non-uniformity",
        lambda m: (m.bench, _linear(m)),
        uniformity_of,
        "e-",
        "EMVA 1288 R4 eq. 66, 67",
    ),
    Instrument("spectrogram", _half, _spectrograms, "", "EMVA 1288 A2.01 7.3.2"),
    Instrument("profiles", _half, _profiles, "DN", "EMVA 1288 R4 8.6"),
    Instrument("defect pixels", _half, defects, "%", "distance from the neighbours' median"),
    Instrument(
        "dark current",
        lambda m: (dark_series(m.bench),),
        dark_current,
        "e-",
        "EMVA 1288 R4 7.1",
    ),
    Instrument(
        "dark current over temperature",
        lambda m: (m.bench,),
        over_temperature,
        "",
        "EMVA 1288 R4 7.2",
    ),
    Instrument(
        "dark signal",
        lambda m: (longest_dark(m.bench), black_level(m.bench)),
        dark_signal,
        "DN",
        "BIC of four distributions",
    ),
    Instrument(
        "RTS pixels",
        lambda m: (max(darks_of(m.bench), key=len),),
        rts_pixels,
        "e-",
        "likelihood ratio of two levels and one",
    ),
)
"""All instruments in the order in which they measure; later ones use results of earlier ones."""
