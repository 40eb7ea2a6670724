"""What an export works on: the samples of a dataset, the folder that it fills, and where pictures were taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from numpy.typing import NDArray

from ...core import InputError
from ...core.small_files import json_value
from ...files.appearing import write_drawing
from ...files.png import write_png
from ...files.tiff import write_tiff
from ...files.whole_folder import inside
from ...optics.calibration import calibration_of
from ..plan.file import DatasetFile
from ..read.previews import PICTURE
from ..read.reader import AOVS, IMAGES, Sample
from ..store.entry_files import checked, require_file
from ..store.keys import Facts, canonical
from .poses import PosedImage, rigid_pose

IRRADIANCE = "irradiance"
LARGEST_PNG = 16  # bits of a pixel
NEEDED = ("image", "config", "view", "light", "versions")  # of sample.json
USUAL = ("raw", "clean", "variance")
"""Arrays that are written where nothing is asked for, as far as the dataset has them."""
OF_WORLD = ("scene", "parameters", "traverse", "motion", "scene_unit")
"""Parts of a view's configuration that decide what its world space is."""


class PosedSample(NamedTuple):
    """A sample, and where its picture was taken; the picture has the name of its key."""

    sample: Sample
    image: PosedImage


@dataclass(frozen=True)
class Job:
    """One export.

    samples : in the order of the dataset.  folder : empty, and renamed when all is done.
    options : of :class:`dataset.options.ExportOptions`, complete.  step : called after each sample.
    file : that the dataset was made from.  left_out : keys of samples that cannot be in the export.
    remarks : sentences for people and for the card.
    """

    samples: Sequence[Sample]
    folder: Path
    options: Mapping[str, Any]
    step: Callable[[], object]
    file: DatasetFile
    left_out: set[str] = field(default_factory=set)
    remarks: list[str] = field(default_factory=list)

    @property
    def title(self) -> str:
        """Name and description of the dataset."""
        if self.file.description:
            return f"{self.file.name}: {self.file.description}"
        return self.file.name

    @property
    def licence(self) -> str:
        """That is asked for, or that of the dataset file."""
        return self.options["licence"] or self.file.licence

    def leave_out(self, samples: Sequence[Sample], what: str, why: str) -> None:
        """Note, with a remark, that samples cannot be in the export.  what, why : they are, for the remark."""
        for sample in samples:
            self.left_out.add(sample.key)
            self.step()
        count = f"left out are {len(samples)} samples"
        if len(samples) == 1:
            count = "left out is one sample"
        self.remarks.append(f"{count} of {what}: {why}")

    def arrays_of(self, sample: Sample, usual: Sequence[str] = USUAL) -> Sequence[str]:
        """Names of the arrays of a sample that the options ask for; by default those of ``usual`` that it has.
        Raises InputError for none."""
        if self.options["arrays"]:
            return list(dict.fromkeys(self.options["arrays"]))
        found = [name for name in usual if _has(sample, name)]
        if not found:
            raise InputError(
                f"the samples have none of {', '.join(usual)}; name one in the outputs of the dataset, and make it "
                "again, or say which arrays to write, e.g. `--array depth_m`."
            )
        return found

    def worlds(self) -> dict[str, list[PosedSample]]:
        """Posed samples by the world that their poses are in. Those that no pose or calibration can describe are left
        out. Raises InputError where none remains."""
        found, unposed = worlds(self.samples)
        for (scene, why), samples in unposed.items():
            self.leave_out(samples, f"scene {scene}", why.removesuffix("."))
        if not found:
            raise InputError(f"no sample can be exported; {'; '.join(self.remarks)}.")
        return found

    def place_picture(self, sample: Sample, stem: str) -> str:
        """Write the picture of a sample that the options ask for. Returns its name without folders. Raises InputError
        where the dataset has none.

        stem : of its name in the export, with folders.
        """
        if self.options["images"] == "raw":
            self._require(sample, "raw", IMAGES["raw"], "preview")
            return _place_raw(self.folder, sample, stem)
        self._require(sample, "preview", PICTURE, "raw")
        name = f"{stem}.png"
        write_drawing(inside(self.folder, name), checked(sample.files, PICTURE))
        return PurePath(name).name

    def _require(self, sample: Sample, output: str, file: str, other: str) -> None:
        """Raise InputError where a sample has no such picture.  other : output that has pictures, too."""
        if sample.files.has(file):
            return
        remedy = f"add {output} to the outputs of the dataset, and make it again"
        if other in self.file.outputs:
            remedy = f"take --images {other}, or {remedy}"
        raise InputError(f"there is no {sample.files.place(file)}; {remedy}.")


def _has(sample: Sample, name: str) -> bool:
    """Whether a sample, or its view, has the file of an image or of the irradiance."""
    if name == IRRADIANCE:
        return sample.view_files.has(f"{IRRADIANCE}.exr")
    return sample.files.has(IMAGES[name])


def _place_raw(folder: Path, sample: Sample, stem: str) -> str:
    """Write the first raw frame; the name of its file, by the bits of its codes."""
    frame = checked_array(sample, "raw")[0]
    if frame.dtype.itemsize * 8 <= LARGEST_PNG:
        place = inside(folder, f"{stem}.png")
        write_png(place, frame)
    else:
        place = inside(folder, f"{stem}.tiff")
        write_tiff(place, frame)
    return place.name


def facts_of(sample: Sample) -> Facts:
    """sample.json, which a sample in a list would keep: that of a million of them is too much. Raises InputError."""
    found: Facts = json_value(checked(sample.files, "sample.json").decode())
    if missing := [name for name in NEEDED if not isinstance(found.get(name), dict)]:
        raise InputError(
            f"{sample.files.place('sample.json')} has no {missing[0]}: another version made it; make it again."
        )
    return found


def facts_text_of(sample: Sample) -> str:
    """The text of sample.json. Raises InputError."""
    return checked(sample.files, "sample.json").decode()


def checked_array(sample: Sample, name: str) -> NDArray[Any]:
    """An array of a sample whose file is as it was written. Raises InputError."""
    if name in AOVS:
        require_file(sample.view_files, "aovs.exr", name)
        checked(sample.view_files, "aovs.exr")
    elif file := {**IMAGES, "preview": PICTURE}.get(name):
        require_file(sample.files, file, name)
        checked(sample.files, file)
    return sample.read(name)


def worlds(
    samples: Sequence[Sample],
) -> tuple[dict[str, list[PosedSample]], dict[tuple[str, str], list[Sample]]]:
    """Posed samples by their world: the name of a scene, with a number where it has variants; and by scene and reason
    those that have no pose or calibration which other programs could read."""
    found: dict[tuple[str, str], list[PosedSample]] = {}
    unposed: dict[tuple[str, str], list[Sample]] = {}
    for sample in samples:
        facts = facts_of(sample)
        view = facts["view"]
        try:
            image = posed(sample, facts)
        except InputError as error:
            unposed.setdefault((view["scene"], str(error)), []).append(sample)
            continue
        variant = canonical({name: view["config"].get(name) for name in OF_WORLD})
        found.setdefault((view["scene"], variant), []).append(PosedSample(sample, image))
    scenes = [scene for scene, _ in found]
    named: dict[str, list[PosedSample]] = {}
    for (scene, _), group in found.items():
        name, number = scene, 0
        while name in named or (name in scenes and (name != scene or scenes.count(scene) > 1)):
            number += 1
            name = f"{scene}-{number:03d}"
        named[name] = group
    return named, unposed


def posed(sample: Sample, facts: Facts) -> PosedImage:
    """Calibration and pose of a sample's picture, which has the name of its key.  facts : its sample.json.
    Raises InputError."""
    light, pitch_um = facts["light"], facts["config"]["camera"]["pixel"]["pitch_x_um"]
    if light.get("camera_to_world") is None:
        raise InputError(
            f"{sample.files.place('sample.json')} has no pose; the dataset was made by an older version: make it again."
        )
    calibration = calibration_of(light["intrinsics"], pitch_um)
    return PosedImage(sample.key, calibration, rigid_pose(light["camera_to_world"]))
