"""Rows of a sheet as a page: for each chart a table of all settings, the plots of the first one, and a picture."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...core.types import Float64Array
from ...lab.statistics.estimators import z_limit
from ...pages.page import (
    Drawing,
    Mark,
    MarkedRow,
    Part,
    Plot,
    Section,
    Study,
    line,
    study_of,
    table,
)
from ..figures_page import with_digits
from .sheet import ChartPart, Row, rows_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HEADINGS = (
    "symbol | figure | filter | gain | temperature [K] | measured | 95 % from | to | unit | theory | z | section | "
    "note"
)
OF_TABLE = (
    "z: distance from theory in standard errors. A row is marked where the figure is farther from theory, or from the "
    "range in which single chips of the datasheet lie, than chance allows for so many figures: once in 100 sheets"
)
CHARTS_OF_LINE, TITLE_LETTERS = 3, 26
"""Charts side by side in the overview, and letters of a line of a title there."""
TRENDS = "K", "σ_d", "µ_I.mean", "DSNU1288", "DR", "MTF50"
"""Figures that are drawn over the settings."""


def sheet_study(name: str, parts: Sequence[ChartPart], **about: object) -> Study:
    """The page of a camera.  about : what page and sheet.json say beside the figures."""
    rows = list(rows_of(parts))
    limit = z_limit(sum(bool(row.beside) for row in rows))
    charts = list(dict.fromkeys(part.name for part in parts))
    sections = [
        _section([part for part in parts if part.name == chart], limit) for chart in charts
    ]
    sections.insert(0, Section((), True, (_overview(parts),)))
    figures = [row.to_dict() | {"mark": mark_of(row, limit)} for row in rows]
    title = f"Image quality of {name}"
    return study_of("sheet", title, sections, rows=figures, z_limit=limit, **about)


def _overview(parts: Sequence[ChartPart]) -> Drawing:
    """Frame and first plot of every chart at the first setting, side by side."""
    first = [part for part in parts if part.setting == parts[0].setting]
    lines = math.ceil(len(first) / CHARTS_OF_LINE)
    draw = partial(draw_overview, first)
    return Drawing("Overview", draw, f"at {parts[0].setting}", lines)


def draw_overview(parts: Sequence[ChartPart], ax: Axes) -> None:
    """A frame and a plot below for every chart, three side by side."""
    ax.set_axis_off()
    lines = math.ceil(len(parts) / CHARTS_OF_LINE)
    for number, part in enumerate(parts):
        line_number, column = divmod(number, CHARTS_OF_LINE)
        box = column / CHARTS_OF_LINE, 1 - (line_number + 1) / lines, 1 / lines
        _draw_part(part, box, ax)


def _draw_part(part: ChartPart, box: tuple[float, float, float], ax: Axes) -> None:
    """One chart of the overview.  box : left, bottom and height of its place."""
    left, bottom, height = box
    width = 0.72 / CHARTS_OF_LINE
    if part.picture is not None:
        above = ax.inset_axes((left, bottom + 0.55 * height, width, 0.36 * height))
        above.imshow(mean_of_tiles(part.picture, part.tile), cmap="gray", vmin=0)
        above.set_title(part.name, fontsize=9)
        above.set_axis_off()
    for title, draw in list(part.drawings.items())[:1]:
        below = ax.inset_axes((left, bottom + 0.08 * height, width, 0.36 * height))
        draw(below)
        below.set_title(_in_lines(title), fontsize=7)
        below.tick_params(labelsize=6)
        below.set_xlabel(below.get_xlabel(), fontsize=6)
        below.set_ylabel(below.get_ylabel(), fontsize=6)


def _in_lines(title: str) -> str:
    """A title, with the filter in a second line where it is long."""
    if len(title) > TITLE_LETTERS:
        return title.replace(" behind ", "\nbehind ")
    return title


def mean_of_tiles(frame: Float64Array, tile: tuple[int, int]) -> Float64Array:
    """A frame with one value for each tile of its colour mosaic, without pixels of tiles that are cut off."""
    rows, columns = (count // step for count, step in zip(frame.shape, tile, strict=True))
    whole = frame[: rows * tile[0], : columns * tile[1]]
    return np.asarray(whole.reshape(rows, tile[0], columns, tile[1]).mean(axis=(1, 3)))


def mark_of(row: Row, limit: float) -> Mark:
    """``good`` or ``bad`` beside theory, nothing without."""
    if not row.beside:
        return ""
    if abs(row.beside["z_of_chip"]) < limit:
        return "good"
    return "bad"


def _section(parts: Sequence[ChartPart], limit: float) -> Section:
    """One chart at all settings."""
    first, rows = parts[0], list(rows_of(parts))
    title, name = first.title, first.name
    bad = [row for row in rows if mark_of(row, limit) == "bad"]
    compared = sum(bool(row.beside) for row in rows)
    findings = []
    if compared:
        findings.append(
            f"{name}: {compared - len(bad)} of {compared} figures agree with theory within {limit:.1f} standard errors"
        )
    findings += [_told(row) for row in bad]
    refused = [f"{name} at {part.setting}: {text}" for part in parts for text in part.refused]
    findings += [f"not measured: {sentence}" for sentence in refused]
    shown = [_table_row(row, limit) for row in rows]
    pictures = [
        Drawing(f"{name}: {drawing}", draw, f"at {first.setting}")
        for drawing, draw in first.drawings.items()
    ]
    if first.picture is not None:
        draw = partial(draw_frame, first.picture)
        pictures.append(Drawing(f"{name}: a frame", draw, f"at {first.setting}"))
    content: tuple[Part, ...] = (
        table(title, HEADINGS, shown, OF_TABLE),
        *_trends(rows),
        *pictures,
    )
    failed = tuple(dict.fromkeys(f"{name} {row.quantity.symbol}" for row in bad))
    return Section(
        tuple(findings), not bad, content, failed=failed, missing=_missing(parts, rows)
    )


def _missing(parts: Sequence[ChartPart], rows: Sequence[Row]) -> tuple[str, ...]:
    """The chart, or that some of it, where an instrument refused."""
    charts = dict.fromkeys(part.name for part in parts if part.refused)
    if rows:
        return tuple(f"some figures of {chart}" for chart in charts)
    return tuple(charts)


def _told(row: Row) -> str:
    """A figure that is not what theory says, in one sentence."""
    quantity, theory = row.quantity, row.beside["datasheet"]
    where = " ".join(filter(None, (row.chart, row.filter_name, row.gain)))
    both = f"{quantity.symbol} ({where}): measured {quantity.value:.4g}, theory {theory:.4g}"
    return f"{both} {quantity.unit}".rstrip()


def _table_row(row: Row, limit: float) -> MarkedRow:
    """A line of the table."""
    values = row.to_dict()
    numbers = (values["value"], values["low"], values["high"])
    cells = (values["symbol"], values["name"], *numbers, values["unit"], values["theory"])
    symbol, name, value, low, high, unit, theory = with_digits(cells)
    setting = row.filter_name, row.gain, row.temperature_k
    rest = values["z"], values["section"], values["note"]
    shown = (symbol, name, *setting, value, low, high, unit, theory, *rest)
    return mark_of(row, limit), shown


def _trends(rows: Sequence[Row]) -> Iterator[Plot]:
    """Figures over the temperature, one line for each gain and filter; of sheets at several temperatures."""
    for symbol in TRENDS:
        lines: dict[str, list[tuple[float, float, float]]] = {}
        theory: dict[str, list[tuple[float, float]]] = {}
        chosen = [row for row in rows if row.quantity.symbol == symbol]
        for row in chosen:
            label = " ".join(filter(None, (row.filter_name, row.gain))) or "measured"
            if row.temperature_k is not None and math.isfinite(row.quantity.value):
                half = 0.5 * (row.quantity.high - row.quantity.low)
                point = row.temperature_k, row.quantity.value, half
                lines.setdefault(label, []).append(point)
                if row.said is not None:
                    theory.setdefault(label, []).append((point[0], row.said.value))
        if lines and max(map(len, lines.values())) > 1:
            drawn = [line(label, points, joined=False) for label, points in lines.items()]
            drawn += [
                line(f"{label}, theory", points, marked=False, dashed=True)
                for label, points in theory.items()
            ]
            unit = chosen[0].quantity.unit
            axis = f"{symbol} [{unit}]" if unit else symbol
            title = f"{symbol} over temperature"
            yield Plot(title, "temperature [K]", axis, tuple(drawn), False, False)


def draw_frame(frame: Float64Array, ax: Axes) -> None:
    """A frame as it is, code by code, from its darkest to its brightest pixels."""
    ax.imshow(frame, cmap="gray", interpolation="nearest")
    ax.grid(visible=False)
    ax.set(xlabel="column", ylabel="row")


def csv_text(rows: Sequence[dict[str, object]]) -> str:
    """The rows as a table of commas, one line each below their names."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
