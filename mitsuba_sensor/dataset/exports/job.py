"""What an export works on: the samples of a dataset, the folder that it fills, and where pictures were taken."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...files import durable
from ...files.whole_folder import copy_into
from ...optics.calibration import calibration_of
from ..keys import Facts, canonical
from ..reader import AOVS, IMAGES, Sample
from ..record import MOST_BYTES, RECORD, record_of
from .poses import PosedImage

PICTURE = "frame.png"
NEEDED = ("image", "config", "view", "light", "versions")  # of sample.json
OF_WORLD = ("scene", "parameters", "traverse", "motion", "scene_unit")
"""Parts of a view's configuration that decide what its world space is."""


@dataclass(frozen=True)
class Job:
    """One export.

    samples : in the order of the dataset.  folder : empty, and renamed when all is done.
    options : of :class:`dataset.options.ExportOptions`, complete.  step : called after each sample.
    title, licence : of the dataset.
    """

    samples: Sequence[Sample]
    folder: Path
    options: Mapping[str, Any]
    step: Callable[[], object]
    title: str = ""
    licence: str = ""

    def place_picture(self, sample: Sample, name: str) -> None:
        """Copy the preview of a sample. Raises InputError where the dataset has none."""
        picture = sample.folder / PICTURE
        if not picture.exists():
            raise InputError(
                f"there is no {picture}; add preview to the outputs of the dataset, and make it again."
            )
        copy_into(self.folder, name, checked(picture))


def checked(path: Path) -> Path:
    """A file of a sample or view, if its content is still that of the record beside it. Raises InputError."""
    with suppress(OSError):
        found = record_of(durable.read_small(os.fspath(path.with_name(RECORD)), MOST_BYTES))
        if found and path.parent.as_posix().endswith(f"/{found.name}"):
            said = found.files.get(path.name)
        else:
            said = None
        if said and not path.is_symlink() and durable.size_and_hash(path) == said:
            return path
    raise InputError(
        f"{path} is not as it was written; `mitsuba-sensor dataset repair` makes it again."
    )


def facts_of(sample: Sample) -> Facts:
    """sample.json, which a sample in a list would keep: that of a million of them is too much. Raises InputError."""
    checked(sample.folder / "sample.json")
    found = replace(sample).facts
    if missing := [name for name in NEEDED if not isinstance(found.get(name), dict)]:
        raise InputError(
            f"sample.json in {sample.folder} has no {missing[0]}: another version made it; make it again."
        )
    return found


def checked_array(sample: Sample, name: str) -> NDArray[Any]:
    """An array of a sample whose file is as it was written. Raises InputError."""
    if name in AOVS:
        checked(sample.existing(sample.view_folder / "aovs.exr", name))
    elif name in IMAGES:
        checked(sample.existing(sample.folder / IMAGES[name], name))
    return sample.read(name)


def worlds(samples: Sequence[Sample]) -> dict[str, list[Sample]]:
    """Samples by the world that their poses are in: the name of a scene, with a number where it has variants."""
    found: dict[tuple[str, str], list[Sample]] = {}
    for sample in samples:
        view = facts_of(sample)["view"]
        variant = canonical({name: view["config"].get(name) for name in OF_WORLD})
        found.setdefault((view["scene"], variant), []).append(sample)
    scenes = [scene for scene, _ in found]
    named: dict[str, list[Sample]] = {}
    for number, ((scene, _), group) in enumerate(found.items()):
        several = ""
        if scenes.count(scene) > 1:
            several = f"-{scenes[:number].count(scene) + 1:03d}"
        named[scene + several] = group
    return named


def posed(sample: Sample, name: str) -> PosedImage:
    """Calibration and pose of a sample's picture.  name : of its file in the export. Raises InputError."""
    facts = facts_of(sample)
    light, pitch_um = facts["light"], facts["config"]["camera"]["pixel"]["pitch_x_um"]
    if light.get("camera_to_world") is None:
        raise InputError(
            f"{sample.folder} has no pose; the dataset was made by an older version: make it again."
        )
    return PosedImage(
        name, calibration_of(light["intrinsics"], pitch_um), np.array(light["camera_to_world"])
    )
