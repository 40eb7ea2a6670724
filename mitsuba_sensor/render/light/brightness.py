"""Luminance of the brightest lamp and of the image, illuminance of the sensor, and one scale for all emitters.

RGB scenes rarely have a meaningful absolute brightness, and Mitsuba takes RGB (1, 1, 1) as 73 000 cd/m².
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...camera.camera import Camera
from ...core import Array, Caution, Float64Array, InputError
from ...core.band_average import band_integrals
from ...core.llvm import drjit
from ...optics.f_number_law import (
    numerical_aperture,
    pixel_response,
    solid_angle_sr,
    transmittance,
)
from ...optics.intrinsics import View
from ...optics.spectra import LUMENS_PER_WATT, VISIBLE_NM, luminous, photopic
from ..samples import SHORTEST_METERED_S
from ..variants import MitsubaObject, evaluate, mitsuba
from .bands import Bands

if TYPE_CHECKING:
    from ..passes.loaded_render import LoadedRender
    from .irradiance import Irradiance

THINGS = (
    (4e-4, "the darkest night sky"),
    (1.4e-3, "a landscape in full moonlight"),
    (2.0, "a floodlit building"),
    (25.0, "a landscape at sunset"),
    (250.0, "the white of a computer screen"),
    (700.0, "a landscape on an overcast day"),
    (5e3, "a landscape in full sunlight"),
    (1.2e4, "a fluorescent lamp"),
    (1.3e5, "a frosted light bulb"),
    (6e5, "the sun at the horizon"),
    (7e6, "the filament of a lamp"),
    (1.6e9, "the sun at noon"),
)
"""Luminances [cd/m²], from Wikipedia, "Orders of magnitude (luminance)"."""
VISIBLE_FRACTION_MIN = 0.95  # of V(λ), covered by the bands, so their sum is a luminance
BAND_NM_MAX = 50.0  # flat bands of this width are right to 2 % for the luminance of daylight
IMAGE_CD_PER_M2_MAX = 1e5  # sunlit snow has 3e4
LAMP_CD_PER_M2_MAX = 1e8  # an arc lamp has as much
SCALE_DIGITS = 4  # can be typed, and does not change with the last bits of a render
LAMP = "AreaLight"  # Mitsuba's emitter with a luminance, other than the sky
SIDE_POINTS, SCALAR_SIDE_POINTS = 4, 2  # along each side of a lamp that may have a texture
STEP_NM, SCALAR_STEP_NM = 1, 4  # between the wavelengths at which a lamp is evaluated
NOT_LUMINOUS = (
    f"luminance needs a render of adjacent bands of at most {BAND_NM_MAX:g} nm that cover visible light; omit it, or "
    "take spectral='cube' and a camera that detects 400 to 700 nm, without wavelength_nm."
)


def cd_per_m2(luminance: float) -> str:
    """Return ``1.5 cd/m² (0.75 times as bright as a floodlit building)``."""
    value, name = min(THINGS, key=lambda thing: abs(math.log(thing[0] / max(luminance, 1e-9))))
    ratio = luminance / value
    return f"{rounded(luminance)} cd/m² ({float(f'{ratio:.2g}'):g} times as bright as {name})"


def brightness_sentence(brightness: Mapping[str, float | None]) -> str:
    """Return one line with the known brightness values of a light; empty if none is known."""
    lamp, median, illuminance = (
        brightness[name]
        for name in ("brightest_lamp_cd_per_m2", "median_cd_per_m2", "illuminance_lx")
    )
    parts = []
    if lamp is not None:
        parts.append(f"luminance of the brightest lamp {cd_per_m2(lamp)}")
    if median is not None and illuminance is not None:
        parts.append(f"median luminance of the image {cd_per_m2(median)}")
        parts.append(f"mean illuminance of the sensor {rounded(illuminance)} lux")
    return "; ".join(parts)


def rounded(value: float) -> str:
    """Return three digits, in groups of three from ten thousand."""
    if 1e4 <= value < 1e10:
        return f"{float(f'{value:.3g}'):,.0f}".replace(",", "\u00a0")
    return f"{value:.0f}" if 1e3 <= value < 1e4 else f"{value:.3g}"


def luminous_weights(bands: Bands) -> Float64Array | None:
    """Return the illuminance of 1 W m⁻² nm⁻¹ in each band, shape (B,) [lx]; None if the bands do not cover visible
    light."""
    if bands.kind != "cube" or bands.bandwidths_nm.max() > BAND_NM_MAX:
        return None
    points = np.arange(VISIBLE_NM[0], VISIBLE_NM[1] + 1)
    of_bands = band_integrals(photopic, points, bands.edges_nm[:-1], bands.edges_nm[1:])
    if of_bands.sum() < VISIBLE_FRACTION_MIN * photopic(points).sum():
        return None
    return np.asarray(LUMENS_PER_WATT * of_bands)


def image_brightness(
    light: Irradiance, bands: Bands, view: View, camera: Camera
) -> tuple[float | None, float | None]:
    """Return the median luminance of the image [cd/m²], from the irradiance and the f-number law, and the mean
    illuminance of the sensor [lx]; None if unknown."""
    weights = luminous_weights(bands)
    if weights is None:
        return None, None
    illuminance = light.data @ weights.astype(np.float32)
    passed = transmittance(camera, bands.wavelengths_nm)
    weights = np.divide(weights, passed, out=np.zeros_like(weights), where=passed > 0)
    angle_sr = (
        pixel_response(view, camera) * math.pi * numerical_aperture(view, camera) ** 2
        if view.sequential
        else solid_angle_sr(view, camera)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        luminance = light.data @ weights.astype(np.float32) / angle_sr  # no copy of the data
    luminance = luminance[np.isfinite(luminance)]
    illuminance = illuminance[np.isfinite(illuminance)]
    return (
        float(np.median(luminance)) if luminance.size else None,
        float(illuminance.mean(dtype=np.float64)) if illuminance.size else None,
    )


def brightest_lamp(scene: MitsubaObject) -> float | None:
    """Return the highest luminance of the area lights [cd/m²]; None without one.

    Each is evaluated from outside at several points, because it may have a texture.
    """
    mi = mitsuba()
    lamps = [n for n, emitter in enumerate(scene.emitters()) if emitter.class_name() == LAMP]
    if not lamps:
        return None
    scalar = mi.variant().startswith("scalar")
    side, step_nm = (SCALAR_SIDE_POINTS, SCALAR_STEP_NM) if scalar else (SIDE_POINTS, STEP_NM)
    middles = (np.arange(side) + 0.5) / side
    points = np.array(np.meshgrid(middles, middles)).reshape(2, -1).T
    wavelengths_nm: Float64Array = np.arange(380.0, 780.0, step_nm) + 0.5
    quarters = wavelengths_nm.reshape(-1, 4)
    grid = np.meshgrid(lamps, range(len(points)), range(len(quarters)), indexing="ij")
    lamp, point, band = (numbers.ravel() for numbers in grid)
    inputs = np.column_stack([lamp, points[point], quarters[band]])
    (radiance,) = evaluate(partial(_lamp_radiance, scene), inputs)
    spectra = radiance.reshape(-1, wavelengths_nm.size)
    luminances = [luminous(wavelengths_nm, spectrum) for spectrum in spectra]
    return max((value for value in luminances if math.isfinite(value)), default=None)


def _lamp_radiance(
    scene: MitsubaObject, lamp: Array, u: Array, v: Array, *wavelengths_nm: Array
) -> tuple[MitsubaObject]:
    """Return the radiance at four wavelengths seen at a point (u, v) of a lamp from just outside of it."""
    mi, dr = mitsuba(), drjit()
    if mi.variant().startswith("scalar"):
        emitter = scene.emitters()[int(lamp)]
    else:
        emitter = dr.gather(mi.EmitterPtr, scene.emitters_dr(), mi.UInt32(lamp))
    place = emitter.get_shape().sample_position(0.0, mi.Point2f(u, v))
    size = dr.max(dr.abs(place.p)) + 1.0
    hit = scene.ray_intersect(mi.Ray3f(place.p + 1e-4 * size * place.n, -place.n))
    hit.wavelengths = mi.UnpolarizedSpectrum(*wavelengths_nm)
    seen = hit.emitter(scene)
    if seen is None:  # in a scalar variant
        return (mi.UnpolarizedSpectrum(0.0),)
    radiance = mi.unpolarized_spectrum(seen.eval(hit))
    return (dr.select(hit.is_valid(), radiance, 0.0),)


def scale_to(luminance: float, light: Irradiance) -> float:
    """Return the factor on all emitters that gives the image this median luminance.  light : at factor 1. Raises
    InputError."""
    assert light.statistics.brightness is not None
    median = light.statistics.brightness["median_cd_per_m2"]
    if median is None:
        raise InputError(NOT_LUMINOUS)
    if not median > 0:
        raise InputError(
            f"luminance is {luminance:g} and the median pixel of the image is black, so no scale reaches it; show "
            "less of the black background, or change the emitters in the scene."
        )
    return float(f"{luminance / median:.{SCALE_DIGITS}g}")


def with_brightness(light: Irradiance, render: LoadedRender) -> Irradiance:
    """Return the light of a render with its brightness in the statistics, and a note if the light is very bright."""
    lamp, scale = render.at_rest.brightest_lamp_cd_per_m2, render.bands.light_scale
    lamp = None if lamp is None else lamp * scale
    median, illuminance = image_brightness(
        light, render.bands, render.scene.view, render.camera
    )
    statistics, notes = light.statistics, list[str]()
    if scale != 1:
        notes.append(
            f"all light is scaled by {scale:g}, so the image has the requested median luminance"
        )
    bright, row_s = list[str](), (render.camera.sensor.row_time_us or 0.0) * 1e-6
    exposure_s = math.inf if statistics.metering is None else statistics.metering["exposure_s"]
    if exposure_s < max(SHORTEST_METERED_S, row_s):
        limit = f"{SHORTEST_METERED_S:g} s"
        if row_s > SHORTEST_METERED_S:
            limit = f"a row of the sensor ({row_s:g} s)"
        bright.append(f"the metered exposure time is {exposure_s:g} s, shorter than {limit}")
    if median is not None and median > IMAGE_CD_PER_M2_MAX:
        bright.append(f"the image has a median luminance of {cd_per_m2(median)}")
    if lamp is not None and lamp > LAMP_CD_PER_M2_MAX:
        bright.append(f"the brightest lamp has {cd_per_m2(lamp)}")
    if bright:
        notes.append(
            Caution(
                f"the light is very bright: {', and '.join(bright)}; render with luminance=500, which scales "
                "all light to a median of 500 cd/m²"
            )
        )
    brightness: dict[str, float | None] = {
        "brightest_lamp_cd_per_m2": lamp,
        "median_cd_per_m2": median,
        "illuminance_lx": illuminance,
        "light_scale": scale,
    }
    notes = [*statistics.notes, *notes]
    return replace(
        light, statistics=replace(statistics, brightness=brightness, notes=tuple(notes))
    )
