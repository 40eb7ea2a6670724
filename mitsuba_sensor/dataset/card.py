"""The card of a dataset, README.md, with its contact sheet and samples.csv: counts, noise, values, how to read it."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.camera_file import camera_from
from ..camera.figures import figures_if_any
from ..core.html import render_template
from ..files import durable
from ..files.parquet import POSE
from ..files.png import png, write_png
from ..files.texts import write_page
from ..output.contact_sheet import SIDE, Captioned, SheetRow, contact_sheet
from .file import DatasetFile
from .keys import Config, Facts, canonical
from .read import IMAGES, Sample
from .store import Row, Store
from .sweep import evenly_chosen
from .table import EXPOSED, Table
from .values import PICTURE

CARD, SHEET, TABLE = "README.md", "contact_sheet.png", "samples.csv"
TEMPLATE = Path(__file__).with_name("card.md.j2")
SAMPLES_READ_MAX = 200
"""Samples that are read for a card, however many there are."""
SHEET_LINES_MAX, SHEET_PICTURES_MAX, SHEET_GROUPS_MIN, CAPTION_LINES_MAX = 2000, 64, 8, 3
GROUPS_WEIGHT = 0.7
"""A sheet may be twice as long to keep groups together: log 2."""
CAPTION_PX = (90, 40)
"""Usual width and height of a caption of a contact sheet."""
VISIBLE_RATIO = 0.1
"""Render variance over sensor variance above which a frame is more than 5 % too noisy."""
ROW_NAMES = ("scene", "view", "time_s", "pose", "exposure_s", "exposure_ev")
"""Values that a contact sheet does not show below the exposure of a picture."""
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
HOW = """import mitsuba_sensor as ms

for sample in ms.Dataset("DIR"):
    print(sample.key, sample.split, sample.values, sample.read("{array}").shape)
"""
ROWS_MAX = 100_000
"""Rows of the largest samples.csv."""
COLUMNS = ("key", "split", "shard", "scene", "view", "camera", "serial", *EXPOSED)
"""First columns of samples.csv; all other varied fields follow."""
AGAIN = (
    f"`index.parquet` lists all samples, and so does `{TABLE}`, of up to {ROWS_MAX} samples. `mitsuba-sensor dataset "
    "run` writes them, this page and the contact sheet again when the dataset changes: keep your own notes in another "
    "file."
)


def write_overview(
    store: Store, file: DatasetFile, table: Table, planned: int, failed: int
) -> str:
    """Write card, contact sheet and samples.csv if the samples changed, and return a sentence on the render noise.
    Raises InputError.

    planned : number of samples in all.  failed : number of tasks that could not be made.
    """
    mark = f"<!-- {table.digest} of {planned}, {failed} failed -->"
    names = [CARD] + [TABLE] * (len(table) <= ROWS_MAX)
    card = durable.read_small(store.folder / CARD, 2**24).decode("utf-8", "replace")
    names += [SHEET] * (f"({SHEET})" in card)
    if mark in card and all((store.folder / name).is_file() for name in names):
        return ""
    notes = [AGAIN, mark]
    if planned > len(table):
        why = f", and {failed} tasks have failed" if failed else ""
        notes.insert(0, f"{planned - len(table)} of {planned} samples are missing{why}.")
    if len(table) <= ROWS_MAX:
        write_page(store.folder / TABLE, samples_csv(table))
    else:
        durable.remove_file(store.folder / TABLE)
    return write_card(store.folder, store, table, file, file.licence, "", notes)


def samples_csv(table: Table) -> str:
    """Return a row for each sample, for spreadsheets; the vectors of a pose have separate columns."""
    names, text = dict.fromkeys((*COLUMNS, *table.names)), io.StringIO()
    if names.pop("pose", "") is None:
        names |= dict.fromkeys(f"pose.{name}" for name in POSE)
    writer = csv.DictWriter(text, [*names], restval="", lineterminator="\n")
    writer.writeheader()
    for line in table:
        cells: Facts = {"key": line.key, "split": line.split, "shard": line.shard}
        cells |= line.exposed | line.values
        cells |= {f"pose.{name}": x for name, x in cells.pop("pose", {}).items()}
        lists = {n: " ".join(map(str, x)) for n, x in cells.items() if isinstance(x, list)}
        writer.writerow(cells | lists)
    return text.getvalue()


def write_card(
    folder: Path,
    store: Store,
    lines: Sequence[Row],
    file: DatasetFile,
    licence: str,
    how: str = "",
    notes: Iterable[str] = (),
) -> str:
    """Write README.md, and contact_sheet.png if there are pictures, and return a sentence on the render noise. Raises
    InputError.

    lines : of the samples.  how : code that reads them; by default the code for the dataset itself.  notes : sentences.
    """
    chosen, all_notes = evenly_chosen(lines, SAMPLES_READ_MAX), [*notes]
    facts = [Sample(store, line).facts for line in chosen]
    if len(chosen) < len(lines):
        all_notes.append(
            f"{len(chosen)} of the {len(lines)} samples, evenly chosen, were read for sizes, noise and values."
        )
    rows = sheet_rows(store, lines)
    if rows:
        write_png(folder / SHEET, contact_sheet(rows))
    else:
        all_notes.append(
            "There is no contact sheet: neither `preview` nor `raw` is among the outputs of the dataset."
        )
    array = next((name for name in file.outputs if name in IMAGES), "")
    is_identifier = re.fullmatch(r"[A-Za-z0-9.-]+", licence)
    noise, render_noise = _noise_rows(facts), _render_noise(facts, file.render)
    versions = facts[0]["versions"].items() if facts else ()
    text = render_template(
        TEMPLATE,
        file=file,
        licence=licence,
        licence_id=licence.lower() if is_identifier else "",
        sheet=SHEET if rows else "",
        figures=_figures(lines, facts),
        render_noise=render_noise,
        notes=all_notes,
        splits=_split_rows(lines),
        noise=noise,
        noise_varies=any(" to " in cell for row in noise for cell in row[3:]),
        values=_value_rows(facts),
        how=how or (HOW.format(array=array) if array else ""),
        versions=", ".join(f"{name} {version}" for name, version in versions if version),
        table=_table,
    )
    write_page(folder / CARD, re.sub(r"\n{3,}", "\n\n", text).strip() + "\n")
    return render_noise


def _figures(lines: Sequence[Row], facts: Sequence[Facts]) -> list[tuple[str, str | int]]:
    """Return counts of the whole dataset."""
    sizes = {f"{x['image']['columns']} × {x['image']['rows']}" for x in facts}
    light_bytes = {line.shard: line.light_bytes for line in lines}
    return [
        ("samples", len(lines)),
        ("raw frames", sum(line.values.get("frames", 1) for line in lines)),
        ("scenes", ", ".join(sorted({str(line.values.get("scene")) for line in lines}))),
        ("renders", len(light_bytes)),
        ("pixels", ", ".join(sorted(sizes))),
        ("bytes", sum(line.bytes for line in lines) + sum(light_bytes.values())),
    ]


def _split_rows(lines: Iterable[Row]) -> list[tuple[str | int, ...]]:
    """Return split and numbers of samples, scenes, renders and sensor units."""
    by_split: dict[str, list[tuple[object, ...]]] = {}
    for line in lines:
        unit = (*map(line.values.get, ("camera", "serial", "sensor")),)
        row = line.key, line.values.get("scene"), line.shard, unit
        by_split.setdefault(line.split, []).append(row)
    return [
        (split or "–", *(len({*column}) for column in zip(*rows, strict=True)))
        for split, rows in by_split.items()
    ]


def _noise_rows(facts: Iterable[Facts]) -> list[tuple[Any, ...]]:
    """Return camera, gain, samples, and ranges of K, σ_d, saturation, black and white level; also of each readout."""
    rows: dict[tuple[str, str], list[list[float | None]]] = {}
    figures: dict[str, dict[str, list[float | None]]] = {}
    names = ("overall_system_gain_dn_per_e", "black_level_dn", "white_level_dn")
    for sample in facts:
        config = sample["config"]
        key = canonical({"camera": config["camera"], "gain": config["gain"]})
        figures[key] = figures.get(key) or _dark_and_full_e(config)
        whole = {**sample["image"], names[0]: sample["system_gain_dn_per_e"]}
        levels = {"": whole} | {x["name"]: x for x in sample["readouts"] or ()}
        for readout, figures_e in figures[key].items():
            camera = sample["camera"] + (f", readout {readout}" if readout else "")
            gain, *black_and_white = map(levels.get(readout, {}).get, names)
            row = [gain, *figures_e, *black_and_white]
            rows.setdefault((camera, _gain_of(sample)), []).append(row)
    return [
        (*key, len(group), *map(_range, zip(*group, strict=True)))
        for key, group in rows.items()
    ]


def _dark_and_full_e(config: Config) -> dict[str, list[float | None]]:
    """Return readout → σ_d and saturation [e-]; the whole frame has an empty name, combined frames have None."""
    camera = camera_from(config["camera"], "of the sample").at_gain(config["gain"])
    names = "temporal_dark_noise_e", "saturation_e"
    return {
        readout: [getattr(figures_if_any(readout_camera), name, None) for name in names]
        for readout, readout_camera in {"": camera, **camera.readout_cameras}.items()
    }


def _value_rows(facts: Iterable[Facts]) -> list[tuple[Any, ...]]:
    """Return minimum, medians and maximum of the quantiles of each camera at each gain."""
    names = {
        "raw frame [DN]": "digital_quantiles_dn",
        "photoelectrons [e-]": "electrons_quantiles_e",
    }
    groups: dict[tuple[str, str, str], list[list[float]]] = {}
    for sample in facts:
        for quantity, name in names.items():
            key = sample["camera"], _gain_of(sample), quantity
            groups.setdefault(key, []).append(sample[name])
    return [
        (*key, np.min(group), *np.median(group, axis=0)[1:-1], np.max(group))
        for key, group in groups.items()
    ]


def _gain_of(sample: Facts) -> str:
    return str(sample["config"]["gain"] or "–")


def _render_noise(facts: Iterable[Facts], render: Config) -> str:
    """Return a sentence on the render noise of the views relative to the sensor's, and a remedy if it is visible."""
    ratios = {x["view"]["key"]: x["light"]["noise_ratio_median"] for x in facts}
    medians = [ratio for ratio in ratios.values() if ratio is not None]
    if not medians:
        return ""
    median = float(np.median(medians))
    views = " of one view" if len(medians) == 1 else f", and over {len(medians)} views"
    note = (
        f"Render noise is {median:.3g} × the sensor's temporal noise (variance; median over the pixels{views}) in the "
        "exposure that a view is rendered for; `clean` holds the same render noise as `raw`."
    )
    if median <= VISIBLE_RATIO:
        return note
    return f"{note} {less_render_noise(render)}, and make the dataset in a new folder."


def less_render_noise(render: Config) -> str:
    """Return how to reduce render noise with this [render] table, without a full stop."""
    remedies = [] if render.get("denoise") else ["`denoise = true`"]
    goal = render.get("noise_ratio")
    if goal is None:
        remedies.append(f"a larger `{'max_spp' if 'max_spp' in render else 'spp'}`")
        without = " and without `spp`" if "spp" in render else ""
        remedies.append(f"`noise_ratio = {VISIBLE_RATIO}` with `max_spp`{without}")
    else:
        remedies += ["a larger `max_spp`"] + ["a smaller `noise_ratio`"] * (
            goal > VISIBLE_RATIO
        )
    *others, last = remedies
    several = f"{', '.join(others)} or {last}" if others else last
    return f"To reduce it, set {several} in `[render]` of the dataset file"


def sheet_rows(store: Store, lines: Sequence[Row]) -> list[SheetRow]:
    """Return the rows of a nearly square contact sheet; none without previews and raw frames.

    A caption begins with the sample's number in the dataset.
    """
    looked_at = evenly_chosen([*enumerate(lines)], SHEET_LINES_MAX)
    varied = _varied([line.values for _, line in looked_at])
    groups: dict[tuple[object, object], list[tuple[int, Row]]] = {}
    for number, line in looked_at:
        scene_and_view = line.values.get("scene"), line.values.get("view")
        groups.setdefault(scene_and_view, []).append((number, line))
    longest = max(map(len, groups.values()), default=1)
    chosen = evenly_chosen([*groups], max(SHEET_PICTURES_MAX // longest, SHEET_GROUPS_MIN))
    pictures, sizes, aspect = list[Captioned](), list[int](), 1.0
    for scene, view in chosen:
        label = [f"{scene}" if view is None else f"{scene}, view {view}"] * (len(chosen) > 1)
        shown = evenly_chosen(groups[scene, view], SHEET_PICTURES_MAX // len(chosen))
        for number, line in shown:
            sample = Sample(store, line)
            if not sample.has(PICTURE) and not sample.has(IMAGES["raw"]):
                return []
            preview = sample.read("preview")
            first_line, *others = *label, *caption(line, varied)
            pictures.append(Captioned(png(preview), [f"{number}: {first_line}", *others]))
            shrink = max(-(-max(preview.shape) // SIDE), 1)
            rows_px, columns_px = (size / shrink for size in preview.shape[:2])
            aspect = max(columns_px, CAPTION_PX[0]) / (rows_px + CAPTION_PX[1])
        sizes.append(len(shown))
    columns = columns_of(sizes, aspect)
    firsts = range(0, len(pictures), columns)
    return [SheetRow([], pictures[first : first + columns]) for first in firsts]


def columns_of(sizes: Sequence[int], aspect: float) -> int:
    """Return the columns of a nearly square page, if possible with whole groups or parts of one group in each row.

    sizes : pictures of each group.  aspect : width over height of a picture with its caption.
    """
    total, size = sum(sizes), max(sizes, default=1)

    def badness(columns: int) -> float:
        elongation = abs(math.log(columns * aspect / -(-total // columns)))
        fits = len(sizes) == 1 or size % columns == 0 or columns % size == 0
        return elongation + GROUPS_WEIGHT * (not fits)

    return min(range(1, total + 1), key=badness, default=1)


def _varied(values: Sequence[Config]) -> list[str]:
    """Return the names with several values, in the order of the samples."""
    first = {name: x for row in reversed(values) for name, x in row.items()}
    return [name for name, x in first.items() if any(row.get(name, x) != x for row in values)]


def caption(line: Row, varied: Sequence[str]) -> list[str]:
    """Return the actual exposure and the other varied values, one line each."""
    stops, time_s = line.values.get("exposure_ev"), line.exposed["exposed_s"]
    lines = [f"{time_text(time_s)}, {stops:+g} EV" if stops else time_text(time_s)]
    for name in varied:
        if name in line.values and name not in ROW_NAMES:
            values = line.values[name]
            values = values if isinstance(values, list | tuple) else [values]
            text = " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in values)
            lines.append(text if name == "camera" else f"{name.rpartition('.')[2]} {text}")
    return lines[:CAPTION_LINES_MAX]


def time_text(seconds: float) -> str:
    """Return a time with its unit: 22 µs, 0 s, 1.5 s."""
    unit = next((unit for unit, size in TIME_UNITS.items() if seconds >= size), "ns")
    unit = unit if seconds else "s"
    return f"{seconds / TIME_UNITS[unit]:.3g} {unit}"


def _range(values: Iterable[float | None]) -> str:
    """Return one value, or the smallest and the largest."""
    numbers = [value for value in values if value is not None]
    cells = (
        [_cell(value) for value in (min(numbers), max(numbers))] if numbers else [_cell(None)]
    )
    return " to ".join(dict.fromkeys(cells))


def _table(heads: Sequence[str], rows: Sequence[Sequence[str | float | None]]) -> str:
    """Return a Markdown table; an empty text without rows."""
    lines = [heads, ["---"] * len(heads), *([_cell(value) for value in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) if rows else ""


def _cell(value: str | float | None) -> str:
    """Return a number with five digits and grouped thousands; a text without what would end the cell."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return " ".join(value.split()).replace("|", "\\|")
    if isinstance(value, int) or 1e4 <= abs(value) < 1e9:
        return f"{value:,.0f}".replace(",", " ")
    if 1e3 <= abs(value) < 1e4:
        return f"{value:,.1f}".replace(",", " ").removesuffix(".0")
    return f"{value:.5g}"
