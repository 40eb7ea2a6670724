"""Included cameras by name, camera files by path, and cameras from TOML text or a dict."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, overload

import numpy as np

from ..core import InputError, nearest, nearest_file
from ..core.errors import shown
from ..core.small_files import require_small, toml_tables
from .camera import Camera, checked_camera
from .shipped import list_cameras, shipped_text

AnyCamera: TypeAlias = Camera | str | Path
"""A camera, the name of an included camera, or the path of a camera file."""

SEARCHED_LETTERS_MIN = 3
"""Shorter texts are not searched for in descriptions."""

TOML_TEXT = "the TOML text"
"""Name of a camera text in messages."""


@overload
def camera_of(camera: AnyCamera) -> Camera: ...
@overload
def camera_of(camera: AnyCamera | None) -> Camera | None: ...
def camera_of(camera: AnyCamera | None) -> Camera | None:
    """Return the camera itself, or the camera of this name or file; None stays None. Raises InputError."""
    if isinstance(camera, str):
        return _shipped_camera(camera) or load_camera(camera)
    return load_camera(camera) if isinstance(camera, Path) else camera


@cache
def _shipped_camera(name: str) -> Camera | None:
    """Return an included camera, checked once; None for another name."""
    return load_camera(name) if name in list_cameras() else None


def load_camera(name: str | Path | Mapping[str, Any]) -> Camera:
    """Return an included camera by name (``konnik_table1``), or a camera file by path (``my.toml``).

    ::

        camera = ms.load_camera("konnik_table1").replace(**{"adc.bits": 14})
        print(camera.emva1288())

    name : may also be the text of a camera file, or its tables as a dict,
        ``{"name": "mine", "sensor": {"columns": 640, …}, …}``; paths in them start at the working folder.
    Raises InputError for an unknown camera and for the first wrong field; :func:`check_camera` lists all errors.
    """
    if isinstance(name, Mapping):
        return checked_camera(plain_tables(name), "the dict", ".")
    text, where, folder = camera_text(name)
    try:
        data = toml_tables(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where} is not valid TOML: {error}.") from None
    return checked_camera(data, where, folder)


class CameraText(NamedTuple):
    """Text of a camera file, its name in messages, and the folder where its paths start."""

    text: str
    where: str
    folder: str = "."


def _meant(name: str) -> str:
    """Return `` Did you mean …?`` with cameras whose name or description holds this text, else with a close name."""
    cameras = cameras_with(name) if len(name) >= SEARCHED_LETTERS_MIN else []
    named = [repr(camera) for camera in cameras if _letters(name) in _letters(camera)]
    described = (f"{camera!r} ({description_of(camera)})" for camera in cameras)
    if not cameras:
        return nearest(name, list_cameras())
    return f" Did you mean {' or '.join(named or described)}?"


def camera_text(name: str | Path) -> CameraText:
    """Return the text of an included camera, of a camera file, or the text itself. Raises InputError."""
    if not isinstance(name, str | Path):
        raise InputError(
            f"name is {shown(name)}; pass the name of a camera, a .toml path, TOML text or a dict of tables."
        )
    if _is_text(name):
        return CameraText(str(name), TOML_TEXT)
    shipped, path = list_cameras(), Path(name)
    if isinstance(name, str) and name in shipped:
        return CameraText(shipped_text(name), f"{name}.toml")
    if path.suffix != ".toml" and not (str(name) and os.path.exists(path)):
        remedy = " Pass the path of a .toml file, or a name from ms.list_cameras()."
        meant = _meant(str(name)) or nearest_file(str(name), ".toml")
        raise InputError(f"unknown camera {str(name)[:200]!r}.{meant or remedy}")
    try:
        require_small(path, "the camera file")
        return CameraText(path.read_text("utf-8"), str(path), str(path.parent))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        near = nearest_file(str(path), ".toml") if isinstance(error, FileNotFoundError) else ""
        raise InputError(f"the camera file {path} cannot be read: {reason}.{near}") from None


def plain_tables(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables with NumPy values and paths converted to TOML's types."""
    return {str(key): _plain(value) for key, value in data.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return plain_tables(value)
    if isinstance(value, list | tuple):
        return [_plain(element) for element in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


def _is_text(name: str | Path) -> bool:
    """Return True for the text of a camera file: it has line breaks, or an = outside a path."""
    if not isinstance(name, str) or "\n" in name:
        return isinstance(name, str)
    return "=" in name and not name.endswith(".toml") and not os.path.exists(name)


def camera_from(data: dict[str, Any], where: str) -> Camera:
    """Return the camera of these tables from :meth:`Camera.model_dump`.  where : begins an error. Raises InputError."""
    return checked_camera(data, where)


def toml_value(text: str) -> Any:
    """Return a value written as in a camera file: 14, 0.5, true, [1, 2]; none or nothing is None; else a text."""
    if text in ("", "none"):
        return None
    try:
        return toml_tables(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def description_of(name: str) -> str:
    """Return the one-line description of an included camera."""
    line = re.search(r'^description = "(.*)"$', shipped_text(name), re.M)
    return line[1] if line else ""


def cameras_with(text: str) -> list[str]:
    """Return the cameras whose name or description holds each word, in any spelling: imx477, IMX-477, "pi hq"."""
    words = list(filter(None, map(_letters, text.split())))
    names = {name: _letters(name) for name in list_cameras()}
    described = {name: _letters(f"{name} {description_of(name)}") for name in names}
    matches = [n for n in names if words and all(word in described[n] for word in words)]
    return sorted(matches, key=lambda name: not all(word in names[name] for word in words))


def _letters(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())
