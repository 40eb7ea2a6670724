"""Our two elements in plain Mitsuba: <sensor type="camera"> and <film type="photosensor">.

Each is a factory: it reads its parameters and returns an object of Mitsuba's own (specfilm; perspective or thinlens),
so that ``mi.load_file`` and ``mi.render`` run at full speed in every spectral variant, and a parameter that nobody read
still raises with its file and line. A film of Mitsuba can carry nothing of ours but its id; there it keeps its words,
which live and die with it, and there the sensor around it finds the pitch of its pixels.

The values of such a film are ∫L dλ over each band [W m⁻² sr⁻¹], or what each colour filter makes of it: the lens's
solid angle, exposure and noise come afterwards, with :func:`mitsuba_sensor.render`. A lens with a prescription is
traced there only; plain Mitsuba gets the thin lens of the same focal length and f-number.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError
from .bands import choose_bands
from .film import response_film
from .scene_settings import FILM, PASSED, SENSOR, SceneSettings, film_fields_of, sensor_fields_of, setup_from
from .variants import mitsuba

if TYPE_CHECKING:
    from ..sensor.camera import Camera

BANDWIDTH_NM = 10.0  # the default of mitsuba_sensor.render


def register() -> None:
    """Make the two elements known to Mitsuba, in the variant that is set and in all that will be. May be repeated."""
    mi = mitsuba()
    mi.detail.add_variant_callback(_register)  # a set: the same function is kept once
    if mi.variant() is not None:
        _register(None, mi.variant())


def built_in(setup: SceneSettings, camera: Camera, columns: int) -> tuple[str, dict[str, Any]]:
    """Mitsuba's own sensor that a <sensor type="camera"> stands for: its type and its parameters.

    A thin lens of focal length f in focus at d has its image at s = f·d/(d − f), and f without a focus distance: then
    all is sharp, and no lens samples are drawn. Field of view 2·atan(columns·pitch/(2·s)), aperture radius f/(2·N).
    columns : width of the film in pixels.  Raises InputError.
    """
    if setup.focal_length_mm is None:
        raise InputError('a camera needs its focal length, e.g. <float name="focal_length_mm" value="25"/>.')
    focal_m, focus_m, unit_m = setup.focal_length_mm * 1e-3, setup.focus_distance_m, setup.unit_m or 1.0
    if focus_m is not None and focus_m <= focal_m:
        far = f"more than the focal length, {focal_m:g} m"
        raise InputError(f"focus_distance_m is {focus_m:g}; it must be {far} (the distance of what is sharp, e.g. 2).")
    image_m = focal_m if focus_m is None else focal_m * focus_m / (focus_m - focal_m)
    half_width = columns * camera.pixel.pitch_x_um * 1e-6 / (2 * image_m)
    view = {"fov": 2 * math.degrees(math.atan(half_width)), "fov_axis": "x"}
    if focus_m is None:
        return "perspective", view
    radius_m = focal_m / (2 * camera.lens.f_number)
    return "thinlens", {**view, "aperture_radius": radius_m / unit_m, "focus_distance": focus_m / unit_m}


def _register(_before: str | None, _now: str | None) -> None:
    mi = mitsuba()
    mi.register_film(FILM, _film)
    mi.register_sensor(SENSOR, _sensor)


def _film(props: Any) -> Any:
    """<film type="photosensor"> → a specfilm with the bands of its camera."""
    words = film_fields_of(props)
    return _photosensor(words, setup_from(words, {}))


def _photosensor(words: Mapping[str, Any], setup: SceneSettings) -> Any:
    """A specfilm that carries these words."""
    mi, camera = mitsuba(), setup.camera
    if not mi.is_spectral:
        raise InputError("a photosensor needs a spectral variant; call mitsuba.set_variant('scalar_spectral') first.")
    if camera is None:
        raise InputError('a photosensor needs its camera, e.g. <string name="camera" value="konnik_table1"/>.')
    bands = choose_bands(camera, setup.wavelength_nm, setup.bandwidth_nm or BANDWIDTH_NM, setup.spectral or "auto")
    whole = {"width": camera.sensor.columns, "height": camera.sensor.rows}
    return response_film(mi, bands.responses, {**whole, **setup.size, "id": f"{FILM} {json.dumps(words)}"})


def _sensor(props: Any) -> Any:
    """<sensor type="camera"> → Mitsuba's perspective or thinlens."""
    mi, lens = mitsuba(), sensor_fields_of(props)
    nested = {name: props[name] for name in props if props.type(name) == mi.Properties.Type.Object}
    film_name = next((name for name, value in nested.items() if isinstance(value, mi.Film)), None)
    if film_name is None or not nested[film_name].id().startswith(f"{FILM} "):
        raise InputError(f'a camera needs a <film type="{FILM}">: its pixels and the focal length make the view.')
    words = json.loads(nested[film_name].id().removeprefix(f"{FILM} "))
    setup = setup_from(words, lens)
    camera: Any = setup.camera  # which the film has, or it would not be built
    kind, view = built_in(setup, camera, nested[film_name].size()[0])
    if "transmission" in lens:  # which the channels of the film contain
        nested[film_name] = _photosensor(words, setup)
    passed = {name: props[name] for name in props if name in PASSED}
    return mi.load_dict({"type": kind, "id": props.id(), **view, **passed, **nested})
