"""Checks of mean photons, which expose() and plan() accept, of their bands and of their place on the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.exposure_times import later_exposures
from ..camera.fingerprint import pixel_fingerprint, polarizer_fingerprint
from ..core import (
    Exposure,
    Float64Array,
    InputError,
    Photons,
    numbers,
    require_seed,
)
from ..core.checks import require_pair
from ..stages.effects.shot_noise import LEFT
from ..stages.image_lag import BEFORE

if TYPE_CHECKING:
    from ..camera.camera import Camera

ORIGIN = "(row, column) of the first pixel, e.g. (0, 0)"
FIELDS = {
    "bandwidths_nm": "one positive, finite width in nm per band",
    "in_band": "one finite factor of the photoelectrons per pixel, 0 or more",
    "variance_e2": "one variance per pixel in e-², finite and 0 or more; a render of one pass has none, so pass None",
}
"""Fields of photons that are arrays beside the mean, and what they hold."""


def as_photons(
    photons: Photons | ArrayLike,
    camera: Camera,
    wavelengths_nm: ArrayLike | None = None,
    check: bool = True,
) -> Photons:
    """Anything that ``expose`` accepts as mean photons, checked: shape, and if ``check``, NaN and negative values."""
    checked = _as_photons(photons, camera, wavelengths_nm, check)
    if not isinstance(photons, Photons) or photons.by_readout is None:
        return checked
    others = dict[str, Photons]()
    _check_light_of_readouts(photons.by_readout, camera)
    for name, given in photons.by_readout.items():
        others[name] = _as_photons(given, camera, wavelengths_nm, check)
        if others[name].shape != checked.shape:
            raise InputError(
                f"photons.by_readout[{name!r}] has shape {others[name].shape}; it must be {checked.shape}, as that of "
                "the first exposure."
            )
        if others[name].origin != checked.origin:
            raise InputError(
                f"photons.by_readout[{name!r}] has its first pixel at {others[name].origin}; it must be "
                f"{checked.origin}, as that of the first exposure: give it the same origin."
            )
    return checked.changed(by_readout=others)


def _as_photons(
    photons: Photons | ArrayLike, camera: Camera, wavelengths_nm: ArrayLike | None, check: bool
) -> Photons:
    """The photons of one exposure."""
    if not isinstance(photons, Photons):
        mean = _mean_photons(photons, camera)
        _refuse_pictures(np.asarray(photons).dtype)
        _refuse_infinite(mean)
        checked = Photons(mean, _checked_centres(wavelengths_nm, mean, may_be_unknown=False))
        if check:
            check_light(checked)
        return checked
    check_polarizers(photons.polarizers, camera)
    checked = photons.changed(by_readout=None)
    if photons.factor is not None and wavelengths_nm is None:
        _check_lengths(photons.wavelengths_nm)
        if photons.detected:
            _check_channels(photons.shape, camera)
    else:
        mean = _mean_photons(photons.mean, camera)
        mean = _channels(mean, camera) if photons.detected else mean
        centres_nm = photons.wavelengths_nm if wavelengths_nm is None else wavelengths_nm
        bands_nm = _checked_centres(centres_nm, mean, may_be_unknown=photons.detected)
        checked = checked.changed(mean=mean, wavelengths_nm=bands_nm)
    if check:
        check_light(checked)
    variance_e2 = None
    if photons.variance_e2 is not None:
        variance_e2 = _checked_variance(photons.variance_e2, checked, camera)
    checked = checked.changed(
        variance_e2=variance_e2, bandwidths_nm=None, in_band=None, in_band_of=None
    )
    if (
        checked.wavelengths_nm is None
        or wavelengths_nm is not None
        or photons.bandwidths_nm is None
    ):
        return checked
    widths_nm = _checked_field(
        "bandwidths_nm", photons.bandwidths_nm, checked.wavelengths_nm.shape
    )
    in_band = None
    if photons.in_band is not None and photons.in_band_of in (None, pixel_fingerprint(camera)):
        in_band = _checked_field("in_band", photons.in_band, checked.shape[:2])
    return checked.changed(
        bandwidths_nm=widths_nm, in_band=in_band, in_band_of=photons.in_band_of
    )


def _mean_photons(values: ArrayLike, camera: Camera) -> Float64Array:
    """Mean photons (H, W) or (H, W, B); a number is the light of the whole sensor."""
    remedy = "a number or an array of mean photons per pixel; of a render, collect(light, camera, exposure)"
    mean = numbers("photons", values, remedy)
    if mean.ndim == 0:
        mean = np.full((camera.sensor.rows, camera.sensor.columns), float(mean))
    if mean.ndim not in (2, 3) or 0 in mean.shape:
        raise InputError(
            f"photons has shape {mean.shape}; it must be a number, (H, W) or (H, W, bands)."
        )
    return mean


def _checked_centres(
    wavelengths_nm: ArrayLike | None, mean: Float64Array, may_be_unknown: bool
) -> Float64Array | None:
    """Centres of the bands [nm], one for each; None where they are not known and need not be."""
    count = mean.shape[2] if mean.ndim == 3 else 1
    if wavelengths_nm is None:
        if mean.ndim == 2 or may_be_unknown:
            return None
        if mean.shape[0] in (3, 4) and count > 4:
            raise InputError(
                f"photons has shape {mean.shape}, as a picture whose colour planes come first; photons are (H, W), or "
                "(H, W, B) with wavelengths_nm. Light of an RGB picture comes from ms.light_from_rgb."
            )
        raise _wrong_count(count, "none")
    remedy = "numbers in nm, one per band, e.g. [550.0]"
    centres_nm = np.atleast_1d(numbers("wavelengths_nm", wavelengths_nm, remedy))
    if centres_nm.shape != (count,):
        raise _wrong_count(count, str(centres_nm.size))
    _check_lengths(centres_nm)
    return centres_nm


def _wrong_count(bands: int, wavelengths: str) -> InputError:
    """The sentence about bands without a wavelength each."""
    return InputError(
        f"photons has {bands} band(s) and wavelengths_nm {wavelengths}; pass one wavelength per band; "
        "light of an RGB picture comes from ms.light_from_rgb."
    )


def _check_lengths(bands: NDArray[np.float64] | None) -> None:
    """Raise InputError for a wavelength that is no length."""
    if bands is not None and (wrong := bands[~(np.isfinite(bands) & (bands > 0))]).size:
        raise InputError(
            f"wavelengths_nm holds {wrong[0]}; every band needs a positive, finite length in nm."
        )


def _checked_field(name: str, values: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Values of one of :data:`FIELDS`, an array of this shape. Raises InputError."""
    array = numbers(f"photons.{name}", values, FIELDS[name])
    if array.shape != shape:
        raise InputError(
            f"photons.{name} has shape {array.shape}; it must be {shape}, {FIELDS[name]}."
        )
    bad = ~(np.isfinite(array) & (array > 0 if name == "bandwidths_nm" else array >= 0))
    if bad.any():
        first = first_place(bad)
        raise InputError(
            f"photons.{name} is {array[first]:g} in the first of {int(bad.sum())} bad place(s), {first}; pass "
            f"{FIELDS[name]}."
        )
    return array


def _checked_variance(values: Any, photons: Photons, camera: Camera) -> NDArray[np.float64]:
    """One finite variance for every pixel, (H, W) [e-²]; 0 where the light is infinite and saturates anyway."""
    name, shape = "variance_e2", photons.shape[:2]
    if camera.quantum_efficiency.quantum_yield:
        raise InputError(
            f"photons.{name} is given and quantum_efficiency.quantum_yield of {camera.name} too, whose electrons come "
            "in bursts; leave one of them out: photons without variance_e2 keep the render's noise beside the shot "
            "noise."
        )
    variance_e2 = numbers(f"photons.{name}", values, FIELDS[name])
    if variance_e2.shape == shape:
        variance_e2 = np.where(photons.total == np.inf, 0.0, variance_e2)
    return _checked_field(name, variance_e2, shape)


def check_light(photons: Photons) -> None:
    """Raise InputError for NaN or negative photons, with how many there are and where the first one is."""
    if all(strip.mean.min() >= 0 for strip in photons.strips()):  # NaN if any of them is
        return
    mean = photons.mean
    kind, bad = ("NaN", np.isnan(mean)) if np.isnan(mean).any() else ("negative", mean < 0)
    raise InputError(
        f"photons is {kind} in {int(bad.sum())} place(s), first at {first_place(bad)}; a mean number of photons is "
        "0 or more: clamp or correct them before expose()."
    )


def _refuse_pictures(kind: np.dtype[Any]) -> None:
    """Raise InputError for a mask or an 8-bit picture in place of photons."""
    if kind.kind == "b" or kind.itemsize == 1:
        raise InputError(
            f"photons is of {kind.name}, as a mask or a picture has it; pass mean photons per pixel, 0 or more, as "
            "float64: photons.astype(float), if that is what the numbers are."
        )


def _refuse_infinite(mean: NDArray[np.float64]) -> None:
    """Raise InputError for infinite photons in an array; a render's own (Photons) saturate their pixels."""
    if mean.max() == np.inf:
        bad = np.isinf(mean)
        raise InputError(
            f"photons is infinite in {int(bad.sum())} place(s), first at {first_place(bad)}; pass a finite number, "
            "e.g. 1e9 for a pixel that saturates."
        )


def first_place(bad: NDArray[np.bool_]) -> tuple[int, ...]:
    """Index of the first one."""
    return tuple(int(i) for i in np.argwhere(bad)[0])


def _channels(mean: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Mean photoelectrons behind each colour filter, (H, W, F), of those or of each pixel behind its own, (H, W)."""
    if mean.ndim == 2:
        filters = len(camera.quantum_efficiency.curves)
        mean = np.broadcast_to(mean[..., None], (*mean.shape, filters))
    _check_channels(mean.shape, camera)
    return mean


def _check_channels(shape: tuple[int, ...], camera: Camera) -> None:
    """Raise InputError unless these are channels of this camera."""
    filters = len(camera.quantum_efficiency.curves)
    if len(shape) != 3 or shape[2] != filters or camera.quantum_efficiency.quantum_yield:
        raise InputError(
            f"photons has shape {shape} and is detected already; it must be (H, W), or (H, W, {filters}), one layer "
            "per colour filter, of a camera without quantum_yield: render it again for this camera."
        )


def check_polarizers(polarizers: str | None, camera: Camera) -> None:
    """Raise InputError for light behind the polarisers of another camera.  polarizers : fingerprint of its own."""
    if polarizers not in (None, polarizer_fingerprint(camera)):
        has = "none" if camera.sensor.polarizers is None else "others"
        raise InputError(
            f"the light was rendered behind the polarisers of another camera, and {camera.name} has {has}; render it "
            "for this camera."
        )


def _check_light_of_readouts(given: Mapping[str, Photons], camera: Camera) -> None:
    """Raise InputError for light that no part of the pixels of this camera would collect, and where light is missing
    that later exposures collect."""
    if not isinstance(given, Mapping) or not all(
        isinstance(x, Photons) for x in given.values()
    ):
        raise InputError(
            "photons.by_readout holds something else than Photons by name; give {name: ms.Photons(mean)}."
        )
    parts = [readout.name for readout in camera.readouts[1:] if readout.of != "charge"]
    known = f"{camera.name} has light of its own for " + ", ".join(map(repr, parts))
    needed = [*later_exposures(camera, Exposure(1.0))]
    if camera.sensor.dual_pixel:
        parts, needed = [LEFT], [LEFT]
        known = f"of dual pixels it has the light of the left photodiodes alone, {LEFT!r}"
    elif camera.quantum_efficiency.image_lag:
        parts = [BEFORE]
        known = f"of a camera with image lag it has the light of the frame before, {BEFORE!r}"
    elif not parts:
        known = f"{camera.name} has one exposure of one photodiode; pass photons.changed(by_readout=None)"
    unknown = [name for name in given if name not in parts]
    if unknown:
        raise InputError(f"photons.by_readout names {unknown[0]!r}; {known}.")
    missing = [name for name in needed if name not in given]
    if missing:
        raise InputError(
            f"photons.by_readout lacks {missing[0]!r}; give the light of all of {', '.join(map(repr, needed))}, or "
            "photons.changed(by_readout=None) where it is the same in all exposures."
        )


# -- place on the sensor -----------------------------------------------------------------------------------------------


def placed(light: Photons, first_pixel: object, camera: Camera) -> Photons:
    """The light where it was asked for on the sensor, or where it is; what is known of each pixel's own filter holds
    behind that one only. Raises InputError."""
    if first_pixel is None:
        return _at(light, require_pair("origin", light.origin, ORIGIN), moved=False)
    row, column = require_pair("origin", first_pixel, ORIGIN)
    if light.polarizers is not None:
        _refuse_other_polarizers((row, column), light.origin, camera)
    moved = (row - light.origin[0]) % len(camera.tile) or (column - light.origin[1]) % len(
        camera.tile[0]
    )
    return _at(light, (row, column), bool(moved))


def _at(light: Photons, origin: tuple[int, int], moved: bool) -> Photons:
    """The light of all exposures from this pixel on.  moved : whether each pixel has another filter there."""
    in_band = None if moved else light.in_band
    placed_light = light.changed(origin=origin, in_band=in_band)
    return placed_light.with_readouts(lambda one: _at(one, origin, moved))


def _refuse_other_polarizers(
    first_pixel: tuple[int, int], origin: tuple[int, int], camera: Camera
) -> None:
    """Raise InputError where each pixel's light would come to a pixel with another polariser."""
    periods = camera.sensor.polarizer_periods
    if any((new - old) % n for new, old, n in zip(first_pixel, origin, periods, strict=True)):
        raise InputError(
            f"origin is {first_pixel}, and the light was rendered behind the polarisers of the pixels from {origin} "
            f"on; move it by a multiple of {periods[0]} rows and {periods[1]} columns, or render it there."
        )


def check_numbers(frames: Any, first_frame: Any, seed: Any) -> tuple[int, int, int]:
    """The same as Python integers. Raises InputError where the random number generator's counters cannot hold them."""
    given = {"frames": frames, "first_frame": first_frame, "seed": seed}
    frames, first_frame, seed = (require_seed(name, number) for name, number in given.items())
    if frames < 1 or first_frame + frames > 2**32:
        raise InputError(
            f"frames is {frames} from {first_frame}; ask for at least 1, numbered from 0 to 2^32 - 1."
        )
    return frames, first_frame, seed
