"""A study as one page that needs nothing else: text, tables and drawings in a single HTML file."""

from __future__ import annotations

import math
from html import escape

from .drawing import svg
from .page import Mark, Part, Study, Table

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 76rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.5rem; margin-bottom: .2rem; } h2 { font-size: 1.1rem; margin: 2rem 0 .4rem; }
.verdict { display: inline-block; padding: .1rem .6rem; border-radius: .3rem; font-weight: 600; }
.findings li { margin: .3rem 0; } .note { color: #555; font-size: .9rem; max-width: 60rem; }
.wide { overflow-x: auto; } svg { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; }
th { text-align: left; border-bottom: 1.5px solid #888; vertical-align: bottom; }
th, td { padding: .18rem .7rem .18rem 0; } td { border-bottom: 1px solid #e8e8e8; vertical-align: top; }
td.number { text-align: right; white-space: nowrap; }
.good { background: #e3f3ea; } .bad { background: #f9d9cc; } .best { background: #bfe3cf; } .dim { color: #888; }
footer { margin: 2.5rem 0 1rem; color: #555; font-size: .85rem; border-top: 1px solid #ddd; padding-top: .6rem; }
""".strip()

ORIGIN = ("command", "scene", "camera", "exposure", "machine", "versions", "seconds", "date")
"""What of a study's data stands at the foot of the page: what it was made with and how long that took."""


def html(study: Study) -> str:
    """The whole page."""
    verdict: Mark = "good" if study.passed else "bad"
    told = "everything that must hold does" if study.passed else "something that must hold does not"
    findings = "".join(f"<li>{escape(finding)}</li>" for finding in study.findings)
    made = "".join(f"<div>{name}: {escape(text(study.data[name]))}</div>" for name in ORIGIN if name in study.data)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(study.title)}</title>\n'
        f"<style>\n{STYLE}\n</style></head><body>\n<h1>{escape(study.title)}</h1>\n"
        f'<p><span class="verdict {verdict}">{told}</span></p>\n<ul class="findings">{findings}</ul>\n'
        f"{''.join(_part(part) for part in study.parts)}<footer>{made}</footer>\n</body></html>\n"
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
            return ", ".join(text(one) for one in value)
    return str(value)


def _part(part: Part) -> str:
    inside = _table(part) if isinstance(part, Table) else f"<div>{svg(part)}</div>"
    note = f'<p class="note">{escape(part.note)}</p>' if part.note else ""
    return f"<section><h2>{escape(part.title)}</h2>{note}{inside}</section>\n"


def _table(table: Table) -> str:
    heads = "".join(f"<th>{escape(column)}</th>" for column in table.columns)
    marks = table.marks or ("",) * len(table.rows)
    rows = "".join(
        f'<tr class="{mark}">{"".join(map(_cell, row))}</tr>' for mark, row in zip(marks, table.rows, strict=True)
    )
    return f'<div class="wide"><table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>'


def _cell(value: object) -> str:
    kind = ' class="number"' if isinstance(value, int | float) and not isinstance(value, bool) else ""
    return f"<td{kind}>{escape(text(value))}</td>"
