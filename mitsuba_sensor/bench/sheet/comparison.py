"""Two sheets side by side: figures of the same chart, filter and setting, and how far they are apart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...core import InputError
from ...files.texts import Facts, read_json
from ...lab.quantity import TWO_SIDED
from ...pages.page import Bars, MarkedRow, Part, Section, Study, study_of, table

SHEET = "sheet.json"
REMEDY = "give a folder that `mitsuba-sensor sheet` wrote, or the name of a camera"
Place = tuple[str, str, str, int, float | None]
"""Chart, filter, symbol, number of the gain setting, temperature [K]."""
HEADINGS = (
    "symbol | figure | filter | setting | {} | ± | {} | ± | unit | ratio | z of the difference"
)
SHOWN = (
    "K",
    "σ_d",
    "DR",
    "PRNU1288",
    "DSNU1288",
    "µ_I.mean",
    "MTF50",
    "MTF(0.25)",
    "S_sat",
    "SNR_max",
)
"""Figures whose ratios are drawn."""
CLEAR = 3.0
"""Standard errors from which on a difference is said."""


def read_sheet(path: Path) -> list[Facts]:
    """The rows of a sheet on disk.  path : its folder, or sheet.json. Raises InputError for another file."""
    file = path / SHEET if path.is_dir() else path
    rows = read_json(file, REMEDY).get("rows")
    if not isinstance(rows, list) or not all(map(_is_row, rows)):
        raise InputError(f"{file} is no sheet of a camera; {REMEDY}.")
    return rows


def _is_row(row: object) -> bool:
    needed = {"chart", "filter", "symbol", "name", "unit", "gain", "temperature_k", "value"}
    return isinstance(row, dict) and needed | {"low", "high"} <= set(row)


def compared(names: tuple[str, str], sheets: tuple[Sequence[Facts], Sequence[Facts]]) -> Study:
    """The page of two sheets.

    Gain settings of equal names belong together; where no name is in both, those of the same number in each.
    Raises InputError where no figure is in both.
    """
    pairs = list(_pairs(*sheets))
    if not pairs:
        raise InputError(
            f"{names[0]} and {names[1]} have no figure in common; make both sheets with the same charts, --gains and "
            "--temperatures."
        )
    charts = dict.fromkeys(first["chart"] for first, _ in pairs)
    sections = [
        _section(names, [pair for pair in pairs if pair[0]["chart"] == chart])
        for chart in charts
    ]
    rows = [_values(pair) for pair in pairs]
    title = f"Image quality of {names[0]} and {names[1]}"
    return study_of("sheet comparison", title, sections, rows=rows)


def _pairs(first: Sequence[Facts], second: Sequence[Facts]) -> Iterator[tuple[Facts, Facts]]:
    """Figures of both sheets that belong together, in the order of the first."""
    gains = [list(dict.fromkeys(str(row["gain"]) for row in rows)) for rows in (first, second)]
    if set(gains[0]) & set(gains[1]):
        shared = list(dict.fromkeys(gains[0] + gains[1]))
        gains = [shared, shared]
    others = {_place(row, gains[1]): row for row in second}
    for row in first:
        other = others.get(_place(row, gains[0]))
        if other is not None and row["value"] is not None and other["value"] is not None:
            yield row, other


def _place(row: Facts, gains: Sequence[str]) -> Place:
    number = gains.index(str(row["gain"]))
    return row["chart"], row["filter"], row["symbol"], number, row["temperature_k"]


def _values(pair: tuple[Facts, Facts]) -> Facts:
    """One line of the comparison."""
    first, second = pair
    shared = ("chart", "filter", "symbol", "name", "unit", "temperature_k")
    values = {name: first[name] for name in shared}
    for number, row in enumerate(pair):
        letter = "ab"[number]
        values |= {f"{name}_{letter}": row[name] for name in ("gain", "value", "low", "high")}
    ratio = second["value"] / first["value"] if first["value"] else None
    return values | {"ratio": ratio, "z": _distance(first, second)}


def _half(row: Facts) -> float:
    return 0.5 * float(row["high"] - row["low"])


def _distance(first: Facts, second: Facts) -> float | None:
    """Difference over its standard error; None where neither figure has one."""
    error = math.hypot(_half(first), _half(second)) / TWO_SIDED
    if not error:
        return None
    return float((second["value"] - first["value"]) / error)


def _section(names: tuple[str, str], pairs: Sequence[tuple[Facts, Facts]]) -> Section:
    """One chart of both."""
    lines = [_values(pair) for pair in pairs]
    apart = [line for line in lines if line["z"] is not None and abs(line["z"]) > CLEAR]
    chart = lines[0]["chart"]
    finding = f"{chart}: {len(apart)} of {len(lines)} figures differ by more than {CLEAR:g} standard errors"
    rows: list[MarkedRow] = [("", _cells(pair)) for pair in pairs]
    parts: list[Part] = [table(chart, HEADINGS.format(*names), rows)]
    drawn = [line for line in lines if line["symbol"] in SHOWN and line["ratio"]]
    if drawn:
        labels = tuple(" ".join(filter(None, (x["symbol"], x["filter"]))) for x in drawn)
        ratios = {f"{names[1]} over {names[0]}": [x["ratio"] for x in drawn]}
        parts.append(
            Bars(f"{chart}: ratios", "ratio", labels, ratios, log_x=True, level=(1, ""))
        )
    return Section((finding,), True, tuple(parts))


def _cells(pair: tuple[Facts, Facts]) -> tuple[object, ...]:
    """A line of the table."""
    first, second = pair
    values = _values(pair)
    kelvin = first["temperature_k"]
    gains = " / ".join(dict.fromkeys(filter(None, (first["gain"], second["gain"]))))
    setting = ", ".join(filter(None, (gains, "" if kelvin is None else f"{kelvin:g} K")))
    numbers = (first["value"], _half(first), second["value"], _half(second))
    shown = (first["symbol"], first["name"], first["filter"], setting, *numbers)
    return (*shown, first["unit"], values["ratio"], values["z"])
