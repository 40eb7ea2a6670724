"""A camera in the laboratory: its figures with intervals, next to the datasheet's figures if known, and plots."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from ..lab.frames.bench import Bench
from ..lab.measure.measurement import INSTRUMENTS, Measurement, measure_bench
from ..lab.quantity import IN_DECIBELS, TWO_SIDED, Quantity
from ..lab.statistics.estimators import z_limit
from ..pages.page import Drawing, Mark, MarkedRow, Part, Section, Study, study_of, table
from .datasheet import Datasheet, Said, of_filter

MAIN = [
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
]
"""Symbols of the main figures."""
ROOTS = "σ_", "DSNU", "PRNU"
"""Beginnings of the symbols of figures that are roots of variances."""
INTERVAL_DIGITS, DECIMALS_MAX = 2, 6
MAIN_HEADINGS = "figure | measured | 95 % from | to | unit | datasheet"
HEADINGS = "symbol | figure | measured | 95 % from | to | unit | datasheet | z | one unit from | to | section | note"
TABLE_NOTE = (
    "z: distance from the datasheet in standard errors. One unit from, to: range of this figure among single sensor "
    "units, if the datasheet has one. A figure fails if it is farther from that range than chance allows for this "
    "many figures; limits (< and >) are not judged."
)


def figures_of(
    bench: Bench, progress: Callable[[float, int, str], None]
) -> tuple[Measurement, ...]:
    """Measure a bench with all instruments; progress gets the number done, the total and the current instrument."""
    begun, total = 0, len(bench.of_filters()) * len(INSTRUMENTS)

    def begins(title: str) -> None:
        nonlocal begun
        name, _, levels = title.partition(": ")
        begun += not levels
        done, of = re.findall(r"\d+", levels) or (0, 1)
        progress(begun - 1 + int(done) / int(of), total, f"measuring: {name}")

    return measure_bench(bench, begins)


def characterized(
    name: str,
    measured: Sequence[Measurement],
    datasheet: Datasheet,
    remarks: Sequence[str] = (),
    **about: object,
) -> Study:
    """Return the study of one camera.

    datasheet : empty if only frames are known.  remarks : further findings.
    about : further facts for the page and report.json.
    """
    sheets = [of_filter(datasheet, part.filter_name) for part in measured]
    parts = list(zip(measured, sheets, strict=True))
    limit = z_limit(sum(symbol in sheet for part, sheet in parts for symbol in part.figures))
    figures = {}
    for part, sheet in parts:
        rows = [
            {**figure.to_dict(), **beside_datasheet(figure, sheet)}
            for figure in part.figures.values()
        ]
        figures[part.filter_name or "all pixels"] = {
            "figures": rows,
            "notes": part.notes,
            "refused": part.refused,
        }
    sections = [filter_section(part, sheet, limit) for part, sheet in parts]
    sections.append(Section(tuple(remarks), True, ()))
    data = {"measured": figures, "z_limit": limit, **about}
    return study_of("characterize", f"EMVA 1288 figures of {name}", sections, **data)


def filter_section(
    measured: Measurement, datasheet: Mapping[str, Said], limit: float
) -> Section:
    """Return the figures under one filter; passed if all agree with the datasheet and no frame is clipped."""
    where = f", {measured.filter_name} pixels" if measured.filter_name else ""
    rows, wrong, excluded, compared = list[MarkedRow](), list[Quantity](), list[str](), 0
    for figure in measured.figures.values():
        row = figure_row(figure, datasheet, limit)
        rows += [row, *_in_decibels(figure, datasheet, limit, row[0])]
        compared += row[0] != ""
        wrong += [figure] if row[0] == "bad" else []
        if row[0] == "good" and not figure.low <= datasheet[figure.symbol].value <= figure.high:
            excluded.append(figure.symbol)
    findings = []
    if compared:
        findings.append(
            f"{compared - len(wrong)} of the {compared} figures{where} on the page agree with the datasheet within "
            f"{limit:.1f} standard errors"
        )
    if excluded:
        findings.append(
            f"holds{where}, although the 95 % interval excludes the datasheet's value: {', '.join(excluded)}; one "
            "sensor unit may differ, and one interval in 20 misses by chance"
        )
    for figure in wrong:
        values = f"measured {figure.value:.4g}, datasheet {datasheet[figure.symbol].value:.4g}"
        findings.append(f"{figure.symbol}{where}: {values} {figure.unit}".rstrip())
    if measured.hidden:
        findings.append(
            f"not measured{where}, because pixels are at the lowest or highest code: {', '.join(measured.hidden)}"
        )
    refused = measured.refused.items()
    findings += [f"not measured{where}: {title}: {sentence}" for title, sentence in refused]
    findings += [f"{where[2:]}: {note}" if where else note for note in measured.notes]
    main = [
        (mark, (f"{cells[0]} {cells[1]}", *cells[2:7]))
        for mark, cells in rows
        if cells[0] in MAIN
    ]
    parts: tuple[Part, ...] = (
        table(f"Main figures{where}", MAIN_HEADINGS, main),
        *(Drawing(f"{name}{where}", draw) for name, draw in measured.drawings.items()),
        table(f"All figures{where}", HEADINGS, rows, TABLE_NOTE, terminal=""),
    )
    failed = [f"{figure.symbol}{where}" for figure in wrong]
    failed += [f"clipped frames{where}"] if measured.hidden else []
    missing = tuple(f"{title}{where}" for title in measured.refused)
    return Section(tuple(findings), not failed, parts, failed=tuple(failed), missing=missing)


def figure_row(figure: Quantity, datasheet: Mapping[str, Said], limit: float) -> MarkedRow:
    """Return a figure with its interval and the datasheet's value, marked if both are compared."""
    beside = beside_datasheet(figure, datasheet)
    said = [beside.get("datasheet"), beside.get("z"), None, None]
    if beside and beside["chip_low"] < beside["chip_high"]:
        said[2:] = beside["chip_low"], beside["chip_high"]
    numbers = with_digits(figure, beside.get("datasheet"))
    names, rest = (figure.symbol, figure.name), (*said[1:], figure.section, figure.note)
    cells = (*names, *numbers[:3], figure.unit, numbers[3], *rest)
    if not beside or not has_interval(figure):
        return "", cells
    return ("good" if abs(beside["z_of_chip"]) < limit else "bad"), cells


def has_interval(figure: Quantity) -> bool:
    """Return True for a value with both ends of its interval; a limit has only one."""
    return all(map(math.isfinite, (figure.value, figure.low, figure.high)))


def with_digits(figure: Quantity, said: float | None) -> list[object]:
    """Return value, low, high and the datasheet's value; half the width of the interval has two digits.

    A limit is shown as ``< 3.2`` or ``≥ 3.2``.
    """
    if figure.is_bound:
        return [f"< {figure.high:.4g}", None, None, said]
    if math.isinf(figure.high) and math.isfinite(figure.value):
        return [f"≥ {figure.value:.4g}", None, None, said]
    if not has_interval(figure):
        return [None, None, None, said]
    numbers: list[Any] = [figure.value, figure.low, figure.high, said]
    if figure.high == figure.low:
        return [figure.value, None, None, said]
    half_width = (figure.high - figure.low) / 2
    decimals = max(INTERVAL_DIGITS - 1 - math.floor(math.log10(half_width)), 0)
    if decimals <= DECIMALS_MAX:
        return [None if x is None else f"{x:.{decimals}f}" for x in numbers]
    return numbers


def _in_decibels(
    figure: Quantity, datasheet: Mapping[str, Said], limit: float, mark: Mark
) -> Iterator[MarkedRow]:
    """Return the row of a ratio once more as 20·log10 of it [dB], as EMVA 1288 R4 also prints it."""
    if figure.symbol in IN_DECIBELS and not figure.unit and figure.low > 0:
        said = datasheet.get(figure.symbol)
        sheet = {}
        if said is not None and said.low > 0:
            sheet[figure.symbol] = Said(*map(_decibels, said))
        _, cells = figure_row(figure.mapped(_decibels, unit="dB"), sheet, limit)
        yield mark, cells


def _decibels(ratio: float) -> float:
    return 20 * math.log10(ratio)


def beside_datasheet(figure: Quantity, datasheet: Mapping[str, Said]) -> dict[str, float]:
    """Return the datasheet's value of a figure and distances from it; empty if the datasheet does not have the figure.

    datasheet, z : its value, and the measured value's distance from it in standard errors.
    chip_low, chip_high, z_of_chip : the range of single sensor units, and the distance from that range.
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
    """Return a figure minus a value in standard errors of the nearer side of its interval."""
    half_width = figure.value - figure.low
    if value > figure.value:
        half_width = figure.high - figure.value
    if half_width > 0:
        standard_errors = TWO_SIDED * (figure.value - value) / half_width
        if value == 0 and figure.symbol.startswith(ROOTS):
            # The square of a standard deviation of 0 is normally distributed, the standard deviation is not.
            return standard_errors * figure.value / (figure.value + figure.low)
        return standard_errors
    if figure.low <= value <= figure.high:
        return 0.0
    return math.copysign(math.inf, figure.value - value)
