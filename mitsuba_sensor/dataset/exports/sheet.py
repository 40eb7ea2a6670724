"""Rows of the contact sheet of a dataset: a row for each scene and view, what varies above each picture."""

from __future__ import annotations

from collections.abc import Sequence

from ...files.png import png as png_of
from ...output.contact_sheet import Captioned, SheetRow
from ..index.part import Line
from ..plan.planned import evenly_chosen
from ..plan.values import text_of
from ..read.previews import PICTURE, preview_of_sample
from ..read.reader import IMAGES, Sample, sample_of
from ..store.entry_files import checked
from ..store.keys import Config
from ..store.store import Store
from .job import facts_of

MOST_ROWS, MOST_COLUMNS = 8, 10
MOST_LOOKED_AT = 2000  # of all samples, for their scenes, views and what varies
MOST_LINES = 3  # of the caption of a picture
OF_ROW = ("scene", "view", "time_s", "pose")
OF_EXPOSURE = ("exposure_s", "exposure_ev")


def sheet_rows(store: Store, lines: Sequence[Line]) -> list[SheetRow]:
    """Rows for samples with previews or raw frames, evenly chosen of all scenes, views and samples.

    lines : of the index.  Raises InputError for a preview that is not as it was written.
    """
    lines = evenly_chosen(lines, MOST_LOOKED_AT)
    scenes: dict[str, dict[object, list[Line]]] = {}  # scene → view → lines
    for line in lines:
        views = scenes.setdefault(str(line.values.get("scene")), {})
        views.setdefault(line.values.get("view"), []).append(line)
    varied, rows = names_that_vary(lines), []
    shown = evenly_chosen([*scenes], MOST_ROWS)
    for scene in shown:
        for view in evenly_chosen([*scenes[scene]], MOST_ROWS // len(shown)):
            if view is None:
                label = [scene]
            else:
                label = [scene, f"view {view}"]
            chosen = evenly_chosen(scenes[scene][view], MOST_COLUMNS)
            rows.append(SheetRow(label, _pictures(store, chosen, varied)))
    return [row for row in rows if row.pictures]


def _pictures(store: Store, lines: Sequence[Line], varied: Sequence[str]) -> list[Captioned]:
    """The previews of these samples, developed from the raw frame where none is stored, of those that have either."""
    pictures = []
    for line in lines:
        sample = sample_of(store, line)
        if (png := _picture(sample)) is not None:
            text = caption(line.values, varied, facts_of(sample)["image"]["exposure_s"])
            pictures.append(Captioned(png, text))
    return pictures


def _picture(sample: Sample) -> bytes | None:
    """The PNG of a preview. Raises InputError where what it is made of is not as it was written."""
    if sample.files.has(PICTURE):
        return checked(sample.files, PICTURE)
    if not sample.files.has(IMAGES["raw"]):
        return None
    checked(sample.files, IMAGES["raw"])
    return png_of(preview_of_sample(sample))


def names_that_vary(lines: Sequence[Line]) -> list[str]:
    """Names that have several values, in the order in which the samples have them."""
    first: dict[str, object] = {}
    varied: dict[str, None] = {}
    for line in lines:
        for name, value in line.values.items():
            if first.setdefault(name, value) != value:
                varied[name] = None
    return [name for name in first if name in varied]


def caption(values: Config, varied: Sequence[str], exposure_s: float) -> list[str]:
    """The exposure, and what else varies and is not said left of the row: one line for each.

    exposure_s : as it was exposed, metering and stops included.
    """
    lines = [_exposure(values, exposure_s)]
    for name in varied:
        if name in values and name not in (*OF_ROW, *OF_EXPOSURE):
            if name == "camera":
                short = ""
            else:
                short = f"{name.rpartition('.')[2]} "
            lines.append(f"{short}{_text(values[name])}")
    return lines[:MOST_LINES]


def _exposure(values: Config, exposure_s: float) -> str:
    """``0.01 s`` or ``0.0025 s, -2 EV``: the time that was exposed, and the stops that are in it."""
    stops = values.get("exposure_ev")
    if not stops:
        return f"{exposure_s:.3g} s"
    return f"{exposure_s:.3g} s, {stops:+g} EV"


def _text(value: object) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return " ".join(map(_text, value))
    if isinstance(value, float):
        return f"{value:g}"
    return text_of(value)
