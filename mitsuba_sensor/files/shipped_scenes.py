"""Included scenes: their names, descriptions, parameters, sensors and emitters.

A checkout has them in ``scenes/``, an installed package in its own folder.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from ..core import InputError, nearest
from .sensor_names import sensor_name

PACKAGE = Path(__file__).parents[1]
SCENE, MOTION = ".xml", ".toml"
"""Suffixes of scene files, and of files that describe the motion in the scene of the same name."""
NAME = re.compile(r"\w{1,64}")
COMMENT = r"<!--(?:(?!-->).)*-->"
DEFAULT = re.compile(
    rf'(?P<comment>{COMMENT}\s*)?<default name="(?P<name>\w+)" value="(?P<value>[^"]*)"', re.S
)


class SceneParameter(NamedTuple):
    """A <default> of a scene file.  meaning : comment above it or its group, or ""."""

    name: str
    value: str
    meaning: str


class SceneEmitter(NamedTuple):
    """An emitter of a scene file.  id : name for ``render --light-groups``, or ""."""

    id: str
    type: str


def scenes_folder() -> Path:
    """Return the folder of the scenes on this machine."""
    installed = PACKAGE / "scenes"
    return installed if installed.is_dir() else PACKAGE.parent / "scenes"


def list_scenes() -> list[str]:
    """Return the names of the included scenes."""
    return sorted(file.stem for file in scenes_folder().glob(f"*{SCENE}"))


def shipped_file(
    name: object, end: str, folders: Iterable[str | os.PathLike[str]] = (".",)
) -> Path | None:
    """Return the included scene or motion file of this name; None if one of the folders has a file of this name.

    end : SCENE or MOTION.
    """
    if not isinstance(name, str) or not NAME.fullmatch(name):
        return None
    if any(os.path.isfile(os.path.join(folder, name)) for folder in folders):
        return None
    file = scenes_folder() / f"{name}{end}"
    return file if file.is_file() else None


def names_of_scenes(given: str) -> str:
    """Return the end of a sentence: the command that lists the names, the names, and the most similar one."""
    names = list_scenes()
    return f"a name from `mitsuba-sensor scenes list`: {', '.join(names)}.{nearest(Path(given).stem, names)}"


def scene_file(name: str) -> Path:
    """Return the file of an included scene. Raises InputError for another name."""
    if name not in list_scenes():
        raise InputError(f"unknown scene {name[:200]!r}; give {names_of_scenes(name)}")
    return scenes_folder() / f"{name}{SCENE}"


def scene_description(name: str) -> str:
    """Return the first sentence of the comment at the start of a scene file."""
    comment = re.search(COMMENT, scene_file(name).read_text("utf-8"), re.S)
    return re.split(r"(?<=\.)(?:\s|$)", _plain(comment[0] if comment else ""))[0]


def scene_parameters(name: str) -> list[SceneParameter]:
    """Return the <default> elements of a scene, in order."""
    parameters, meaning = [], ""
    for one in DEFAULT.finditer(scene_file(name).read_text("utf-8")):
        meaning = _plain(one["comment"]) if one["comment"] else meaning
        parameters.append(SceneParameter(one["name"], one["value"], meaning))
    return parameters


def scene_sensors(name: str) -> list[str]:
    """Return the names of the sensors of a scene for ``render --sensor``, in order."""
    tags = re.findall(r"<sensor\b[^>]*>", _elements(scene_file(name)))
    ids = (re.search(r'\bid="([^"]*)"', tag) for tag in tags)
    return [sensor_name(given[1] if given else "", number) for number, given in enumerate(ids)]


def scene_emitters(name: str) -> list[SceneEmitter]:
    """Return the emitters of a scene, in order."""
    tags = re.findall(r"<emitter\b[^>]*>", _elements(scene_file(name)))
    attributes = (dict(re.findall(r'\b(type|id)="([^"]*)"', tag)) for tag in tags)
    return [SceneEmitter(given.get("id", ""), given["type"]) for given in attributes]


def _elements(file: Path) -> str:
    """Return the text of a scene without comments, followed by its included files."""
    text = re.sub(COMMENT, "", file.read_text("utf-8"), flags=re.S)
    included = re.findall(r'<include\b[^>]*\bfilename="([^"]+)"', text)
    return "\n".join([text, *(_elements(file.parent / name) for name in included)])


def _plain(comment: str) -> str:
    return " ".join(comment.strip().removeprefix("<!--").removesuffix("-->").split())
