"""The page of a study: one self-contained HTML file for a screen, a phone and paper."""

from __future__ import annotations

import base64
import math
from pathlib import Path

from ..core.html import render_template
from .drawing import svg
from .page import VERDICTS, Study, Table

ORIGIN = [
    "command",
    "scene",
    "camera",
    "exposure",
    "machine",
    "load",
    "versions",
    "seconds",
    "date",
]
"""Data of the study that the footer shows."""
FIGURE_SPACE, POINT_SPACE = "\u2007", "\u2008"
"""Spaces as wide as a digit and as a decimal point."""


def html(study: Study) -> str:
    """Return the page as HTML."""
    pictures = {
        id(part): base64.b64encode(svg(part)).decode()
        for part in study.parts
        if not isinstance(part, Table)
    }
    return render_template(
        Path(__file__).with_name("page.html.j2"),
        study=study,
        origin={name: text(study.data[name]) for name in ORIGIN if name in study.data},
        pictures=pictures,
        tables={id(part): shown(part) for part in study.parts if isinstance(part, Table)},
        id=id,
    )


def shown(part: Table) -> tuple[list[str], list[bool], list[tuple[str, list[str]]]]:
    """Return the headings, True for each numeric column, and the rows as texts with their marks.

    Marked rows have their verdict in the second column. Columns without any value are omitted. The decimal points of
    a numeric column are aligned.
    """
    columns = list(zip(part.columns, zip(*part.rows, strict=True), strict=True))
    columns = [
        (name, cells) for name, cells in columns if any(x not in (None, "") for x in cells)
    ]
    if any(part.marks):
        columns.insert(1, ("verdict", tuple(VERDICTS[mark] for mark in part.marks)))
    numeric = [all(x is None or is_number(x) for x in cells) for _, cells in columns]
    texts = [
        aligned([text(x) for x in cells]) if of_numbers else [text(x) for x in cells]
        for (_, cells), of_numbers in zip(columns, numeric, strict=True)
    ]
    marks = part.marks or ("",) * len(part.rows)
    headings = [name.replace(" [1]", "") for name, _ in columns]
    rows = [list(row) for row in zip(*texts, strict=True)] or [[] for _ in part.rows]
    return headings, numeric, list(zip(marks, rows, strict=True))


def aligned(numbers: list[str]) -> list[str]:
    """Pad numbers so their decimal points align in a right-aligned column."""
    ends = [len(number.partition(".")[2]) for number in numbers]
    most = max(ends, default=0)
    padded = []
    for number, end in zip(numbers, ends, strict=True):
        point = POINT_SPACE if most and not end else ""
        padded.append(number + point + FIGURE_SPACE * (most - end))
    return padded


def is_number(value: object) -> bool:
    """Return True for a number or its text, which may begin with < or >."""
    if isinstance(value, str):
        try:
            float(value.lstrip("<> "))
        except ValueError:
            return False
        return True
    return isinstance(value, int | float) and not isinstance(value, bool)


def text(value: object) -> str:
    """Return a value as text: numbers with four digits (298.15 with all), lists joined, a dash for None."""
    match value:
        case None:
            return "–"
        case bool():
            return "yes" if value else "no"
        case float() if value == 0:
            return "0"
        case float():
            if math.isfinite(value) and not 1e-3 <= abs(value) < 1e5:
                return f"{value:.3g}"
            return f"{value:g}" if value == round(value, 2) else f"{value:.4g}"
        case dict():
            return ", ".join(f"{key} {text(entry)}" for key, entry in value.items())
        case list() | tuple():
            return ", ".join(map(text, value))
    return str(value)
