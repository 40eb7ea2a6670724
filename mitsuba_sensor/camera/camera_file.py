"""Cameras that ship with the package by name, any camera file by path, and cameras from a text or a dict."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, overload

import numpy as np

from ..core import InputError, nearest
from ..core.small_files import require_small, toml_tables
from .camera import Camera, checked_camera
from .shipped import SHIPPED, list_cameras

AnyCamera: TypeAlias = Camera | str | Path
"""A camera, or what :func:`load_camera` takes: the name of one that ships with the package, or a file."""

SHORTEST_TEXT, MOST_DESCRIBED = 3, 4
"""Letters of a text that descriptions are searched for, and cameras that are proposed with their descriptions."""

TOML_TEXT = "the TOML text"
"""What a camera that is given as text is called in messages."""


@overload
def camera_of(camera: AnyCamera) -> Camera: ...
@overload
def camera_of(camera: AnyCamera | None) -> Camera | None: ...
def camera_of(camera: AnyCamera | None) -> Camera | None:
    """The camera itself, or the one of this name or file; None stays None. Raises InputError."""
    if isinstance(camera, str):
        return _shipped_camera(camera) or load_camera(camera)
    return load_camera(camera) if isinstance(camera, Path) else camera


@cache
def _shipped_camera(name: str) -> Camera | None:
    """A camera that ships with the package, checked in the first call only; None for another name."""
    return load_camera(name) if name in list_cameras() else None


def load_camera(name: str | Path | Mapping[str, Any]) -> Camera:
    """A shipped camera by name (``konnik_table1``), any camera file by path (``my.toml``), or a camera that is no file.

    ::

        camera = ms.load_camera("konnik_table1").replace(**{"adc.bits": 14})
        print(camera.emva1288())

    name : also the text of a camera file, which has line breaks, or its tables as a dict,
        ``{"name": "mine", "sensor": {"columns": 640, …}, …}``. Files that these name are sought in the working folder.
    Raises InputError when there is no such camera or a field is wrong; :func:`check_camera` finds all that is wrong.
    """
    if isinstance(name, Mapping):
        return checked_camera(plain_tables(name), "the dict", ".")
    text, where, folder = camera_text(name)
    try:
        data = toml_tables(text)
    except tomllib.TOMLDecodeError as error:
        if where == TOML_TEXT:
            what = where
        else:
            what = f"The camera file {where}"
        raise InputError(f"{what} is not valid TOML: {error}.") from None
    return checked_camera(data, where, folder)


class CameraText(NamedTuple):
    """The text of a camera file, its name for messages, and the folder of files that it names."""

    text: str
    where: str
    folder: str = "."


def _meant(name: str) -> str:
    """`` Did you mean …?`` with the cameras that have this text in name or description, a sensor for example, else
    the one whose name is close."""
    found = cameras_with(name) if len(name) >= SHORTEST_TEXT else []
    found = [one for one in found if _letters(name) in _letters(one)] or found
    if not found:
        return nearest(name, list_cameras())
    if len(found) > MOST_DESCRIBED:
        return f" Did you mean one of {', '.join(map(repr, found))}?"
    return f" Did you mean {'; '.join(f'{one!r} ({description_of(one)})' for one in found)}?"


def camera_text(name: str | Path) -> CameraText:
    """The file of a shipped camera by name, any camera file by path, or its text itself. Raises InputError."""
    if not isinstance(name, str | Path):
        raise InputError(
            f"name is {name!r}; pass the name of a camera or the path of a .toml file, or a camera itself, as its text "
            "or a dict of its tables."
        )
    if _is_text(name):
        return CameraText(str(name), TOML_TEXT)
    shipped, path = list_cameras(), Path(name)
    if isinstance(name, str) and name in shipped:
        return CameraText(_shipped_text(name), f"{name}.toml")
    if path.suffix != ".toml" and not (str(name) and os.path.exists(path)):
        raise InputError(
            f"unknown camera {str(name)[:200]!r}.{_meant(str(name))} Pass the path of a .toml file, or one of the "
            f"cameras included with mitsuba_sensor: {', '.join(shipped)}."
        )
    try:
        require_small(path, "the camera file")
        return CameraText(path.read_text("utf-8"), str(path), str(path.parent))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(f"The camera file {path} cannot be read: {reason}.") from None


def plain_tables(data: Mapping[str, Any]) -> dict[str, Any]:
    """The same tables with the numbers, texts and lists that a file would have, for NumPy's and paths."""
    return {str(key): _plain(value) for key, value in data.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return plain_tables(value)
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


def _is_text(name: str | Path) -> bool:
    """Whether it is the text of a camera file: it has line breaks, or an = that is not in a path."""
    if not isinstance(name, str) or "\n" in name:
        return isinstance(name, str)
    return "=" in name and not name.endswith(".toml") and not os.path.exists(name)


def camera_from(data: dict[str, Any], where: str) -> Camera:
    """The camera of these tables, as :meth:`Camera.model_dump` gives them.  where : for what is said of an error.

    Raises InputError.
    """
    return checked_camera(data, where)


def toml_value(text: str) -> Any:
    """A value as in a camera file: 14, 0.5, true, [1, 2]; None for none and for nothing; anything else is a text."""
    if text in ("", "none"):
        return None
    try:
        return toml_tables(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _shipped_text(name: str) -> str:
    """The text of the file of a camera that ships with the package."""
    return (SHIPPED / f"{name}.toml").read_text("utf-8")


def description_of(name: str) -> str:
    """Its line about itself."""
    found = re.search(r'^description = "(.*)"$', _shipped_text(name), re.M)
    return found[1] if found else ""


def cameras_with(text: str) -> list[str]:
    """Names of those whose name or description has each part of the text, in any writing: imx477, IMX-477, "pi hq"."""
    wanted = list(filter(None, map(_letters, text.split())))
    named = {name: _letters(name) for name in list_cameras()}
    described = {name: _letters(f"{name} {description_of(name)}") for name in named}
    found = [n for n in named if wanted and all(part in described[n] for part in wanted)]
    return sorted(found, key=lambda name: not all(part in named[name] for part in wanted))


def _letters(text: str) -> str:
    return re.sub(r"[^a-z0-9]", "", text.lower())
