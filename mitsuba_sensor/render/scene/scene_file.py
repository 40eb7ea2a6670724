"""Parses a scene file without building it: its nodes, their line numbers, and its errors as one sentence."""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from ...core import InputError
from ..variants import MitsubaObject, mitsuba
from . import old_formats, old_text
from .plugin_names import meant, remedy_for_unknown
from .scene_edits import SceneEdits

EXAMPLE_SENSOR = (
    '<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">'
    '<lookat origin="0, 1, 4" target="0, 1, 0" up="0, 1, 0"/></transform></sensor>'
)
LONGEST = 1000  # characters of a message of Mitsuba, which repeats the values of a scene
AS_TEXT = (
    "<string>"  # the name that Mitsuba gives to a file that was changed before it was parsed
)
IMAGING = ("perspective", "thinlens", "orthographic", "camera")
NO_IMAGE = {
    "irradiancemeter": "measures the irradiance on its shape",
    "radiancemeter": "measures the radiance along one ray",
    "distant": "measures the radiance that leaves the scene in one direction",
}
"""Sensors of Mitsuba without a focal plane, and what they do."""
POLARISING = ("circular", "polarizer", "retarder", "measured_polarized")


class ChosenSensor(NamedTuple):
    """A sensor of a scene.  key : its name in the properties of the scene.  number : its place among the sensors."""

    key: str
    name: str
    number: int


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A parsed scene: Mitsuba's parser state, whose nodes[0] is the scene, and values for its ``<default>`` names.

    parameters : names that it has for values.
    exposure_s : value of the ``<default>`` of that name, which no element need use.
    changes : where, what was changed in it and why: an old format, or another integrator that was asked for.
    content : what was given instead of a file, or stands for it in the digest.
    loaded : view of a scene that Mitsuba has loaded, of which only the sensor is in the nodes; else None.
    text : what was parsed, if not the file as it is; Mitsuba's state refers to it and does not keep it.
    ignore_polarization : whether elements that polarise light are rendered in unpolarised light.
    resolver : finds meshes and textures beside the file and in the folders that its ``<path>`` elements name.
    edits : what is changed when it is built.
    chosen : the sensor that was asked for; None for the first one.
    """

    path: Path
    config: MitsubaObject
    state: MitsubaObject
    values: Mapping[str, str]
    resolver: MitsubaObject
    parameters: tuple[str, ...] = ()
    exposure_s: str | None = None
    changes: tuple[tuple[str, tuple[str, str]], ...] = ()
    text: str = ""
    ignore_polarization: bool = False
    content: bytes = b""
    loaded: MitsubaObject = None
    edits: SceneEdits = field(default_factory=SceneEdits)
    chosen: ChosenSensor | None = None

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

    @property
    def holds_objects(self) -> bool:
        """Whether it was loaded by Mitsuba or is a dict with objects, which belong to one variant."""
        kind = mitsuba().Properties.Type.Object
        nodes = (node.props for node in self.state.nodes)
        return self.loaded is not None or any(
            props.type(name) == kind for props in nodes for name in props
        )

    def sensor(self) -> MitsubaObject:
        """The node of the sensor that was asked for, else of the first one; raises InputError if there is none."""
        for key, sensor in self.children(self.root, "Sensor"):
            if self.chosen is None or self.chosen.key == key:
                return sensor
        on_shapes = sorted({node.props.plugin_name() for node in self.nodes("Sensor")})
        but = (
            f" but {', '.join(on_shapes)} on a shape, which takes no image" if on_shapes else ""
        )
        raise InputError(
            f"scene {self.name!r} has no sensor{but}; add one, e.g. {EXAMPLE_SENSOR}."
        )

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
        if self.chosen is not None and self.chosen.number:
            digest.update(f"sensor {self.chosen.number}".encode())
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


def why_no_image(kind: str) -> str:
    """Why a sensor of this type cannot be rendered, and what can: the end of a sentence."""
    if kind == "batch":
        return (
            "'batch' puts several sensors on one film; move those of type perspective, thinlens or orthographic out of "
            "it into the scene, and `--sensor all` takes a frame of each"
        )
    many = ", ".join(IMAGING)
    if kind in NO_IMAGE:
        return f"{kind!r} {NO_IMAGE[kind]} and takes no image; replace it by one of {many}"
    return f"a sensor of type {kind!r} cannot be rendered; it must be one of {many}"


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


def is_old(text: str) -> bool:
    """Whether a scene file has the format of a Mitsuba before version 3."""
    return old_text.version_of(text) < old_text.CURRENT


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
def as_input_error(
    file: Path, place: str = "", values: Mapping[str, str] | None = None
) -> Iterator[None]:
    """Turn Mitsuba's RuntimeError about a file into an InputError; that of an old file names its format.

    place : in the file, where Mitsuba does not know it.  values : of the scene's parameters.
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
        said = f"scene {str(file)!r} cannot be loaded: {place}{text}{_remedy(text, file, values or {})}"
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


def _remedy(message: str, file: Path, values: Mapping[str, str]) -> str:
    """The way out that belongs to Mitsuba's message, from the full stop or semicolon on."""
    if "No document element found" in message:
        if file.suffix == ".exr":
            return (
                "; it is no XML: `mitsuba-sensor expose` takes light that is rendered already."
            )
        return "; it is no XML, or empty: give the path of a Mitsuba 3 scene."
    unreadable = re.search(r'[Cc]ould not parse (.*) value "(.*)"', message)
    for name, value in values.items():
        if unreadable and value == unreadable[2]:
            kind = unreadable[1]
            return f"; it is the value of the parameter {name} (-D {name}=…), which takes a value of the kind {kind}."
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
            "; take `--integrator path` (integrator='path'), or volpath if the scene has media"
            if of_integrator and remedy.startswith(".")
            else ""
        )
        return f"{way_out}{remedy}"
    return "."
