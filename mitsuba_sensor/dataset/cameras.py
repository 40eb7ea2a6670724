"""The cameras of a dataset, with all that is set or varied in them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import NamedTuple

from ..camera.camera import Camera, with_fields_of
from ..camera.camera_file import load_camera
from ..camera.datasheet_errors import fields_of
from ..camera.dual_pixels import has_several_readouts
from ..camera.lens_file import list_lenses
from ..camera.shipped import SHIPPED, list_cameras
from ..core import InputError, nearest
from ..files.scene_references import camera_references, check_below, files_digest, folder_names
from .file import CameraEntry
from .keys import Config, Facts, key_of
from .sweep import Combination, of_kind
from .values import SAME

SET_BY_DATASET = "set by the dataset file"
MAY_BE_FILES = ("lens.prescription", "quantum_efficiency.file")


class VariedCamera(NamedTuple):
    """A camera before its gain.

    datasheet : its numbers, without what is written for people.  key : of the datasheet.  gain : name of its gain
    setting, or None for that of the datasheet.
    """

    camera: Camera
    datasheet: Facts
    key: str
    gain: str | None


class Folders(NamedTuple):
    """Where the files of a dataset are looked for.

    roots : the folder of the dataset file, and those of --root.  untrusted : whether files outside of these folders are
    rejected, because somebody else wrote the dataset file or a scene. Otherwise every file that they name is read.
    """

    roots: Sequence[Path]
    untrusted: bool = False

    def find(self, name: str, what: str) -> Path:
        """The file of this name. Raises InputError where there is none, or it may not be read.

        what : the file is, for messages.
        """
        known = folder_names(self.roots)
        remedy = f"name its folder with --root and write its path from there (the folders now: {known})"
        leads_out = os.path.isabs(name) or ".." in PurePath(name).parts or "\0" in name
        if leads_out and (self.untrusted or "\0" in name):
            raise InputError(
                f"{what} is {name!r}, which may lead out of the folders that may be read; {remedy}."
            )
        for root in self.roots:
            if os.path.isfile(root / name):  # False also for names that are too long
                if self.untrusted and not (root / name).resolve().is_relative_to(
                    root.resolve()
                ):
                    raise InputError(
                        f"{what} is {name!r}, a link that leads out of {root}; {remedy}."
                    )
                return root / name
        raise InputError(f"{what} is {name[:200]!r}, and there is no such file; {remedy}.")

    def named(self, paths: Sequence[Path], beside: Path) -> list[tuple[str, Path]]:
        """Names of files that are the same on every machine, and the files. Raises InputError for one outside."""
        return check_below(paths, self.roots, None if self.untrusted else beside)

    def digest(self, paths: Sequence[Path], beside: Path) -> str:
        """SHA-256 over these names and the contents."""
        return files_digest(paths, self.roots, None if self.untrusted else beside)


class Cameras:
    """The cameras of the entries of a dataset file. Raises InputError for one that cannot be."""

    def __init__(self, entries: Sequence[CameraEntry], folders: Folders) -> None:
        self.entries, self.folders = entries, folders
        self._files = [*map(self._file_of, entries)]
        self._varied: dict[str, VariedCamera] = {}
        self.as_given = [*map(self._of_entry, entries, self._files)]

    @property
    def models(self) -> list[str]:
        """Names of the models, by entry: two entries of one model and serial number are the same chip."""
        return [camera.name for camera in self.as_given]

    def name(self, number: int) -> str:
        """What the dataset calls it."""
        return self.entries[number].name or self.models[number]

    def of(self, one: Combination) -> VariedCamera:
        """The camera with all that varies in it; that it has the gain setting is checked. Raises InputError."""
        varied = _varied(one)
        gain = one.values.get("gain")
        known = repr((one.camera, gain, varied))
        if known not in self._varied:
            changes = self._with_places(varied, "the camera")
            camera = with_fields_of(self.as_given[one.camera], changes, SET_BY_DATASET)
            if gain is None:
                setting = None
            else:
                setting = camera.at_gain(gain).gain
            sheet = camera.model_dump(mode="json", exclude={"description", "sources"})
            self._varied[known] = VariedCamera(camera, sheet, key_of(sheet), setting)
        return self._varied[known]

    def files(self, one: Combination) -> Iterator[tuple[Path, str]]:
        """All files that the camera of a sample is read from, and what they are of."""
        use, file = f"camera {self.name(one.camera)}", self._files[one.camera]
        if file is None:
            found = [Path(str(SHIPPED / f"{self.entries[one.camera].camera}.toml"))]
        else:
            found = camera_references(file)
        for changes in (fields_in(self.entries[one.camera].set), _varied(one)):
            found += [self.folders.find(name, use) for name in _files_in(changes)]
        yield from ((path, use) for path in found)

    def _file_of(self, entry: CameraEntry) -> Path | None:
        """The file of a camera; None where it ships with the package. Raises InputError."""
        where = f"camera {entry.camera[:200]!r}"
        shipped = entry.camera in list_cameras()
        if not shipped and not entry.camera.endswith(".toml"):
            near = nearest(entry.camera, list_cameras())
            remedy = "`mitsuba-sensor cameras list` has them; the name of a camera file ends in .toml"
            raise InputError(f"{where} is not a camera; {remedy}.{near}")
        if shipped:
            return None
        file = self.folders.find(entry.camera, where)
        self.folders.named(camera_references(file), file.parent)
        return file

    def _of_entry(self, entry: CameraEntry, file: Path | None) -> Camera:
        camera = load_camera(entry.camera if file is None else file)
        where = f"camera {entry.camera[:200]!r}"
        changes = self._with_places(fields_in(entry.set), where)
        return with_fields_of(camera, changes, SET_BY_DATASET).without(*entry.without)

    def _with_places(self, changes: Config, where: str, table: str = "") -> Facts:
        """The same; fields that name files, with their place below a root.  table : in which the fields are."""
        found = dict(changes)
        for field, value in changes.items():
            name = f"{table}{field}"
            if isinstance(value, Mapping):
                found[field] = self._with_places(value, where, f"{name}.")
            elif _is_file(name, value):
                found[field] = str(self.folders.find(value, f"{name} of {where}"))
        return found


def _varied(one: Combination) -> Facts:
    """Fields of the camera of a sample that vary, and their values."""
    return of_kind("camera", {SAME.get(name, name): x for name, x in one.values.items()})


def _files_in(changes: Config, table: str = "") -> Iterator[str]:
    """Names of the files that fields name.  table : in which the fields are."""
    for field, value in changes.items():
        if isinstance(value, Mapping):
            yield from _files_in(value, f"{table}{field}.")
        elif _is_file(f"{table}{field}", value):
            yield value


def _is_file(field: str, value: object) -> bool:
    """Whether a field of a camera is the name of a file which does not ship with the package."""
    return field in MAY_BE_FILES and isinstance(value, str) and value not in list_lenses()


def fields_in(tables: Config, table: str = "") -> Facts:
    """Dotted names of fields and their values: `adc.bits = 12` without quotes is a table in a table."""
    found, known = dict[str, object](), fields_of(Camera)
    for name, value in tables.items():
        dotted = f"{table}{name}"
        if (
            isinstance(value, Mapping)
            and value
            and all(f"{dotted}.{one}" in known for one in value)
        ):
            found |= fields_in(value, f"{dotted}.")
        else:
            found[dotted] = value
    return found


def of_light(camera: Camera, cube: bool) -> Facts:
    """What of the camera decides the light in front of its pixels. With a cube all that it detects is its band."""
    whole = camera.model_dump(mode="json", include={"lens", "sensor", "quantum_efficiency"})
    of_sensor = ("columns", "rows", "shutter", "row_time_us", "dual_pixel")
    sensor = {name: whole["sensor"][name] for name in of_sensor}
    pitch = [camera.pixel.pitch_x_um, camera.pixel.pitch_y_um]
    if cube:
        detected = {"band_nm": camera.band_nm}
    else:
        detected = {"quantum_efficiency": whole["quantum_efficiency"]}
    return {"lens": whole["lens"], "sensor": sensor, "pitch_um": pitch, **detected}


def check_outputs(outputs: Sequence[str], cameras: Sequence[Camera]) -> None:
    """Raise InputError for an output that no camera of the dataset has."""
    if "readouts" in outputs and not any(map(has_several_readouts, cameras)):
        raise InputError(
            "outputs names 'readouts', and every camera of the dataset reads each pixel once; leave it out, or take a "
            "camera with several read-outs, e.g. scmos_dual_gain."
        )
    if "companded" in outputs and not any(camera.companding.knees for camera in cameras):
        raise InputError(
            "outputs names 'companded', and no camera of the dataset has companding.knees; leave it out, or take one "
            "that has, e.g. sony_imx490."
        )
