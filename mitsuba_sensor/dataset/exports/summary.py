"""Figures of a dataset for its card: counts, bytes, noise of its cameras, quantiles of its frames, hashes."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...camera.camera import Camera
from ...camera.camera_file import camera_from
from ...camera.figures import figures_if_any
from ...core import InputError
from ...files import durable
from ...render.limits import SHORTEST_METERED_S
from ..index.part import Line
from ..plan.file import DatasetFile
from ..plan.planned import evenly_chosen
from ..read.reader import IMAGES, sample_of
from ..store.entry_files import MADE_AGAIN, EntryFiles
from ..store.keys import Facts, key_of
from ..store.record import FILE, RECORD, text_of
from ..store.store import Store
from .card import CameraNumbers, CardFacts
from .job import facts_of
from .sheet import sheet_rows

HOW = """import mitsuba_sensor as ms

for sample in ms.Dataset("DIR"):
    print(sample.key, sample.split, sample.values, sample.read("{array}").shape)
"""
LEVELS = ("overall_system_gain_dn_per_e", "black_level_dn", "white_level_dn")
"""Facts of a read-out."""
VISIBLE_RATIO = 0.1
"""Render variance over sensor variance from which on a frame is 5 % too noisy."""
LESS_RENDER_NOISE = (
    "In `[render]` of the dataset file `denoise = true`, a larger `spp`, or `noise_ratio = 0.1` with `max_spp` and "
    "without `spp` makes it smaller."
)
MOST_CHIPS = 10**5
"""Of a split, that are counted."""
NO_SHEET = "There is no contact sheet: neither `preview` nor `raw` is among the outputs of the dataset."


@dataclass
class _Group:
    """Samples of one camera at one gain.

    noise : by read-out, the figures of each camera that it is, by scene and varied field.
    """

    noise: dict[str, list[tuple[float | None, ...]]] = field(default_factory=dict)
    digital: list[list[float]] = field(default_factory=list)
    electrons: list[list[float]] = field(default_factory=list)


@dataclass
class _Split:
    """What a split has."""

    samples: int = 0
    frames: int = 0
    renders: int = 0
    scenes: set[str] = field(default_factory=set)
    chips: set[tuple[object, ...]] = field(default_factory=set)

    def counts(self) -> tuple[int | str, ...]:
        """Samples, scenes, renders and chips."""
        chips: int | str = len(self.chips)
        if chips == MOST_CHIPS:
            chips = f"{MOST_CHIPS} or more"
        return self.samples, len(self.scenes), self.renders, chips


@dataclass
class _Read:
    """What is known of the samples that were read so far.

    models : entry of the dataset file → camera's own name.  noise_ratios : key of a view → its median noise ratio.
    metered_s : the shortest exposure time that was metered.
    figures : key of a camera and its gain → σ_d and saturation by read-out, of the whole under an empty name.
    """

    groups: dict[tuple[str, str], _Group] = field(default_factory=dict)
    figures: dict[str, dict[str, tuple[float | None, float | None]]] = field(
        default_factory=dict
    )
    models: dict[str, str] = field(default_factory=dict)
    noise_ratios: dict[str, float] = field(default_factory=dict)
    metered_s: float = math.inf
    sizes: set[str] = field(default_factory=set)
    versions: dict[str, str | None] = field(default_factory=dict)
    bytes: int = 0


def summary(
    folder: Path,
    lines: Sequence[Line],
    file: DatasetFile,
    step: Callable[[], object] = lambda: None,
    most: int | None = None,
) -> CardFacts:
    """What the card of these samples says.

    lines : of the index.  step : called after each sample that was read.
    most : samples that are read, and then no hashes of records; all by default.
    Raises InputError for a sample that is not as it was written.
    """
    store, read, digest = Store(folder), _Read(), hashlib.sha256()
    chosen, views = evenly_chosen(lines, most or len(lines)), dict[str, EntryFiles]()
    for line in chosen:
        sample = sample_of(store, line)
        _add(read, line, facts_of(sample))
        _add_record(read, sample.files, digest)
        if line.place is None and line.view_files:  # in a shard they are a sample's
            views[line.view] = sample.view_files
        step()
    for files in views.values():
        _add_record(read, files, digest)
    hashes = {f"`{FILE}`": durable.sha256_of(folder / FILE)}
    if most is None:
        records = f"every `{RECORD}` in the order of the samples, then of the renders"
        hashes[records] = digest.hexdigest()
    notes = []
    if {"preview", "raw"}.isdisjoint(file.outputs):
        notes.append(NO_SHEET)
    bytes_of = "bytes of the dataset"
    if len(chosen) < len(lines):
        bytes_of = f"bytes of {len(chosen)} samples"
        notes.append(
            f"{len(chosen)} of the {len(lines)} samples, evenly chosen, were read for pixels, bytes, noise and values."
        )
    remarks = tuple(_bright_notes(read.metered_s))
    arrays = [name for name in file.outputs if name in IMAGES]
    splits = _counted(lines, read.models)
    return CardFacts(
        file.name,
        file.description,
        file.licence,
        {
            "samples": len(lines),
            "raw frames": sum(one.frames for one in splits.values()),
            "scenes": ", ".join(
                sorted({name for one in splits.values() for name in one.scenes})
            ),
            "renders": sum(one.renders for one in splits.values()),
            "pixels": ", ".join(sorted(read.sizes)),
            bytes_of: read.bytes,
        },
        [_numbers(*key, group) for key, group in read.groups.items()],
        hashes,
        {split: one.counts() for split, one in splits.items()},
        HOW.format(array=arrays[0]) if arrays else "",
        sheet_rows(store, lines),
        read.versions,
        _render_noise_note(read.noise_ratios),
        [*remarks, *notes],
        remarks=remarks,
    )


def _counted(lines: Iterable[Line], models: Mapping[str, str]) -> dict[str, _Split]:
    """What each split has."""
    found: dict[str, _Split] = {}
    view = ""
    for line in lines:
        split, values = found.setdefault(line.split, _Split()), line.values
        split.samples += 1
        split.frames += values.get("frames", 1)
        split.renders += line.view != view  # the samples of a render follow one another
        split.scenes.add(str(values.get("scene")))
        if len(split.chips) < MOST_CHIPS:
            camera = values.get("camera", "")
            chip = models.get(camera, camera), values.get("serial"), values.get("sensor")
            split.chips.add(chip)
        view = line.view
    return found


def _render_noise_note(noise_ratios: Mapping[str, float]) -> str:
    """How large the render noise of the views is beside the sensor's, and what helps where it shows."""
    if not noise_ratios:
        return ""
    median = float(np.median([*noise_ratios.values()]))
    views = f", and over {len(noise_ratios)} views"
    if len(noise_ratios) == 1:
        views = " of one view"
    note = (
        f"Render noise is {median:.3g} × the sensor's temporal noise (variance; median over the pixels{views}) in the "
        "exposure that a view is rendered for; `clean` holds the same render noise as `raw`."
    )
    if median > VISIBLE_RATIO:
        note = f"{note} {LESS_RENDER_NOISE}"
    return note


def _bright_notes(metered_s: float) -> Iterator[str]:
    """Where the light is so bright that a metered exposure is shorter than those of cameras."""
    if metered_s < SHORTEST_METERED_S:
        yield (
            f"A metered exposure time is {metered_s:g} s, shorter than {SHORTEST_METERED_S:g} s, because the light is "
            "so bright; multiply the emitters of the scene by the light_scale that "
            "`mitsuba-sensor render --luminance 500` writes into frame.json."
        )


def _add(read: _Read, line: Line, facts: Facts) -> None:
    """Count one sample."""
    config, image = facts["config"], facts["image"]
    key = facts["camera"], str(config["gain"] or "–")
    group = read.groups.setdefault(key, _Group())
    for readout, figures in _noise(read, facts):
        group.noise.setdefault(readout, []).append(figures)
    group.digital.append(facts["digital_quantiles_dn"])
    group.electrons.append(facts["electrons_quantiles_e"])
    read.models[str(line.values.get("camera"))] = facts["camera"]
    read.noise_ratios[line.view] = facts["light"]["noise_ratio_median"]
    if metering := facts["light"]["metering"]:
        read.metered_s = min(read.metered_s, metering["exposure_s"])
    read.sizes.add(f"{image['columns']} × {image['rows']}")
    read.versions = facts["versions"]


def _noise(read: _Read, facts: Facts) -> Iterator[tuple[str, tuple[float | None, ...]]]:
    """K, σ_d, saturation, black and white level of the camera of a sample, as its scene and the dataset set it, at its
    gain; and of each read-out that its frames are combined from."""
    config = facts["config"]
    key = key_of({"camera": config["camera"], "gain": config["gain"]})
    if key not in read.figures:
        camera = camera_from(config["camera"], "of the sample").at_gain(config["gain"])
        cameras = {"": camera, **camera.readout_cameras}
        read.figures[key] = {name: _dark_and_full_e(one) for name, one in cameras.items()}
    own = facts["image"] | {"overall_system_gain_dn_per_e": facts["system_gain_dn_per_e"]}
    levels = {"": own} | {one["name"]: one for one in facts["readouts"] or ()}
    for name, figures_e in read.figures[key].items():
        gain, black, white = (levels[name][level] for level in LEVELS)
        yield name, (gain, *figures_e, black, white)


def _dark_and_full_e(camera: Camera) -> tuple[float | None, float | None]:
    """σ_d and saturation; None of frames that are combined from several read-outs."""
    figures = figures_if_any(camera)
    if figures is None:
        return None, None
    return figures.temporal_dark_noise_e, figures.saturation_e


def _add_record(read: _Read, files: EntryFiles, digest: Any) -> None:
    """Bytes of an entry, and its record, which has the hashes of its files."""
    if (record := files.record()) is None:
        raise InputError(f"{files.place(RECORD)} is not as it was written; {MADE_AGAIN}.")
    read.bytes += sum(size for size, _ in record.files.values())
    digest.update(text_of(record))


def _numbers(name: str, gain: str, group: _Group) -> CameraNumbers:
    return CameraNumbers(
        name,
        gain,
        len(group.digital),
        {readout: _all_ends(figures) for readout, figures in group.noise.items()},
        _over(group.digital),
        _over(group.electrons),
    )


def _all_ends(figures: list[tuple[float | None, ...]]) -> list[tuple[float, float] | None]:
    """The smallest and the largest of each figure."""
    return [_ends(values) for values in zip(*figures, strict=True)]


def _ends(values: Sequence[float | None]) -> tuple[float, float] | None:
    """The smallest and the largest of those that there are."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    return min(known), max(known)


def _over(quantiles: list[list[float]]) -> list[float]:
    """Lowest of the lowest, medians, highest of the highest."""
    found = np.array(quantiles)
    return [
        float(found[:, 0].min()),
        *np.median(found[:, 1:-1], axis=0).tolist(),
        float(found[:, -1].max()),
    ]
