"""HTML from Jinja templates with escaped text, for notebooks and pages."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from jinja2 import Environment

WIDTH_MAX_PX, WIDTH_MIN_PX = 480, 160
"""Widths of an image on the page; narrower images are enlarged."""


class Table(NamedTuple):
    """Rows of texts and numbers below a header; the header may be empty."""

    header: Sequence[object]
    rows: Sequence[Sequence[object]]


class Picture(NamedTuple):
    """An embedded PNG."""

    data: str
    width_px: int
    rendering: str
    described: str


def facts(values: Mapping[str, object]) -> Table:
    """Return a table of names and values."""
    return Table((), tuple(values.items()))


def picture(png: bytes, columns: int, described: str) -> Picture:
    """Return an embedded PNG with this many columns; few columns are enlarged without smoothing."""
    width_px = min(max(columns, WIDTH_MIN_PX), WIDTH_MAX_PX)
    rendering = "pixelated" if columns < width_px else "auto"
    return Picture(base64.b64encode(png).decode(), width_px, rendering, described)


def fragment(title: str, *parts: Table | Picture) -> str:
    """Return a heading and its parts, for ``_repr_html_``."""
    return render_template(
        Path(__file__).with_name("fragment.html.j2"), title=title, parts=parts
    )


def render_template(template: Path, **values: object) -> str:
    """Return the text of a Jinja template with these values, escaped."""
    return _environment(template.parent).get_template(template.name).render(values)


@cache
def _environment(folder: Path) -> Environment:
    """Return Jinja's environment for the templates of a folder; the first page imports Jinja."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
