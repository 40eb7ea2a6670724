"""Reads camera, exposure and seeds of a scene file: <sensor type="camera"> and <film type="photosensor">.

:mod:`.plugins` builds Mitsuba's own objects from them; :func:`settings_of` reads them without building anything.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from ...camera.camera import SET_BY_SCENE, Camera, with_fields_of
from ...camera.camera_file import camera_of, load_camera, toml_value
from ...camera.fingerprint import unused_note
from ...camera.shipped import DEFAULT_CAMERA, list_cameras
from ...core import Exposure, InputError, first_given, nearest, require, require_seed
from ...core.options import complete, part_of
from ...sensor.metering import Metering
from ..light.bands import BANDWIDTH_NM, SPECTRAL, Bands, choose_bands
from ..options import FileOptions, RenderOptions
from ..samples import hashed_seed
from ..variants import (
    MitsubaObject,
    Variant,
    choose_variant,
    is_polarized,
    mitsuba,
    parser_config,
    polarized,
    use,
)
from .parse_scene import parse_scene
from .plugin_names import OWN_PLUGINS
from .plugin_parameters import (
    EXPOSURE_PARAMETERS,
    FILM_PARAMETERS,
    LENS_PARAMETERS,
    PASSED_ON_PARAMETERS,
    SENSOR_PARAMETERS,
    SIZE_PARAMETERS,
)
from .polarizer_rays import polarised_by
from .scene_edits import SceneEdits
from .scene_file import SceneFile, as_input_error, searching
from .scene_nodes import SceneInput, check_loaded, parse_nodes, view_of_loaded
from .scene_sensors import each_sensor, with_sensor

SENSOR, FILM, _ = OWN_PLUGINS  # plugin names of the two elements
FILES = ("camera", "lens.prescription", "quantum_efficiency.file")  # these may be a path
SIZE, EXPOSURE_FIELDS, FILM_FIELDS, SENSOR_FIELDS, PASSED_ON = (
    tuple(one.name for one in those)
    for those in (
        SIZE_PARAMETERS,
        EXPOSURE_PARAMETERS,
        FILM_PARAMETERS,
        SENSOR_PARAMETERS,
        PASSED_ON_PARAMETERS,
    )
)
LENS_FIELDS = {one.name: field for field, one in LENS_PARAMETERS.items()}
METRES = {
    "km": 1e3,
    "m": 1.0,
    "dm": 0.1,
    "cm": 0.01,
    "mm": 1e-3,
    "um": 1e-6,
    "in": 0.0254,
    "ft": 0.3048,
}
OF_SENSOR = -4
"""Of the seeds of sensors: see :func:`hashed_seed`."""

Fields = dict[str, Any]  # parameter name → value, of one element


@dataclass(frozen=True, eq=False)
class SceneSettings:
    """Camera, exposure and seeds of a scene file; None, or empty, where the file does not set them.

    camera : the named one, with the fields that the file sets.  fields : those alone, by dotted name.
    exposure_s : seconds, or "auto".  meter : how it is metered, as text, see :meth:`Metering.of_text`.
    focal_length_mm, focus_distance_m, unit_m : of <sensor type="camera">; metres per scene unit.
    size : width, height and crop of the film, in pixels.
    is_default_camera : whether the file names no camera, and ``camera`` is the one that is taken then.
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
        """The exposure, metered unless the file sets its time; at 298.15 K unless it sets another temperature."""
        if self.exposure_s is None or isinstance(self.exposure_s, str):
            return self.metering()
        return Exposure(
            self.exposure_s, first_given(self.temperature_k, Exposure(0.0).temperature_k)
        )

    def metering(self, temperature_k: float | None = None) -> Metering:
        """How this file's exposure is metered, or would be, by default at its own temperature. Raises InputError."""
        temperature_k = first_given(
            temperature_k, self.temperature_k, Exposure(0.0).temperature_k
        )
        return (
            Metering(temperature_k)
            if self.meter is None
            else Metering.of_text(self.meter, temperature_k)
        )

    def metres(self, scene_unit: str | float | None) -> float | None:
        """Metres per scene unit: as asked for, else as the file says; None if neither does."""
        return self.unit_m if scene_unit is None else unit_m(scene_unit)

    def applied_to(self, camera: Camera) -> Camera:
        """The camera of this file, or the default one, with the fields that the file sets; focal length and focus apply
        to a prescription too. A camera that the user names is taken as it is."""
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
        """With the camera that is taken where nobody names one, and the fields that this file sets."""
        camera = self.applied_to(camera_of(DEFAULT_CAMERA))
        return replace(self, camera=camera, is_default_camera=True)

    def unused_note(self, camera: Camera) -> list[str]:
        """The sentence about fields that this file sets and that this named camera has otherwise, or none."""
        return unused_note(self.fields, self.applied_to(camera), camera)


def settings_of(scene: SceneFile) -> SceneSettings:
    """The settings of the sensor of a parsed scene that is rendered; no variant need be set. Raises InputError."""
    sensor, film = scene.sensor(), scene.film()
    of_film, of_sensor = Fields(), Fields()
    try:
        node = film or sensor
        if film is not None and film.props.plugin_name() == FILM:
            _check_names(
                film.props, (*FILM_FIELDS, *(name for name in film.props if "." in name))
            )  # a camera's field
            with searching(scene.resolver):
                of_film = film_fields_of(film.props)
        elif scene.exposure_s is not None:
            of_film = {"exposure_s": seconds_of(scene.exposure_s)}
        settings_from(of_film, {})  # its errors are located at the film
        node = sensor
        if sensor.props.plugin_name() == SENSOR:
            _check_names(
                sensor.props, (*SENSOR_FIELDS, *PASSED_ON, *dict(scene.children(sensor.props)))
            )
            of_sensor = sensor_fields_of(sensor.props)
        return settings_from(of_film, of_sensor)
    except InputError as error:
        raise InputError(f"scene {scene.name!r}, {scene.where(node)}: {error}") from None


def _check_names(props: MitsubaObject, known: Iterable[str]) -> None:
    """InputError for a parameter that is not known."""
    for name in props:
        if name not in known:
            raise InputError(
                f"{name[:80]!r} is not a parameter of a {props.plugin_name()}.{nearest(name, known)}"
            )


def film_fields_of(props: MitsubaObject) -> Fields:
    """Parameters of a <film type="photosensor">; files are searched beside the scene."""
    fields: Fields = {name: props[name] for name in props if name in FILM_FIELDS or "." in name}
    for name, value in fields.items():
        if not isinstance(value, bool | int | float | str):
            raise InputError(
                f"{name} of a photosensor must be a <string>, <float>, <integer> or <boolean>."
            )
    for name in set(FILES) & set(fields):
        found = Path(str(mitsuba().file_resolver().resolve(str(fields[name]))))
        if os.path.isfile(found) and fields[name] not in list_cameras():
            fields[name] = str(found)
    return fields


def sensor_fields_of(props: MitsubaObject) -> Fields:
    """Parameters of the lens of a <sensor type="camera">."""
    return {name: props[name] for name in props if name in SENSOR_FIELDS}


def settings_from(film: Fields, lens: Fields) -> SceneSettings:
    """The checked settings of the parameters of a film and a sensor. Raises InputError."""
    own = {
        name: toml_value(v) if isinstance(v, str) else v
        for name, v in film.items()
        if "." in name
    }
    of_lens = lens_fields(lens)
    for name in sorted(own.keys() & of_lens):
        raise InputError(
            f"{name} is set in the film and in the sensor; give it in one of the two."
        )
    exposure = {name: film[name] for name in EXPOSURE_FIELDS if name in film}
    time_s = exposure.get("exposure_s", "auto")
    Exposure(
        0.0 if time_s == "auto" else time_s, exposure.get("temperature_k", 0.0)
    )  # checked here, with line numbers
    if "meter" in exposure:
        Metering.of_text(exposure["meter"])
        if time_s != "auto":
            raise InputError(
                f"meter is {exposure['meter']!r} and exposure_s is {time_s!r}; leave one of them out."
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
        fields=own | of_lens,
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
            f"gain is {film['gain']!r}, and no camera is named; name the camera whose setting it is."
        )
    return settings


def lens_fields(lens: Fields) -> Fields:
    """Parameters of a <sensor type="camera"> → fields of a camera; a spectral transmission becomes its curve."""
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
    """The number in a <default name="exposure_s">, "auto" as it is; other text is left to the check of an exposure."""
    try:
        return float(text)
    except ValueError:
        return text


def unit_m(scene_unit: str | float) -> float:
    """Metres per scene unit, from its name or its length in metres. Raises InputError."""
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


@dataclass(frozen=True, eq=False)
class ParsedScene:
    """A scene file, parsed but not built, what it says of camera, exposure and seeds, and the variant set for it."""

    file: SceneFile
    settings: SceneSettings
    variant: Variant

    def in_variant_for(self, camera: Camera) -> ParsedScene:
        """The same in a variant that follows the polarisation of light, which is set from now on, where camera or scene
        polarise it. Raises InputError where another variant was asked for."""
        what = polarised_by(self.file, camera)
        if what is None or is_polarized():
            return self
        variant = polarized(self.variant)
        if self.variant.reason == "asked for" or self.file.holds_objects:
            raise InputError(
                f"{what}, which {self.variant.name} does not follow; load and render the scene in variant "
                f"{variant.name!r}, or ignore_polarization (--ignore-polarization) for unpolarised light."
            )
        use(variant)
        return replace(self, variant=variant, file=replace(self.file, config=parser_config()))

    def with_camera(self) -> ParsedScene:
        """With the default camera where the file names none."""
        if self.settings.camera is not None:
            return self
        return replace(self, settings=self.settings.with_default_camera())

    def seed(self, given: int | None) -> int:
        """The seed that was given, else the scene file's, else 1; of the sensors after the first one a seed that
        follows from it, so that their noise is independent. Raises InputError."""
        seed = require_seed("seed", first_given(given, self.settings.seed, 1))
        if not self._sensor_number:
            return seed
        return hashed_seed(seed, OF_SENSOR, self._sensor_number)

    def serial(self, given: int | None) -> int:
        """The serial number of the camera, by default 1, of the sensors after the first one counted on; a number of the
        scene file is that of its own sensor. Raises InputError."""
        if given is None and self.settings.serial is not None:
            return require_seed("serial", self.settings.serial)
        return require_seed("serial", first_given(given, 1)) + self._sensor_number

    @property
    def _sensor_number(self) -> int:
        return 0 if self.file.chosen is None else self.file.chosen.number


def parse(scene: SceneInput, options: Mapping[str, Any]) -> ParsedScene:
    """Parse a scene, and set the variant. options : those of :class:`render.options.SceneOptions`, or some of them.
    Raises InputError."""
    chosen = complete(FileOptions, part_of(FileOptions, options))
    parameters = chosen["parameters"]
    if parameters is not None and not isinstance(parameters, Mapping):
        raise InputError(
            f"parameters is {parameters!r}; pass a dict of the scene's <default> names and their values."
        )
    if (loaded := view_of_loaded(scene)) is not None:
        check_loaded(loaded.scene, options)
    variant = choose_variant(chosen["variant"])
    use(variant)
    if isinstance(scene, str | os.PathLike):
        file = parse_scene(
            scene, parameters or {}, chosen["integrator"], chosen["ignore_polarization"]
        )
    else:
        file = parse_nodes(scene, chosen)
    file = with_sensor(file, cast(str | None, chosen["sensor"]))
    with as_input_error(file.path):
        return ParsedScene(
            replace(file, edits=SceneEdits.of(options)), settings_of(file), variant
        )


def parse_sensors(scene: SceneInput, options: Mapping[str, Any]) -> dict[str, ParsedScene]:
    """Parse a scene once; it is returned for each of its sensors, by name. Raises InputError."""
    whole = parse(scene, {**options, "sensor": None})
    return {
        name: replace(whole, file=file, settings=settings_of(file))
        for name, file in each_sensor(whole.file).items()
    }


def bands_asked_for(
    options: RenderOptions, settings: SceneSettings, camera: Camera, usual: str
) -> Bands:
    """The channels asked for, else those of the scene file, else the ``usual`` ones. Raises InputError."""
    wavelength_nm = first_given(options["wavelength_nm"], settings.wavelength_nm)
    in_scene = "auto" if options["wavelength_nm"] else settings.spectral
    spectral = first_given(options["spectral"], in_scene, "auto")
    if spectral == "auto":  # channels have no width, and no electrons in bursts
        bands = wavelength_nm is not None or options["bandwidth_nm"] is not None
        spectral = "auto" if bands or camera.quantum_efficiency.quantum_yield else usual
    width_nm = first_given(options["bandwidth_nm"], settings.bandwidth_nm, BANDWIDTH_NM)
    return choose_bands(camera, wavelength_nm, width_nm, spectral)
