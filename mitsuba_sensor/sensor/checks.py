"""Check mean photons for expose() and plan(): their values, their bands and their place on the sensor."""

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
REMEDIES = {
    "photons": "a number or an array of mean photons per pixel; of a render, collect(light, camera, exposure)",
    "wavelengths_nm": "positive numbers in nm, one per band, e.g. [550.0]",
    "photons.bandwidths_nm": "one positive, finite width in nm per band",
    "photons.in_band": "one finite factor of the photoelectrons per pixel, 0 or more",
}


def as_photons(
    photons: Photons | ArrayLike,
    camera: Camera,
    wavelengths_nm: ArrayLike | None = None,
    check: bool = True,
) -> Photons:
    """Return what ``expose`` accepts as mean photons, with its shape and, if ``check``, its values checked."""
    checked = _as_photons(photons, camera, wavelengths_nm, check)
    if not isinstance(photons, Photons) or photons.by_readout is None:
        return checked
    _check_light_of_readouts(photons.by_readout, camera)
    others = dict[str, Photons]()
    for name, given in photons.by_readout.items():
        other = others[name] = _as_photons(given, camera, wavelengths_nm, check)
        if (other.shape, other.origin) != (checked.shape, checked.origin):
            raise InputError(
                f"photons.by_readout[{name!r}] has shape {other.shape} from pixel {other.origin}; it must be "
                f"{checked.shape} from {checked.origin}, as the first exposure."
            )
    return checked.changed(by_readout=others)


def _as_photons(
    photons: Photons | ArrayLike, camera: Camera, wavelengths_nm: ArrayLike | None, check: bool
) -> Photons:
    """Return the photons of one exposure."""
    filters = len(camera.quantum_efficiency.curves)
    if not isinstance(photons, Photons):
        mean = _mean_photons(photons, camera)
        _refuse_pictures(photons, mean)
        checked = Photons(mean, _centres_nm(wavelengths_nm, mean, may_be_unknown=False))
    else:
        check_polarizers(photons.polarizers, camera)
        checked = photons.changed(by_readout=None)
        if photons.factor is None or wavelengths_nm is not None:
            mean = _mean_photons(photons.mean, camera)
            if photons.detected and mean.ndim == 2:  # each pixel's own filter
                mean = np.broadcast_to(mean[..., None], (*mean.shape, filters))
            centres_nm = photons.wavelengths_nm if wavelengths_nm is None else wavelengths_nm
            bands_nm = _centres_nm(centres_nm, mean, may_be_unknown=photons.detected)
            checked = checked.changed(mean=mean, wavelengths_nm=bands_nm)
    shape = checked.shape
    has_channels = len(shape) == 3 and shape[2] == filters
    if checked.detected and (not has_channels or camera.quantum_efficiency.quantum_yield):
        raise InputError(
            f"photons has shape {shape} and is already detected; it must be (H, W), or (H, W, {filters}) with one "
            "layer per colour filter, for a camera without quantum_yield; render it again for this camera."
        )
    if check:
        check_light(checked)
    if not isinstance(photons, Photons):
        return checked
    centres_nm, widths_nm, in_band = checked.wavelengths_nm, photons.bandwidths_nm, None
    if centres_nm is None or wavelengths_nm is not None or widths_nm is None:
        return checked.changed(bandwidths_nm=None, in_band=None, in_band_of=None)
    if photons.in_band is not None and photons.in_band_of in (None, pixel_fingerprint(camera)):
        in_band = _checked_array("photons.in_band", photons.in_band, shape[:2])
    widths_nm = _checked_array("photons.bandwidths_nm", widths_nm, centres_nm.shape)
    return checked.changed(bandwidths_nm=widths_nm, in_band=in_band)


def _mean_photons(values: ArrayLike, camera: Camera) -> Float64Array:
    """Return mean photons, shape (H, W) or (H, W, B); one number lights the whole sensor."""
    mean = numbers("photons", values, REMEDIES["photons"])
    if mean.ndim == 0:
        mean = np.full((camera.sensor.rows, camera.sensor.columns), float(mean))
    if mean.ndim not in (2, 3) or 0 in mean.shape:
        raise InputError(
            f"photons has shape {mean.shape}; it must be a number, (H, W) or (H, W, bands)."
        )
    return mean


def _centres_nm(
    wavelengths_nm: ArrayLike | None, mean: Float64Array, may_be_unknown: bool
) -> Float64Array | None:
    """Return the centre of each band, shape (B,) [nm]; None if the wavelengths are unknown and may be."""
    count = mean.shape[2] if mean.ndim == 3 else 1
    if wavelengths_nm is None and (mean.ndim == 2 or may_be_unknown):
        return None
    if wavelengths_nm is None and mean.shape[0] in (3, 4) and count > 4:
        raise InputError(
            f"photons has shape {mean.shape}, as an image whose colour planes come first; photons are (H, W), or "
            "(H, W, B) with wavelengths_nm. Light of an RGB image comes from ms.light_from_rgb."
        )
    given: Any = [] if wavelengths_nm is None else wavelengths_nm
    centres_nm = np.atleast_1d(numbers("wavelengths_nm", given, REMEDIES["wavelengths_nm"]))
    if centres_nm.shape != (count,):
        raise InputError(
            f"photons has {count} band(s) and wavelengths_nm {centres_nm.size or 'none'}; pass one wavelength per "
            "band. Light of an RGB image comes from ms.light_from_rgb."
        )
    return _checked_array("wavelengths_nm", centres_nm, (count,))


def _checked_array(name: str, values: Any, shape: tuple[int, ...]) -> Float64Array:
    """Return positive, finite numbers of this shape; ``photons.in_band`` may be 0. Raises InputError."""
    array = numbers(name, values, REMEDIES[name])
    if array.shape != shape:
        raise InputError(
            f"{name} has shape {array.shape}; it must be {shape}, {REMEDIES[name]}."
        )
    bad = ~(np.isfinite(array) & (array >= 0 if name == "photons.in_band" else array > 0))
    if bad.any():
        first = first_place(bad)
        raise InputError(
            f"{name} is {array[first]:g} in the first of {int(bad.sum())} bad place(s), {first}; pass "
            f"{REMEDIES[name]}."
        )
    return array


def check_light(photons: Photons) -> None:
    """Raise InputError for NaN or negative photons; it names their number and the first place."""
    if all(strip.mean.min() >= 0 for strip in photons.strips()):  # the minimum of NaN is NaN
        return
    mean = photons.mean
    kind, bad = ("NaN", np.isnan(mean)) if np.isnan(mean).any() else ("negative", mean < 0)
    raise InputError(
        f"photons is {kind} in {int(bad.sum())} place(s), first at {first_place(bad)}; mean photons are 0 or more: "
        "clamp or correct them before expose()."
    )


def _refuse_pictures(photons: ArrayLike, mean: Float64Array) -> None:
    """Raise InputError for a mask or an 8-bit image instead of photons, and for infinite photons in an array.

    Infinite photons of a render (``Photons``) saturate their pixels.
    """
    kind = np.asarray(photons).dtype
    if kind.kind == "b" or kind.itemsize == 1:
        raise InputError(
            f"photons is of {kind.name}, like a mask or an image; pass mean photons per pixel as float64, e.g. "
            "photons.astype(float) if the numbers are photons."
        )
    if mean.max() == np.inf:
        bad = np.isinf(mean)
        raise InputError(
            f"photons is infinite in {int(bad.sum())} place(s), first at {first_place(bad)}; pass a finite number, "
            "e.g. 1e9 for a pixel that saturates."
        )


def first_place(bad: NDArray[np.bool_]) -> tuple[int, ...]:
    """Return the index of the first True."""
    return tuple(int(i) for i in np.argwhere(bad)[0])


def check_polarizers(polarizers: str | None, camera: Camera) -> None:
    """Raise InputError for light behind the polarisers of another camera.  polarizers : their fingerprint."""
    if polarizers not in (None, polarizer_fingerprint(camera)):
        raise InputError(
            f"the light was rendered behind the polarisers of another camera than {camera.name}; render it for this "
            "camera."
        )


def _check_light_of_readouts(given: Mapping[str, Photons], camera: Camera) -> None:
    """Raise InputError for light that no exposure or photodiode of this camera collects, and for missing light."""
    if not isinstance(given, Mapping) or not all(
        isinstance(x, Photons) for x in given.values()
    ):
        raise InputError("photons.by_readout must be a dict {name: ms.Photons(mean)}.")
    parts = [readout.name for readout in camera.readouts[1:] if readout.of != "charge"]
    needed = [*later_exposures(camera, Exposure(1.0))]
    if camera.sensor.dual_pixel:
        parts, needed = [LEFT], [LEFT]
    elif camera.quantum_efficiency.image_lag:
        parts = [BEFORE]
    without = "pass photons.changed(by_readout=None) for one light in all exposures"
    if unknown := [name for name in given if name not in parts]:
        names = ", ".join(map(repr, parts)) or "no separate light"
        raise InputError(
            f"photons.by_readout names {unknown[0]!r}; {camera.name} takes {names}; {without}."
        )
    if missing := [name for name in needed if name not in given]:
        raise InputError(
            f"photons.by_readout lacks {missing[0]!r}; give the light of all of {', '.join(map(repr, needed))}, or "
            f"{without}."
        )


# -- place on the sensor -----------------------------------------------------------------------------------------------


def placed(light: Photons, first_pixel: object, camera: Camera) -> Photons:
    """Return the light at the requested place on the sensor. Raises InputError.

    ``in_band`` holds behind each pixel's own filter only, so another filter drops it.
    """
    old = light.origin
    new = require_pair("origin", old if first_pixel is None else first_pixel, ORIGIN)
    shift = new[0] - old[0], new[1] - old[1]
    periods = camera.sensor.polarizer_periods
    if light.polarizers is not None and any(
        by % n for by, n in zip(shift, periods, strict=True)
    ):
        raise InputError(
            f"origin is {new}, but the light was rendered behind the polarisers of the pixels from {old} on; move it "
            f"by a multiple of {periods[0]} rows and {periods[1]} columns, or render it there."
        )
    tile = len(camera.tile), len(camera.tile[0])
    is_other_filter = any(by % n for by, n in zip(shift, tile, strict=True))

    def at(one: Photons) -> Photons:
        in_band = None if is_other_filter else one.in_band
        return one.changed(origin=new, in_band=in_band).with_readouts(at)

    return at(light)


def check_numbers(frames: Any, first_frame: Any, seed: Any) -> tuple[int, int, int]:
    """Return the numbers as Python integers. Raises InputError if the random number counters cannot hold them."""
    given = {"frames": frames, "first_frame": first_frame, "seed": seed}
    frames, first_frame, seed = (require_seed(name, number) for name, number in given.items())
    if frames < 1 or first_frame + frames > 2**32:
        raise InputError(
            f"frames is {frames} from {first_frame}; ask for at least 1, numbered from 0 to 2^32 - 1."
        )
    return frames, first_frame, seed
