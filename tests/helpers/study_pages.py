"""What is wrong with the page of a study, as sentences: series, colours, units; its measurements through files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mitsuba_sensor.output.measurements import Measurements
from mitsuba_sensor.pages.page import Bars, Plot, Study, Table

MOST_SERIES = 8


def through_files(
    known: dict[str, Any], records: tuple[type, ...], folder: Path
) -> dict[str, Any]:
    """Measurements as the next process reads them."""
    written = Measurements(folder, "study", records=records)
    for key, value in known.items():
        written[key] = value
    read = Measurements(folder, "study", records=records)
    assert set(read) == set(known)
    return dict(read)


def faults(study: Study) -> list[str]:
    """None in a page that is as it must be."""
    return [*_of_series(study), *_of_units(study)]


def _of_series(study: Study) -> Iterator[str]:
    known: dict[str, int | None] = {}
    for part in study.parts:
        if isinstance(part, Plot | Bars):
            lines = (
                {line.label: line.colour for line in part.lines}
                if isinstance(part, Plot)
                else part.colours
            )
            if len(lines) > MOST_SERIES:
                yield f"{part.title}: {len(lines)} series"
            if len(set(lines.values())) < len(lines):
                yield f"{part.title}: two series of one colour"
            for name, colour in lines.items():
                if known.setdefault(name, colour) != colour:
                    yield f"{part.title}: {name} has another colour than before"


def _of_units(study: Study) -> Iterator[str]:
    for part in study.parts:
        if isinstance(part, Table) and "unit" not in part.columns:
            for heading, *cells in zip(part.columns, *part.rows, strict=True):
                if any(isinstance(cell, float) for cell in cells) and not heading.endswith("]"):
                    yield f"{part.title}: {heading} has no unit"
        axes = {Plot: ("x_label", "y_label"), Bars: ("x_label",)}.get(type(part), ())
        yield from (
            f"{part.title}: {name} has no unit"
            for name in axes
            if not getattr(part, name).endswith("]")
        )
