"""Scenes that are no file: a dict as for mi.load_dict, or a scene that Mitsuba has loaded already.

Both become parsed nodes, as of a file, in which film and sensor are replaced. Of a loaded scene these are its sensor,
film and filter, described again from their parameters; it is rendered itself, through another sensor.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ...core import InputError
from ..variants import POLARIZED, MitsubaObject, is_polarized, mitsuba, parser_config, values_of
from .plugin_id import PluginParameters, parameters_of
from .plugin_names import (
    OWN_PLUGINS,
    refuse_foreign_plugins,
    remedy_for_unknown,
    type_of_plugin,
)
from .scene_file import (
    EXAMPLE_SENSOR,
    POLARISING,
    SceneFile,
    as_input_error,
    why_no_image,
    with_integrator,
)

SceneInput: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | MitsubaObject
"""A path, XML text, a dict as for mi.load_dict, a mi.Scene."""

SENSOR, FILM, RAW_FRAME = OWN_PLUGINS
SENSORS = {
    "PerspectiveCamera": "perspective",
    "ThinLensCamera": "thinlens",
    "OrthographicCamera": "orthographic",
}
NO_CAMERAS = {
    "IrradianceMeter": "irradiancemeter",
    "RadianceMeter": "radiancemeter",
    "DistantSensorImpl": "distant",
    "BatchSensor": "batch",
}
"""Classes of sensors that take no image here, and their types."""
FILTERS = {
    "BoxFilter": "box",
    "GaussianFilter": "gaussian",
    "TentFilter": "tent",
    "CatmullRomFilter": "catmullrom",
}
FILTERS |= {"MitchellNetravaliFilter": "mitchell", "LanczosSincFilter": "lanczos"}
FILMS = {"HDRFilm": "hdrfilm", "SpecFilm": "specfilm"}
NO_RADIANCE = ("DepthIntegrator", "ParticleTracerIntegrator")
POLARISERS = (
    "LinearPolarizer",
    "CircularPolarizer",
    "LinearRetarder",
    "MeasuredPolarized",
)  # classes of POLARISING
# Options which change a scene before it is loaded:
OPTIONS = (
    "parameters",
    "sensor",
    "integrator",
    "motion",
    "ignore_polarization",
    "traverse",
    "look_at",
    "repeatable",
    "infrared",
)
CROP = ("crop_width", "crop_height", "crop_offset_x", "crop_offset_y")  # of a film
LOADED = (
    "pictures and colours of a loaded scene are not looked at for what is black in the bands"
)
ANOTHER = "pass the scene as a path, as XML text or as a dict"


class LoadedView(NamedTuple):
    """A loaded scene and what one picture of it is made with.

    integrator : or None for path.  film : whose parameters are those of our plugins, if any; that of the sensor, or of
    the batch to which the sensor belongs.
    """

    scene: MitsubaObject
    sensor: MitsubaObject
    integrator: MitsubaObject
    film: MitsubaObject

    @classmethod
    def of_first_sensor(cls, scene: MitsubaObject) -> LoadedView:
        """The picture of the first sensor that is not on a shape. Raises InputError for a scene without sensors."""
        if not (sensors := scene.sensors()):
            raise InputError(f"scene 'mi.Scene' has no sensor; add one, e.g. {EXAMPLE_SENSOR}.")
        sensors = [one for one in sensors if one.get_shape() is None] or sensors
        integrator = scene.integrator()
        return cls(
            scene, sensors[0], getattr(integrator, "inner", integrator), sensors[0].film()
        )


def view_of_loaded(scene: object) -> LoadedView | None:
    """What is to be rendered of a mi.Scene, of any variant; None for what is no mi.Scene."""
    if isinstance(scene, LoadedView):
        return scene
    is_scene = hasattr(scene, "sensors") and hasattr(scene, "variant_name")
    return LoadedView.of_first_sensor(scene) if is_scene else None


def check_loaded(scene: MitsubaObject, options: Mapping[str, Any]) -> None:
    """Raise InputError for a loaded scene of another variant, or with options that it comes too late for."""
    own, wanted = scene.variant_name(), options.get("variant") or mitsuba().variant()
    if "_spectral" not in own:
        raise InputError(
            f"the scene was loaded in variant {own!r}, which keeps no spectra; call mitsuba.set_variant"
            "('scalar_spectral') before you load it, or pass its path, XML text or dict."
        )
    if own != wanted:
        way_out = f"load it again, or pass variant={own!r}"
        raise InputError(
            f"the scene was loaded in variant {own!r}, and {wanted!r} is to render it; {way_out}."
        )
    for name in OPTIONS:
        if options.get(name):
            raise InputError(
                f"{name} is given and the scene is a loaded mi.Scene, which it cannot change; {ANOTHER}."
            )


def parse_nodes(scene: object, options: Mapping[str, Any]) -> SceneFile:
    """The nodes of a dict or a loaded scene; the variant must be set. options : of FileOptions. Raises InputError."""
    mi, loaded = mitsuba(), view_of_loaded(scene)
    if loaded is not None:
        tree, name, digest = _tree_of(loaded), "mi.Scene", _digest_of_view(loaded)
        changes = [("mi.Scene", (LOADED, ANOTHER))]
    elif isinstance(scene, Mapping):
        name, tree, changes = "dict", dict(scene), []
        _check_dict(tree, options)
        digest = json.dumps(list(_described(tree)))
    else:
        kinds = "a path, a name from `mitsuba-sensor scenes list`, XML text, a dict as for mi.load_dict, or a mi.Scene"
        given = " ".join(repr(scene).split())
        if shape := getattr(scene, "shape", None):
            given = f"an array of shape {tuple(shape)}, of which light_from_rgb or collect makes light"
        raise InputError(f"scene is {given}; pass {kinds}, e.g. 'cornell_box'.")
    config = parser_config()
    resolver = type(mi.file_resolver())(mi.file_resolver())
    tree, fields = _fields_apart(tree)
    with as_input_error(Path(name)):
        state = mi.parser.parse_dict(config, tree)
        refuse_foreign_plugins(name, state, resolver)  # before any plugin is built
        _know_types(state)
        mi.parser.transform_resolve(config, state)
    polarised, content = bool(options.get("ignore_polarization")), digest.encode()
    file = SceneFile(
        Path(name),
        config,
        state,
        {},
        resolver,
        changes=tuple(changes),
        ignore_polarization=polarised,
        content=content,
    )
    file = replace(file, loaded=loaded)
    for key, node in file.children(file.root, "Sensor"):
        for _, film in file.children(node.props, "Film"):
            for field, value in fields.get(key, {}).items():
                film.props[field] = value
    return with_integrator(file, options.get("integrator"))


def _check_dict(tree: Mapping[str, Any], options: Mapping[str, Any]) -> None:
    if tree.get("type") != "scene":
        raise InputError(
            f"the dict has type {tree.get('type')!r}; pass one of a whole scene, with 'type': 'scene'."
        )
    if options.get("parameters"):
        raise InputError(
            "parameters are for the <default> names of a scene in XML; change the dict instead."
        )
    for place, value in _leaves(tree):
        if options.get("integrator") and isinstance(value, mitsuba().Integrator):
            raise InputError(
                f"integrator is given and {place!r} of the dict is one already; leave one of them out."
            )
        own, now = _variant_of(value), mitsuba().variant()
        if own not in ("", now):
            way_out = f"call mitsuba.set_variant({now!r}) before you make it"
            if "_spectral" in own:
                way_out += f", or pass variant={own!r}"
            raise InputError(
                f"{place!r} of the dict was made in variant {own!r}, and {now!r} renders; {way_out}."
            )


def _variant_of(value: Any) -> str:
    """The variant that an object of a dict was made in; empty for pictures and what else belongs to all variants."""
    return str(value.variant_name()) if hasattr(value, "variant_name") else ""


def _fields_apart(tree: dict[str, Any]) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The tree without the fields of cameras in its films ("adc.bits"), because no name in a dict of Mitsuba has a dot;
    and these by the name of the sensor."""
    plain, fields = dict(tree), dict[str, dict[str, Any]]()
    for name, sensor in tree.items():
        if isinstance(sensor, Mapping) and isinstance(film := sensor.get("film"), Mapping):
            fields[name] = {key: value for key, value in film.items() if "." in key}
            others = {key: value for key, value in film.items() if "." not in key}
            plain[name] = {**sensor, "film": others}
    return plain, fields


def _know_types(state: MitsubaObject) -> None:
    """Types of elements that Python has registered, ours among them: in XML they are known by the tag. InputError for a
    type that no plugin has; Mitsuba itself says so when it builds the scene."""
    types = mitsuba().ObjectType
    own = {SENSOR: types.Sensor, FILM: types.Film, RAW_FRAME: types.Integrator}
    for node in state.nodes:
        if node.type != types.Unknown:
            continue
        kind = node.props.plugin_name()
        kind_of_node = own.get(kind) or type_of_plugin(node.props)
        if kind_of_node is None:
            place = mitsuba().parser.file_location(state, node).removeprefix("dictionary ")
            raise InputError(
                f"scene 'dict', {place}: there is no plugin {kind!r}{remedy_for_unknown(kind)}"
            )
        node.type = kind_of_node


def _leaves(tree: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted name, value) of everything that is no dict itself."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{place}{name}.")
        else:
            yield f"{place}{name}", value


def _described(tree: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """(dotted name, what is there) in the order of the dict."""
    for place, value in _leaves(tree):
        built = hasattr(value, "variant_name")
        array = isinstance(value, np.ndarray) or hasattr(value, "__array__")
        yield (
            place,
            _digest_of(value)
            if built
            else repr(np.asarray(value).tolist())
            if array
            else repr(value),
        )


def _tree_of(view: LoadedView) -> dict[str, Any]:
    """A dict with the sensor of a loaded scene, described again. Raises InputError where it is of no use."""
    if view.integrator is not None:
        _check_integrator(view.integrator)
    own = view.scene.variant_name()
    polarised = own + POLARIZED
    for number, shape in enumerate(view.scene.shapes()):
        if is_polarized() or not any(name in str(shape.bsdf()) for name in POLARISERS):
            continue
        raise InputError(
            f"shape {shape.id() or number!r} of the scene polarises light ({', '.join(POLARISING)}), which "
            f"{own!r} does not follow; load it in {polarised!r}, or {ANOTHER} and "
            "ignore_polarization=True for unpolarised light."
        )
    return {"type": "scene", "sensor": _described_sensor(view.sensor, parameters_of(view.film))}


def _check_integrator(integrator: MitsubaObject) -> None:
    kind = integrator.class_name()
    if integrator.aov_names() or kind in NO_RADIANCE:
        why = (
            "adds channels that the sensor cannot use"
            if integrator.aov_names()
            else "computes no radiance"
        )
        raise InputError(
            f"the integrator of the scene, {kind}, {why}; load the scene with another, e.g. 'path'."
        )


def _described_sensor(
    sensor: MitsubaObject, parameters: PluginParameters | None
) -> dict[str, Any]:
    """The parameters of a sensor and its film, from which they are built again.  parameters : of our plugins, in which
    size and crop are those of the film as it is."""
    mi, kind, film = mitsuba(), SENSORS.get(sensor.class_name()), sensor.film()
    if kind is None:
        kind = NO_CAMERAS.get(sensor.class_name(), sensor.class_name())
        raise InputError(f"scene 'mi.Scene': {why_no_image(kind)}.")
    if sensor.get_medium() is not None:
        raise InputError(f"the sensor of the scene is inside a medium; {ANOTHER}.")
    found, size = mi.traverse(sensor), (film.size(), film.crop_size(), film.crop_offset())
    (width, height), crop, offset = (tuple(int(n) for n in pair) for pair in size)
    names: tuple[str, ...] = (
        "near_clip",
        "far_clip",
        "principal_point_offset_x",
        "principal_point_offset_y",
    )
    names += ("focus_distance", "aperture_radius") if kind == "thinlens" else ()
    numbers = {name: float(np.ravel(found[name])[0]) for name in names if name in found}
    pose = mi.ScalarTransform4f(np.array(found["to_world"].matrix, dtype=float).reshape(4, 4))
    own = {"width": width, "height": height}
    if crop != (width, height):
        own |= dict(zip(CROP, crop + offset, strict=True))
    view = (
        {"fov": float(np.ravel(found["x_fov"])[0]), "fov_axis": "x"} if "x_fov" in found else {}
    )
    rfilter = {"type": FILTERS.get(film.rfilter().class_name(), "gaussian")}
    described = {
        "type": FILMS.get(film.class_name(), "hdrfilm"),
        "component_format": "float32",
        "rfilter": rfilter,
    }
    if parameters is not None:
        described = {
            "type": FILM,
            **{key: parameters.film[key] for key in parameters.film if key not in CROP},
        }
        if parameters.sensor is not None:
            moved = {
                name: value
                for name, value in numbers.items()
                if "_clip" in name or "principal" in name
            }
            return {
                "type": SENSOR,
                **parameters.sensor,
                **moved,
                "to_world": pose,
                "film": {**described, **own},
            }
    return {"type": kind, **view, **numbers, "to_world": pose, "film": {**described, **own}}


def _digest_of_view(view: LoadedView) -> str:
    """Of everything that its parts print and contain, whatever their order: that of the shapes is left to chance."""
    parts = [*view.scene.shapes(), *view.scene.emitters(), view.sensor]
    return json.dumps(sorted([_digest_of(part) for part in parts] + [str(view.integrator)]))


def _digest_of(thing: MitsubaObject) -> str:
    """SHA-256 of what an object of Mitsuba prints, and of its parameters."""
    digest = hashlib.sha256(str(thing).encode())
    if isinstance(thing, mitsuba().Bitmap):
        digest.update(np.ascontiguousarray(np.array(thing)).tobytes())
    for _, value in sorted((name.split(".")[-1], value) for name, value in _arrays(thing)):
        digest.update(value)
    return digest.hexdigest()


def _arrays(thing: MitsubaObject) -> Iterator[tuple[str, bytes]]:
    for name, value in values_of(thing):
        values = getattr(value, "matrix", value)  # of a transform
        yield name, np.ascontiguousarray(np.array(values)).tobytes()
