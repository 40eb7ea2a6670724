"""A comparison of two sheets: a table of figures with equal chart, filter and setting, and the figures left over."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ...core import InputError
from ...files.texts import Facts, read_json
from ...lab.quantity import Quantity
from ...pages.page import Dots, MarkedRow, Section, Study, study_of, table

SHEET = "sheet.json"
REMEDY = "give a folder that `mitsuba-sensor sheet` wrote, or a camera name"
COLUMNS = {"chart", "filter", "symbol", "name", "unit", "gain", "temperature_k", "value"}
COLUMNS |= {"low", "high", "mark"}
DIFFERENCE_SIGMAS = 3.0
"""Standard errors beyond which a difference is counted."""
DRAWN_MAX = 40
"""Largest number of ratios in the picture."""
RENDER_NOISE = "ε_render"
"""Symbol of the renderer's noise, which is not a camera figure."""


class Sheet(NamedTuple):
    """The rows of a sheet and the camera's name."""

    name: str
    rows: Sequence[Facts]

    @property
    def figures(self) -> list[Facts]:
        """Rows with a value of the camera."""
        return [
            row
            for row in self.rows
            if row["symbol"] != RENDER_NOISE and row["value"] is not None
        ]


def read_sheet(path: Path) -> Sheet:
    """Read a sheet.  path : its folder, or sheet.json.  Raises InputError for another file."""
    file = path / SHEET if path.is_dir() else path
    found = read_json(file, REMEDY)
    rows = found.get("rows")
    if not isinstance(rows, list) or not all(
        isinstance(row, dict) and set(row) >= COLUMNS for row in rows
    ):
        raise InputError(f"{file} is not the sheet of a camera; {REMEDY}.")
    return Sheet(str(found.get("camera") or path.resolve().name), rows)


def compared(first: Sheet, second: Sheet) -> Study:
    """Return the page of two sheets; it passes if no row of either sheet failed.

    Raises InputError if the sheets have no figure in common.
    """
    names = (first.name, second.name)
    if names[0] == names[1]:
        names = f"{names[0]} (A)", f"{names[1]} (B)"
    pairs = list(_pairs(first.figures, second.figures))
    if not pairs:
        raise InputError(
            f"{names[0]} and {names[1]} have no figure in common; make both sheets with the same charts=, gains= and "
            "temperatures=."
        )
    lines = [_values(*pair) for pair in pairs]
    apart = sum(abs(one["z"] or 0.0) > DIFFERENCE_SIGMAS for one in lines)
    findings = [
        f"{apart} of {len(lines)} figures differ by more than {DIFFERENCE_SIGMAS:g} standard errors"
    ]
    failed, left = list[str](), list[MarkedRow]()
    for name, sheet, used in zip(names, (first, second), zip(*pairs, strict=True), strict=True):
        bad = [row for row in sheet.rows if row["mark"] == "bad"]
        if bad:
            findings.append(
                f"{name}: {len(bad)} of {len(sheet.rows)} rows disagree with theory"
            )
        failed += dict.fromkeys(f"{name}: {row['chart']} {row['symbol']}" for row in bad)
        left += [("", (name, *one)) for one in _left_out(sheet.figures, used)]
    if left:
        findings.append("not compared: figures that only one sheet has (last table)")
    both = f"{names[0]} | ± | {names[1]} | ±"
    shown = table(
        "Both cameras",
        f"chart | symbol | figure | filter | setting | {both} | unit | ratio | from | to | z",
        map(_cells, lines),
        "± is half the 95 % interval; from, to: 95 % interval of the ratio; z: difference in standard errors.",
    )
    rest = table("Not compared", "camera | chart | figures | symbols", left)
    parts = (_ratios(f"{names[1]} over {names[0]}", lines), shown, rest)
    section = Section(tuple(findings), not failed, parts, failed=tuple(failed))
    title = f"Image quality of {names[0]} and {names[1]}"
    return replace(study_of("sheet comparison", title, [section], rows=lines), checked=False)


def _pairs(first: Sequence[Facts], second: Sequence[Facts]) -> Iterator[tuple[Facts, Facts]]:
    """Yield matching figures of both sheets; a monochrome camera's figures match every filter.

    Gain settings match by name, or by position if no name is in both sheets.
    """
    gains = [list(dict.fromkeys(row["gain"] for row in rows)) for rows in (first, second)]
    if set(gains[0]) & set(gains[1]):
        gains = [list(dict.fromkeys(gains[0] + gains[1]))] * 2

    def place(row: Facts, number: int) -> tuple[object, ...]:
        gain = gains[number].index(row["gain"])
        return row["chart"], row["symbol"], gain, row["temperature_k"]

    for row in first:
        for other in second:
            filters = {row["filter"], other["filter"]}
            if place(row, 0) != place(other, 1) or (len(filters) > 1 and "" not in filters):
                continue
            if None not in (row["low"], row["high"], other["low"], other["high"]):
                yield row, other


def _left_out(rows: Sequence[Facts], used: Sequence[Facts]) -> Iterator[tuple[str, int, str]]:
    """Yield chart, number and symbols of the figures without a match."""
    left: dict[str, list[str]] = {}
    for row in rows:
        if not any(row is one for one in used):
            name = f"{row['symbol']} {row['filter']}".strip()
            left.setdefault(row["chart"], []).append(name)
    for chart, symbols in left.items():
        yield chart, len(symbols), ", ".join(dict.fromkeys(symbols))


def _quantity(row: Facts) -> Quantity:
    return Quantity("", "", row["value"], row["low"], row["high"], row["unit"], "")


def _values(first: Facts, second: Facts) -> Facts:
    """Return one line of the comparison."""
    values = {
        name: first[name] for name in ("chart", "symbol", "name", "unit", "temperature_k")
    }
    names = dict.fromkeys(row["filter"] or "all" for row in (first, second))
    values["filter"] = "" if list(names) == ["all"] else " / ".join(names)
    for letter, row in zip("ab", (first, second), strict=True):
        values |= {f"{name}_{letter}": row[name] for name in ("gain", "value", "low", "high")}
    one, other = _quantity(first), _quantity(second)
    if one.low > 0:
        ratio = other.divided(one, "")
        values |= {"ratio": ratio.value, "ratio_low": ratio.low, "ratio_high": ratio.high}
    error = math.hypot(one.standard_error, other.standard_error)
    none = dict.fromkeys(("ratio", "ratio_low", "ratio_high"))
    return none | values | {"z": (other.value - one.value) / error if error else None}


def _cells(line: Facts) -> MarkedRow:
    """Return a line of the table."""
    kelvin, gains = line["temperature_k"], dict.fromkeys((line["gain_a"], line["gain_b"]))
    temperature = "" if kelvin is None else f"{kelvin:g} K"
    setting = ", ".join(filter(None, (*gains, temperature)))
    halves = ((line[f"high_{one}"] - line[f"low_{one}"]) / 2 for one in "ab")
    pairs = zip((line["value_a"], line["value_b"]), halves, strict=True)
    what = (line["chart"], line["symbol"], line["name"], line["filter"], setting)
    ratio = (line["ratio"], line["ratio_low"], line["ratio_high"], line["z"])
    return "", (*what, *(x for pair in pairs for x in pair), line["unit"], *ratio)


def _ratios(name: str, lines: Sequence[Facts]) -> Dots:
    """Return a picture of the most precise ratios about a line at 1."""
    known = [one for one in lines if one["ratio"] is not None and one["ratio_low"] > 0]
    best = sorted(known, key=lambda one: one["ratio_high"] / one["ratio_low"])[:DRAWN_MAX]
    shown = [one for one in known if one in best]
    labels = tuple(f"{one['symbol']} {one['filter']} ({one['chart']})" for one in shown)
    values = [(one["ratio"], one["ratio_low"], one["ratio_high"]) for one in shown]
    note = f"Bars are 95 % intervals. {len(shown)} of {len(known)} ratios are shown, those with the shortest bars."
    level = 1.0, "equal"
    return Dots("Ratios of the figures", "ratio", labels, {name: values}, level, True, note)
