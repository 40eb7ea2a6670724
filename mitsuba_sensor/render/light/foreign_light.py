"""Light from elsewhere: bands or RGB radiance of another program as irradiance at the focal plane of a camera.

Radiance before the lens becomes irradiance by the f-number law of the camera, E = L·T(λ)·Ω. RGB becomes a spectrum as
in Mitsuba's emitters: the smooth spectrum of Jakob & Hanika 2019, "A Low-Dimensional Function Space for Efficient
Spectral Upsampling", doi:10.1111/cgf.13626, of the colour over twice its largest component, times this value and D65.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...camera.camera import Camera
from ...camera.camera_file import AnyCamera, camera_of
from ...camera.fingerprint import pixel_fingerprint
from ...core import (
    Exposure,
    Float32Array,
    Float64Array,
    InputError,
    NumpyArray,
    check_types,
    nearest,
    require,
)
from ...core.band_average import NODES, Curves, band_integrals
from ...core.checks import PICTURE_FILE, numeric_array, refuse_path
from ...optics import spectra
from ...optics.f_number_law import solid_angle_sr, transmittance
from ...optics.intrinsics import View
from ...optics.veiling_glare import glare_sentence, veiling_glare_of
from ..samples import MITSUBA_NM, clean
from ..variants import choose_variant, restores_variant, use
from .bands import BANDWIDTH_NM, in_band_factor, of_own_filter
from .irradiance import Irradiance
from .statistics import RenderStatistics

D65_OF_WHITE = (
    98.99741751876255  # D65 over this number is RGB (1, 1, 1) [W m⁻² sr⁻¹ nm⁻¹] in Mitsuba
)
UPSAMPLED = "RGB up-sampled by Jakob & Hanika 2019 as in Mitsuba, times D65, which ends at 360 and 830 nm"


class Bands(NamedTuple):
    """Bands of radiance or irradiance.

    values : shape (H, W, B), per nm.  wavelengths_nm, bandwidths_nm : centres and widths, shape (B,).
    in_band, response : as in :class:`Irradiance`, if the spectrum within each band is known.
    """

    values: NDArray[np.float32]
    wavelengths_nm: Float64Array
    bandwidths_nm: Float64Array
    in_band: NDArray[np.float32] | None = None
    response: str | None = None


def upsampled(rgb: NDArray[np.floating[Any]], camera: Camera) -> Bands:
    """Return the spectral radiance [W m⁻² sr⁻¹ nm⁻¹] of linear sRGB, shape (H, W, 3), in bands of 10 nm that the camera
    detects.

    The spectrum is known at all wavelengths, and therefore also the photoelectrons of this camera: ``in_band``.
    """
    low_nm, high_nm = (float(np.clip(end, *MITSUBA_NM)) for end in camera.band_nm)
    count = max(math.ceil((high_nm - low_nm) / BANDWIDTH_NM), 1)
    edges_nm = np.linspace(low_nm, high_nm, count + 1)
    centres_nm, widths_nm = 0.5 * (edges_nm[1:] + edges_nm[:-1]), np.diff(edges_nm)
    largest = 2 * rgb.max(axis=-1, keepdims=True)
    colours = np.divide(rgb, largest, out=np.zeros(rgb.shape, np.float32), where=largest > 0)
    coefficients = np.moveaxis(_coefficients(colours.astype(np.float32)), -1, 0)
    brightness, shape = largest[..., 0], rgb.shape[:2]
    weights, flat_weights = _electrons_per_radiance(camera, centres_nm, widths_nm)
    filters = camera.filter_index((shape[0], shape[1]))
    values = np.empty((*shape, count), np.float32)
    electrons, flat = np.zeros(shape), np.zeros(shape)
    daylight = spectra.d65(centres_nm) / D65_OF_WHITE
    for band, centre_nm in enumerate(centres_nm):
        for node, place in enumerate(NODES - 0.5):
            smooth = brightness * _smooth(coefficients, centre_nm + place * widths_nm[band])
            electrons += weights[band, node][filters] * smooth
            if place == 0:
                values[..., band] = daylight[band] * smooth
        flat += flat_weights[:, band][filters] * values[..., band]
    in_band = in_band_factor(electrons, flat)
    return Bands(values, centres_nm, widths_nm, in_band, pixel_fingerprint(camera))


def _smooth(coefficients: Float64Array, nm: float) -> Float64Array:
    """Return the spectrum of Jakob & Hanika 2019 at a wavelength, shape (H, W), from 0 to 1.

    coefficients : shape (3, H, W).
    """
    a, b, c = coefficients
    slope = (a * nm + b) * nm + c
    with np.errstate(invalid="ignore"):
        sine = np.where(np.isinf(slope), np.sign(slope), slope / np.sqrt(1 + slope**2))
    return np.asarray(0.5 + 0.5 * sine)


def _detected_of_node(camera: Camera, node: int, centre_nm: float, width_nm: float) -> Curves:
    """Return a function of wavelengths, shape (N,), with T·QE·λ·D65·ℓ, shape (F, N), where ℓ is the parabola of one
    Gauss node in this band."""
    places = NODES - 0.5
    others = np.delete(places, node)

    def detected(nm: Float64Array) -> Float64Array:
        x = (nm - centre_nm) / width_nm
        parabola = np.prod((x[:, None] - others) / (places[node] - others), axis=1)
        light = transmittance(camera, nm) * spectra.d65(nm) / D65_OF_WHITE
        return np.asarray(camera.qe(nm) * nm * light * parabola)

    return detected


def _electrons_per_radiance(
    camera: Camera, centres_nm: Float64Array, widths_nm: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return ∫ T·QE·λ·D65·ℓ dλ over each band for the parabolas ℓ that are 1 at one Gauss node and 0 at the other
    nodes, shape (B, 3, F), and the photoelectrons of a flat spectrum in the same unit, T(λ_c)·∫ QE·λ dλ, shape (F,
    B)."""
    section, lens_nm = camera.quantum_efficiency, camera.lens.transmission_wavelengths_nm
    points_nm = np.unique([*section.wavelengths_nm, *(lens_nm or ()), *spectra.daylight_nm()])
    low_nm, high_nm = centres_nm - widths_nm / 2, centres_nm + widths_nm / 2
    weights = np.empty((centres_nm.size, NODES.size, len(camera.filter_names)))
    for band, node in np.ndindex(weights.shape[:2]):
        detected = _detected_of_node(
            camera, node, float(centres_nm[band]), float(widths_nm[band])
        )
        limits_nm = low_nm[[band]], high_nm[[band]]
        weights[band, node] = band_integrals(detected, points_nm, *limits_nm)[:, 0]
    detected_nm = band_integrals(lambda nm: camera.qe(nm) * nm, points_nm, low_nm, high_nm)
    return weights, transmittance(camera, centres_nm) * detected_nm


@restores_variant
def _coefficients(colours: NDArray[np.float32]) -> Float64Array:
    """Return the coefficients of the model as in Mitsuba's textures, shape (H, W, 3)."""
    mi = use(choose_variant())
    settings = {"raw": False, "filter_type": "nearest", "format": "variant"}
    # A texture has at least 2 × 2 pixels.
    padded = np.ascontiguousarray(np.pad(colours, ((0, 1), (0, 1), (0, 0)), mode="edge"))
    texture = mi.load_dict({"type": "bitmap", "bitmap": mi.Bitmap(padded), **settings})
    coefficients = np.array(mi.traverse(texture)["data"], dtype=np.float64)
    return coefficients.reshape(padded.shape)[:-1, :-1]


def behind_lens(bands: Bands, camera: Camera, fov_deg: float | None) -> tuple[Bands, str]:
    """Return the irradiance of radiance before the lens, and the assumptions.

    fov_deg : horizontal field of view; None omits cos⁴.  Raises InputError for a lens that needs rays.
    """
    size, lens = (bands.values.shape[1], bands.values.shape[0]), camera.lens
    if lens.prescription is not None or lens.distortion or lens.distortion_percent is not None:
        raise InputError(
            f"only a render follows the lens of {camera.name}, and this light is already rendered; take a camera whose "
            "lens has neither prescription nor distortion."
        )
    half_width, how = 0.0, "without cos⁴, because no field of view is given"
    if fov_deg is not None:
        fov_deg = require("fov_deg", fov_deg, 0.0, 179.0, "degrees, e.g. 40")
        half_width = math.tan(math.radians(fov_deg) / 2)
        how = f"cos⁴ for {fov_deg:g} degrees across"
    solid_angle = solid_angle_sr(View(size, size, half_width=half_width), camera)
    factor = solid_angle[..., None] * transmittance(camera, bands.wavelengths_nm)
    values = (bands.values * factor).astype(np.float32)
    return bands._replace(values=values), f"lens at f/{lens.f_number:g}, {how}"


def irradiance_of(
    bands: Bands, notes: tuple[str, ...], sha256: str, negative: int = 0
) -> Irradiance:
    """Return irradiance with unknown errors. Negative values and NaN become 0 and are counted; +inf stays.

    negative : number of values that became 0 before.
    """
    values, infinite, more_negative, non_finite = clean(bands.values)
    negative += more_negative
    if negative:
        why = "colours outside sRGB, or a reconstruction filter that rings"
        notes = (*notes, f"{negative} negative values became 0; their usual cause is {why}")
    data = values.astype(np.float32)
    data[infinite] = np.inf
    statistics = RenderStatistics(
        passes=0,
        samples_per_pixel=0,
        seconds=0.0,
        variant="",
        sampler="",
        spectral="cube" if data.shape[2] > 1 else "single",
        noise_ratio_median=0.0,
        noise_ratio_p95=0.0,
        noise_ratio_max=0.0,
        noise_ratio_asked=None,
        ended_by="read",
        reliable=False,
        firefly_fraction=0.0,
        negative=negative,
        non_finite=non_finite,
        notes=(*notes, "render noise of this light is unknown, and remains in the frames"),
        scene_sha256=sha256,
        aperture_f_number=None,
    )
    errors = np.zeros_like(data), np.zeros(data.shape[:2], np.float32)
    return Irradiance(
        data,
        bands.wavelengths_nm,
        bands.bandwidths_nm,
        *errors,
        statistics,
        in_band=bands.in_band,
        response=bands.response,
    )


def behind_glare(light: Irradiance, camera: Camera) -> Irradiance:
    """Return the light after the veiling glare of the camera's lens; infinite light causes no glare."""
    size = light.data.shape[1], light.data.shape[0]
    glare = veiling_glare_of(camera, View(size, size))
    if glare is None:
        return light
    infinite = ~np.isfinite(light.data)
    data = np.where(infinite, np.float32(0), light.data)
    before_e = _flat_electrons(light, data, camera)
    glare.add_to_bands(data, np.zeros_like(data))
    in_band = light.in_band
    if in_band is not None:
        filters = camera.filter_index((size[1], size[0]))
        exact_e, _ = glare.of_electrons(before_e * in_band, np.zeros(in_band.shape), filters)
        in_band = in_band_factor(exact_e, _flat_electrons(light, data, camera))
    data[infinite] = np.inf
    notes = (*light.statistics.notes, glare_sentence(camera))
    return replace(
        light, data=data, in_band=in_band, statistics=replace(light.statistics, notes=notes)
    )


def _flat_electrons(
    light: Irradiance, data: NDArray[np.float32], camera: Camera
) -> Float64Array:
    """Return the photoelectrons of each pixel for spectra that are flat within each band, in a common unit."""
    detected = camera.qe(light.wavelengths_nm, light.bandwidths_nm) * light.wavelengths_nm
    weights = np.atleast_2d(detected) * light.bandwidths_nm
    return of_own_filter(data @ weights.T, np.array(camera.tile), light.origin)


RgbUnit = Literal["radiance_rgb", "cd_per_m2", "srgb"]
RGB_UNITS = {
    "radiance_rgb": "linear sRGB as Mitsuba has it: 1, 1, 1 is D65 of 73 000 cd/m²",
    "cd_per_m2": "linear sRGB: 1, 1, 1 is D65 of 1 cd/m²",
    "srgb": "a picture after the sRGB curve",
}
NO_UNIT = (
    "unit is not given, so their brightness is unknown; for a picture pass unit='srgb' and the luminance of "
    "its white, e.g. white_cd_per_m2=200; for linear sRGB pass unit='cd_per_m2', where (1, 1, 1) is D65 of 1 cd/m², or "
    "unit='radiance_rgb' as in Mitsuba, where it is D65 of 73 000 cd/m²."
)
SRGB_MAX = 1.001
EIGHT_BITS_MAX = 255


def light_from_rgb(
    rgb: ArrayLike,
    camera: AnyCamera,
    *,
    unit: RgbUnit | None = None,
    white_cd_per_m2: float | None = None,
    fov_deg: float | None = None,
) -> Irradiance:
    """Return the irradiance on the sensor of a camera that looks at a picture.

    ::

        light = ms.light_from_rgb(picture, "bayer_2mp", unit="srgb", white_cd_per_m2=200)
        ms.capture(light, "bayer_2mp", ms.Exposure(0.01)).save("out/")

    rgb : shape (H, W, 3); each pixel is a pixel of the sensor.
    camera : its lens passes the light.
    unit : meaning of the values. "radiance_rgb": linear sRGB as in Mitsuba, where (1, 1, 1) is D65 of 73 000 cd/m².
        "cd_per_m2": linear sRGB, where (1, 1, 1) is D65 of 1 cd/m². "srgb": a picture after the sRGB curve, uint8 or 0
        to 1, whose white has ``white_cd_per_m2``.
    white_cd_per_m2 : luminance of white in a picture [cd/m²]: a screen 200, a cloudy day 5000.
    fov_deg : horizontal field of view [°] for the cos⁴ of the lens. Default: no cos⁴.

    Each colour becomes the smooth spectrum that Mitsuba gives it (Jakob & Hanika 2019), times D65, from 360 to 830 nm,
    where Mitsuba's D65 ends. Outside 400 to 700 nm the spectrum is a guess. Raises InputError.
    """
    camera = camera_of(camera)
    check_types(camera, Exposure(0.0))
    refuse_path("rgb", rgb, PICTURE_FILE)
    values = numeric_array("rgb", rgb, "integers or floats, shape (H, W, 3)")
    if values.ndim != 3 or values.shape[2] != 3 or 0 in values.shape:
        raise InputError(
            f"rgb has shape {values.shape}; pass (H, W, 3) with red, green and blue last, without transparency, e.g. "
            "np.moveaxis(rgb, 0, -1) or rgb[..., :3]."
        )
    linear = _linear(values, unit, white_cd_per_m2)
    bad = ~np.isfinite(linear) | (linear < 0)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"rgb is negative or not finite in {int(bad.sum())} value(s), first at {first}; clamp or correct them."
        )
    bands, lens = behind_lens(upsampled(linear, camera), camera, fov_deg)
    notes = f"read as {RGB_UNITS[str(unit)]}", UPSAMPLED, lens
    light = irradiance_of(bands, notes, hashlib.sha256(linear.tobytes()).hexdigest())
    return behind_glare(light, camera)


def luminance_of_white() -> float:
    """Return the luminance of Mitsuba's RGB (1, 1, 1) [cd/m²]."""
    low_nm, high_nm = spectra.VISIBLE_NM
    fine_nm = np.arange(low_nm, high_nm + 1)
    return spectra.luminous(fine_nm, spectra.d65(fine_nm) / D65_OF_WHITE)


def _linear(
    values: NumpyArray, unit: str | None, white_cd_per_m2: float | None
) -> Float32Array:
    """Return the values in the unit of Mitsuba's RGB."""
    if unit is None:
        raise InputError(NO_UNIT)
    if not isinstance(unit, str) or unit not in RGB_UNITS:
        raise InputError(
            f"unit is {unit!r}; it must be one of {', '.join(RGB_UNITS)}.{nearest(str(unit), RGB_UNITS)}"
        )
    if (white_cd_per_m2 is not None) != (unit == "srgb"):
        remedy = 'omit white_cd_per_m2, which is for unit "srgb"'
        if unit == "srgb":
            remedy = "give the luminance of its white, e.g. white_cd_per_m2=200"
        raise InputError(f"unit is {unit!r}; {remedy}.")
    if values.dtype.kind in "iu" and unit != "srgb":
        raise InputError(
            f'rgb is of {values.dtype} like a picture, but unit is {unit!r}; pass unit="srgb" and white_cd_per_m2, or '
            "floats."
        )
    if white_cd_per_m2 is None:
        factor = 1.0 if unit == "radiance_rgb" else 1 / luminance_of_white()
        return np.asarray(values.astype(np.float32) * np.float32(factor), np.float32)
    white = require("white_cd_per_m2", white_cd_per_m2, 0.0, 1e10, "cd/m², e.g. 200")
    encoded = np.asarray(values, np.float32)
    if values.dtype == np.uint8:
        encoded = encoded / np.float32(EIGHT_BITS_MAX)
    if (values.dtype.kind in "iu" and values.dtype != np.uint8) or encoded.max() > SRGB_MAX:
        raise InputError(
            f'rgb is of {values.dtype} up to {values.max()} and unit "srgb"; pass uint8, or floats from 0 to 1.'
        )
    factor = white / luminance_of_white()
    return np.asarray(spectra.inverse_srgb_curve(encoded) * np.float32(factor), np.float32)
