"""``study paper``: section 4 of Konnik & Welsh 2014, its tables and figures for Table 1's camera beside the printed."""

from __future__ import annotations

from functools import partial

from ...lab.statistics.families import FAMILIES
from ..kit import Kit, Step
from ..page import MarkedRow, Section, Study, study_of, table
from . import dark, light, pattern, transfer
from .camera import CURVES, FULL, LINEAR, PAIR, Size
from .published import DARK_SIGNALS, NOT_TO_BE_MET, TABLE_2

TITLE = "Section 4 of Konnik & Welsh 2014: published and ours"
RECORDS: tuple[type, ...] = (
    light.Sweep,
    transfer.Curve,
    pattern.MeasuredPrnu,
    pattern.Whiteness,
    dark.Rate,
    *map(type, FAMILIES.values()),
)
"""Classes that its measurements consist of."""


def paper(kit: Kit, size: Size = FULL) -> Study:
    """Measure everything that is not measured yet, and compare it with what is printed and with closed forms."""
    sweeps = {name: f"radiometric, {name}" for name in (LINEAR, PAIR)}
    curves = {name: f"gradient, {name}" for name in CURVES}
    whiteness = {
        (row, camera): f"F, {row.name}, {row.time_s:g} s, {camera}" for row in TABLE_2 for camera in pattern.CAMERAS
    }
    laws = {law: f"dark, {law.time_s:g} s" for law in DARK_SIGNALS}
    kit.take(
        [
            *(Step(key, 4.0, partial(light.measure, name, size)) for name, key in sweeps.items()),
            *(Step(key, 14.0, partial(transfer.measure, name, size)) for name, key in curves.items()),
            Step("PRNU", 4.0, partial(pattern.measure_prnu, size)),
            *(Step(key, 12.0, partial(pattern.measure_f, *one, size)) for one, key in whiteness.items()),
            *(Step(key, 2.0, partial(dark.measure, law, size)) for law, key in laws.items()),
            Step("dark current", 3.0, partial(dark.measure_rate, size)),
        ]
    )
    sections = [
        light.section({name: kit[key] for name, key in sweeps.items()}, size),
        transfer.section({name: kit[key] for name, key in curves.items()}),
        pattern.prnu_section(kit["PRNU"], size),
        pattern.f_section({one: kit[key] for one, key in whiteness.items()}, size),
        dark.section({law: kit[key] for law, key in laws.items()}, kit["dark current"], size),
        _gaps(),
    ]
    return study_of("paper", TITLE, sections)


def _gaps() -> Section:
    rows: list[MarkedRow] = [("", row) for row in NOT_TO_BE_MET]
    gaps = table("What the text prints and nobody can measure again", "figure or table | why", rows)
    return Section((), True, (gaps,))
