"""The scenes that ship with the package: found by name, listed, described.

They are in ``scenes/`` of a checkout; in an installed package they lie inside of it.
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
"""Ends of the names of scene files, and of files that say what moves in the scene of the same name."""
NAME = re.compile(r"\w{1,64}")
COMMENT = r"<!--(?:(?!-->).)*-->"
DEFAULT = re.compile(
    rf'(?P<comment>{COMMENT}\s*)?<default name="(?P<name>\w+)" value="(?P<value>[^"]*)"', re.S
)


class SceneParameter(NamedTuple):
    """A <default> of a scene file.  meaning : the comment above it, or nothing."""

    name: str
    value: str
    meaning: str


class SceneEmitter(NamedTuple):
    """An emitter of a scene file.  id : for ``render --light-groups``; empty where it has none."""

    id: str
    type: str


def scenes_folder() -> Path:
    """Where the scenes are on this machine."""
    installed = PACKAGE / "scenes"
    if installed.is_dir():
        return installed
    return PACKAGE.parent / "scenes"


def list_scenes() -> list[str]:
    """Names of the scenes that ship with the package."""
    return sorted(file.stem for file in scenes_folder().glob(f"*{SCENE}"))


def shipped_file(
    name: object, end: str, folders: Iterable[str | os.PathLike[str]] = (".",)
) -> Path | None:
    """The scene or motion file that ships under this name.

    None where there is none, and where one of the folders has a file that is called so.  end : SCENE or MOTION.
    """
    if not isinstance(name, str) or not NAME.fullmatch(name):
        return None
    if any(os.path.isfile(os.path.join(folder, name)) for folder in folders):
        return None
    file = scenes_folder() / f"{name}{end}"
    if file.is_file():
        return file
    return None


def names_of_scenes(given: str) -> str:
    """Where to find the names, which there are, and the one that was perhaps meant: the end of a sentence."""
    names = list_scenes()
    return f"a name from `mitsuba-sensor scenes list`: {', '.join(names)}.{nearest(Path(given).stem, names)}"


def scene_file(name: str) -> Path:
    """The file of a scene that ships with the package. Raises InputError for another name."""
    if name not in list_scenes():
        raise InputError(
            f"{name[:200]!r} is no scene that ships with mitsuba_sensor; give {names_of_scenes(name)}"
        )
    return scenes_folder() / f"{name}{SCENE}"


def scene_description(name: str) -> str:
    """The first sentence of the comment at the beginning of a scene file."""
    comment = re.search(COMMENT, scene_file(name).read_text("utf-8"), re.S)
    return re.split(r"(?<=\.)(?:\s|$)", _plain(comment[0] if comment else ""))[0]


def scene_parameters(name: str) -> list[SceneParameter]:
    """Its <default> elements, in their order."""
    return [
        SceneParameter(one["name"], one["value"], _plain(one["comment"] or ""))
        for one in DEFAULT.finditer(scene_file(name).read_text("utf-8"))
    ]


def scene_sensors(name: str) -> list[str]:
    """What ``render --sensor`` calls its sensors, in their order."""
    text = _elements(scene_file(name))
    sensors = list[str]()
    for number, tag in enumerate(re.findall(r"<sensor\b[^>]*>", text)):
        given = re.search(r'\bid="([^"]*)"', tag)
        sensors.append(sensor_name(given[1] if given else "", number))
    return sensors


def scene_emitters(name: str) -> list[SceneEmitter]:
    """Its emitters in their order."""
    text = _elements(scene_file(name))
    emitters = list[SceneEmitter]()
    for tag in re.findall(r"<emitter\b[^>]*>", text):
        given = dict(re.findall(r'\b(type|id)="([^"]*)"', tag))
        emitters.append(SceneEmitter(given.get("id", ""), given["type"]))
    return emitters


def _elements(file: Path) -> str:
    """The text of a scene without comments, and that of the files it includes behind it."""
    text = re.sub(COMMENT, "", file.read_text("utf-8"), flags=re.S)
    included = re.findall(r'<include\b[^>]*\bfilename="([^"]+)"', text)
    return "\n".join([text, *(_elements(file.parent / name) for name in included)])


def _plain(comment: str) -> str:
    return " ".join(comment.strip().removeprefix("<!--").removesuffix("-->").split())
