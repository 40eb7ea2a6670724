"""The card of a dataset, README.md, and its contact sheet: counts, noise of the cameras, values, how to read it."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.figures import figures_if_any
from ..core.html import render_template
from ..files import durable
from ..files.parquet import POSE
from ..files.png import png, write_png
from ..files.texts import write_page
from ..output.contact_sheet import Captioned, SheetRow, contact_sheet
from .file import DatasetFile
from .keys import Config, Facts, canonical
from .read import IMAGES, Sample
from .store import Row, Store
from .sweep import evenly_chosen
from .table import EXPOSED, Table
from .values import PICTURE

CARD, SHEET = "README.md", "contact_sheet.png"
TEMPLATE = Path(__file__).with_name("card.md.j2")
SAMPLES_READ_MAX = 200
"""Samples that are read for a card, however many there are."""
SHEET_LINES_MAX, SHEET_ROWS_MAX, SHEET_COLUMNS_MAX, CAPTION_LINES_MAX = 2000, 8, 10, 3
VISIBLE_RATIO = 0.1
"""Render variance over sensor variance from which on a frame is 5 % too noisy."""
LESS_RENDER_NOISE = (
    "To reduce it, set `denoise = true`, a larger `spp`, or `noise_ratio = 0.1` with `max_spp` and without `spp` in "
    "`[render]` of the dataset file."
)
ROW_NAMES = ("scene", "view", "time_s", "pose", "exposure_s", "exposure_ev")
"""Values that stand elsewhere in a contact sheet than below the exposure of a picture."""
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
HOW = """import mitsuba_sensor as ms

for sample in ms.Dataset("DIR"):
    print(sample.key, sample.split, sample.values, sample.read("{array}").shape)
"""


TABLE = "samples.csv"
ROWS_MAX = 100_000
"""Rows of which spreadsheets are made."""
COLUMNS = ("key", "split", "shard", "scene", "view", "camera", "serial", *EXPOSED)
"""First columns of samples.csv; then all others that vary."""
AGAIN = (
    f"`index.parquet` lists all samples, and so does `{TABLE}`, of up to {ROWS_MAX} samples. `mitsuba-sensor dataset "
    "run` writes them, this page and the contact sheet again when the dataset changes: keep notes of your own in "
    "another file."
)


def write_overview(
    store: Store, file: DatasetFile, table: Table, planned: int, failed: int
) -> str:
    """Write all three where the card is of other samples, and return how large the render noise is. Raises InputError.

    planned : samples in all.  failed : tasks that could not be made.
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
        notes.insert(0, f"{planned - len(table)} of {planned} samples are not there{why}.")
    if len(table) <= ROWS_MAX:
        write_page(store.folder / TABLE, samples_csv(table))
    else:
        durable.remove_file(store.folder / TABLE)
    return write_card(store.folder, store, table, file, file.licence, "", notes)


def samples_csv(table: Table) -> str:
    """A row for each sample, for spreadsheets; the parts of a pose have columns of their own."""
    names, text = dict.fromkeys((*COLUMNS, *table.names)), io.StringIO()
    if "pose" in names:
        names |= dict.fromkeys(f"pose.{name}" for name in POSE)
        del names["pose"]
    writer = csv.DictWriter(text, [*names], restval="", lineterminator="\n")
    writer.writeheader()
    for line in table:
        cells = {"key": line.key, "split": line.split, "shard": line.shard, **line.exposed}
        pose = line.values.get("pose", {}).items()
        cells |= line.values | {f"pose.{name}": vector for name, vector in pose}
        cells.pop("pose", None)
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
    """Write README.md, and contact_sheet.png where there are pictures, and return how large the render noise is. Raises
    InputError.

    lines : of the samples.  how : code that reads them; by default that for the dataset itself.  notes : sentences.
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
    noise, render_noise = _noise_rows(facts), _render_noise(facts)
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
        noise_varies=any(" to " in _cell(cell) for row in noise for cell in row[3:]),
        values=_value_rows(facts),
        how=how or (HOW.format(array=array) if array else ""),
        versions=", ".join(f"{name} {version}" for name, version in versions if version),
        table=_table,
    )
    write_page(folder / CARD, re.sub(r"\n{3,}", "\n\n", text).strip() + "\n")
    return render_noise


def _figures(lines: Sequence[Row], facts: Sequence[Facts]) -> list[tuple[str, str | int]]:
    """Counts of the whole dataset."""
    sizes = {f"{one['image']['columns']} × {one['image']['rows']}" for one in facts}
    bytes_of_lights = {line.shard: line.light_bytes for line in lines}
    return [
        ("samples", len(lines)),
        ("raw frames", sum(line.values.get("frames", 1) for line in lines)),
        ("scenes", ", ".join(sorted({str(line.values.get("scene")) for line in lines}))),
        ("renders", len(bytes_of_lights)),
        ("pixels", ", ".join(sorted(sizes))),
        ("bytes", sum(line.bytes for line in lines) + sum(bytes_of_lights.values())),
    ]


def _split_rows(lines: Iterable[Row]) -> list[tuple[str | int, ...]]:
    """Split, samples, scenes, renders and sensor units."""
    found: dict[str, tuple[set[object], ...]] = {}
    for line in lines:
        sets = found.setdefault(line.split, (set(), set(), set(), set()))
        unit = (*map(line.values.get, ("camera", "serial", "sensor")),)
        things = line.key, line.values.get("scene"), line.shard, unit
        for known, thing in zip(sets, things, strict=True):
            known.add(thing)
    return [(split or "–", *map(len, sets)) for split, sets in found.items()]


def _noise_rows(facts: Iterable[Facts]) -> list[tuple[Any, ...]]:
    """Camera, gain, samples, and the ranges of K, σ_d, saturation, black and white level; a row of each readout too."""
    rows: dict[tuple[str, str], list[tuple[float | None, ...]]] = {}
    known: dict[str, Mapping[str, tuple[float | None, float | None]]] = {}
    for one in facts:
        config, image = one["config"], one["image"]
        key = canonical({"camera": config["camera"], "gain": config["gain"]})
        if key not in known:
            known[key] = _dark_and_full_e(config)
        own = {**image, "overall_system_gain_dn_per_e": one["system_gain_dn_per_e"]}
        levels = {"": own} | {readout["name"]: readout for readout in one["readouts"] or ()}
        for readout, figures_e in known[key].items():
            name = f"{one['camera']}, readout {readout}" if readout else one["camera"]
            level = levels.get(readout, {})
            gain, black, white = (
                level.get(x)
                for x in ("overall_system_gain_dn_per_e", "black_level_dn", "white_level_dn")
            )
            row = (gain, *figures_e, black, white)
            rows.setdefault((name, str(config["gain"] or "–")), []).append(row)
    return [
        (*key, len(found), *map(_range, zip(*found, strict=True)))
        for key, found in rows.items()
    ]


def _dark_and_full_e(config: Config) -> dict[str, tuple[float | None, float | None]]:
    """Readout → σ_d and saturation, of the whole frame under an empty name; None of combined frames."""
    from ..camera.camera_file import camera_from

    camera = camera_from(config["camera"], "of the sample").at_gain(config["gain"])
    found: dict[str, tuple[float | None, float | None]] = {}
    for name, one in {"": camera, **camera.readout_cameras}.items():
        figures = figures_if_any(one)
        found[name] = (None, None)
        if figures is not None:
            found[name] = figures.temporal_dark_noise_e, figures.saturation_e
    return found


def _value_rows(facts: Iterable[Facts]) -> list[tuple[Any, ...]]:
    """Lowest of the lowest, medians, highest of the highest of the quantiles of each camera at each gain."""
    groups: dict[tuple[str, str, str], list[list[float]]] = {}
    for one in facts:
        key = one["camera"], str(one["config"]["gain"] or "–")
        groups.setdefault((*key, "raw frame [DN]"), []).append(one["digital_quantiles_dn"])
        groups.setdefault((*key, "photoelectrons [e-]"), []).append(
            one["electrons_quantiles_e"]
        )
    rows = []
    for names, group in groups.items():
        quantiles = np.array(group)
        middle = np.median(quantiles[:, 1:-1], axis=0).tolist()
        rows.append((*names, float(quantiles.min()), *middle, float(quantiles.max())))
    return rows


def _render_noise(facts: Iterable[Facts]) -> str:
    """How large the render noise of the views is beside the sensor's, and what helps where it shows."""
    ratios = {one["view"]["key"]: one["light"]["noise_ratio_median"] for one in facts}
    known = [ratio for ratio in ratios.values() if ratio is not None]
    if not known:
        return ""
    median = float(np.median(known))
    views = " of one view" if len(known) == 1 else f", and over {len(known)} views"
    note = (
        f"Render noise is {median:.3g} × the sensor's temporal noise (variance; median over the pixels{views}) in the "
        "exposure that a view is rendered for; `clean` holds the same render noise as `raw`."
    )
    return f"{note} {LESS_RENDER_NOISE}" if median > VISIBLE_RATIO else note


def sheet_rows(store: Store, lines: Sequence[Row]) -> list[SheetRow]:
    """Rows of a contact sheet, one for each scene and view, evenly chosen; none without previews and raw frames."""
    looked_at = evenly_chosen(lines, SHEET_LINES_MAX)
    scenes: dict[str, dict[object, list[Row]]] = {}
    for line in looked_at:
        views = scenes.setdefault(str(line.values.get("scene")), {})
        views.setdefault(line.values.get("view"), []).append(line)
    varied, rows = _varied([line.values for line in looked_at]), list[SheetRow]()
    shown = evenly_chosen([*scenes], SHEET_ROWS_MAX)
    for scene in shown:
        for view in evenly_chosen([*scenes[scene]], SHEET_ROWS_MAX // len(shown)):
            pictures = []
            for line in evenly_chosen(scenes[scene][view], SHEET_COLUMNS_MAX):
                sample = Sample(store, line)
                if sample.has(PICTURE) or sample.has(IMAGES["raw"]):
                    picture = png(sample.read("preview"))
                    pictures.append(Captioned(picture, caption(line, varied)))
            if pictures:
                rows.append(
                    SheetRow([scene] if view is None else [scene, f"view {view}"], pictures)
                )
    return rows


def _varied(values: Sequence[Config]) -> list[str]:
    """Names that have several values, in the order in which the samples have them."""
    first = {name: x for one in reversed(values) for name, x in one.items()}
    return [name for name, x in first.items() if any(one.get(name, x) != x for one in values)]


def caption(line: Row, varied: Sequence[str]) -> list[str]:
    """The exposure as it was, metering and stops included, and what else varies: one line for each."""
    stops, time_s = line.values.get("exposure_ev"), line.exposed["exposed_s"]
    found = [f"{time_text(time_s)}, {stops:+g} EV" if stops else time_text(time_s)]
    for name in varied:
        if name in line.values and name not in ROW_NAMES:
            values = line.values[name]
            values = values if isinstance(values, list | tuple) else [values]
            text = " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in values)
            found.append(text if name == "camera" else f"{name.rpartition('.')[2]} {text}")
    return found[:CAPTION_LINES_MAX]


def time_text(seconds: float) -> str:
    """A time with its unit: 22 µs, 0 s, 1.5 s."""
    unit = next((unit for unit, size in TIME_UNITS.items() if seconds >= size), "ns")
    if not seconds:
        unit = "s"
    return f"{seconds / TIME_UNITS[unit]:.3g} {unit}"


def _range(values: Iterable[float | None]) -> str | float | None:
    """One value, or the smallest and the largest."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    low, high = _cell(min(known)), _cell(max(known))
    return known[0] if low == high else f"{low} to {high}"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str | float | None]]) -> str:
    """A Markdown table; none without rows."""
    lines = [heads, ["---"] * len(heads), *([_cell(value) for value in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) if rows else ""


def _cell(value: str | float | None) -> str:
    """Numbers to five digits or whole, thousands apart; text without what would end the cell."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return " ".join(value.split()).replace("|", "\\|")
    if isinstance(value, int) or 1e4 <= abs(value) < 1e9:
        return f"{value:,.0f}".replace(",", " ")
    if 1e3 <= abs(value) < 1e4:
        return f"{value:,.1f}".replace(",", " ").removesuffix(".0")
    return f"{value:.5g}"
