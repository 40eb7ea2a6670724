"""The page of a study: one HTML file that needs nothing else, whose tables and plots scroll on a phone."""

from __future__ import annotations

import math
from pathlib import Path

from ..core.html import render_template
from .drawing import svg
from .page import Study, Table

ORIGIN = (
    "command",
    "scene",
    "camera",
    "exposure",
    "machine",
    "versions",
    "seconds",
    "longest_step",
    "date",
)
"""What stands at the foot of the page, where the data of the study has it."""


def html(study: Study) -> str:
    """The whole page."""
    return render_template(
        Path(__file__).with_name("page.html.j2"),
        study=study,
        origin={
            name.replace("_", " "): text(study.data[name])
            for name in ORIGIN
            if name in study.data
        },
        pictures={id(picture): svg(picture) for picture in study.pictures},
        is_table=lambda part: isinstance(part, Table),
        is_number=is_number,
        id=id,
        text=text,
    )


def is_number(value: object) -> bool:
    """Whether a cell stands to the right."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def text(value: object) -> str:
    """A value for people: numbers with four digits, lists joined, a dash for None."""
    match value:
        case None:
            return "–"
        case bool():
            if value:
                return "yes"
            return "no"
        case float():
            plain = value == 0 or 1e-3 <= abs(value) < 1e5
            if plain or not math.isfinite(value):
                return f"{value:.4g}"
            return f"{value:.3g}"
        case dict():
            return ", ".join(f"{key} {text(entry)}" for key, entry in value.items())
        case list() | tuple():
            return ", ".join(map(text, value))
    return str(value)
