"""What a scene file says of camera, exposure and seeds, in <sensor type="camera"> and <film type="photosensor">.

The words of the two elements, their meaning and their checks are here, once; :mod:`.plugins` builds Mitsuba's own
objects from them, and :func:`read_setup` reads them without building anything.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..core.errors import InputError, nearest, require, require_seed
from ..core.exposure import Exposure
from ..sensor.camera import Camera, list_cameras, load_camera, toml_value
from .bands import SPECTRAL
from .scene_file import SceneFile, folder_of, parse_scene
from .variants import mitsuba

FILM, SENSOR = "photosensor", "camera"  # the types of our two elements
SIZE = ("width", "height", "crop_width", "crop_height", "crop_offset_x", "crop_offset_y")
FILES = ("camera", "lens.prescription", "quantum_efficiency.file")  # these may be a path
SHOT = ("exposure_s", "temperature_k", "seed", "serial", "wavelength_nm", "bandwidth_nm", "spectral")
FILM_FIELDS = ("camera", *SHOT, *SIZE)
LENS_FIELDS = {
    "f_number": "lens.f_number",
    "pupil_convention": "lens.convention",
    "pupil_magnification": "lens.pupil_magnification",
}
SENSOR_FIELDS = (*LENS_FIELDS, "transmission", "focal_length_mm", "focus_distance_m", "scene_unit")
# What Mitsuba's own sensors take, passed along as it is.
PASSED = ("to_world", "near_clip", "far_clip", "principal_point_offset_x", "principal_point_offset_y")
METRES = {"km": 1e3, "m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}


@dataclass(frozen=True, eq=False)
class SceneSettings:
    """What a scene file says of the picture; None, or nothing, where it does not.

    camera : the named one, with the fields that the file sets.  fields : those alone, by dotted name; see :meth:`on`.
    focal_length_mm, focus_distance_m, unit_m : of <sensor type="camera">; metres per scene unit.
    size : width, height and crop of the film, in pixels.
    """

    camera: Camera | None = None
    fields: Mapping[str, Any] = field(default_factory=dict)
    exposure_s: float | None = None
    temperature_k: float | None = None
    seed: int | None = None
    serial: int | None = None
    wavelength_nm: float | None = None
    bandwidth_nm: float | None = None
    spectral: str | None = None
    focal_length_mm: float | None = None
    focus_distance_m: float | None = None
    unit_m: float | None = None
    size: Mapping[str, int] = field(default_factory=dict)

    @property
    def exposure(self) -> Exposure | None:
        """The exposure, if the file says how long it is; at 298.15 K unless it says another temperature."""
        if self.exposure_s is None:
            return None
        return (
            Exposure(self.exposure_s) if self.temperature_k is None else Exposure(self.exposure_s, self.temperature_k)
        )

    def on(self, camera: Camera) -> Camera:
        """Another camera with the fields that this file sets.

        A prescription takes focal length and focus too. Raises InputError.
        """
        changed = camera.replace(**self.fields) if self.fields else camera
        if changed.lens.prescription is None:
            return changed
        focus = {"lens.focal_length_mm": self.focal_length_mm, "lens.focus_m": self.focus_distance_m}
        given = {name: value for name, value in focus.items() if value is not None and name not in self.fields}
        return changed.replace(**given) if given else changed


def read_setup(path: str | os.PathLike[str], parameters: Mapping[str, Any]) -> SceneSettings:
    """What the scene file says about camera, exposure and seeds. Nothing is built, and no variant need be set.

    parameters : values for the scene's ``<default>`` names.  Raises InputError, one sentence.
    """
    return setup_of(parse_scene(path, parameters))


def setup_of(scene: SceneFile) -> SceneSettings:
    """The setup of the first sensor of a parsed scene. Raises InputError."""
    sensor, film = scene.sensor(), scene.film()
    film_fields: dict[str, Any] = {}
    lens_field_values: dict[str, Any] = {}
    try:
        node = film
        if film is not None and film.props.plugin_name() == FILM:
            _refuse_others(film.props, FILM_FIELDS, dotted=True)
            with folder_of(scene.path):
                film_fields = film_fields_of(film.props)
            setup_from(film_fields, {})  # what is wrong here stands in the film
        node = sensor
        if sensor.props.plugin_name() == SENSOR:
            nested = [name for name, _ in scene.children(sensor.props)]
            _refuse_others(sensor.props, (*SENSOR_FIELDS, *PASSED, *nested), dotted=False)
            lens_field_values = sensor_fields_of(sensor.props)
        return setup_from(film_fields, lens_field_values)
    except InputError as error:
        raise InputError(f"scene {scene.path.name!r}, {scene.where(node)}: {error}") from None


def film_fields_of(props: Any) -> dict[str, Any]:
    """What a <film type="photosensor"> says; files are looked for beside the scene."""
    words = {name: props[name] for name in props if name in FILM_FIELDS or "." in name}
    for name, value in words.items():
        if not isinstance(value, bool | int | float | str):
            raise InputError(f"{name} of a photosensor must be a <string>, <float>, <integer> or <boolean>.")
    for name in set(FILES) & set(words):
        found = Path(str(mitsuba().file_resolver().resolve(str(words[name]))))
        if found.is_file() and words[name] not in list_cameras():
            words[name] = str(found)
    return words


def sensor_fields_of(props: Any) -> dict[str, Any]:
    """What a <sensor type="camera"> says of its lens."""
    return {name: props[name] for name in props if name in SENSOR_FIELDS}


def setup_from(film: Mapping[str, Any], lens: Mapping[str, Any]) -> SceneSettings:
    """The checked setup of the words of a film and a sensor. Raises InputError."""
    own = {name: toml_value(v) if isinstance(v, str) else v for name, v in film.items() if "." in name}
    fields = own | lens_fields(lens)
    for name in sorted(set(own) & set(lens_fields(lens))):
        raise InputError(f"{name} stands in the film and in the sensor; give it in one of the two.")
    shot = {name: film[name] for name in SHOT if name in film}
    _check(shot, lens)
    setup = SceneSettings(
        fields=fields,
        focal_length_mm=lens.get("focal_length_mm"),
        focus_distance_m=lens.get("focus_distance_m"),
        unit_m=unit_m(lens["scene_unit"]) if "scene_unit" in lens else None,
        size={name: film[name] for name in SIZE if name in film},
        **shot,
    )
    return replace(setup, camera=setup.on(load_camera(film["camera"]))) if "camera" in film else setup


def lens_fields(lens: Mapping[str, Any]) -> dict[str, Any]:
    """Words of a <sensor type="camera"> → fields of a camera; a spectrum of the transmission becomes its curve."""
    fields = {LENS_FIELDS[word]: value for word, value in lens.items() if word in LENS_FIELDS}
    through = lens.get("transmission")
    if through is None:
        return fields
    if isinstance(through, int | float):
        return fields | {"lens.transmission": through}
    if not hasattr(through, "wavelengths"):
        raise InputError('transmission must be a <float>, or a <spectrum> of pairs, e.g. value="400:0.9, 700:0.95".')
    if through.is_uniform():
        return fields | {"lens.transmission": float(through.values[0])}
    return fields | {
        "lens.transmission": 1.0,
        "lens.transmission_curve": tuple(float(v) for v in through.values),
        "lens.transmission_wavelengths_nm": tuple(float(v) for v in through.wavelengths),
    }


def unit_m(scene_unit: str | float) -> float:
    """Metres per scene unit, from its name or its length in metres. Raises InputError."""
    if scene_unit in METRES:
        return METRES[str(scene_unit)]
    try:
        metres = float(scene_unit)
    except (TypeError, ValueError):
        known = ", ".join(METRES)
        raise InputError(f"scene_unit is {scene_unit!r}; it must be one of {known}, or metres per unit.") from None
    return require("scene_unit", metres, 1e-12, 1e12, "metres per unit, e.g. 0.001")


def _refuse_others(props: Any, known: Iterable[str], dotted: bool) -> None:
    for name in props:
        if name not in known and not (dotted and "." in name):
            kind = props.plugin_name()
            raise InputError(f"{name!r} is not a parameter of a {kind}.{nearest(name, known)}")


def _check(shot: Mapping[str, Any], lens: Mapping[str, Any]) -> None:
    """Refuse what would be refused later, while it is known where it stands."""
    Exposure(shot.get("exposure_s", 0.0), shot.get("temperature_k", 0.0))
    for name in ("seed", "serial"):
        require_seed(name, shot.get(name, 0))
    if shot.get("spectral", SPECTRAL[0]) not in SPECTRAL:
        raise InputError(f"spectral is {shot['spectral']!r}; it must be one of {', '.join(SPECTRAL)}.")
    for name, example in (("focal_length_mm", 25), ("focus_distance_m", 2)):
        if name in lens:
            require(name, lens[name], 1e-6, 1e9, f"e.g. {example}")
