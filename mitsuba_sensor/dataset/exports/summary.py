"""Figures of a dataset for its card: counts, bytes, noise of its cameras, quantiles of its frames, hashes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...camera.camera_file import camera_from
from ...camera.figures import figures_if_any
from ...core import InputError
from ...files import durable
from ..file import DatasetFile
from ..keys import Facts
from ..reader import Dataset, Sample, read_index
from ..record import FILE, RECORD, Kind, Record, text_of
from ..store import Store
from .card import CameraNumbers, CardFacts
from .job import PICTURE, checked, facts_of

MOST_ROWS, MOST_COLUMNS = 8, 10  # of the contact sheet: scenes, and samples of each


Thing = TypeVar("Thing")


@dataclass
class _Group:
    """Samples of one camera at one gain."""

    noise: tuple[float | None, ...]
    digital: list[list[float]] = field(default_factory=list)
    electrons: list[list[float]] = field(default_factory=list)


@dataclass
class _Counts:
    """Of the samples so far."""

    groups: dict[tuple[str, str], _Group] = field(default_factory=dict)
    splits: dict[str, tuple[list[str], set[str], set[tuple[str, int]]]] = field(
        default_factory=dict
    )
    views: dict[str, None] = field(default_factory=dict)
    bytes: int = 0
    frames: int = 0
    sizes: set[str] = field(default_factory=set)
    versions: dict[str, str | None] = field(default_factory=dict)


def summary(
    dataset: Dataset, samples: Sequence[Sample], file: DatasetFile, step: Callable[[], object]
) -> CardFacts:
    """What the card of these samples says.

    step : called after each sample.  Raises InputError for a sample that is not as it was written.
    """
    store, counts, digest = Store(dataset.folder), _Counts(), hashlib.sha256()
    for sample in samples:
        _add(counts, sample, facts_of(sample))
        _add_record(counts, store, ("samples", sample.key), digest)
        step()
    with_files = {
        line["view"] for line in read_index(dataset.folder).lines if line["view_files"]
    }
    for key in (one for one in counts.views if one in with_files):
        _add_record(counts, store, ("views", key), digest)
    return CardFacts(
        file.name,
        file.description,
        file.licence,
        {
            "samples": len(samples),
            "raw frames": counts.frames,
            "scenes": ", ".join(
                sorted(set[str]().union(*(scenes for _, scenes, _ in counts.splits.values())))
            ),
            "renders": len(counts.views),
            "pixels": ", ".join(sorted(counts.sizes)),
            "bytes of the dataset": counts.bytes,
        },
        [_numbers(*key, group) for key, group in counts.groups.items()],
        {
            f"`{FILE}`": durable.sha256_of(dataset.folder / FILE),
            f"every `{RECORD}` in the order of the samples, then of the renders": digest.hexdigest(),
        },
        {
            split: (len(keys), len(scenes), len(chips))
            for split, (keys, scenes, chips) in counts.splits.items()
        },
        "",
        _pictures(samples),
        counts.versions,
    )


def _add(counts: _Counts, sample: Sample, facts: Facts) -> None:
    """Count one sample."""
    config, image = facts["config"], facts["image"]
    key = facts["camera"], str(config["gain"] or "–")
    if key not in counts.groups:
        counts.groups[key] = _Group(_noise(facts))
    counts.groups[key].digital.append(facts["digital_quantiles_dn"])
    counts.groups[key].electrons.append(facts["electrons_quantiles_e"])
    keys, scenes, chips = counts.splits.setdefault(sample.split, ([], set(), set()))
    keys.append(sample.key)
    scenes.add(facts["view"]["scene"])
    chips.add((facts["camera"], config["serial"]))
    counts.views[sample.view_folder.name] = None
    counts.frames += image["frames"]
    counts.sizes.add(f"{image['columns']} × {image['rows']}")
    counts.versions = facts["versions"]


def _noise(facts: Facts) -> tuple[float | None, ...]:
    """K, σ_d, saturation, black and white level of the camera of a sample, at its gain."""
    config, image = facts["config"], facts["image"]
    figures = figures_if_any(
        camera_from(config["camera"], "of the sample").at_gain(config["gain"])
    )
    emva = (
        (None, None)
        if figures is None
        else (figures.temporal_dark_noise_e, figures.saturation_e)
    )
    return (
        facts["system_gain_dn_per_e"],
        *emva,
        image["black_level_dn"],
        image["white_level_dn"],
    )


def _add_record(counts: _Counts, store: Store, entry: tuple[Kind, str], digest: Any) -> None:
    """Bytes of an entry, and its record, which has the hashes of its files."""
    found: Record | None = store.record(*entry)
    if found is None:
        raise InputError(
            f"{store.folder_of(*entry)} is not as it was written; `mitsuba-sensor dataset repair` makes it again."
        )
    counts.bytes += sum(size for size, _ in found.files.values())
    digest.update(text_of(found))


def _numbers(name: str, gain: str, group: _Group) -> CameraNumbers:
    return CameraNumbers(
        name,
        gain,
        len(group.digital),
        group.noise,
        _over(group.digital),
        _over(group.electrons),
    )


def _over(quantiles: list[list[float]]) -> list[float]:
    """Lowest of the lowest, medians, highest of the highest."""
    found = np.array(quantiles)
    return [
        float(found[:, 0].min()),
        *np.median(found[:, 1:-1], axis=0).tolist(),
        float(found[:, -1].max()),
    ]


def _pictures(samples: Sequence[Sample]) -> list[list[Path]]:
    """Previews for the contact sheet: of scenes, and of the samples of each, evenly chosen."""
    rows: dict[str, list[Path]] = {}
    for one in samples:
        if (one.folder / PICTURE).exists():
            rows.setdefault(str(one.values["scene"]), []).append(one.folder / PICTURE)
    return [
        [checked(path) for path in _some(rows[name], MOST_COLUMNS)]
        for name in _some(list(rows), MOST_ROWS)
    ]


def _some(things: Sequence[Thing], most: int) -> list[Thing]:
    """At most so many of them, evenly chosen."""
    chosen = np.unique(np.linspace(0, len(things) - 1, min(most, len(things))).astype(int))
    return [things[k] for k in chosen]
