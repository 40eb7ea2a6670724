"""Parses the text of a scene: its parameters, old formats, and what was changed so that Mitsuba 3 reads it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ...core import InputError, nearest
from ...files.scene_xml import require_scene_file, require_shallow
from ...files.shipped_scenes import SCENE, shipped_file
from ..variants import MitsubaObject, mitsuba, own_folder_first, parser_config
from . import old_formats, old_text
from .plugin_names import refuse_foreign_plugins
from .scene_file import SceneFile, as_input_error, is_old, searching, with_integrator

NAME_OF_TEXT = "XML text"
"""What a scene that is given as text is called in messages."""


class SceneText(NamedTuple):
    """The text of a scene, and the file that it stands in, or would stand in.

    text : as it was written.  is_file : whether it was read from the file.
    """

    file: Path
    text: str
    is_file: bool


class UpgradedText(NamedTuple):
    """The text of a scene in the terms of Mitsuba 3.

    tags : elements that were changed.  values : of the parameters that are left in it.
    """

    text: str
    tags: list[str]
    values: dict[str, str]


class ParsedNodes(NamedTuple):
    """Mitsuba's own parser state.

    config : of the parser.  resolver : finds files that the scene names.  changed : nodes of old formats, and what
    they became.
    """

    config: MitsubaObject
    state: MitsubaObject
    resolver: MitsubaObject
    changed: list[tuple[MitsubaObject, str]]


def parse_scene(
    path: str | os.PathLike[str],
    parameters: Mapping[str, object],
    integrator: str | None = None,
    ignore_polarization: bool = False,
) -> SceneFile:
    """Parse a scene file, one that ships with the package by its name, or the text of one. Raises InputError.

    No variant need be set, except to read colours and transforms.
    integrator, ignore_polarization : see :class:`render.options.SceneOptions`.
    """
    source = read_scene_text(path)
    values = {str(name): str(value) for name, value in parameters.items()}
    refuse_unknown_parameters(source, values)
    upgraded = upgrade_text(source, values)
    nodes = parse_nodes(source, upgraded)
    refuse_other_documents(nodes.state, source.file)
    scene = SceneFile(
        source.file,
        nodes.config,
        nodes.state,
        values,
        nodes.resolver,
        parameters=tuple(parameter_names(source.text)),
        exposure_s=exposure_parameter(source.text, values),
        text=upgraded.text,
        ignore_polarization=ignore_polarization,
        content=b"" if source.is_file else source.text.encode(),
    )
    changes = changes_of_format(scene, source, upgraded, nodes, integrator)
    return with_integrator(replace(scene, changes=changes), integrator)


def is_text(scene: object) -> bool:
    """Whether a scene is given as XML text, and not as a path."""
    return isinstance(scene, str) and scene.lstrip("\ufeff \t\r\n").startswith("<")


def read_scene_text(path: str | os.PathLike[str]) -> SceneText:
    """The text of a scene file, or the text that was given in its place. Raises InputError."""
    if is_text(path):
        source = SceneText(Path(NAME_OF_TEXT), str(path), is_file=False)
    else:
        place = shipped_file(path, SCENE) or path
        require_scene_file(os.fspath(place))
        file = Path(place)
        text = file.read_text(encoding="utf-8", errors="replace")
        source = SceneText(file, text, is_file=True)
    require_shallow(source.text, source.file)
    return source


def parameter_names(text: str) -> list[str]:
    """Names that a scene's text has for values, in alphabetical order."""
    defaults = re.findall(r'<default\s+name="(\w+)"', text)
    used = re.findall(r"\$\{?(\w+)", text)
    return sorted({*defaults, *used})


def refuse_unknown_parameters(source: SceneText, values: Mapping[str, str]) -> None:
    """Raise InputError for a value that the scene has no name for. Names in included files are left to Mitsuba."""
    known = parameter_names(source.text)
    unknown = [name for name in values if name not in known]
    if not unknown or "<include" in source.text:
        return
    has = f"it has {', '.join(known)}" if known else "it has none"
    raise InputError(
        f"scene {str(source.file)!r} has no parameter {unknown[0]!r}; {has}.{nearest(unknown[0], known)}"
    )


def exposure_parameter(text: str, values: Mapping[str, str]) -> str | None:
    """Value of the ``<default>`` called exposure_s, which no element need use; None where there is none."""
    usual = re.search(r'<default\s+name="exposure_s"\s+value="([^"]*)"', text)
    return values.get("exposure_s", usual[1]) if usual else None


def upgrade_text(source: SceneText, values: dict[str, str]) -> UpgradedText:
    """The text in the terms of Mitsuba 3, and the values that it still uses: Mitsuba refuses others."""
    text, tags = source.text, list[str]()
    if is_old(text):
        whole = _with_old_includes(text, source.file.parent)
        text, tags = old_text.upgraded_text(whole, values)
    used = dict(values)
    for name in values:
        mark = f"${name}"
        was_used = name == "exposure_s" or mark in source.text
        if was_used and mark not in text:
            del used[name]
    return UpgradedText(text, tags, used)


def parse_nodes(source: SceneText, upgraded: UpgradedText) -> ParsedNodes:
    """The nodes of a scene, old formats in the terms of Mitsuba 3. Raises InputError."""
    mi, config, file = mitsuba(), parser_config(), source.file
    beside = type(mi.file_resolver())(mi.file_resolver())
    beside.prepend(str(file.resolve().parent))
    with searching(beside), as_input_error(file, values=upgraded.values):
        if source.is_file and not upgraded.tags:
            state = mi.parser.parse_file(config, str(file), **upgraded.values)
        else:
            state = mi.parser.parse_string(config, upgraded.text, **upgraded.values)
        mi.parser.transform_upgrade(config, state)
        changed = old_formats.upgrade(state)
        mi.parser.transform_resolve(config, state)
        resolver = mi.file_resolver()
        own_folder_first(resolver)
        refuse_foreign_plugins(str(file), state, resolver)
    return ParsedNodes(config, state, resolver, changed)


def refuse_other_documents(state: MitsubaObject, file: Path) -> None:
    """Raise InputError for a document that is no scene, and for a format that Mitsuba 3 does not know."""
    if state.nodes[0].type != mitsuba().ObjectType.Scene:
        raise InputError(
            f'{str(file)!r} holds no scene; its outermost element must be <scene version="3.0.0">.'
        )
    for version in map(str, state.versions):
        if int(version.split(".")[0]) > old_text.CURRENT[0]:
            newest = f'formats up to 3 can be read: write version="{old_text.version_name("")}", if it is one of these'
            raise InputError(
                f"scene {str(file)!r} has the format of Mitsuba {version}; {newest}."
            )


def changes_of_format(
    scene: SceneFile,
    source: SceneText,
    upgraded: UpgradedText,
    nodes: ParsedNodes,
    integrator: str | None,
) -> tuple[tuple[str, tuple[str, str]], ...]:
    """Where a scene of an old format was changed, what it became and why.

    integrator : that is asked for in place of the scene's own, of which nothing is said then.
    """
    why = f"converted from the format of Mitsuba {old_text.version_name(source.text)}"
    changes = []
    if upgraded.tags:
        what = f"<{', '.join(upgraded.tags)}> in the terms of Mitsuba 3"
        changes.append((scene.where(nodes.state.nodes[0]), (what, why)))
    for node, what in nodes.changed:
        replaced = node.type == mitsuba().ObjectType.Integrator and integrator is not None
        if not replaced:
            changes.append((scene.where(node), (what, why)))
    return tuple(changes)


def _with_old_includes(text: str, folder: Path) -> str:
    """The text with the old files that it includes in place of the <include>, on its line: they too must be changed."""

    def content(found: re.Match[str]) -> str:
        file = folder / found[1]
        inner = file.read_text(encoding="utf-8", errors="replace") if file.is_file() else ""
        if not is_old(inner):
            return found[0]
        body = re.search(
            r"<scene[^>]*>(.*)</scene>",
            re.sub(r"<!--.*?-->", "", inner, flags=re.DOTALL),
            re.DOTALL,
        )
        return " ".join(_with_old_includes(body[1], file.parent).split()) if body else found[0]

    return re.sub(r'<include\s+filename="([^"$]+)"\s*/>', content, text)
