"""Pieces of HTML that objects show in a notebook: tables, bars and embedded pictures, all text escaped."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape

WIDEST_PX, NARROWEST_PX = 480, 160  # of a picture on the page; a few pixels are shown enlarged


class Markup(str):
    """Text that is HTML already."""


def element(name: str, content: object, **attributes: object) -> Markup:
    """<name …>content</name>; content and attributes are escaped, except for :class:`Markup`."""
    given = "".join(f' {key}="{escape(str(value))}"' for key, value in attributes.items())
    return Markup(f"<{name}{given}>{content if isinstance(content, Markup) else escape(str(content))}</{name}>")


def joined(parts: Iterable[Markup]) -> Markup:
    """The parts one after another."""
    return Markup("".join(parts))


def table(header: Sequence[object], rows: Iterable[Sequence[object]]) -> Markup:
    """A table with one line for each row."""
    lines = [joined(element("th", cell, style="text-align:left") for cell in header)] if header else []
    lines += [joined(element("td", cell, style="text-align:left") for cell in row) for row in rows]
    return element("table", joined(element("tr", line) for line in lines))


def facts(values: Mapping[str, object]) -> Markup:
    """A table of names and values."""
    return table((), values.items())


def bar(share: float, said: str) -> Markup:
    """A horizontal bar, full at a share of 1, behind which stands what is said."""
    width = f"{100 * min(max(share, 0.0), 1.0):.1f}px"
    mark = element("span", "", style=f"display:inline-block;height:0.7em;background:#4c78a8;width:{width}")
    return Markup(mark + " " + escape(said))


def picture(png: bytes, columns: int, described: str) -> Markup:
    """An embedded PNG of so many columns, enlarged without smoothing where it has few."""
    wide = min(max(columns, NARROWEST_PX), WIDEST_PX)
    style = f"width:{wide}px;max-width:100%;image-rendering:{'pixelated' if columns < wide else 'auto'}"
    data = base64.b64encode(png).decode()
    return Markup(f'<img src="data:image/png;base64,{data}" alt="{escape(described)}" style="{style}">')


def fragment(title: str, *parts: Markup) -> str:
    """What ``_repr_html_`` returns: a heading and its parts."""
    return element("div", joined((element("p", element("b", title)), *parts)))
