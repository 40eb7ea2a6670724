"""Section 4 of Konnik & Welsh 2014: its tables and figures for Table 1's camera, beside the printed ones.

``paper_pages.py`` makes the pages. published : what is printed.  camera : Table 1's, and closed forms of its response.
light, transfer, pattern, dark : sections of the text in their order.  check : measured numbers beside closed forms."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from mitsuba_sensor.pages.page import MarkedRow, Section, Study, study_of, table
from mitsuba_sensor.study.kit import Progress, measured

from . import dark, light, pattern, transfer
from .camera import CURVES, FULL, LINEAR, PAIR, SMALL, Size
from .published import DARK_SIGNALS, NOT_TO_BE_MET, TABLE_2

TITLE = "Section 4 of Konnik & Welsh 2014: published and ours"
__all__ = ["SMALL", "measure_paper"]


def measure_paper(progress: Progress, size: Size = FULL) -> Study:
    """Measure everything, and compare it with what is printed and with closed forms."""
    sweeps = {name: f"radiometric, {name}" for name in (LINEAR, PAIR)}
    curves = {name: f"gradient, {name}" for name in CURVES}
    whiteness = {
        (row, camera): f"F, {row.name}, {row.time_s:g} s, {camera}"
        for row in TABLE_2
        for camera in pattern.CAMERAS
    }
    laws = {law: f"dark, {law.time_s:g} s" for law in DARK_SIGNALS}
    steps: dict[str, Callable[[], Any]] = {
        key: partial(light.measure, name, size) for name, key in sweeps.items()
    }
    steps |= {key: partial(transfer.measure, name, size) for name, key in curves.items()}
    steps["PRNU"] = partial(pattern.measure_prnu, size)
    steps |= {key: partial(pattern.measure_f, *row, size) for row, key in whiteness.items()}
    steps |= {key: partial(dark.measure, law, size) for law, key in laws.items()}
    found = measured(steps, progress)
    sections = [
        light.section({name: found[key] for name, key in sweeps.items()}, size),
        transfer.section({name: found[key] for name, key in curves.items()}),
        pattern.prnu_section(found["PRNU"], size),
        pattern.f_section({row: found[key] for row, key in whiteness.items()}, size),
        dark.section({law: found[key] for law, key in laws.items()}, size),
        _gaps(),
    ]
    return study_of("paper", TITLE, sections)


def _gaps() -> Section:
    rows: list[MarkedRow] = [("", row) for row in NOT_TO_BE_MET]
    gaps = table(
        "What the text prints and nobody can measure again", "figure or table | why", rows
    )
    return Section((), True, (gaps,))
