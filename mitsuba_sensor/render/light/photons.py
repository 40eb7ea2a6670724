"""Mean photons per pixel from irradiance: a render, a map, a spectral cube or a complex optical field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...camera.camera import Camera
from ...camera.camera_file import AnyCamera, camera_of
from ...camera.exposure_times import later_exposures
from ...camera.fingerprint import response_fingerprint
from ...camera.sensor_size import check_on_sensor
from ...core import (
    Exposure,
    Float64Array,
    InputError,
    Photons,
    check_types,
    first_given,
    numbers,
    refuse_masked,
    require,
    require_seed,
)
from ...core.heap import trim_heap
from ...core.units import photon_energy_j
from ...optics.shutter import shutter_of
from ...sensor.checks import as_photons, check_polarizers
from ...sensor.metering import AUTO, AskedExposure, Metering, checked_exposure
from .bands import Bands, of_own_filter
from .irradiance import Irradiance, is_exact
from .light_source import CollectedLight
from .light_sum import OF_PHOTODIODES, light_of_frame


def photons_per_irradiance(
    camera: Camera, exposure: Exposure, wavelengths_nm: ArrayLike, bandwidths_nm: ArrayLike
) -> Float64Array:
    """Return the photons per pixel for 1 W m⁻² nm⁻¹ in each band, Δλ·w·h·FF·t·λ/(hc), shape (B,) (paper eq. 12).

    One band of 1 nm at 550 nm on the pixel of Table 1 (5.7 µm, 50 %) in 0.1 s gives 4.4978e6 photons.
    """
    area_m2 = (
        camera.pixel.pitch_x_um * camera.pixel.pitch_y_um * 1e-12 * camera.pixel.fill_factor
    )
    energy_j = photon_energy_j(np.asarray(wavelengths_nm, dtype=np.float64))
    return np.asarray(
        np.asarray(bandwidths_nm, dtype=np.float64) * area_m2 * exposure.time_s / energy_j
    )


def electrons_per_irradiance(camera: Camera, exposure: Exposure, bands: Bands) -> Float64Array:
    """Return the photoelectrons per pixel for 1 W m⁻² nm⁻¹ in each band, shape (F, B), for F colour filters and B
    bands. The spectrum is flat within each band (paper eqs. 12 and 14)."""
    photons = photons_per_irradiance(
        camera, exposure, bands.wavelengths_nm, bands.bandwidths_nm
    )
    detected = (
        np.eye(len(bands))
        if bands.kind == "channels"
        else camera.qe(bands.wavelengths_nm, bands.bandwidths_nm)
    )
    return np.asarray(detected * photons)


def mean_electrons(light: Irradiance, camera: Camera, exposure: Exposure) -> Float64Array:
    """Return the photoelectrons of each pixel, shape (H, W), for light that was rendered for this camera."""
    photons = photons_per_irradiance(
        camera, exposure, light.wavelengths_nm, light.bandwidths_nm
    )
    detected = camera.qe(light.wavelengths_nm, light.bandwidths_nm)
    weights = (np.eye(len(photons)) if light.filters else np.atleast_2d(detected)) * photons
    own = of_own_filter(light.data @ weights.T, np.array(camera.tile), light.origin)
    return own if light.in_band is None else own * light.in_band


def collect(
    light: Irradiance | ArrayLike,
    camera: AnyCamera,
    exposure: Exposure,
    *,
    wavelengths_nm: ArrayLike | None = None,
    bandwidths_nm: ArrayLike | None = None,
    start_s: float = 0.0,
) -> Photons:
    """Return the mean photons per pixel and band, shape (H, W, B), unrounded.

    ::

        irradiance = np.full((48, 64), 1e-3)  # W/m²
        photons = ms.collect(irradiance, camera, ms.Exposure(0.01), wavelengths_nm=[550.0])

    light : the result of :func:`render`; an irradiance map, shape (H, W) [W m⁻²], at one wavelength; a complex field U,
        shape (H, W), with |U|² in W m⁻² (wavefront sensing); or a cube, shape (H, W, B) [W m⁻² nm⁻¹], with
        ``wavelengths_nm``.
    wavelengths_nm : band centres, shape (B,); one for a map or field. Default: the camera's reference wavelength.
    bandwidths_nm : of a cube, shape (B,). Default: the spacing of the wavelengths.
    start_s : when the first row opens, for lamps that flicker (:meth:`Irradiance.with_lights`).

    Photons of a render are computed in float64 on demand, so ``light.data`` must not change until then. The irradiance
    already includes the lens of the camera of the render; the lens of ``camera`` is not used. Raises InputError for
    shapes that do not fit and for negative or NaN irradiance.
    """
    camera = camera_of(camera)
    check_types(camera, exposure)
    if isinstance(light, Photons):
        raise InputError(
            "light is Photons; pass it to expose(), or pass an irradiance to collect()."
        )
    if isinstance(light, Irradiance):
        refuse_masked("light.data", light.data)
        check_on_sensor("the light", light.data.shape, light.origin, camera)
        responses = None, response_fingerprint(camera)
        if light.filters is not None and light.response not in responses:
            raise InputError(
                "light was rendered into the channels of a camera with another quantum efficiency or lens; render it "
                "again for this camera, or with spectral='cube' for any camera."
            )
        check_polarizers(light.polarizers, camera)
        photons = _of_exposure(light, camera, exposure, start_s)
        if camera.sensor.dual_pixel:
            return photons.changed(by_readout=_of_left(light, camera, exposure))
        return photons.changed(by_readout=_later(light, camera, exposure, start_s))
    values = _irradiance_values(light)
    if values.ndim == 2:
        centre = first_given(wavelengths_nm, camera.quantum_efficiency.reference_nm)
        if centre is None or np.size(centre) != 1:
            raise InputError(
                "light is a map at one wavelength; pass this wavelength as wavelengths_nm, e.g. 550."
            )
        photons = _photons(values[..., None], _centres(centre), np.ones(1), camera, exposure)
        return photons.changed(bandwidths_nm=None)
    if wavelengths_nm is None or np.size(wavelengths_nm) != values.shape[2]:
        raise InputError(
            f"light has {values.shape[2]} bands; pass wavelengths_nm with one centre for each band."
        )
    centres = _centres(wavelengths_nm)
    return _photons(values, centres, _widths(centres, bandwidths_nm), camera, exposure)


def _of_exposure(
    light: Irradiance, camera: Camera, exposure: Exposure, start_s: float
) -> Photons:
    """Return the mean photons of a render in one exposure."""
    light = light_of_frame(light, shutter_of(camera, exposure, start_s))
    photons = _photons(light.data, light.wavelengths_nm, light.bandwidths_nm, camera, exposure)
    photons = photons.changed(
        origin=light.origin,
        illuminant=light.rendered_for and light.rendered_for.illuminant,
        intrinsics=light.statistics.intrinsics,
        source=CollectedLight.of(light),
        polarizers=light.polarizers,
    )
    if light.filters is not None:
        return photons.changed(detected=True, bandwidths_nm=None)
    in_band = light.in_band if is_exact(light, camera) else None
    return photons.changed(in_band=in_band, in_band_of=light.response)


def _of_left(
    light: Irradiance, camera: Camera, exposure: Exposure
) -> dict[str, Photons] | None:
    """Return the mean photons of the left photodiodes of dual pixels; None without halves of the pupil."""
    half = light.groups.get(OF_PHOTODIODES["left"])
    if half is None:
        return None
    return {"left": _of_exposure(half, camera, exposure, 0.0)}


def _later(
    light: Irradiance, camera: Camera, exposure: Exposure, start_s: float
) -> dict[str, Photons] | None:
    """Return the mean photons of the later exposures of a frame; None if their light is the same.

    Raises InputError for light of a moving scene that contains only the first exposure.
    """
    asked = later_exposures(camera, exposure, start_s)
    if not asked:
        return None
    moves = light.statistics.motion is not None
    if not (moves or light.waveforms):
        return None
    photons = dict[str, Photons]()
    for name, (exposure_of_name, begin_s) in asked.items():
        if moves and name not in light.later:
            raise InputError(
                f"the scene moved while the light was rendered, and the readout {name!r} of {camera.name} is exposed "
                "at another time, whose light a file does not hold; render and expose at once (ms.capture, "
                f"`mitsuba-sensor render`) for this camera, or take camera.at_readout({camera.readouts[0].name!r})."
            )
        of_name = light.later.get(name, light)
        photons[name] = _of_exposure(of_name, camera, exposure_of_name, begin_s)
    return photons


def collected(
    light: Irradiance,
    camera: Camera | None,
    asked: AskedExposure | None,
    serial: int | None,
    gain: str | float | None = None,
    start_s: float = 0.0,
) -> tuple[Photons, Camera, Exposure, int | None]:
    """Return photons, camera, exposure and serial number as requested, else as rendered. An exposure that is neither
    requested nor rendered is metered, for the camera at this gain setting. Raises InputError."""
    exposure = checked_exposure(camera, asked)
    if (known := light.rendered_for) is not None:
        camera, serial = first_given(camera, known.camera), first_given(serial, known.serial)
        if asked is None:
            exposure = known.exposure
        elif exposure is AUTO:
            exposure = replace(AUTO, temperature_k=known.exposure.temperature_k)
    if camera is None:
        raise InputError("no camera is given and the irradiance names none; pass camera=….")
    camera = camera.at_gain(gain)
    if not isinstance(exposure, Exposure):
        exposure = metered(light, camera, exposure or Metering())
    return photons_of(light, camera, exposure, start_s), camera, exposure, serial


def photons_of(
    light: Irradiance, camera: Camera, exposure: Exposure, start_s: float = 0.0
) -> Photons:
    """Return the checked mean photons of a render. Raises InputError for NaN and negative irradiance."""
    return as_photons(collect(light, camera, exposure, start_s=start_s), camera)


def metered(light: Irradiance, camera: Camera, metering: Metering) -> Exposure:
    """Return the exposure for an image of the requested brightness, with the mean of flickering lamps. Raises
    InputError for black light."""
    steady = replace(light, waveforms={})
    photons = _of_exposure(steady, camera, metering.unit_exposure, 0.0)
    exposure = metering.exposure(as_photons(photons, camera), camera)
    trim_heap()
    return exposure


def _irradiance_values(light: object) -> Float64Array:
    """Return a checked map, shape (H, W), or cube, shape (H, W, B); |U|² for a complex field U."""
    if getattr(light, "dtype", np.dtype(float)).kind == "c":
        refuse_masked("light", light)
        values: Float64Array = np.abs(np.asarray(light)) ** 2
    else:
        values = numbers(
            "light", light, "irradiance (H, W) or (H, W, bands), or a complex field (H, W)"
        )
    if values.ndim not in (2, 3) or 0 in values.shape:
        raise InputError(
            f"light has shape {values.shape}; pass (H, W) in W/m², or (H, W, bands) in W/m²/nm."
        )
    bad = np.asarray(~(values >= 0))
    if bad.any():
        where = f"{int(bad.sum())} place(s), first at {tuple(np.argwhere(bad)[0].tolist())}"
        raise InputError(f"light is negative or NaN in {where}; irradiance is 0 or more.")
    return values


def uniform_light(irradiance_w_per_m2: float, shape: tuple[int, int]) -> Float64Array:
    """Return uniform irradiance, shape (H, W) [W m⁻²]: a flat field for :func:`collect`.

    ::

        flat = ms.uniform_light(1e-3, (48, 64))
        photons = ms.collect(flat, camera, ms.Exposure(0.01))
    """
    level = require("irradiance_w_per_m2", irradiance_w_per_m2, 0.0, np.inf, "W/m², e.g. 0.01")
    return np.full(_shape(shape), level)


def gradient_light(
    low_w_per_m2: float, high_w_per_m2: float, shape: tuple[int, int]
) -> Float64Array:
    """Return irradiance that rises linearly from the first column to the last, shape (H, W) [W m⁻²], as in the paper's
    PTC.

    ::

        ramp = ms.gradient_light(0.0, 1e-2, (48, 64))
        photons = ms.collect(ramp, camera, ms.Exposure(0.01))
    """
    low = require("low_w_per_m2", low_w_per_m2, 0.0, np.inf, "W/m², e.g. 0")
    high = require("high_w_per_m2", high_w_per_m2, 0.0, np.inf, "W/m², e.g. 0.012")
    size = _shape(shape)
    return np.broadcast_to(np.linspace(low, high, size[1]), size).copy()


def _shape(shape: Sequence[int]) -> tuple[int, int]:
    """Return the checked (rows, columns)."""
    if not isinstance(shape, tuple | list) or len(shape) != 2 or 0 in shape:
        raise InputError(f"shape is {shape!r}; it must be (rows, columns), e.g. (480, 640).")
    return require_seed("shape", shape[0]), require_seed("shape", shape[1])


def _photons(
    data: NDArray[Any],
    centres: Float64Array,
    widths: Float64Array,
    camera: Camera,
    exposure: Exposure,
) -> Photons:
    """Return the photons of irradiance, shape (H, W, B); those of a render are computed on demand."""
    factor = photons_per_irradiance(camera, exposure, centres, widths)
    centres, widths = (np.asarray(x, dtype=np.float64) for x in (centres, widths))
    photons = Photons(data, centres, bandwidths_nm=widths, factor=factor)
    return photons if data.dtype == np.float32 else photons.changed(mean=photons.mean)


def _centres(wavelengths_nm: ArrayLike) -> Float64Array:
    """Return the checked band centres."""
    centres = np.ravel(wavelengths_nm).tolist()
    return np.array(
        [require("wavelengths_nm", x, 1.0, 1e5, "nanometres, e.g. 550") for x in centres]
    )


def _widths(centres: Float64Array, bandwidths_nm: ArrayLike | None) -> Float64Array:
    """Return the given widths, or the spacing of evenly spaced centres."""
    if bandwidths_nm is not None:
        count = np.size(bandwidths_nm)
        if not isinstance(bandwidths_nm, str) and count not in (1, centres.size):
            raise InputError(
                f"bandwidths_nm has {count} widths for {centres.size} bands; pass one width for each band."
            )
        widths = np.broadcast_to(
            numbers("bandwidths_nm", bandwidths_nm, "one width per band in nm"), centres.shape
        )
        if (wrong := widths[~((widths > 0) & np.isfinite(widths))]).size:
            raise InputError(
                f"bandwidths_nm is {wrong[0]:g}; every band needs a positive, finite width in nm."
            )
        return widths
    steps = np.diff(centres)
    if not steps.size or not (steps > 0).all() or not np.allclose(steps, steps[0]):
        raise InputError(
            "wavelengths_nm is not evenly spaced and rising; pass bandwidths_nm, one width per band in nm."
        )
    return np.full(centres.shape, steps[0])
