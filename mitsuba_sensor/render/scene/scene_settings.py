"""Reads camera, exposure and seeds of a scene file: <sensor type="camera"> and <film type="photosensor">.

:mod:`mitsuba_sensor.render.plugins` builds Mitsuba's own objects from them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ...camera.camera import SET_BY_SCENE, Camera, with_fields_of
from ...camera.camera_file import camera_of, load_camera, toml_value
from ...camera.fingerprint import unused_note
from ...camera.shipped import DEFAULT_CAMERA, list_cameras
from ...core import Exposure, InputError, first_given, require, require_seed
from ...sensor.metering import Metering
from ..light.bands import BANDWIDTH_NM, SPECTRAL, Bands, choose_bands
from ..options import RenderOptions
from ..variants import MitsubaObject, mitsuba
from .mitsuba_errors import OWN_PLUGINS
from .plugin_parameters import (
    EXPOSURE_PARAMETERS,
    FILM_PARAMETERS,
    LENS_PARAMETERS,
    PASSED_ON_PARAMETERS,
    SENSOR_PARAMETERS,
    SIZE_PARAMETERS,
)

SENSOR, FILM, _ = OWN_PLUGINS  # plugin names of the two elements
FILES = ("camera", "lens.prescription", "quantum_efficiency.file")  # these can be paths
SIZE, EXPOSURE_FIELDS, FILM_FIELDS, SENSOR_FIELDS, PASSED_ON = (
    tuple(parameter.name for parameter in parameters)
    for parameters in (
        SIZE_PARAMETERS,
        EXPOSURE_PARAMETERS,
        FILM_PARAMETERS,
        SENSOR_PARAMETERS,
        PASSED_ON_PARAMETERS,
    )
)
LENS_FIELDS = {parameter.name: field for field, parameter in LENS_PARAMETERS.items()}
METRES = {"km": 1e3, "m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6}
METRES |= {"in": 0.0254, "ft": 0.3048}
Fields = dict[str, Any]  # parameter name → value, of one element


@dataclass(frozen=True, eq=False)
class SceneSettings:
    """Camera, exposure and seeds of a scene file; None or empty if the file does not set them.

    camera : the named camera with the fields that the file sets.  fields : only these fields, by dotted name.
    exposure_s : seconds, or "auto".  meter : text for the metering, see :meth:`Metering.of_text`.
    focal_length_mm, focus_distance_m, unit_m : of <sensor type="camera">; unit_m is metres per scene unit.
    size : width, height and crop of the film [pixels].
    is_default_camera : True if the file names no camera, so ``camera`` is the default camera.
    """

    camera: Camera | None = None
    fields: Mapping[str, object] = field(default_factory=dict)
    exposure_s: float | str | None = None
    meter: str | None = None
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
    is_default_camera: bool = False

    @property
    def exposure(self) -> Exposure | Metering:
        """The exposure, metered unless the file sets a time, at 298.15 K unless the file sets a temperature."""
        if self.exposure_s is None or isinstance(self.exposure_s, str):
            return self.metering()
        return Exposure(
            self.exposure_s, first_given(self.temperature_k, Exposure(0.0).temperature_k)
        )

    def metering(self, temperature_k: float | None = None) -> Metering:
        """Return the metering of the file, by default at the temperature of the file. Raises InputError."""
        temperature_k = first_given(
            temperature_k, self.temperature_k, Exposure(0.0).temperature_k
        )
        return (
            Metering(temperature_k=temperature_k)
            if self.meter is None
            else Metering.of_text(self.meter, temperature_k)
        )

    def metres(self, scene_unit: str | float | None) -> float | None:
        """Return metres per scene unit as requested, else as in the file; None if unknown."""
        return self.unit_m if scene_unit is None else unit_m(scene_unit)

    def applied_to(self, camera: Camera) -> Camera:
        """Return the camera of this file, or the default camera, with the fields that the file sets; focal length and
        focus also apply to a prescription. A camera that the user names is not changed."""
        changed = with_fields_of(camera, self.fields, SET_BY_SCENE)
        if changed.lens.prescription is None:
            return changed
        focus = {
            "lens.focal_length_mm": self.focal_length_mm,
            "lens.focus_m": self.focus_distance_m,
        }
        given = {
            name: value
            for name, value in focus.items()
            if value is not None and name not in self.fields
        }
        return with_fields_of(changed, given, SET_BY_SCENE)

    def with_default_camera(self) -> SceneSettings:
        """Return the settings with the default camera and the fields that this file sets."""
        camera = self.applied_to(camera_of(DEFAULT_CAMERA))
        return replace(self, camera=camera, is_default_camera=True)

    def unused_note(self, camera: Camera) -> list[str]:
        """Return a note on fields of this file that differ in a named camera, if any."""
        return unused_note(self.fields, self.applied_to(camera), camera)


def film_fields_of(props: MitsubaObject) -> Fields:
    """Return the parameters of a <film type="photosensor">; files are searched beside the scene."""
    fields: Fields = {name: props[name] for name in props if name in FILM_FIELDS or "." in name}
    for name, value in fields.items():
        if not isinstance(value, bool | int | float | str):
            raise InputError(
                f"{name} of a photosensor must be a <string>, <float>, <integer> or <boolean>."
            )
    for name in set(FILES) & set(fields):
        file = Path(str(mitsuba().file_resolver().resolve(str(fields[name]))))
        if os.path.isfile(file) and fields[name] not in list_cameras():
            fields[name] = str(file)
    return fields


def sensor_fields_of(props: MitsubaObject) -> Fields:
    """Return the lens parameters of a <sensor type="camera">."""
    return {name: props[name] for name in props if name in SENSOR_FIELDS}


def settings_from(film: Fields, lens: Fields) -> SceneSettings:
    """Return the checked settings of a film and a sensor. Raises InputError."""
    of_camera = {
        name: toml_value(x) if isinstance(x, str) else x
        for name, x in film.items()
        if "." in name
    }
    of_lens = lens_fields(lens)
    for name in sorted(of_camera.keys() & of_lens):
        raise InputError(f"{name} is set in both film and sensor; give it in one of the two.")
    exposure = {name: film[name] for name in EXPOSURE_FIELDS if name in film}
    time_s = exposure.get("exposure_s", "auto")
    # Checked here for errors with line numbers.
    Exposure(0.0 if time_s == "auto" else time_s, exposure.get("temperature_k", 0.0))
    if "meter" in exposure:
        Metering.of_text(exposure["meter"])
        if time_s != "auto":
            raise InputError(
                f"meter is {exposure['meter']!r} and exposure_s is {time_s!r}; remove one of them."
            )
    for name in ("seed", "serial"):
        require_seed(name, exposure.get(name, 0))
    if film.get("output", "bands") not in ("bands", "raw"):
        raise InputError(f"output is {film['output']!r}; it must be bands or raw.")
    if exposure.get("spectral", SPECTRAL[0]) not in SPECTRAL:
        raise InputError(
            f"spectral is {exposure['spectral']!r}; it must be one of {', '.join(SPECTRAL)}."
        )
    for name, example in (("focal_length_mm", 25), ("focus_distance_m", 2)):
        if name in lens:
            require(name, lens[name], 1e-6, 1e9, f"e.g. {example}")
    settings = SceneSettings(
        fields=of_camera | of_lens,
        focal_length_mm=lens.get("focal_length_mm"),
        focus_distance_m=lens.get("focus_distance_m"),
        unit_m=unit_m(lens["scene_unit"]) if "scene_unit" in lens else None,
        size={name: film[name] for name in SIZE if name in film},
        **exposure,
    )
    if "camera" in film:
        camera = load_camera(film["camera"]).at_gain(film.get("gain"))
        return replace(settings, camera=settings.applied_to(camera))
    if "gain" in film:
        raise InputError(
            f"gain is {film['gain']!r}, but no camera is named; name the camera with this gain setting."
        )
    return settings


def lens_fields(lens: Fields) -> Fields:
    """Return parameters of a <sensor type="camera"> as camera fields; a spectral transmission becomes a curve."""
    fields = {LENS_FIELDS[name]: value for name, value in lens.items() if name in LENS_FIELDS}
    transmission = lens.get("transmission")
    if transmission is None:
        return fields
    if isinstance(transmission, int | float):
        return fields | {"lens.transmission": transmission}
    if not hasattr(transmission, "wavelengths"):
        raise InputError(
            'transmission must be a <float>, or a <spectrum> of pairs, e.g. value="400:0.9, 700:0.95".'
        )
    if transmission.is_uniform():
        return fields | {"lens.transmission": float(transmission.values[0])}
    curve, nodes_nm = (
        tuple(map(float, numbers))
        for numbers in (transmission.values, transmission.wavelengths)
    )
    table = {"lens.transmission_curve": curve, "lens.transmission_wavelengths_nm": nodes_nm}
    return fields | {"lens.transmission": 1.0, **table}


def seconds_of(text: str) -> float | str:
    """Return the number in a <default name="exposure_s">; other text, e.g. "auto", is returned unchanged."""
    try:
        return float(text)
    except ValueError:
        return text


def unit_m(scene_unit: str | float) -> float:
    """Return metres per scene unit, from its name or its length in metres. Raises InputError."""
    if isinstance(scene_unit, str) and scene_unit in METRES:
        return METRES[scene_unit]
    try:
        metres = float(scene_unit)
    except (TypeError, ValueError, OverflowError):
        known = ", ".join(METRES)
        raise InputError(
            f"scene_unit is {scene_unit!r}; it must be one of {known}, or metres per unit."
        ) from None
    return require("scene_unit", metres, 1e-12, 1e12, "metres per unit, e.g. 0.001")


def bands_asked_for(
    options: RenderOptions, settings: SceneSettings, camera: Camera, default: str
) -> Bands:
    """Return the requested channels, else the channels of the scene file, else the default. Raises InputError."""
    wavelength_nm = first_given(options["wavelength_nm"], settings.wavelength_nm)
    in_scene = "auto" if options["wavelength_nm"] else settings.spectral
    spectral = first_given(options["spectral"], in_scene, "auto")
    if spectral == "auto":  # channels have no width and no quantum yield
        bands = wavelength_nm is not None or options["bandwidth_nm"] is not None
        spectral = "auto" if bands or camera.quantum_efficiency.quantum_yield else default
    width_nm = first_given(options["bandwidth_nm"], settings.bandwidth_nm, BANDWIDTH_NM)
    return choose_bands(camera, wavelength_nm, width_nm, spectral)


def built_in_sensor(
    settings: SceneSettings, camera: Camera, columns: int
) -> tuple[str, dict[str, float | str]]:
    """Return type and parameters of the Mitsuba sensor that replaces a <sensor type="camera">.

    A thin lens of focal length f focused at d has its image at s = f·d/(d − f). Without a focus distance s = f, and a
    pinhole images everything sharply. The field of view is 2·atan(columns·pitch/(2·s)), the aperture radius f/(2·N).

    columns : width of the film [pixels].  Raises InputError.
    """
    if settings.focal_length_mm is None:
        raise InputError(
            'a camera needs its focal length, e.g. <float name="focal_length_mm" value="25"/>.'
        )
    focal_m, focus_m = settings.focal_length_mm * 1e-3, settings.focus_distance_m
    unit_m = settings.unit_m or 1.0
    if focus_m is not None and focus_m <= focal_m:
        far = f"more than the focal length, {focal_m:g} m (the distance of objects in focus, e.g. 2)"
        raise InputError(f"focus_distance_m is {focus_m:g}; it must be {far}.")
    image_m = focal_m if focus_m is None else focal_m * focus_m / (focus_m - focal_m)
    half_width = columns * camera.pixel.pitch_x_um * 1e-6 / (2 * image_m)
    view: dict[str, float | str] = {
        "fov": 2 * math.degrees(math.atan(half_width)),
        "fov_axis": "x",
    }
    if focus_m is None:
        return "perspective", view
    radius_m = focal_m / (2 * camera.lens.f_number)
    view |= {"aperture_radius": radius_m / unit_m, "focus_distance": focus_m / unit_m}
    return "thinlens", view
