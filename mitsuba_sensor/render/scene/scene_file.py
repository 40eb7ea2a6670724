"""Parses a scene file without building it: its nodes, their line numbers, and its errors as one sentence."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ...core import InputError, nearest
from ...files.scene_xml import require_scene_file, require_shallow
from ..variants import MitsubaObject, mitsuba, own_folder_first, parser_config
from . import old_formats, old_text
from .plugin_names import meant, refuse_foreign_plugins, remedy_for_unknown
from .scene_edits import SceneEdits

EXAMPLE_SENSOR = (
    '<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">'
    '<lookat origin="0, 1, 4" target="0, 1, 0" up="0, 1, 0"/></transform></sensor>'
)
NAME_OF_TEXT = "XML text"  # what a scene that is given as text is called in messages
LONGEST = 1000  # characters of a message of Mitsuba, which repeats the values of a scene
AS_TEXT = (
    "<string>"  # the name that Mitsuba gives to a file that was changed before it was parsed
)
POLARISING = ("circular", "polarizer", "retarder", "measured_polarized")


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A parsed scene: Mitsuba's parser state, whose nodes[0] is the scene, and values for its ``<default>`` names.

    exposure_s : value of the ``<default>`` of that name, which no element need use.
    changes : where, what was changed in it and why: an old format, or another integrator that was asked for.
    content : what was given instead of a file, or stands for it in the digest.
    loaded : view of a scene that Mitsuba has loaded, of which only the sensor is in the nodes; else None.
    text : what was parsed, if not the file as it is; Mitsuba's state refers to it and does not keep it.
    ignore_polarization : whether elements that polarise light are rendered in unpolarised light.
    resolver : finds meshes and textures beside the file and in the folders that its ``<path>`` elements name.
    edits : what is changed when it is built.
    """

    path: Path
    config: MitsubaObject
    state: MitsubaObject
    values: Mapping[str, str]
    resolver: MitsubaObject
    exposure_s: str | None = None
    changes: tuple[tuple[str, tuple[str, str]], ...] = ()
    text: str = ""
    ignore_polarization: bool = False
    content: bytes = b""
    loaded: MitsubaObject = None
    edits: SceneEdits = field(default_factory=SceneEdits)

    @property
    def name(self) -> str:
        """What messages call the scene: the path as it was given."""
        return str(self.path)

    @property
    def root(self) -> MitsubaObject:
        """The properties of the scene itself."""
        return self.state.nodes[0].props

    def children(self, props: MitsubaObject, *kinds: str) -> list[tuple[str, MitsubaObject]]:
        """(name, node) of the objects nested in a node; of these types only, where any are named."""
        mi, nodes = mitsuba(), self.state.nodes
        types = [getattr(mi.ObjectType, kind) for kind in kinds]
        names = (
            name for name in props if props.type(name) == mi.Properties.Type.ResolvedReference
        )
        found = [(name, nodes[props[name].index()]) for name in names]
        return [(name, node) for name, node in found if not kinds or node.type in types]

    def nodes(self, *kinds: str) -> list[MitsubaObject]:
        """All nodes of these types."""
        types = [getattr(mitsuba().ObjectType, kind) for kind in kinds]
        return [node for node in self.state.nodes if node.type in types]

    def where(self, node: MitsubaObject) -> str:
        """``line 12``, with the name of the file if it is an included one."""
        text: str = mitsuba().parser.file_location(self.state, node)
        found = re.fullmatch(r"(.*) \(line (\d+), col \d+\)", text)
        if not found:  # of a dict
            return text.removeprefix("dictionary ")
        return (
            f"line {found[2]}"
            if node.file_index == 0
            else f"{Path(found[1]).name} line {found[2]}"
        )

    def sensor(self) -> MitsubaObject:
        """The node of the scene's first sensor; raises InputError if there is none."""
        for _, sensor in self.children(self.root, "Sensor"):
            return sensor
        raise InputError(f"scene {self.name!r} has no sensor; add one, e.g. {EXAMPLE_SENSOR}.")

    def film(self) -> MitsubaObject:
        """The node of that sensor's film; None where it has Mitsuba's default."""
        return next((node for _, node in self.children(self.sensor().props, "Film")), None)

    def digest(self) -> str:
        """SHA-256 over parameters, scene file, its includes and edits; not over meshes and textures."""
        digest = hashlib.sha256(json.dumps(sorted(self.values.items())).encode() + self.content)
        for file in self.state.files:
            if str(file) != AS_TEXT or not self.content:
                path = self.path if str(file) == AS_TEXT else Path(str(file))
                digest.update(path.read_bytes())
        if self.changes:
            digest.update(json.dumps(self.changes).encode())
        digest.update(self.edits.digest())
        return digest.hexdigest()

    def build(self) -> MitsubaObject:
        """The scene itself; raises InputError for whatever is missing or wrong."""
        mi = mitsuba()
        state = mi.parser.ParserState(
            self.state
        )  # a copy, because the transforms leave nothing where it was
        for node in state.nodes:
            for name in node.props:  # what was read here would count as known to the plugin
                node.props.mark_queried(name, False)
            picture = node.props.get("bitmap", None)
            if isinstance(picture, mi.Bitmap):
                node.props["bitmap"] = mi.Bitmap(
                    picture
                )  # Mitsuba takes the pixels out of what it is given
        with searching(self.resolver), as_input_error(self.path):
            mi.parser.transform_all(self.config, state)
            built = mi.parser.instantiate(self.config, state)
            scene = built[0] if isinstance(built, list) else built
            self.edits.apply(scene)
        return scene


def parse_scene(
    path: str | os.PathLike[str],
    parameters: Mapping[str, object],
    integrator: str | None = None,
    ignore_polarization: bool = False,
) -> SceneFile:
    """Parse a scene file, or its text. Raises InputError.

    No variant need be set, except to read colours and transforms.
    integrator, ignore_polarization : see :class:`render.options.SceneOptions`.
    """
    given = path if is_text(path) else ""
    file, mi = Path(NAME_OF_TEXT if given else path), mitsuba()
    if not given:
        require_scene_file(os.fspath(path))
    values = {str(k): str(v) for k, v in parameters.items()}
    text = str(given) or file.read_text(encoding="utf-8", errors="replace")
    require_shallow(text, file)
    usual = re.search(r'<default\s+name="exposure_s"\s+value="([^"]*)"', text)
    exposure_s = values.get("exposure_s", usual[1]) if usual else None
    known = sorted(
        {*re.findall(r'<default\s+name="(\w+)"', text), *re.findall(r"\$\{?(\w+)", text)}
    )
    unknown = next((name for name in values if name not in known), None)
    if (
        unknown is not None and "<include" not in text
    ):  # names in included files are left to Mitsuba
        has = f"it has {', '.join(known)}" if known else "it has none"
        raise InputError(
            f"scene {str(file)!r} has no parameter {unknown!r}; {has}.{nearest(unknown, known)}"
        )
    config = parser_config()
    beside = type(mi.file_resolver())(mi.file_resolver())
    beside.prepend(str(file.resolve().parent))
    old = _with_old_includes(text, file.parent) if is_old(text) else ""
    new, tags = old_text.upgraded_text(old, values) if old else (text, [])
    gone = [
        name
        for name in values
        if f"${name}" not in new and (name == "exposure_s" or f"${name}" in text)
    ]
    used = {
        name: value for name, value in values.items() if name not in gone
    }  # Mitsuba refuses what is not used
    with searching(beside), as_input_error(file):
        as_text, name = bool(tags or given), str(file)
        state = (
            mi.parser.parse_string(config, new, **used)
            if as_text
            else mi.parser.parse_file(config, name, **used)
        )
        mi.parser.transform_upgrade(config, state)
        changed = old_formats.upgrade(state)
        mi.parser.transform_resolve(config, state)
        resolver = mi.file_resolver()
        own_folder_first(resolver)
        refuse_foreign_plugins(str(file), state, resolver)
    if state.nodes[0].type != mi.ObjectType.Scene:
        raise InputError(
            f'{str(file)!r} holds no scene; its outermost element must be <scene version="3.0.0">.'
        )
    _refuse_newer(state, file)
    content = str(given).encode()
    scene = SceneFile(
        file, config, state, values, resolver, exposure_s, (), new, ignore_polarization, content
    )
    converted = f"converted from the format of Mitsuba {old_text.version_name(text)}"
    changes = [
        (
            scene.where(state.nodes[0]),
            (f"<{', '.join(tags)}> in the terms of Mitsuba 3", converted),
        )
    ][: len(tags)]
    if integrator is not None:
        changed = [one for one in changed if one[0].type != mi.ObjectType.Integrator]
    changes += [(scene.where(node), (what, converted)) for node, what in changed]
    return with_integrator(replace(scene, changes=tuple(changes)), integrator)


def _refuse_newer(state: MitsubaObject, file: Path) -> None:
    """InputError for a format that Mitsuba 3 does not know, and reads all the same."""
    for version in map(str, state.versions):
        if int(version.split(".")[0]) > old_text.CURRENT[0]:
            newest = f'formats up to 3 can be read: write version="{old_text.version_name("")}", if it is one of these'
            raise InputError(
                f"scene {str(file)!r} has the format of Mitsuba {version}; {newest}."
            )


def with_integrator(scene: SceneFile, integrator: str | None) -> SceneFile:
    """The scene with the integrator that is asked for, if any, in place of its own."""
    if integrator is None:
        return scene
    asked = old_formats.take_integrator(
        scene.root, scene.children(scene.root, "Integrator"), integrator
    )
    changes = [
        (scene.where(node), (what, "leave the option out for the scene's own"))
        for node, what in asked
    ]
    return replace(scene, changes=(*scene.changes, *changes))


def is_text(scene: object) -> bool:
    """Whether a scene is given as XML text, and not as a path."""
    return isinstance(scene, str) and scene.lstrip("\ufeff \t\r\n").startswith("<")


def is_old(text: str) -> bool:
    """Whether a scene file has the format of a Mitsuba before version 3."""
    return old_text.version_of(text) < old_text.CURRENT


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


@contextlib.contextmanager
def searching(resolver: MitsubaObject) -> Iterator[None]:
    """Let Mitsuba find files with this resolver inside the ``with`` block."""
    mi = mitsuba()
    before = mi.file_resolver()
    mi.set_file_resolver(resolver)
    try:
        yield
    finally:
        mi.set_file_resolver(before)


@contextlib.contextmanager
def as_input_error(file: Path, place: str = "") -> Iterator[None]:
    """Turn Mitsuba's RuntimeError about a file into an InputError; that of an old file names its format.

    place : in the file, where Mitsuba does not know it.
    """
    try:
        yield
    except RuntimeError as error:
        begin, name = (
            "At|While loading|Error while loading|Parsing of XML file",
            re.escape(str(file)),
        )
        known = f'{name}|{re.escape(str(file.resolve()))}|string|dictionary node "root'
        where = rf'(?:{begin}) "?(?:{known})"?(?: failed)?:? '
        text = re.sub(where, "", plain_message(error))
        said = f"scene {str(file)!r} cannot be loaded: {place}{text}{_remedy(text, file)}"
        raise InputError(_with_version(said, file)) from error
    except InputError as error:
        raise InputError(_with_version(str(error), file)) from error


def _with_version(said: str, file: Path) -> str:
    """An error with the format of the file, where that is an old one; once."""
    if not file.is_file():
        return said
    text = file.read_text(encoding="utf-8", errors="replace")
    if not is_old(text) or "The file has the format" in said:
        return said
    version = old_text.version_name(text)
    return f"{said} The file has the format of Mitsuba {version}; what has an equivalent in version 3 was converted."


def plain_message(error: BaseException) -> str:
    """Mitsuba's message without its source lines and line breaks."""
    text = re.sub(r"\[\w+\.(?:cpp|h|py):\d+\]\s*", "", str(error))
    text = re.sub(r"[\s\x00-\x1f\x7f]+", " ", text).strip().rstrip(".!")
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} …"


def _remedy(message: str, file: Path) -> str:
    """The way out that belongs to Mitsuba's message, from the full stop or semicolon on."""
    if "No document element found" in message:
        return "; it is no XML, or empty: give the path of a Mitsuba 3 scene."
    if "undefined parameter" in message:
        return "; give it a value (-D name=value)."
    if "unreferenced propert" in message:
        return f".{meant(message)}"
    unknown = re.search(r'Plugin "(\w+)" not found', message)
    if unknown:
        remedy, of_integrator = (
            remedy_for_unknown(unknown[1]),
            "failed to instantiate integrator" in message,
        )
        way_out = (
            "; take --integrator path (integrator='path')"
            if of_integrator and remedy.startswith(".")
            else ""
        )
        return f"{way_out}{remedy}"
    return "."
