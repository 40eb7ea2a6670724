"""Registers two plugins for plain Mitsuba: <sensor type="camera"> and <film type="photosensor">.

Each is a factory: it reads its parameters and returns a built-in Mitsuba object (specfilm; perspective or thinlens), so
``mi.load_file`` and ``mi.render`` run at full speed in every spectral variant, and an unknown parameter still raises
with file and line. A film of Mitsuba can carry no data except its id, which contains the parameters; the sensor around
the film reads the pixel pitch from it.

The values of such a film are ∫L dλ over each band [W m⁻² sr⁻¹], or weighted by each colour filter. The solid angle of
the lens, exposure and noise follow in :func:`mitsuba_sensor.render`, which also traces a prescription; plain Mitsuba
gets the thin lens of the same focal length and f-number.
"""

from __future__ import annotations

import json

from ...core import InputError
from ..light.bands import BANDWIDTH_NM, choose_bands, response_film
from ..scene.plugin_parameters import PluginParameters, parameters_of
from ..scene.scene_settings import (
    FILM,
    PASSED_ON,
    built_in_sensor,
    film_fields_of,
    lens_fields,
    sensor_fields_of,
    settings_from,
)
from ..variants import MitsubaObject, mitsuba
from .raw_film import RAW, raw_film
from .silhouettes import splat_silhouettes_in_bands

OF_VIEW = ("focal_length_mm", "focus_distance_m", "scene_unit")
"""Parameters of a sensor that are not camera fields."""


def photosensor(props: MitsubaObject) -> MitsubaObject:
    """Return Mitsuba's specfilm for <film type="photosensor">."""
    return _photosensor(PluginParameters(film_fields_of(props)))


def _photosensor(parameters: PluginParameters) -> MitsubaObject:
    """Return a specfilm with the bands of its camera, and the parameters of film and sensor in its id."""
    mi, settings = mitsuba(), settings_from(parameters.film, {})
    if not mi.is_spectral:
        raise InputError(
            "a photosensor needs a spectral variant; call mitsuba.set_variant('scalar_spectral') first."
        )
    if (camera := settings.camera) is None:
        raise InputError(
            'a photosensor needs its camera, e.g. <string name="camera" value="konnik_table1"/>.'
        )
    width_nm = settings.bandwidth_nm or BANDWIDTH_NM
    bands = choose_bands(camera, settings.wavelength_nm, width_nm, settings.spectral or "auto")
    full = {"width": camera.sensor.columns, "height": camera.sensor.rows}
    film = response_film(bands.responses, {**full, **settings.size, "id": parameters.id()})
    if "_ad_" in mi.variant():
        splat_silhouettes_in_bands()
    return raw_film(film, parameters) if parameters.film.get("output") == RAW else film


def camera(props: MitsubaObject) -> MitsubaObject:
    """Return Mitsuba's perspective or thinlens sensor for <sensor type="camera">."""
    mi, lens = mitsuba(), sensor_fields_of(props)
    kind = mi.Properties.Type.Object
    nested = {name: props[name] for name in props if props.type(name) == kind}
    film_name = next((name for name, x in nested.items() if isinstance(x, mi.Film)), None)
    known = None if film_name is None else parameters_of(nested[film_name])
    if film_name is None or known is None:
        raise InputError(
            f'a camera needs a <film type="{FILM}">: its pixels and the focal length determine the view.'
        )
    settings = settings_from(known.film, lens)
    assert settings.camera is not None  # a photosensor is not built without one
    kind, view = built_in_sensor(settings, settings.camera, nested[film_name].size()[0])
    of_camera = {name: json.dumps(value) for name, value in lens_fields(lens).items()}  # TOML
    rest = {name: value for name, value in lens.items() if name in OF_VIEW}
    parameters = PluginParameters({**known.film, **of_camera}, rest)
    nested[film_name] = _photosensor(parameters)
    passed = {name: props[name] for name in props if name in PASSED_ON}
    sensor = mi.load_dict({"type": kind, "id": props.id(), **view, **passed, **nested})
    sensor.film().set_id(parameters.id())  # load_dict changes the id to the name in the dict
    return sensor
