"""A scene that Mitsuba has loaded already: its sensor is described again from its parameters."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from ...core import InputError
from ..variants import POLARIZED, MitsubaObject, is_polarized, mitsuba, values_of
from .mitsuba_errors import OWN_PLUGINS
from .plugin_parameters import parameters_of

SENSOR, FILM, _ = OWN_PLUGINS
KINDS = {
    "PerspectiveCamera": "perspective",
    "ThinLensCamera": "thinlens",
    "OrthographicCamera": "orthographic",
    "BoxFilter": "box",
    "TentFilter": "tent",
    "CatmullRomFilter": "catmullrom",
    "MitchellNetravaliFilter": "mitchell",
    "LanczosSincFilter": "lanczos",
    "SpecFilm": "specfilm",
}
"""Classes of sensors, filters and films → their types."""
IMAGING = ("perspective", "thinlens", "orthographic", "camera")
NO_RADIANCE = ("DepthIntegrator", "ParticleTracerIntegrator")
POLARISERS = ("LinearPolarizer", "CircularPolarizer", "LinearRetarder", "MeasuredPolarized")
"""Classes of materials that act on polarised light."""
OPTIONS = (
    *("parameters", "sensor", "integrator", "motion", "ignore_polarization"),
    *("traverse", "look_at", "repeatable", "infrared"),
)
"""Options that change a scene before it is loaded."""
CROP = ("crop_width", "crop_height", "crop_offset_x", "crop_offset_y")
LOADED = "pictures and colours of a loaded scene are not checked for spectra that are black in the bands"
LOADED_REMEDY = "pass the scene as a path, as XML text or as a dict"


class LoadedView(NamedTuple):
    """A loaded scene, its sensor and its integrator (None for path)."""

    scene: MitsubaObject
    sensor: MitsubaObject
    integrator: MitsubaObject

    def digest(self) -> str:
        """Return a digest of all objects, independent of the order of the shapes, which Mitsuba leaves to chance."""
        parts = [*self.scene.shapes(), *self.scene.emitters(), self.sensor]
        return json.dumps(sorted([digest_of(part) for part in parts] + [str(self.integrator)]))


def view_of_loaded(scene: Any, options: Mapping[str, Any]) -> LoadedView | None:
    """Return the view of a mi.Scene through its first sensor that is not on a shape; None for any other object. Raises
    InputError for a scene of another variant, or for options that must be applied before loading."""
    if isinstance(scene, LoadedView):
        view = scene
    elif hasattr(scene, "sensors") and hasattr(scene, "variant_name"):
        if not (sensors := scene.sensors()):
            raise InputError(
                "scene 'mi.Scene' has no sensor; load it with one of type perspective, thinlens or orthographic."
            )
        sensors = [sensor for sensor in sensors if sensor.get_shape() is None] or sensors
        integrator = scene.integrator()
        inner = getattr(integrator, "inner", integrator)
        view = LoadedView(scene, sensors[0], inner)
    else:
        return None
    variant, wanted = view.scene.variant_name(), options.get("variant") or mitsuba().variant()
    if "_spectral" not in variant:
        raise InputError(
            f"the scene was loaded in variant {variant!r}, which keeps no spectra; call mitsuba.set_variant"
            "('scalar_spectral') before you load it, or pass its path, XML text or dict."
        )
    if variant != wanted:
        raise InputError(
            f"the scene was loaded in variant {variant!r}, and {wanted!r} is to render it; load it again, or pass "
            f"variant={variant!r}."
        )
    for name in OPTIONS:
        if options.get(name):
            raise InputError(
                f"{name} is given and the scene is a loaded mi.Scene, which it cannot change; {LOADED_REMEDY}."
            )
    return view


def tree_of(view: LoadedView) -> dict[str, Any]:
    """Return a dict with the sensor of a loaded scene. Raises InputError for a scene that cannot be rendered."""
    integrator, variant, why = view.integrator, view.scene.variant_name(), ""
    if integrator is not None and integrator.aov_names():
        why = "adds channels that the sensor cannot use"
    elif integrator is not None and integrator.class_name() in NO_RADIANCE:
        why = "does not compute radiance"
    if why:
        raise InputError(
            f"the integrator of the scene, {integrator.class_name()}, {why}; load the scene with another integrator, "
            "e.g. 'path'."
        )
    for number, shape in enumerate(view.scene.shapes()):
        if not is_polarized() and any(name in str(shape.bsdf()) for name in POLARISERS):
            raise InputError(
                f"shape {shape.id() or number!r} of the scene polarises light, which {variant!r} does not follow; load "
                f"it in {variant + POLARIZED!r}, or {LOADED_REMEDY} and ignore_polarization=True for unpolarised light."
            )
    return {"type": "scene", "sensor": _described(view.sensor)}


def why_no_image(kind: str) -> str:
    """Return why a sensor of this type cannot be rendered, and what to do, as the end of a sentence."""
    if kind.lower().startswith("batch"):
        return (
            f"a {kind!r} puts several sensors on one film; move its sensors into the scene, so sensor='all' takes a "
            "frame of each"
        )
    return f"a sensor of type {kind!r} takes no image; it must be one of {', '.join(IMAGING)}"


def _described(sensor: MitsubaObject) -> dict[str, Any]:
    """Return the parameters that rebuild a sensor and its film."""
    mi, film = mitsuba(), sensor.film()
    kind = KINDS.get(sensor.class_name(), sensor.class_name())
    if kind not in IMAGING:
        raise InputError(f"scene 'mi.Scene': {why_no_image(kind)}.")
    if sensor.get_medium() is not None:
        raise InputError(f"the sensor of the scene is inside a medium; {LOADED_REMEDY}.")
    values = mi.traverse(sensor)

    def number(name: str) -> float:
        return float(np.ravel(values[name])[0])

    pose = mi.ScalarTransform4f(np.array(values["to_world"].matrix, dtype=float).reshape(4, 4))
    names = ("near_clip", "far_clip", "principal_point_offset_x", "principal_point_offset_y")
    view: dict[str, Any] = {"to_world": pose}
    view |= {name: number(name) for name in names if name in values}
    pairs = film.size(), film.crop_size(), film.crop_offset()
    size, crop, offset = (tuple(int(n) for n in pair) for pair in pairs)
    tree: dict[str, Any] = dict(zip(("width", "height"), size, strict=True))
    if crop != size:
        tree |= dict(zip(CROP, crop + offset, strict=True))
    parameters = parameters_of(film)
    if parameters is None:
        rfilter = {"type": KINDS.get(film.rfilter().class_name(), "gaussian")}
        film_kind = KINDS.get(film.class_name(), "hdrfilm")
        tree |= {"type": film_kind, "component_format": "float32", "rfilter": rfilter}
    else:
        kept = {key: parameters.film[key] for key in parameters.film if key not in CROP}
        tree = {"type": FILM, **kept, **tree}
        if parameters.sensor is not None:
            return {"type": SENSOR, **parameters.sensor, **view, "film": tree}
    if kind == "thinlens":
        view |= {name: number(name) for name in ("focus_distance", "aperture_radius")}
    if "x_fov" in values:
        view |= {"fov": number("x_fov"), "fov_axis": "x"}
    return {"type": kind, **view, "film": tree}


def digest_of(thing: MitsubaObject) -> str:
    """Return the SHA-256 of the description and the parameters of a Mitsuba object."""
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
