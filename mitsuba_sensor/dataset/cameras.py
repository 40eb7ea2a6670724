"""The cameras of a dataset with their set and varied fields, and the folders of its files."""

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
from ..core import Exposure, InputError, nearest, nearest_file
from ..files.scene_references import camera_references, check_below, folder_names
from .file import CameraEntry, DatasetFile
from .keys import Config, Facts, Fixed, key_of
from .sweep import Combination, of_kind
from .values import SAME

SET_BY_DATASET = "set by the dataset file"
FILE_FIELDS = ("lens.prescription", "quantum_efficiency.file")
CAMERAS_KEPT = 500


class VariedCamera(NamedTuple):
    """A camera before its gain.

    datasheet : its parameters, without text for people.  key : of the datasheet.  gain : name of its gain setting, or
    None for the gain of the datasheet.  light : the fields that decide the light before the pixels.  is_staggered :
    True if it has exposures one after the other.
    """

    camera: Camera
    datasheet: Fixed
    key: str
    gain: str | None
    light: Fixed
    is_staggered: bool


class Folders(NamedTuple):
    """The folders that hold the files of a dataset.

    roots : the folder of the dataset file, and the folders of --root.  untrusted : True to reject files outside these
    folders, because somebody else wrote the dataset file or a scene.
    """

    roots: Sequence[Path]
    untrusted: bool = False

    def near(self, name: str, suffix: str) -> str:
        """Return `` Did you mean …?`` with a file whose name is close to a missing file; empty if untrusted."""
        roots = () if self.untrusted else self.roots
        return next(filter(None, (nearest_file(name, suffix, root) for root in roots)), "")

    def find(self, name: str, what: str, suffix: str = "") -> Path:
        """Return the path of a file. Raises InputError for a missing or forbidden file.

        what : the file is, for messages.  suffix : of files to suggest instead of a missing file.
        """
        folders = folder_names(self.roots)
        remedy = f"name its folder with roots= and write its path from there (the folders now: {folders})"
        leads_out = os.path.isabs(name) or ".." in PurePath(name).parts or "\0" in name
        if leads_out and (self.untrusted or "\0" in name):
            raise InputError(
                f"{what} is {name!r}, which may lead out of the folders that may be read; {remedy}."
            )
        for root in self.roots:
            if os.path.isfile(root / name):  # False also for names that are too long
                path = root / name
                if self.untrusted and not path.resolve().is_relative_to(root.resolve()):
                    raise InputError(
                        f"{what} is {name!r}, a link that leads out of {root}; {remedy}."
                    )
                return path
        near = self.near(name, suffix)
        remedy = f".{near} Otherwise {remedy}" if near else f"; {remedy}"
        raise InputError(f"{what} is {name[:200]!r}, but there is no such file{remedy}.")

    def check(self, paths: Sequence[Path]) -> None:
        """Raise InputError for a forbidden file."""
        if self.untrusted:
            check_below(paths, self.roots)


class Cameras:
    """The cameras of a dataset file. Raises InputError for an impossible camera.

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
        """Return the name of a camera in the dataset."""
        return self.entries[number].name or self.models[number]

    def of(self, sample: Combination) -> VariedCamera:
        """Return the camera of a sample. Raises InputError if it lacks the gain setting."""
        values = {x: sample.values[x] for x in self._varied_names if x in sample.values}
        key = repr((sample.camera, values))
        if key not in self._varied:
            if len(self._varied) >= CAMERAS_KEPT:
                self._varied.clear()
            self._varied[key] = self._with(sample.camera, values)
        return self._varied[key]

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
                near = nearest(source, list_cameras()) or self.folders.near(source, ".toml")
                raise InputError(
                    f"{where} is not a camera; `mitsuba-sensor cameras list` has the names, and camera files end in "
                    f".toml.{near}"
                )
            path = self.folders.find(source, where, ".toml")
            self.folders.check(camera_references(path))
            source = str(path)
        changes = self._with_places(_fields_in(entry.set), where)
        camera = with_fields_of(load_camera(source), changes, SET_BY_DATASET)
        return camera.without(*entry.without)

    def _with_places(self, changes: Config, where: str, table: str = "") -> Facts:
        """Return changes in which names of files are paths below a root.  table : prefix of the fields."""
        placed = dict(changes)
        for field, value in changes.items():
            name = f"{table}{field}"
            if isinstance(value, Mapping):
                placed[field] = self._with_places(value, where, f"{name}.")
            elif name in FILE_FIELDS and isinstance(value, str) and value not in list_lenses():
                placed[field] = str(self.folders.find(value, f"{name} of {where}"))
        return placed


def is_staggered(camera: Camera) -> bool:
    """Return True if a camera has exposures one after the other."""
    return bool(later_exposures(camera, Exposure(1.0)))


def _fields_in(tables: Config, table: str = "") -> Facts:
    """Return values by dotted field: `adc.bits = 12` without quotes is a table in a table."""
    values, fields = dict[str, object](), fields_of(Camera)
    for name, value in tables.items():
        dotted = f"{table}{name}"
        is_table = isinstance(value, Mapping) and all(f"{dotted}.{x}" in fields for x in value)
        values |= _fields_in(value, f"{dotted}.") if is_table and value else {dotted: value}
    return values


def _of_light(camera: Camera, is_cube: bool) -> Facts:
    """Return the fields of a camera that decide the light before its pixels; in a cube only its band counts of QE."""
    light = camera.model_dump(mode="json", include={"lens", "sensor", "quantum_efficiency"})
    of_sensor = ("columns", "rows", "shutter", "row_time_us", "dual_pixel")
    light["sensor"] = {name: light["sensor"][name] for name in of_sensor}
    if is_cube:
        del light["quantum_efficiency"]
        light["band_nm"] = camera.band_nm
    return {**light, "pitch_um": [camera.pixel.pitch_x_um, camera.pixel.pitch_y_um]}


def _check_outputs(outputs: Sequence[str], cameras: Sequence[Camera]) -> None:
    """Raise InputError for an output that no camera of the dataset has."""
    if "readouts" in outputs and not any(map(has_several_readouts, cameras)):
        raise InputError(
            "outputs names 'readouts', but every camera of the dataset reads each pixel once; remove it, or give a "
            "camera with several readouts, e.g. scmos_dual_gain."
        )
    if "companded" in outputs and not any(camera.companding.knees for camera in cameras):
        raise InputError(
            "outputs names 'companded', but no camera of the dataset has companding.knees; remove it, or give a camera "
            "with knees, e.g. sony_imx490."
        )
