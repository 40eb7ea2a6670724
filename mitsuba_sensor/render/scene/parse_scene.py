"""Parses a scene without building it: a path, XML text, a dict as for mi.load_dict, or a loaded scene.

All four become a :class:`ParsedScene`; load/scene.py replaces film and sensor in its state before the scene is built.
The state of a loaded scene contains only its sensor, described again from its parameters; the scene itself is rendered
as given, through another sensor.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

from ...core import Float64Array, InputError, nearest
from ...core.options import complete, part_of
from ...files.scene_xml import require_bounded, require_scene_file
from ...files.shipped_scenes import SCENE, shipped_file
from ..options import RenderOptions
from ..variants import (
    MitsubaObject,
    Variant,
    choose_variant,
    mitsuba,
    own_folder_first,
    parser_config,
    use,
)
from .loaded_scene import LOADED, LOADED_REMEDY, LoadedView, digest_of, tree_of, view_of_loaded
from .mitsuba_errors import (
    OWN_PLUGINS,
    gradient_integrators,
    mitsuba_errors,
    old_version,
    refuse_foreign_plugins,
    searching,
)
from .motion import Motion, read_motion, rigid
from .parsed_scene import ParsedScene
from .scene_edits import BLOCK_SIDE, SceneEdits

SceneInput: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | MitsubaObject
"""A path, XML text, a dict as for mi.load_dict, or a mi.Scene."""

KEPT_BY_INTEGRATORS = ("max_depth", "rr_depth", "hide_emitters")
"""Parameters with the same meaning in each integrator that can be requested; direct has no depth."""


def parse(scene: SceneInput, options: Mapping[str, Any]) -> ParsedScene:
    """Parse a scene, and set the variant.  options : from :class:`render.options.SceneOptions`. Raises InputError."""
    chosen = complete(RenderOptions, part_of(RenderOptions, options))
    parameters = chosen["parameters"]
    if parameters is not None and not isinstance(parameters, Mapping):
        raise InputError(
            f"parameters is {parameters!r}; pass a dict of the scene's <default> names and their values."
        )
    loaded = view_of_loaded(scene, options)
    variant = choose_variant(chosen["variant"])
    use(variant)
    if loaded is not None:
        parsed = _of_loaded(loaded, variant)
    elif isinstance(scene, Mapping):
        parsed = _of_dict(scene, chosen, variant)
    elif isinstance(scene, str | os.PathLike):
        values = {str(name): str(value) for name, value in (parameters or {}).items()}
        parsed = _of_xml(scene, values, variant)
    else:
        given = " ".join(repr(scene).split())
        if shape := getattr(scene, "shape", None):
            given = f"an array of shape {tuple(shape)}, which light_from_rgb or collect turns into light"
        raise InputError(
            f"scene is {given}; pass a path, a name from `mitsuba-sensor scenes list`, XML text, a dict as for "
            "mi.load_dict, or a mi.Scene, e.g. 'cornell_box'."
        )
    ignored = bool(chosen["ignore_polarization"])
    parsed = replace(parsed, ignore_polarization=ignored, edits=SceneEdits.of(chosen))
    if chosen["integrator"] is not None:
        parsed = _with_integrator(parsed, chosen["integrator"])
    return parsed.with_sensor(cast(str | None, chosen["sensor"]))


def parse_sensors(scene: SceneInput, options: Mapping[str, Any]) -> dict[str, ParsedScene]:
    """Parse a scene once, and return it for each of its sensors by name. Raises InputError."""
    whole = parse(scene, {**options, "sensor": None})
    return {name: whole.with_sensor(name) for name in whole.sensors()}


def _of_xml(
    given: str | os.PathLike[str], values: dict[str, str], variant: Variant
) -> ParsedScene:
    """Parse a scene file, an included scene by its name, or XML text."""
    mi, config = mitsuba(), parser_config()
    is_text = isinstance(given, str) and given.lstrip("\ufeff \t\r\n").startswith("<")
    if is_text:
        path, text = Path("XML text"), str(given)
    else:
        place = shipped_file(given, SCENE) or given
        require_scene_file(os.fspath(place))
        path = Path(place)
        text = path.read_text(encoding="utf-8", errors="replace")
    names = _parameter_names(text)
    unknown = [name for name in values if name not in names]
    if unknown and "<include" not in text:  # Mitsuba checks names in included files
        has = f"it has {', '.join(names)}" if names else "it has no parameters"
        raise InputError(
            f"scene {str(path)!r} has no parameter {unknown[0]!r}; {has}.{nearest(unknown[0], names)}"
        )
    beside = type(mi.file_resolver())(mi.file_resolver())
    beside.prepend(str(path.resolve().parent))
    require_bounded(text, path, values, lambda name: str(beside.resolve(name)))
    used = dict(values)
    if "$exposure_s" not in text:  # Mitsuba rejects parameters that no element uses
        used.pop("exposure_s", None)
    with searching(beside), mitsuba_errors(path, text, values):
        if is_text:
            state = mi.parser.parse_string(config, text, **used)
        else:
            state = mi.parser.parse_file(config, str(path), **used)
        mi.parser.transform_upgrade(config, state)
        mi.parser.transform_resolve(config, state)
        resolver = mi.file_resolver()
        own_folder_first(resolver)
        refuse_foreign_plugins(str(path), state, resolver)
    if state.nodes[0].type != mi.ObjectType.Scene:
        raise InputError(
            f'{str(path)!r} holds no scene; its outermost element must be <scene version="3.0.0">.'
        )
    default = re.search(r'<default\s+name="exposure_s"\s+value="([^"]*)"', text)
    old = old_version(text)
    upgraded = (
        f"the scene has the format of Mitsuba {old}, which Mitsuba's own upgrade has read"
    )
    changes = ("line 1", upgraded, "compare the picture with one of that version")
    return ParsedScene(
        path,
        variant,
        config,
        state,
        resolver,
        values,
        tuple(names),
        exposure_s=values.get("exposure_s", default[1]) if default else None,
        changes=(changes,) if old else (),
        text=text,
        content=text.encode() if is_text else b"",
    )


def _of_dict(
    given: Mapping[str, Any], options: Mapping[str, Any], variant: Variant
) -> ParsedScene:
    """Parse a dict as for mi.load_dict."""
    if given.get("type") != "scene":
        raise InputError(
            f"the dict has type {given.get('type')!r}; pass one of a whole scene, with 'type': 'scene'."
        )
    if options["parameters"]:
        raise InputError(
            "parameters are for the <default> names of a scene in XML; change the dict instead."
        )
    for place, value in _leaves(given):
        if options["integrator"] and isinstance(value, mitsuba().Integrator):
            raise InputError(
                f"integrator is given and {place!r} of the dict is an integrator; remove one of them."
            )
        made_in = str(getattr(value, "variant_name", str)())
        if made_in not in ("", variant.name):  # a picture has no variant
            remedy = f"call mitsuba.set_variant({variant.name!r}) before you make it"
            if "_spectral" in made_in:
                remedy += f", or pass variant={made_in!r}"
            raise InputError(
                f"{place!r} of the dict was made in variant {made_in!r}, and {variant.name!r} renders; {remedy}."
            )
    content = json.dumps([(place, _described(value)) for place, value in _leaves(given)])
    return _of_tree(Path("dict"), given, content, variant)


def _of_loaded(view: LoadedView, variant: Variant) -> ParsedScene:
    """Parse the sensor of a loaded scene; its shapes and emitters are rendered as given."""
    parsed = _of_tree(Path("mi.Scene"), tree_of(view), view.digest(), variant)
    return replace(parsed, loaded=view, changes=(("mi.Scene", LOADED, LOADED_REMEDY),))


def _of_tree(
    path: Path, tree: Mapping[str, Any], content: str, variant: Variant
) -> ParsedScene:
    mi, config = mitsuba(), parser_config()
    resolver = type(mi.file_resolver())(mi.file_resolver())
    plain, fields = dict(tree), dict[str, dict[str, Any]]()
    for name, sensor in tree.items():  # Mitsuba allows no dot in a name, as in adc.bits
        if isinstance(sensor, Mapping) and isinstance(film := sensor.get("film"), Mapping):
            fields[name] = {key: value for key, value in film.items() if "." in key}
            plain[name] = {**sensor, "film": {k: x for k, x in film.items() if "." not in k}}
    with mitsuba_errors(path):
        state = mi.parser.parse_dict(config, plain)
        refuse_foreign_plugins(str(path), state, resolver)  # before any plugin is built
        _know_types(state)
        mi.parser.transform_resolve(config, state)
    parsed = ParsedScene(path, variant, config, state, resolver, content=content.encode())
    for key, node in parsed.children(parsed.root, "Sensor"):
        for _, film in parsed.children(node.props, "Film"):
            for name, value in fields.get(key, {}).items():
                film.props[name] = value
    return parsed


def _know_types(state: MitsubaObject) -> None:
    """Set the types of elements that Python has registered, which the tag determines in XML. Raises RuntimeError for an
    unknown plugin."""
    mi = mitsuba()
    of_sensor, of_film, of_frame = OWN_PLUGINS
    kinds = dict.fromkeys([*gradient_integrators(), of_frame], mi.ObjectType.Integrator)
    kinds |= {of_sensor: mi.ObjectType.Sensor, of_film: mi.ObjectType.Film}
    for node in state.nodes:
        if node.type != mi.ObjectType.Unknown:
            continue
        kind = node.props.plugin_name()
        node.type = kinds.get(kind, node.type)
        try:
            if kind not in kinds:
                mi.load_dict({"type": kind})
        except RuntimeError as error:  # other errors are about missing parameters
            if f'Plugin "{kind}" not found' in str(error):
                raise


def _leaves(tree: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, value) of every value that is not a dict."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{place}{name}.")
        else:
            yield f"{place}{name}", value


def _described(value: Any) -> str:
    """Return the representation of a dict's value in the digest of the scene."""
    if hasattr(value, "variant_name"):
        return digest_of(value)
    is_array = isinstance(value, np.ndarray) or hasattr(value, "__array__")
    return repr(np.asarray(value).tolist() if is_array else value)


def _with_integrator(scene: ParsedScene, kind: str) -> ParsedScene:
    """Return the scene with its integrator replaced by one of this kind, at the same depth."""
    integrators = scene.children(scene.root, "Integrator")
    for name, _ in integrators[1:]:
        del scene.root[name]
    if not integrators:
        scene.root["integrator"] = mitsuba().load_dict({"type": kind, "block_size": BLOCK_SIDE})
        return scene
    node = integrators[0][1]
    old, kept = node.props.plugin_name(), KEPT_BY_INTEGRATORS[2 * (kind == "direct") :]
    for name in [name for name in node.props if name not in kept]:
        del node.props[name]
    node.props.set_plugin_name(kind)
    what = f"integrator {old!r} is replaced by {kind!r}, as asked"
    remedy = "omit the option for the scene's own"
    return replace(scene, changes=(*scene.changes, (scene.where(node), what, remedy)))


def _parameter_names(text: str) -> list[str]:
    """Return the parameter names in the text of a scene, in alphabetical order."""
    defaults = re.findall(r'<default\s+name="(\w+)"', text)
    return sorted({*defaults, *re.findall(r"\$\{?(\w+)", text)})


def pose_in_file_m(scene: ParsedScene, unit_m: float) -> Float64Array:
    """Return the pose of the sensor in its file [m], shape (4, 4), without scale and mirroring.

    unit_m : metres per scene unit.
    """
    sensor, pose = scene.sensor().props, np.eye(4)
    if "to_world" in sensor:
        pose = rigid(np.array(sensor["to_world"].matrix, dtype=float).reshape(4, 4))
    pose[:3, 3] *= unit_m
    return pose


def refuse_one_place(
    names: Collection[str],
    look_at: object,
    motion: str | os.PathLike[str] | Mapping[str, Any] | Motion | None,
) -> None:
    """Raise InputError for poses in the world that would put all sensors of a scene in one place.

    names : of the sensors.  look_at, motion : options of the render.
    """
    if len(names) < 2:
        return
    camera = read_motion(motion).camera
    in_world = camera is not None and any(key.pose is not None for key in camera.keys)
    for what, given, remedy in (
        ("look_at", look_at is not None, "move them in the scene file"),
        ("the motion", in_world, "give its keys move_m and turn_deg"),
    ):
        if given:
            raise InputError(
                f"{what} has a pose of the camera in the world, which would put all {len(names)} sensors in one "
                f"place; {remedy}, or take one sensor ({', '.join(names)})."
            )
