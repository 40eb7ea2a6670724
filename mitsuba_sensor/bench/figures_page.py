"""A camera in the laboratory: every figure with its interval, beside the datasheet's if there is one, and plots."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

from ..lab.frames.bench import Bench
from ..lab.measure.measurement import INSTRUMENTS, Measurement, measure_bench
from ..lab.quantity import TWO_SIDED, Quantity
from ..lab.statistics.estimators import z_limit
from ..pages.page import Drawing, MarkedRow, Part, Section, Study, study_of, table
from .datasheet import Said

MAIN = (
    "K",
    "η",
    "LE",
    "σ_d",
    "µ_e.sat",
    "SNR_max",
    "DR",
    "PRNU1288",
    "DSNU1288",
    "σ_row",
    "σ_col",
    "µ_I.mean",
    "T_d",
)
RATIOS_IN_DB, DECIBELS = ("SNR_max", "DR"), "dB"
ROOTS = "σ_", "DSNU", "PRNU"
"""Figures that are roots of variances: beginnings of their symbols."""
DIGITS_OF_INTERVAL, MOST_DECIMALS = 2, 6
MAIN_HEADINGS = "figure | measured | 95 % from | to | unit | datasheet"
HEADINGS = "symbol | figure | measured | 95 % from | to | unit | datasheet | z | one chip from | to | section | note"
OF_TABLE = (
    "z: distance from the datasheet in standard errors; one chip from, to: where the figure of a single chip of this "
    "datasheet lies as it is measured here, where that is not the datasheet's value alone. A figure fails if it is "
    "farther from that range than chance allows for so many figures"
)
"""Below the table of all figures."""


def figures_of(
    bench: Bench, progress: Callable[[int, int, str], None]
) -> tuple[Measurement, ...]:
    """What all instruments find in the frames of a bench; told the instruments done, all of them, and the next one."""
    begun, total = 0, len(bench.of_filters()) * len(INSTRUMENTS)

    def begins(title: str) -> None:
        nonlocal begun
        begun += ": " not in title
        progress(begun - 1, total, f"measuring: {title}")

    return measure_bench(bench, begins)


def characterized(
    name: str,
    measured: Sequence[Measurement],
    datasheet: Mapping[str, Mapping[str, Said]],
    **about: object,
) -> Study:
    """The study of one camera.

    datasheet : by name of the filter and symbol; empty for a camera of which only frames are known.
    about : what the page and report.json say beside the figures.
    """
    compared = 0
    figures = {}
    for part in measured:
        said = datasheet.get(part.filter_name, {})
        compared += sum(figure.symbol in said for figure in part.figures.values())
        figures[part.filter_name or "all pixels"] = {
            "figures": [
                {**figure.to_dict(), **beside_datasheet(figure, said)}
                for figure in part.figures.values()
            ],
            "notes": part.notes,
            "refused": part.refused,
        }
    limit = z_limit(compared)
    sections = [
        filter_section(part, datasheet.get(part.filter_name, {}), limit) for part in measured
    ]
    return study_of(
        "characterize",
        f"EMVA 1288 figures of {name}",
        sections,
        measured=figures,
        z_limit=limit,
        **about,
    )


def filter_section(
    measured: Measurement, datasheet: Mapping[str, Said], limit: float
) -> Section:
    """Figures behind one filter: those that are compared with the datasheet must be its own, none may be hidden."""
    where = f", {measured.filter_name} pixels" if measured.filter_name else ""
    rows, wrong, compared = list[MarkedRow](), list[Quantity](), 0
    for figure in measured.figures.values():
        row = figure_row(figure, datasheet, limit)
        rows += [row, *_in_decibels(row)]
        compared += row[0] != ""
        wrong += [figure] if row[0] == "bad" else []
    findings = []
    if compared:
        findings.append(
            f"{compared - len(wrong)} of {compared} figures{where} agree with the datasheet within {limit:.1f} "
            "standard errors"
        )
    for one in wrong:
        said = f"measured {one.value:.4g}, datasheet {datasheet[one.symbol].value:.4g}"
        findings.append(f"{one.symbol}{where}: {said} {one.unit}".rstrip())
    if measured.hidden:
        findings.append(
            f"not measured{where}, because pixels of the frames are at the lowest or highest code: "
            f"{', '.join(measured.hidden)}"
        )
    refused = measured.refused.items()
    findings += [f"not measured{where}: {title}: {sentence}" for title, sentence in refused]
    findings += [f"{where[2:]}: {note}" if where else note for note in measured.notes]
    shown = [(mark, with_digits(cells)) for mark, cells in rows]
    main = [
        (mark, (f"{cells[0]} {cells[1]}", *cells[2:7]))
        for mark, cells in shown
        if cells[0] in MAIN
    ]
    parts: tuple[Part, ...] = (
        table(f"Main figures{where}", MAIN_HEADINGS, main),
        *(Drawing(f"{name}{where}", draw) for name, draw in measured.drawings.items()),
        table(f"All figures{where}", HEADINGS, shown, OF_TABLE),
    )
    failed = [f"{one.symbol}{where}" for one in wrong]
    failed += [f"clipped frames{where}"] if measured.hidden else []
    missing = tuple(f"{title}{where}" for title in measured.refused)
    return Section(tuple(findings), not failed, parts, failed=tuple(failed), missing=missing)


def figure_row(figure: Quantity, datasheet: Mapping[str, Said], limit: float) -> MarkedRow:
    """A figure with its interval beside the datasheet's, marked where both are compared."""
    beside = beside_datasheet(figure, datasheet)
    interval = [
        x if math.isfinite(x) else None for x in (figure.value, figure.low, figure.high)
    ]
    said = [beside.get("datasheet"), beside.get("z"), None, None]
    if beside and beside["chip_low"] < beside["chip_high"]:
        said[2:] = beside["chip_low"], beside["chip_high"]
    cells = (
        figure.symbol,
        figure.name,
        *interval,
        figure.unit,
        *said,
        figure.section,
        figure.note,
    )
    if not beside or not math.isfinite(figure.value):
        return "", cells
    return ("good" if abs(beside["z_of_chip"]) < limit else "bad"), cells


def _in_decibels(row: MarkedRow) -> Iterator[MarkedRow]:
    """The row of a ratio once more as EMVA 1288 R4 prints it too, 20·log10 of it [dB]; of other figures nothing."""
    mark, (symbol, name, value, low, high, _, said, *rest) = row
    if symbol in RATIOS_IN_DB:
        numbers = [_decibels(ratio) for ratio in (value, low, high)]
        z, low, high, *last = rest
        chip = _decibels(low), _decibels(high)
        yield mark, (symbol, name, *numbers, DECIBELS, _decibels(said), z, *chip, *last)


def with_digits(cells: Sequence[object]) -> tuple[object, ...]:
    """The cells of a row with as many decimals as give half the width of its interval two digits."""
    symbol, name, value, low, high, unit, said, *rest = cells
    if not (isinstance(low, float) and isinstance(high, float) and high > low):
        return tuple(cells)
    decimals = DIGITS_OF_INTERVAL - 1 - math.floor(math.log10((high - low) / 2))
    if decimals > MOST_DECIMALS:
        return tuple(cells)
    numbers = (_decimal(number, max(decimals, 0)) for number in (value, low, high, said))
    value, low, high, said = numbers
    return symbol, name, value, low, high, unit, said, *rest


def _decimal(number: object, decimals: int) -> object:
    """A number as text; what is none as it is."""
    if not isinstance(number, float):
        return number
    return f"{number:.{decimals}f}"


def _decibels(ratio: object) -> float | None:
    """20·log10 of a ratio [dB]; none of none and of zero."""
    if not isinstance(ratio, float) or ratio <= 0:
        return None
    return 20 * math.log10(ratio)


def beside_datasheet(figure: Quantity, datasheet: Mapping[str, Said]) -> dict[str, float]:
    """What stands beside a figure that the datasheet has.

    datasheet, z : its value, and how far the measured one is from it, in standard errors of the figure.
    chip_low, chip_high, z_of_chip : the range of single chips, and how far the measured value is outside of it.
    """
    if figure.symbol not in datasheet:
        return {}
    said = datasheet[figure.symbol]
    nearest = min(max(figure.value, said.low), said.high)
    return {
        "datasheet": said.value,
        "z": _distance(figure, said.value),
        "chip_low": said.low,
        "chip_high": said.high,
        "z_of_chip": _distance(figure, nearest),
    }


def _distance(figure: Quantity, value: float) -> float:
    """How far a figure is above a value, in standard errors: those of the side of its interval that is nearer."""
    if value > figure.value:
        half_width = figure.high - figure.value
    else:
        half_width = figure.value - figure.low
    if half_width > 0:
        standard_errors = TWO_SIDED * (figure.value - value) / half_width
        if value == 0 and figure.symbol.startswith(ROOTS):
            # The square of a standard deviation that is 0 has a normal law, the standard deviation has none.
            return standard_errors * figure.value / (figure.value + figure.low)
        return standard_errors
    if figure.low <= value <= figure.high:
        return 0.0
    return math.copysign(math.inf, figure.value - value)
