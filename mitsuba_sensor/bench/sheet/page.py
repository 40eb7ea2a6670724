"""A sheet as a page: for each chart a table of all settings, the plots of the first setting, and a frame."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.types import Float64Array
from ...lab.statistics.estimators import z_limit
from ...pages.drawing import colour_of
from ...pages.page import (
    Drawing,
    Line,
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
from .chart import Draw
from .sheet import ChartPart, Row, rows_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HEADINGS = (
    "symbol | figure | filter | gain | temperature [K] | measured | 95 % from | to | unit | theory | z | section | "
    "note"
)
ON_TERMINAL = (
    "symbol | filter | gain | temperature [K] | measured | 95 % from | to | unit | theory | z"
)
TABLE_NOTE = (
    "z: distance from theory in standard errors. A row fails if the figure is farther from theory, or from the range "
    "of single sensor units, than chance allows in one of 100 sheets; limits (< and >) are not judged."
)
TRENDS = "K", "σ_d", "µ_I.mean", "DSNU1288", "DR", "MTF50"
"""Figures drawn versus temperature."""
KELVINS = 33
"""Points of the theory curve versus temperature."""


def sheet_study(name: str, parts: Sequence[ChartPart], **about: object) -> Study:
    """Return the page of a camera.  about : further facts for the page and sheet.json."""
    rows = rows_of(parts)
    limit = z_limit(sum(bool(row.beside) for row in rows))
    charts = list(dict.fromkeys(part.name for part in parts))
    sections = [
        _section([part for part in parts if part.name == chart], limit) for chart in charts
    ]
    figures = [row.to_dict() | {"mark": mark_of(row, limit)} for row in rows]
    title = f"Image quality of {name}"
    return study_of("sheet", title, sections, rows=figures, z_limit=limit, **about)


def draw_filters(entries: Sequence[tuple[str, Draw, Draw | None]], ax: Axes) -> None:
    """Draw the measurement under each filter in its colour, and theory as dashed lines."""
    for number, (name, measured, theory) in enumerate(entries):
        if len(entries) > 1:
            ax.set_prop_cycle(color=[colour_of(name, number)])
        before = list(chain(ax.lines, ax.containers))
        measured(ax)
        drawn = [one for one in chain(ax.lines, ax.containers) if one not in before]
        if name or not ax.get_legend_handles_labels()[1]:
            _label(drawn, name or "measured")
        if theory is not None:
            before = list(chain(ax.lines, ax.containers))
            theory(ax)
            added = [
                one for one in ax.lines if one not in before and np.size(one.get_xdata()) > 2
            ]
            for one in added:
                colour = one.get_color() if len(entries) > 1 else "black"
                one.set(linestyle="--", linewidth=1, marker="", color=colour)
            _label([one for one in chain(ax.lines, ax.containers) if one not in before], "_")
            _label(added[:1], "theory" if number == 0 else "_")


def _label(artists: Sequence[Any], name: str) -> None:
    """Label new artists in the legend; several artists with labels keep them."""
    own = [one for one in artists if not str(one.get_label() or "_").startswith("_")]
    for one in own if len(own) > 1 else artists[:1]:
        label = f"{name}, {one.get_label()}" if len(own) > 1 else name
        one.set_label(name if name == "_" else label)


def mean_of_tiles(frame: Float64Array, tile: tuple[int, int]) -> Float64Array:
    """Return the mean of each whole tile of the mosaic."""
    rows, columns = (count // step for count, step in zip(frame.shape, tile, strict=True))
    whole = frame[: rows * tile[0], : columns * tile[1]]
    return np.asarray(whole.reshape(rows, tile[0], columns, tile[1]).mean(axis=(1, 3)))


def draw_frame(frame: Float64Array, tile: tuple[int, int], ax: Axes) -> None:
    """Draw a frame from 0 to its largest code, with a colour bar."""
    drawn = ax.imshow(mean_of_tiles(frame, tile), cmap="gray", interpolation="nearest", vmin=0)
    ax.figure.colorbar(drawn, ax=ax, label="digital number [DN]")
    ax.grid(visible=False)
    ax.set(xlabel="column", ylabel="row")


def mark_of(row: Row, limit: float) -> Mark:
    """Return ``good`` or ``bad``, or nothing without theory."""
    if not row.beside:
        return ""
    return "good" if abs(row.beside["z_of_chip"]) < limit else "bad"


def _section(parts: Sequence[ChartPart], limit: float) -> Section:
    """Return the section of one chart at all settings."""
    first, rows = parts[0], rows_of(parts)
    bad = [row for row in rows if mark_of(row, limit) == "bad"]
    compared, findings = sum(bool(row.beside) for row in rows), list[str]()
    if compared:
        agree = f"{compared - len(bad)} of {compared} figures agree with theory"
        findings.append(f"{first.title}: {agree} within {limit:.1f} standard errors")
    findings += [_told(row) for row in bad]
    refused = [
        f"{first.name} at {part.setting}: {text}" for part in parts for text in part.refused
    ]
    findings += [f"not measured: {sentence}" for sentence in refused]
    lines = [_table_row(row, limit) for row in rows]
    shown = table(first.title, HEADINGS, lines, TABLE_NOTE, ON_TERMINAL)
    content: list[Part] = [shown, *_trends(parts)]
    for title, entries in first.drawings.items():
        note = f"At {first.setting}."
        if any(theory is not None for *_, theory in entries):
            note += " Dashed: the same instrument on the noise-free image."
        draw = partial(draw_filters, entries)
        content.append(Drawing(f"{title}: {first.title.partition(':')[0]}", draw, note))
    if first.picture is not None:
        note = f"Frame at {first.setting}."
        if first.tile != (1, 1):
            note += f" Each point is the mean of {first.tile[0]} × {first.tile[1]} pixels of the mosaic."
        draw = partial(draw_frame, first.picture, first.tile)
        content.append(Drawing(f"Frame: {first.title.partition(':')[0]}", draw, note))
    failed = tuple(dict.fromkeys(f"{first.name} {row.quantity.symbol}" for row in bad))
    names = dict.fromkeys(part.name for part in parts if part.refused)
    missing = tuple(f"some figures of {name}" if rows else name for name in names)
    return Section(tuple(findings), not bad, tuple(content), failed=failed, missing=missing)


def _told(row: Row) -> str:
    """Return a sentence about a figure that disagrees with theory."""
    quantity, theory = row.quantity, row.beside["datasheet"]
    where = " ".join(filter(None, (row.chart, row.filter_name, row.gain)))
    both = f"{quantity.symbol} ({where}): measured {quantity.value:.4g}, theory {theory:.4g}"
    return f"{both} {quantity.unit}".rstrip()


def _table_row(row: Row, limit: float) -> MarkedRow:
    """Return a line of the table."""
    figure = row.quantity
    value, low, high, theory = with_digits(figure, None if row.said is None else row.said.value)
    setting = (row.filter_name, row.gain, row.temperature_k)
    z = f"{row.beside['z']:.2f}" if row.beside else None
    numbers = (value, low, high, figure.unit, theory, z)
    return mark_of(row, limit), (
        figure.symbol,
        figure.name,
        *setting,
        *numbers,
        figure.section,
        figure.note,
    )


def _trends(parts: Sequence[ChartPart]) -> Iterator[Plot]:
    """Yield plots versus temperature, with each gain and filter; theory is the model's curve."""
    rows = [(row, part.at_kelvin) for part in parts for row in part.rows]
    kelvins = sorted({row.temperature_k for row, _ in rows if row.temperature_k is not None})
    if len(kelvins) < 2:
        return
    grid = np.linspace(kelvins[0], kelvins[-1], KELVINS).tolist()
    for symbol in TRENDS:
        chosen = [one for one in rows if one[0].quantity.symbol == symbol]
        chosen = [one for one in chosen if math.isfinite(one[0].quantity.value)]
        lines, curves = dict[str, list[Any]](), dict[str, Line]()
        for row, at_kelvin in chosen:
            label = " ".join(filter(None, (row.filter_name, row.gain))) or "measured"
            half = 0.5 * (row.quantity.high - row.quantity.low)
            lines.setdefault(label, []).append((row.temperature_k, row.quantity.value, half))
            if at_kelvin is not None and row.said is not None and label not in curves:
                kind = row.filter_name.partition(" (")[0]
                said = [(kelvin, at_kelvin(kelvin)[kind].get(symbol)) for kelvin in grid]
                points = [(kelvin, one.value) for kelvin, one in said if one is not None]
                name = f"theory {label}".removesuffix(" measured")
                curves[label] = line(name, points, marked=False, dashed=True)
        if lines:
            drawn = [line(label, points, joined=False) for label, points in lines.items()]
            unit, drawn = chosen[0][0].quantity.unit, [*drawn, *curves.values()]
            axis = f"{symbol} [{unit}]" if unit else symbol
            title = f"{symbol} versus temperature"
            yield Plot(title, "temperature [K]", axis, tuple(drawn), log_x=False, log_y=True)


def csv_text(rows: Sequence[dict[str, object]]) -> str:
    """Return the rows as comma-separated lines with a header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
