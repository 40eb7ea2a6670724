"""The cameras of a dataset, with all that is set or varied in them, and the folders that its files are read from."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import NamedTuple

from ..camera.camera import Camera, with_fields_of
from ..camera.camera_file import load_camera
from ..camera.datasheet_errors import fields_of
from ..camera.dual_pixels import has_several_readouts
from ..camera.exposure_times import later_exposures
from ..camera.lens_file import list_lenses
from ..camera.shipped import list_cameras
from ..core import Exposure, InputError, nearest
from ..files.scene_references import camera_references, check_below, folder_names
from .file import CameraEntry, DatasetFile
from .keys import Config, Facts, Fixed, key_of
from .sweep import Combination, of_kind
from .values import SAME

SET_BY_DATASET = "set by the dataset file"
MAY_BE_FILES = ("lens.prescription", "quantum_efficiency.file")
CAMERAS_KEPT = 500


class VariedCamera(NamedTuple):
    """A camera before its gain.

    datasheet : its numbers, without what is written for people.  key : of the datasheet.  gain : name of its gain
    setting, or None for that of the datasheet.  light : what of it decides the light in front of its pixels.
    is_staggered : whether it has exposures one after the other.
    """

    camera: Camera
    datasheet: Fixed
    key: str
    gain: str | None
    light: Fixed
    is_staggered: bool


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

    def check(self, paths: Sequence[Path]) -> None:
        """Raise InputError for a file that may not be read."""
        if self.untrusted:
            check_below(paths, self.roots)


class Cameras:
    """The cameras of a dataset file. Raises InputError for one that cannot be.

    models : names of their models, by entry: two entries of one model and serial number are the same sensor unit.
    """

    def __init__(self, file: DatasetFile, folders: Folders) -> None:
        self.entries, self.folders = file.cameras, folders
        self.as_given = [*map(self._of_entry, file.cameras)]
        self.models = [camera.name for camera in self.as_given]
        self._is_cube = file.render.get("spectral") == "cube"
        self._varied_names = [
            x for x in file.varied if x in ("gain", *SAME) or x.startswith("camera.")
        ]
        self._varied: dict[str, VariedCamera] = {}
        _check_outputs(file.outputs, self.as_given)

    def name(self, number: int) -> str:
        """What the dataset calls it."""
        return self.entries[number].name or self.models[number]

    def of(self, one: Combination) -> VariedCamera:
        """The camera with all that varies in it; that it has the gain setting is checked. Raises InputError."""
        values = {x: one.values[x] for x in self._varied_names if x in one.values}
        known = repr((one.camera, values))
        if known not in self._varied:
            if len(self._varied) >= CAMERAS_KEPT:
                self._varied.clear()
            self._varied[known] = self._with(one.camera, values)
        return self._varied[known]

    def _with(self, entry: int, values: Facts) -> VariedCamera:
        gain = values.pop("gain", None)
        fields = of_kind("camera", {SAME.get(name, name): x for name, x in values.items()})
        changes = self._with_places(fields, "the camera")
        camera = with_fields_of(self.as_given[entry], changes, SET_BY_DATASET)
        setting = None if gain is None else camera.at_gain(gain).gain
        sheet = Fixed(camera.model_dump(mode="json", exclude={"description", "sources"}))
        light = Fixed(_of_light(camera, self._is_cube))
        return VariedCamera(camera, sheet, key_of(sheet), setting, light, is_staggered(camera))

    def _of_entry(self, entry: CameraEntry) -> Camera:
        where, source = f"camera {entry.camera[:200]!r}", entry.camera
        if source not in list_cameras():
            if not source.endswith(".toml"):
                near = nearest(source, list_cameras())
                remedy = "`mitsuba-sensor cameras list` has them; the name of a camera file ends in .toml"
                raise InputError(f"{where} is not a camera; {remedy}.{near}")
            path = self.folders.find(source, where)
            self.folders.check(camera_references(path))
            source = str(path)
        changes = self._with_places(_fields_in(entry.set), where)
        return with_fields_of(load_camera(source), changes, SET_BY_DATASET).without(
            *entry.without
        )

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


def is_staggered(camera: Camera) -> bool:
    """Whether it has exposures one after the other."""
    return bool(later_exposures(camera, Exposure(1.0)))


def _is_file(field: str, value: object) -> bool:
    """Whether a field of a camera is the name of a file which does not ship with the package."""
    return field in MAY_BE_FILES and isinstance(value, str) and value not in list_lenses()


def _fields_in(tables: Config, table: str = "") -> Facts:
    """Dotted names of fields and their values: `adc.bits = 12` without quotes is a table in a table."""
    found, known = dict[str, object](), fields_of(Camera)
    for name, value in tables.items():
        dotted = f"{table}{name}"
        if (
            isinstance(value, Mapping)
            and value
            and all(f"{dotted}.{one}" in known for one in value)
        ):
            found |= _fields_in(value, f"{dotted}.")
        else:
            found[dotted] = value
    return found


def _of_light(camera: Camera, is_cube: bool) -> Facts:
    """What of the camera decides the light in front of its pixels. With a cube all that it detects is its band."""
    whole = camera.model_dump(mode="json", include={"lens", "sensor", "quantum_efficiency"})
    of_sensor = ("columns", "rows", "shutter", "row_time_us", "dual_pixel")
    whole["sensor"] = {name: whole["sensor"][name] for name in of_sensor}
    if is_cube:
        del whole["quantum_efficiency"]
        whole["band_nm"] = camera.band_nm
    return {**whole, "pitch_um": [camera.pixel.pitch_x_um, camera.pixel.pitch_y_um]}


def _check_outputs(outputs: Sequence[str], cameras: Sequence[Camera]) -> None:
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
