"""A frame in a dozen lines: what `render` and `expose` print unless --verbose asks for the table of all stages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from rich.console import Group, RenderableType
from rich.text import Text

from ..core import by_weight
from .tables import number
from .terminal import (
    Report,
    brightness_of,
    ended_by,
    fact,
    head_of,
    left_out_of,
    pictures_of,
    pixels_of,
)

MOST_NOTES = 4
"""That are printed; all are in frame.json."""
NUMBER = re.compile(r"\d[\d.,]*")
GROUPS = re.compile(r"^(?:[A-Za-z][\w-]*, )*[A-Za-z][\w-]*: ")
"""Names of light groups in front of a note."""
WHOLE = "signal behind each stage, more facts and all notes: --verbose, or frame.json"


def short_summary(report: Report, folder: str) -> RenderableType:
    """Camera and exposure, signal and noise, the render's noise, and the notes that matter most."""
    notes, left_out = notes_shown(report["notes"])
    lines = [Text.assemble(("note: ", "bold yellow"), note) for note in notes]
    if left_out:
        lines.append(Text(f"{left_out} more notes: --verbose, or frame.json"))
    return Group(head_of(report, folder), *_facts(report), *lines, Text(WHOLE, style="dim"))


def _facts(report: Report) -> Iterator[Text]:
    last = report["stages"][-1]
    mean, sigma, expected = (
        number(last[key]) for key in ("mean_frame", "sigma_frame", "sigma_expected")
    )
    unit = last["unit"]
    yield fact(
        "signal",
        f"{mean} {unit} on average, with a noise of σ = {sigma} {unit} ({expected} by theory)",
    )
    noise, render = report["render_noise"], report["render"]
    said = "none, because there is no light"
    if report["photons"]["max"]:
        denoised = ", denoised" if render["denoised"] else ""
        ended = ended_by(render["noise_ratio_asked"], render["ended_by"])
        said = (
            f"its variance is {number(noise['over_sensor_median'])} × the sensor's in the median pixel; "
            f"{render['samples_per_pixel']} samples per pixel{denoised}{ended}"
        )
    yield fact("render noise", said)
    yield from brightness_of(report)
    yield pixels_of(report)
    yield from pictures_of(report)
    yield from left_out_of(report)


def notes_shown(notes: Iterable[str]) -> tuple[list[str], int]:
    """The notes that are printed, and how many are not: those that change most come first, and notes that differ in
    their numbers or light groups alone are one."""
    alike: dict[str, list[str]] = {}
    for note in by_weight(notes):
        alike.setdefault(NUMBER.sub("", GROUPS.sub("", note)), []).append(note)
    shown = [
        f"{first} ({len(others)} more notes are alike)" if others else first
        for first, *others in alike.values()
    ]
    return shown[:MOST_NOTES], max(len(shown) - MOST_NOTES, 0)
