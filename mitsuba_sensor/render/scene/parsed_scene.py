"""A parsed scene before it is built: Mitsuba's parser state, and its settings of camera, exposure and seeds."""

from __future__ import annotations

import contextlib
import copy
import hashlib
import json
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from ...camera.camera import Camera
from ...core import InputError, first_given, nearest, require_seed
from ...files.sensor_names import ALL_SENSORS, sensor_name
from ..samples import hashed_seed
from ..variants import (
    MitsubaObject,
    Variant,
    is_polarized,
    mitsuba,
    parser_config,
    polarized,
    use,
)
from .loaded_scene import LoadedView
from .mitsuba_errors import mitsuba_errors, searching
from .scene_edits import SceneEdits
from .scene_settings import (
    FILM,
    FILM_FIELDS,
    PASSED_ON,
    SENSOR,
    SENSOR_FIELDS,
    SIZE,
    Fields,
    SceneSettings,
    film_fields_of,
    seconds_of,
    sensor_fields_of,
    settings_from,
)

EXAMPLE_SENSOR = (
    '<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">'
    '<lookat origin="0, 1, 4" target="0, 1, 0" up="0, 1, 0"/></transform></sensor>'
)
PIXELS_MAX = 2**28  # of one image; its bands alone need 64 GB
WIDTH, HEIGHT = 768, 576  # default of Mitsuba's films
TEXT_FILE = "<string>"
"""Mitsuba's name for a file that is given as text."""
POLARISING = ("circular", "polarizer", "retarder", "measured_polarized")
SENSOR_SEED = -4
"""Namespace of the seeds of sensors, see :func:`hashed_seed`."""
SCENES_OF_LOADED_EMITTERS: list[MitsubaObject] = []
"""Scenes that are never freed, one for each area emitter that a caller loaded: if he keeps the emitter of a freed
shape, the next render in a compiled variant crashes, because Mitsuba 3.9.1 asks the shapes of all emitters."""


class ChosenSensor(NamedTuple):
    """A sensor of a scene.  key : its name in the properties of the scene.  number : its index among the sensors."""

    key: str
    name: str
    number: int


@dataclass(frozen=True, eq=False)
class ParsedScene:
    """A scene in Mitsuba's parser state, whose nodes[0] is the scene, with its settings of camera, exposure and seeds.

    path : as given, for messages.
    variant : the variant that is set for it.
    resolver : finds meshes and textures beside the file and in the folders of its ``<path>`` elements.
    values : of its ``<default>`` names.  parameters : all of these names.
    exposure_s : value of the ``<default>`` of this name, which no element needs to use.
    changes : (where, what, why) of each change.
    text : the parsed text; Mitsuba's state refers to it without keeping it.
    content : representation in the digest of a scene without a file.
    loaded : view of a loaded scene; else None.
    ignore_polarization : True if elements that polarise light are rendered for unpolarised light.
    edits : changes that are made when it is built.
    chosen : the requested sensor; None for the first sensor.
    """

    path: Path
    variant: Variant
    config: MitsubaObject
    state: MitsubaObject
    resolver: MitsubaObject
    values: Mapping[str, str] = field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    exposure_s: str | None = None
    changes: tuple[tuple[str, str, str], ...] = ()
    text: str = ""
    content: bytes = b""
    loaded: LoadedView | None = None
    ignore_polarization: bool = False
    edits: SceneEdits = field(default_factory=SceneEdits)
    chosen: ChosenSensor | None = None
    settings: SceneSettings = field(default_factory=SceneSettings)

    @property
    def name(self) -> str:
        """Name of the scene in messages."""
        return str(self.path)

    @property
    def root(self) -> MitsubaObject:
        """Properties of the scene element."""
        return self.state.nodes[0].props

    def children(self, props: MitsubaObject, *kinds: str) -> list[tuple[str, MitsubaObject]]:
        """Return (name, node) of the objects nested in a node, restricted to these types if any are given."""
        mi, nodes = mitsuba(), self.state.nodes
        types = [getattr(mi.ObjectType, kind) for kind in kinds]
        nested = mi.Properties.Type.ResolvedReference
        names = (name for name in props if props.type(name) == nested)
        children = [(name, nodes[props[name].index()]) for name in names]
        return [(name, node) for name, node in children if not kinds or node.type in types]

    def nodes(self, *kinds: str) -> list[MitsubaObject]:
        """Return all nodes of these types."""
        types = [getattr(mitsuba().ObjectType, kind) for kind in kinds]
        return [node for node in self.state.nodes if node.type in types]

    def where(self, node: MitsubaObject) -> str:
        """Return ``line 12``, with the name of the file if it is an included file."""
        text: str = mitsuba().parser.file_location(self.state, node)
        place = re.fullmatch(r"(.*) \(line (\d+), col \d+\)", text)
        if not place:  # of a dict
            return text.removeprefix("dictionary ")
        file = "" if node.file_index == 0 else f"{Path(place[1]).name} "
        return f"{file}line {place[2]}"

    @property
    def holds_objects(self) -> bool:
        """True for a loaded scene or a dict with objects, which belong to one variant."""
        kind = mitsuba().Properties.Type.Object
        nodes = (node.props for node in self.state.nodes)
        return self.loaded is not None or any(
            props.type(name) == kind for props in nodes for name in props
        )

    def sensors(self) -> dict[str, ChosenSensor]:
        """Return all sensors by name, in the order of the scene. Raises InputError for a scene without a sensor."""
        self.sensor()
        sensors = dict[str, ChosenSensor]()
        for number, (key, node) in enumerate(self.children(self.root, "Sensor")):
            name = sensor_name(str(node.props.id()), number)
            sensors[name] = ChosenSensor(key, name, number)
        return sensors

    def sensor_taken(self) -> ChosenSensor:
        """Return the requested sensor, or the first sensor."""
        return self.chosen or next(iter(self.sensors().values()))

    def sensor(self) -> MitsubaObject:
        """Return the node of the requested sensor, or of the first sensor. Raises InputError without a sensor."""
        for key, sensor in self.children(self.root, "Sensor"):
            if self.chosen is None or self.chosen.key == key:
                return sensor
        kinds = ", ".join(sorted({node.props.plugin_name() for node in self.nodes("Sensor")}))
        but = f" but {kinds} on a shape, which takes no image" if kinds else ""
        raise InputError(
            f"scene {self.name!r} has no sensor{but}; add one, e.g. {EXAMPLE_SENSOR}."
        )

    def film(self) -> MitsubaObject:
        """Return the node of this sensor's film; None for Mitsuba's default film."""
        return next((node for _, node in self.children(self.sensor().props, "Film")), None)

    def film_size(self, camera: Camera | None, width: int | None) -> dict[str, int]:
        """Return width, height and crop of the film by Mitsuba's parameter names, scaled to ``width`` columns of the
        crop window or film. Raises InputError."""
        film, size = self.film(), dict[str, int]()
        if film is not None:
            if film.props.plugin_name() == FILM and camera is not None:
                size = {"width": camera.sensor.columns, "height": camera.sensor.rows}
            size |= {name: value for name, value in film.props.items() if name in SIZE}
        for name, value in size.items():
            if not isinstance(value, int):
                raise InputError(
                    f"scene {self.name!r}, {self.where(film)}: {name} is {value!r}; it must be a whole number, e.g. "
                    f'<integer name="{name}" value="512"/>.'
                )
        whole = {"width": WIDTH, "height": HEIGHT, **size}
        columns = whole.get("crop_width", whole["width"])
        if width is not None:
            if not 1 <= width <= columns:
                what = "crop window" if "crop_width" in whole else "film"
                raise InputError(
                    f"width is {width!r}; it must be a whole number from 1 to the {what}'s own {columns}. A larger "
                    "picture needs a larger film in the scene (-D width=… -D height=… if it has these parameters)."
                )
            size = {
                name: max(round(pixels * width / columns), 0 if "offset" in name else 1)
                for name, pixels in whole.items()
            }
            for side, offset in (("width", "crop_offset_x"), ("height", "crop_offset_y")):
                end = size.get(offset, 0) + size.get(f"crop_{side}", 0)  # both were rounded
                size[side] = max(size[side], end)
            whole = size
        rows, columns = (whole.get(f"crop_{side}", whole[side]) for side in ("height", "width"))
        if columns * rows > PIXELS_MAX:
            raise InputError(
                f"scene {self.name!r} has a film of {columns} × {rows} pixels; at most {PIXELS_MAX} are allowed: crop "
                "it, or take fewer columns with width=."
            )
        return size

    def film_area(
        self, camera: Camera, width: int | None
    ) -> tuple[tuple[int, int], tuple[int, int]]:
        """Return (rows, columns) of the rendered window, and (row, column) of its first pixel. Raises InputError."""
        size = {"width": WIDTH, "height": HEIGHT, **self.film_size(camera, width)}
        shape = size.get("crop_height", size["height"]), size.get("crop_width", size["width"])
        return shape, (size.get("crop_offset_y", 0), size.get("crop_offset_x", 0))

    def with_sensor(self, asked: str | None) -> ParsedScene:
        """Return the scene with the sensor of this id or number, and its settings. Raises InputError."""
        if asked is None:
            return replace(self, settings=_settings_of(self))
        sensors = self.sensors()
        for sensor in sensors.values():
            if asked in (sensor.name, str(sensor.number)):
                chosen = replace(self, chosen=sensor)
                return replace(chosen, settings=_settings_of(chosen))
        known = ", ".join(sensors)
        if asked == ALL_SENSORS:
            raise InputError(
                f"sensor is {asked!r}, which is only for frames of a scene (`mitsuba-sensor render`, capture); give "
                f"one of {known}."
            )
        raise InputError(
            f"scene {self.name!r} has no sensor {asked!r}; its sensors are {known}.{nearest(asked, sensors)}"
        )

    def with_camera(self) -> ParsedScene:
        """Return the scene with the default camera if the scene names no camera."""
        if self.settings.camera is not None:
            return self
        return replace(self, settings=self.settings.with_default_camera())

    def polarised_by(self, camera: Camera) -> str | None:
        """Return the beginning of a sentence on what polarises light; None if nothing does, or if it is ignored."""
        if self.ignore_polarization:
            return None
        if camera.sensor.polarizers is not None:
            return f"camera {camera.name} has polarisers"
        for node in self.nodes("BSDF"):
            if (kind := node.props.plugin_name()) in POLARISING:
                return (
                    f"scene {self.name!r}, {self.where(node)}: {kind!r} acts on polarised light"
                )
        return None

    def in_variant_for(self, camera: Camera) -> ParsedScene:
        """Return the scene in a polarised variant, which is also set, if camera or scene polarise light. Raises
        InputError if another variant was requested."""
        what = self.polarised_by(camera)
        if what is None or is_polarized():
            return self
        variant = polarized(self.variant)
        if self.variant.reason == "asked for" or self.holds_objects:
            raise InputError(
                f"{what}, which {self.variant.name} does not follow; load and render the scene in variant "
                f"{variant.name!r}, or ignore_polarization=True for unpolarised light."
            )
        use(variant)
        return replace(self, variant=variant, config=parser_config())

    def seed(self, given: int | None) -> int:
        """Return the given seed, else the seed of the scene, else 1; a derived seed for sensors after the first, so
        their noise is independent. Raises InputError."""
        seed = require_seed("seed", first_given(given, self.settings.seed, 1))
        if self.chosen is None or self.chosen.number == 0:
            return seed
        return hashed_seed(seed, SENSOR_SEED, self.chosen.number)

    def serial(self, given: int | None) -> int:
        """Return the serial number of the camera, by default 1; sensors after the first count up, and a number in the
        scene applies to its sensor. Raises InputError."""
        if given is None and self.settings.serial is not None:
            return require_seed("serial", self.settings.serial)
        number = 0 if self.chosen is None else self.chosen.number
        return require_seed("serial", first_given(given, 1)) + number

    def digest(self) -> str:
        """Return the SHA-256 of parameters, scene file, includes and edits, without meshes and textures."""
        digest = hashlib.sha256(json.dumps(sorted(self.values.items())).encode() + self.content)
        for file in map(str, self.state.files):
            if file != TEXT_FILE:
                digest.update(Path(file).read_bytes())
        if self.changes:
            digest.update(json.dumps(self.changes).encode())
        digest.update(self.edits.digest())
        if self.chosen is not None and self.chosen.number:
            digest.update(f"sensor {self.chosen.number}".encode())
        return digest.hexdigest()

    def build(self) -> MitsubaObject:
        """Return the built scene. Raises InputError for missing or wrong elements."""
        mi = mitsuba()
        state = mi.parser.ParserState(self.state)  # a copy, which the transforms change
        has_loaded_emitter = False
        for node in state.nodes:
            for (
                name
            ) in node.props:  # a parameter that was read would count as known to the plugin
                node.props.mark_queried(name, False)
                value = node.props[name]  # plugins take the pixels out of bitmaps
                has_loaded_emitter |= isinstance(value, mi.Emitter) and mi.has_flag(
                    value.flags(), mi.EmitterFlags.Surface
                )
                if isinstance(value, mi.Bitmap):
                    node.props[name] = mi.Bitmap(value)
                elif node.props.type(name) == mi.Properties.Type.Any:
                    node.props[name] = copy.copy(value)
                node.props.mark_queried(name, False)
        with searching(self.resolver), self.mitsuba_errors():
            mi.parser.transform_all(self.config, state)
            built = mi.parser.instantiate(self.config, state)
            scene = built[0] if isinstance(built, list) else built
            self.edits.apply(scene)
        if has_loaded_emitter:
            SCENES_OF_LOADED_EMITTERS.append(scene)
        return scene

    @contextlib.contextmanager
    def mitsuba_errors(self, place: str = "") -> Iterator[None]:
        """Turn Mitsuba's RuntimeError about the scene into an InputError.  place : if Mitsuba does not know it."""
        with mitsuba_errors(self.path, self.text, self.values, place):
            yield


def _settings_of(scene: ParsedScene) -> SceneSettings:
    """Return camera, exposure and seeds of the rendered sensor. Raises InputError."""
    sensor, film = scene.sensor(), scene.film()
    of_film, of_sensor = Fields(), Fields()
    node = film or sensor
    try:
        if film is not None and film.props.plugin_name() == FILM:
            of_camera = (name for name in film.props if "." in name)
            _check_names(film.props, (*FILM_FIELDS, *of_camera))
            with searching(scene.resolver):
                of_film = film_fields_of(film.props)
        elif scene.exposure_s is not None:
            of_film = {"exposure_s": seconds_of(scene.exposure_s)}
        settings_from(of_film, {})  # its errors are located at the film
        node = sensor
        if sensor.props.plugin_name() == SENSOR:
            nested = dict(scene.children(sensor.props))
            _check_names(sensor.props, (*SENSOR_FIELDS, *PASSED_ON, *nested))
            of_sensor = sensor_fields_of(sensor.props)
        return settings_from(of_film, of_sensor)
    except InputError as error:
        raise InputError(f"scene {scene.name!r}, {scene.where(node)}: {error}") from None


def _check_names(props: MitsubaObject, known: Collection[str]) -> None:
    """Raise InputError for an unknown parameter."""
    for name in props:
        if name not in known:
            raise InputError(
                f"{name[:80]!r} is not a parameter of a {props.plugin_name()}.{nearest(name, known)}"
            )
