"""Luminance of the brightest lamp and of the picture, illuminance of the sensor; and one scale for all emitters.

A scene in RGB has no absolute brightness that its author thought of, and Mitsuba takes 1, 1, 1 as 73 000 cd/m².
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...camera.camera import Camera
from ...core import Caution, Float64Array, InputError
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
from ..variants import MitsubaObject, mitsuba
from .bands import Bands

if TYPE_CHECKING:
    from ..passes.loaded_render import LoadedRender
    from .irradiance import Irradiance

FAMILIAR = (
    (4e-4, "the darkest night sky"),
    (1.4e-3, "a scene under the full moon"),
    (2.0, "a floodlit building"),
    (25.0, "a scene at sunset"),
    (250.0, "the white of a computer screen"),
    (700.0, "a scene on an overcast day"),
    (5e3, "a scene in full sunlight"),
    (1.2e4, "a fluorescent lamp"),
    (1.3e5, "a frosted light bulb"),
    (6e5, "the sun at the horizon"),
    (7e6, "the filament of a lamp"),
    (1.6e9, "the sun at noon"),
)
"""Luminances [cd/m²] from Wikipedia, "Orders of magnitude (illuminance)", where each has its source."""
ALIKE = 3.0  # a factor within which two luminances are called alike
VISIBLE_SHARE = 0.95  # of V(λ) that the bands must cover, so that their sum is a luminance
WIDEST_NM = 50.0  # of bands whose spectrum may be taken as flat: the luminance of daylight is then right to 2 %
HIGHEST_PICTURE_CD_PER_M2 = 1e5  # sunlit snow has 3e4
HIGHEST_LAMP_CD_PER_M2 = 1e8  # an arc lamp has as much
DIGITS = 4  # of the scale, so that it can be typed, and is the same where the last bits of a render are not
LAMP = "AreaLight"  # the emitter of Mitsuba that has a luminance, and is no sky
POINTS, FEW_POINTS = (
    4,
    2,
)  # along each side of a lamp that may have a texture; few in scalar variants
STEP_NM, WIDE_STEP_NM = 1, 4  # between wavelengths at which a lamp is looked at
NOT_LUMINOUS = (
    f"luminance needs a render of adjacent bands of at most {WIDEST_NM:g} nm that cover visible light; leave it out, "
    "or take spectral='cube' and a camera that sees 400 to 700 nm, without wavelength_nm."
)


def cd_per_m2(luminance: float) -> str:
    """``876 000 cd/m², like the sun at the horizon``."""
    value, name = min(
        FAMILIAR, key=lambda known: abs(math.log(known[0] / max(luminance, 1e-9)))
    )
    ratio = luminance / value
    like = f"{float(f'{ratio:.2g}'):g} ×"
    if 1 / ALIKE <= ratio <= ALIKE:
        like = "like"
    return f"{rounded(luminance)} cd/m², {like} {name}"


def brightness_sentence(found: Mapping[str, float | None]) -> str:
    """What is known of the brightness of a light, in one line; empty where nothing is."""
    lamp, median, illuminance = (
        found[name]
        for name in ("brightest_lamp_cd_per_m2", "median_cd_per_m2", "illuminance_lx")
    )
    parts = []
    if lamp is not None:
        parts.append(f"the brightest lamp has {cd_per_m2(lamp)}")
    if median is not None and illuminance is not None:
        parts.append(f"the picture {cd_per_m2(median)}, in the median")
        parts.append(f"the sensor {rounded(illuminance)} lux on average")
    return "; ".join(parts)


def rounded(value: float) -> str:
    """Three digits, in groups of three from ten thousand on."""
    if not 1e4 <= value < 1e10:
        return f"{value:.3g}" if value < 1e3 or value >= 1e10 else f"{value:.0f}"
    return f"{float(f'{value:.3g}'):,.0f}".replace(",", "\u00a0")


def luminous_weights(bands: Bands) -> Float64Array | None:
    """Illuminance of 1 W m⁻² nm⁻¹ in each band, (B,) [lx]; None where the bands are not visible light as a whole."""
    if bands.kind != "cube" or bands.bandwidths_nm.max() > WIDEST_NM:
        return None
    points = np.arange(VISIBLE_NM[0], VISIBLE_NM[1] + 1)
    of_bands = band_integrals(photopic, points, bands.edges_nm[:-1], bands.edges_nm[1:])
    if of_bands.sum() < VISIBLE_SHARE * photopic(points).sum():
        return None
    return np.asarray(LUMENS_PER_WATT * of_bands)


def median_luminance(
    light: Irradiance, bands: Bands, view: View, camera: Camera
) -> float | None:
    """Median luminance of the picture [cd/m²], from the irradiance on the sensor and the f-number law."""
    weights = luminous_weights(bands)
    if weights is None:
        return None
    passed = transmittance(camera, bands.wavelengths_nm)
    weights = np.divide(weights, passed, out=np.zeros_like(weights), where=passed > 0)
    angle_sr = (
        pixel_response(view, camera) * math.pi * numerical_aperture(view, camera) ** 2
        if view.sequential
        else solid_angle_sr(view, camera)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        luminance = light.data @ weights.astype(np.float32) / angle_sr  # no copy of the data
    known = luminance[np.isfinite(luminance)]
    return float(np.median(known)) if known.size else None


def mean_illuminance(light: Irradiance, bands: Bands) -> float | None:
    """Mean illuminance of the sensor [lx]."""
    weights = luminous_weights(bands)
    if weights is None:
        return None
    illuminance = light.data @ weights.astype(np.float32)
    known = illuminance[np.isfinite(illuminance)]
    return float(known.mean(dtype=np.float64)) if known.size else None


def brightest_lamp(scene: MitsubaObject) -> float | None:
    """The highest luminance of the lamps with a surface [cd/m²]; None without one.

    Each is looked at from outside in several points, because it may have a texture.
    """
    mi, dr = mitsuba(), drjit()
    lamps = [n for n, one in enumerate(scene.emitters()) if one.class_name() == LAMP]
    if not lamps:
        return None
    scalar = mi.variant().startswith("scalar")
    side, step_nm = (FEW_POINTS, WIDE_STEP_NM) if scalar else (POINTS, STEP_NM)
    middles = (np.arange(side) + 0.5) / side
    points = np.array(np.meshgrid(middles, middles)).reshape(2, -1).T.tolist()
    wavelengths_nm: Float64Array = np.arange(380.0, 780.0, step_nm) + 0.5
    quarters = wavelengths_nm.reshape(-1, 4)
    radiance: Float64Array = np.empty((len(lamps), len(points), wavelengths_nm.size))
    if scalar:
        for n, lamp in enumerate(lamps):
            for k, point in enumerate(points):
                emitter = scene.emitters()[lamp]
                four = [np.ravel(_seen(scene, emitter, point, nm)) for nm in quarters.tolist()]
                radiance[n, k] = np.concatenate(four)
    else:
        grid = np.array(
            np.meshgrid(lamps, range(len(points)), range(len(quarters)), indexing="ij")
        )
        which, where, band = grid.reshape(3, -1)
        emitters = dr.gather(mi.EmitterPtr, scene.emitters_dr(), mi.UInt32(which.tolist()))
        u_v = [mi.Float(np.array(points)[where, axis].tolist()) for axis in (0, 1)]
        nm = [mi.Float(quarters[band, k].tolist()) for k in range(4)]
        seen = np.array(_seen(scene, emitters, u_v, nm)).reshape(4, *grid.shape[1:])
        radiance[:] = np.moveaxis(seen, 0, -1).reshape(radiance.shape)
    found = [luminous(wavelengths_nm, x) for x in radiance.reshape(-1, wavelengths_nm.size)]
    return max((value for value in found if math.isfinite(value)), default=None)


def _seen(
    scene: MitsubaObject,
    lamp: MitsubaObject,
    point: Sequence[MitsubaObject],
    wavelengths_nm: Sequence[MitsubaObject],
) -> MitsubaObject:
    """Radiance at four wavelengths of what is seen at a point of a lamp, from just outside of it."""
    mi, dr = mitsuba(), drjit()
    place = lamp.get_shape().sample_position(0.0, mi.Point2f(*point))
    size = dr.max(dr.abs(place.p)) + 1.0
    hit = scene.ray_intersect(mi.Ray3f(place.p + 1e-4 * size * place.n, -place.n))
    hit.wavelengths = mi.UnpolarizedSpectrum(*wavelengths_nm)
    emitter = hit.emitter(scene)
    if emitter is None:  # in a scalar variant
        return mi.UnpolarizedSpectrum(0.0)
    radiance = mi.unpolarized_spectrum(emitter.eval(hit))
    return dr.select(hit.is_valid(), radiance, 0.0)


def scale_to(luminance: float, light: Irradiance) -> float:
    """What all emitters are multiplied by for this median.  light : as it is. Raises InputError."""
    assert light.statistics.brightness is not None
    median = light.statistics.brightness["median_cd_per_m2"]
    if median is None:
        raise InputError(NOT_LUMINOUS)
    if not median > 0:
        raise InputError(
            f"luminance is {luminance:g} and the picture is black in the median, so no scale reaches it; show "
            "less of the black background, or change the emitters in the scene."
        )
    return float(f"{luminance / median:.{DIGITS}g}")


def with_brightness(light: Irradiance, render: LoadedRender) -> Irradiance:
    """The light of a render with its brightness in the statistics, and with notes where that is not of this world."""
    view, lamp = render.scene.view, render.at_rest.brightest_lamp_cd_per_m2
    scale = render.bands.light_scale
    found: dict[str, float | None] = {
        "brightest_lamp_cd_per_m2": None if lamp is None else lamp * scale,
        "median_cd_per_m2": median_luminance(light, render.bands, view, render.camera),
        "illuminance_lx": mean_illuminance(light, render.bands),
        "light_scale": scale,
    }
    statistics = replace(light.statistics, brightness=found)
    metering, camera = statistics.metering, render.camera
    exposure_s = None if metering is None else metering["exposure_s"]
    notes = _notes(found, scale, exposure_s, camera)
    return replace(light, statistics=replace(statistics, notes=(*statistics.notes, *notes)))


def _notes(
    found: Mapping[str, float | None], scale: float, exposure_s: float | None, camera: Camera
) -> Iterator[str]:
    """exposure_s : that was metered."""
    lamp, median = found["brightest_lamp_cd_per_m2"], found["median_cd_per_m2"]
    if scale != 1:
        yield f"all light is scaled by {scale:g}, so that the picture has the median luminance that was asked for"
    bright, row_s = list[str](), (camera.sensor.row_time_us or 0.0) * 1e-6
    if exposure_s is not None and exposure_s < max(SHORTEST_METERED_S, row_s):
        limit = f"{SHORTEST_METERED_S:g} s"
        if row_s > SHORTEST_METERED_S:
            limit = f"a row of the sensor ({row_s:g} s)"
        bright.append(f"the metered exposure time is {exposure_s:g} s, shorter than {limit}")
    if median is not None and median > HIGHEST_PICTURE_CD_PER_M2:
        bright.append(f"the picture has {cd_per_m2(median)}, in the median")
    if lamp is not None and lamp > HIGHEST_LAMP_CD_PER_M2:
        bright.append(f"the brightest lamp has {cd_per_m2(lamp)}")
    if bright:
        yield Caution(
            f"the light is very bright: {', and '.join(bright)}; `render --luminance 500` (luminance=500) scales all "
            "light to a median of 500 cd/m²"
        )
