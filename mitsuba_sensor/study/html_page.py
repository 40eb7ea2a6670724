"""The page of a study: one HTML file that needs nothing else, whose tables and plots scroll on a phone."""

from __future__ import annotations

import math
from html import escape

from .page import LOOK, Part, Study, Table, svg

ORIGIN = ("command", "scene", "camera", "exposure", "machine", "versions", "seconds", "date")  # at the foot of the page


def html(study: Study) -> str:
    """The whole page."""
    mark, verdict = ("good", "everything that must hold does") if study.passed else ("bad", "not all holds")
    findings = "".join(f"<li>{escape(finding)}</li>" for finding in study.findings)
    made = "".join(f"<div>{name}: {escape(text(study.data[name]))}</div>" for name in ORIGIN if name in study.data)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{escape(study.title)}</title>\n<style>\n{LOOK['css'].strip()}\n</style></head><body>\n<h1>{escape(study.title)}</h1>\n"
        f'<p><strong class="{mark}">{verdict}</strong></p>\n<ul>{findings}</ul>\n'
        f"{''.join(map(_part, study.parts))}<footer>{made}</footer>\n</body></html>\n"
    )


def text(value: object) -> str:
    """A value for people: numbers with four digits, lists joined, nothing for None."""
    match value:
        case None:
            return "–"
        case bool():
            return "yes" if value else "no"
        case float():
            plain = value == 0 or 1e-3 <= abs(value) < 1e5
            return f"{value:.4g}" if plain or not math.isfinite(value) else f"{value:.3g}"
        case dict():
            return ", ".join(f"{key} {text(one)}" for key, one in value.items())
        case list() | tuple():
            return ", ".join(map(text, value))
    return str(value)


def _part(part: Part) -> str:
    note = f'<p class="note">{escape(part.note)}</p>' if part.note else ""
    if isinstance(part, Table):
        heads = "".join(f"<th>{escape(column)}</th>" for column in part.columns)
        marked = zip(part.marks or ("",) * len(part.rows), part.rows, strict=True)
        rows = "".join(f'<tr class="{mark}">{"".join(map(_cell, row))}</tr>' for mark, row in marked)
        inside = f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"
    else:
        inside = svg(part)
    return f'<section><h2>{escape(part.title)}</h2>{note}<div class="wide">{inside}</div></section>\n'


def _cell(value: object) -> str:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return f'<td class="{"number" if number else "text"}">{escape(text(value))}</td>'
