"""HTML from Jinja templates, all text escaped: what objects show in a notebook, and the pages of studies."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from jinja2 import Environment

WIDEST_PX, NARROWEST_PX = 480, 160
"""Widths of a picture on the page; a few pixels are shown enlarged."""


class Table(NamedTuple):
    """Rows of texts and numbers below a header, which may be empty."""

    header: Sequence[object]
    rows: Sequence[Sequence[object]]


class Picture(NamedTuple):
    """An embedded PNG."""

    data: str
    width_px: int
    rendering: str
    described: str


def facts(values: Mapping[str, object]) -> Table:
    """A table of names and values."""
    return Table((), tuple(values.items()))


def picture(png: bytes, columns: int, described: str) -> Picture:
    """An embedded PNG of so many columns, enlarged without smoothing where it has few."""
    width_px = min(max(columns, NARROWEST_PX), WIDEST_PX)
    rendering = "pixelated" if columns < width_px else "auto"
    return Picture(base64.b64encode(png).decode(), width_px, rendering, described)


def fragment(title: str, *parts: Table | Picture) -> str:
    """What ``_repr_html_`` returns: a heading and its parts."""
    return render_template(
        Path(__file__).with_name("fragment.html.j2"), title=title, parts=parts
    )


def render_template(template: Path, **values: object) -> str:
    """The text of a Jinja template with these values, which are escaped."""
    return _environment(template.parent).get_template(template.name).render(values)


@cache
def _environment(folder: Path) -> Environment:
    """Jinja, imported with the first page, for the templates of a folder."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader(folder)
    return Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
