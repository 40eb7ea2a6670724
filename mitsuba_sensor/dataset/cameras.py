"""The cameras of a dataset, with all that is set or varied in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ..camera.camera import Camera, with_fields_of
from ..camera.camera_file import load_camera
from ..camera.datasheet_errors import fields_of
from ..camera.dual_pixels import has_several_readouts
from ..camera.lens_file import list_lenses
from ..camera.shipped import list_cameras
from ..core import InputError, nearest
from ..files.scene_references import camera_references, check_below
from .file import SAME, CameraEntry
from .keys import Config, Facts, canonical, key_of
from .roots import find_below
from .sweep import Combination, of_kind

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


class Cameras:
    """The cameras of the entries of a dataset file. Raises InputError for one that cannot be."""

    def __init__(self, entries: Sequence[CameraEntry], roots: Sequence[Path]) -> None:
        self.entries, self.roots = entries, roots
        self._varied: dict[str, VariedCamera] = {}
        self.as_given = [self._of_entry(entry) for entry in entries]

    @property
    def models(self) -> list[str]:
        """Names of the models, by entry: two entries of one model and serial number are the same chip."""
        return [camera.name for camera in self.as_given]

    def name(self, number: int) -> str:
        """What the dataset calls it."""
        return self.entries[number].name or self.models[number]

    def of(self, one: Combination) -> VariedCamera:
        """The camera with all that varies in it; that it has the gain setting is checked. Raises InputError."""
        varied = of_kind(
            "camera", {SAME.get(name, name): value for name, value in one.values.items()}
        )
        gain = one.values.get("gain")
        known = canonical({"entry": one.camera, "varied": varied, "gain": gain})
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

    def _of_entry(self, entry: CameraEntry) -> Camera:
        where = f"camera {entry.camera[:200]!r}"
        shipped = entry.camera in list_cameras()
        if not shipped and not entry.camera.endswith(".toml"):
            near = nearest(entry.camera, list_cameras())
            remedy = "`mitsuba-sensor cameras list` has them; the name of a camera file ends in .toml"
            raise InputError(f"{where} is not a camera; {remedy}.{near}")
        if shipped:
            file = None
        else:
            file = find_below(entry.camera, self.roots, where)
        if file is not None:
            check_below(camera_references(file), self.roots)
        camera = load_camera(entry.camera if file is None else file)
        changes = self._with_places(fields_in(entry.set), where)
        return with_fields_of(camera, changes, SET_BY_DATASET).without(*entry.without)

    def _with_places(self, changes: Config, where: str, table: str = "") -> Facts:
        """The same; fields that name files, with their place below a root.  table : in which the fields are."""
        found = dict(changes)
        for field, value in changes.items():
            name = f"{table}{field}"
            if isinstance(value, Mapping):
                found[field] = self._with_places(value, where, f"{name}.")
            elif name in MAY_BE_FILES and isinstance(value, str) and value not in list_lenses():
                found[field] = str(find_below(value, self.roots, f"{name} of {where}"))
        return found


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
