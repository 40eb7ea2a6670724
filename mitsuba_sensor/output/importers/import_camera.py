"""Import a camera: choose the importer that reads a file."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...camera.camera import Camera
from ...camera.camera_file import load_camera
from ...core import InputError
from ...core.small_files import json_value, require_small
from ...files.npy_dict import read_npy_dict
from .calibration import (
    is_storage,
    is_transforms,
    read_colmap,
    read_storage,
    read_transforms,
    yaml_tables,
)
from .dng import read_dngs
from .draft import Draft
from .emva_report import read_report
from .getframes import PREFIX, preset_text, read_preset
from .libcamera import is_tuning, read_tuning
from .noise_profile import is_profile, read_profile
from .noise_table import is_table, read_table, rows_by_name

LIKE = "bayer_2mp"
YAML = (".yml", ".yaml")
FORMATS = (
    "a libcamera tuning file (.json), a noise calibration (.json, .csv), a noise profile of ELD (.npy), "
    "DNGs (.dng), an EMVA 1288 report (.xml), a preset of getframes "
    f"(.toml, or {PREFIX}NAME), or a geometric calibration (OpenCV .yml or .xml, ROS, "
    "EuRoC and Kalibr .yaml, COLMAP's cameras.txt, nerfstudio's transforms.json)"
)
BYTES_MAX = 2**24


def import_camera(
    files: str | Path | Sequence[str | Path],
    like: Camera | str | Path = LIKE,
    name: str | None = None,
) -> Camera:
    """Return the camera that a file of another program describes, with the source of every value in ``sources``.

    files : a libcamera tuning file, a noise calibration of ELD or PMN, a noise profile of ELD (.npy), an EMVA 1288
        report, a preset of getframes ("getframes:NAME"), DNGs of one camera, one for each ISO, or a calibration of
        OpenCV, ROS, EuRoC, Kalibr, COLMAP or nerfstudio, which contains size and lens distortion.
    like : camera that gives the values missing from the file; their sources begin with "assumed:".
    name : name of the camera. Default: the name in the file, or else the file name.
    Raises InputError for other files, and for values out of range.
    """
    if isinstance(files, str | Path):
        files = [files]
    paths = [Path(file) for file in files]
    if not paths:
        raise InputError(f"files is empty; give {FORMATS}.")
    draft = _draft(paths, like if isinstance(like, Camera) else load_camera(like))
    draft.name = name or draft.name or paths[0].stem
    return draft.camera()


def _draft(paths: list[Path], like: Camera) -> Draft:
    """Return the draft of the importer that suits the name of the first file, and its content."""
    first, kind = paths[0], paths[0].suffix.lower()
    if kind == ".dng" and all(path.suffix.lower() == kind for path in paths):
        return read_dngs(paths, like)
    if len(paths) > 1:
        raise InputError(
            f"{len(paths)} files are given, but not all are DNGs; give one file, or DNGs of one camera."
        )
    if str(first).startswith(PREFIX):
        return read_preset(preset_text(str(first).removeprefix(PREFIX)), str(first), like)
    if kind == ".npy":
        return _read_npy(first, like)
    if kind not in (".json", ".csv", ".xml", ".toml", ".txt", *YAML):
        raise InputError(f"{first} has an unknown format; give {FORMATS}.")
    text = _read_text(first)
    if kind == ".txt":
        return read_colmap(text, first.name, like)
    if kind == ".json":
        return _read_json(text, first.name, like)
    if kind == ".csv":
        return read_table(rows_by_name(text), first.name, like)
    if kind in YAML or (kind == ".xml" and is_storage(text)):
        return read_storage(text, first.name, like)
    if kind == ".xml":
        return read_report(text, first.name, like)
    return read_preset(text, first.name, like)


def _read_json(text: str, file: str, like: Camera) -> Draft:
    """Return the draft of the importer that knows the names in a JSON file."""
    try:
        data: Any = json_value(text)
    except ValueError as error:
        data = None
        with suppress(InputError):
            data = yaml_tables(text, file)  # as libcamera reads its own
        if not is_tuning(data):
            raise InputError(f"{file} is not valid JSON: {error}. Give {FORMATS}.") from None
    if is_tuning(data):
        return read_tuning(data, file, like)
    if is_table(data):
        return read_table(data, file, like)
    if is_transforms(data):
        return read_transforms(data, file, like)
    raise InputError(
        f"{file} has no algorithms (tuning file), no rows (noise calibration) and no intrinsics (fl_x); give {FORMATS}."
    )


def _read_npy(path: Path, like: Camera) -> Draft:
    try:
        data = read_npy_dict(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}. Give {FORMATS}.") from None
    if not is_profile(data):
        names = ", ".join(data)[:200] or "nothing"
        raise InputError(f"{path} has {names}; a noise profile has Kmin, Kmax and Profile-1.")
    return read_profile(data, path.name, like)


def _read_text(path: Path) -> str:
    try:
        require_small(path, "the file", BYTES_MAX)
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(f"{path} cannot be read: {reason}. Give {FORMATS}.") from None
