"""A study as one page that needs nothing else: text, tables and drawings in a single HTML file."""

from __future__ import annotations

import math
from html import escape

from .drawing import svg
from .page import Part, Study, Table

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 76rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin: 2rem 0 .4rem; }
.note, footer { color: #555; font-size: .9rem; } .wide { overflow-x: auto; } svg { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .18rem .7rem .18rem 0; border-bottom: 1px solid #ddd; }
td.number { text-align: right; white-space: nowrap; }
.good { background: #e3f3ea; } .bad { background: #f9d9cc; } .best { background: #bfe3cf; } .dim { color: #888; }
""".strip()

ORIGIN = ("command", "scene", "camera", "exposure", "machine", "versions", "seconds", "date")
"""What of a study's data stands at the foot of the page: what it was made with and how long that took."""


def html(study: Study) -> str:
    """The whole page."""
    mark, verdict = ("good", "everything that must hold does") if study.passed else ("bad", "not all holds")
    findings = "".join(f"<li>{escape(finding)}</li>" for finding in study.findings)
    made = "".join(f"<div>{name}: {escape(text(study.data[name]))}</div>" for name in ORIGIN if name in study.data)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(study.title)}</title>\n'
        f"<style>\n{STYLE}\n</style></head><body>\n<h1>{escape(study.title)}</h1>\n"
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
    inside = _table(part) if isinstance(part, Table) else svg(part)
    return f'<section><h2>{escape(part.title)}</h2>{note}<div class="wide">{inside}</div></section>\n'


def _table(table: Table) -> str:
    heads = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    marked = zip(table.marks or ("",) * len(table.rows), table.rows, strict=True)
    rows = "".join(f'<tr class="{mark}">{"".join(map(_cell, row))}</tr>' for mark, row in marked)
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"


def _cell(value: object) -> str:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return f'<td class="{"number" if number else "text"}">{escape(text(value))}</td>'
