"""Checks of mean photons, which expose() and plan() accept, of their bands and of their place on the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

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


class Numbers(NamedTuple):
    """Numbers that come with photons.  remedy : what to pass.  may_be_zero : whether 0 is allowed."""

    remedy: str
    may_be_zero: bool = True


ARRAYS = {
    "photons": Numbers(
        "a number or an array of mean photons per pixel; of a render, collect(light, camera, exposure)"
    ),
    "wavelengths_nm": Numbers("positive numbers in nm, one per band, e.g. [550.0]", False),
    "photons.bandwidths_nm": Numbers("one positive, finite width in nm per band", False),
    "photons.in_band": Numbers("one finite factor of the photoelectrons per pixel, 0 or more"),
}


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
        own, first = ((one.shape, one.origin) for one in (others[name], checked))
        if own != first:
            raise InputError(
                f"photons.by_readout[{name!r}] has shape {own[0]} from pixel {own[1]}; it must be {first[0]} from "
                f"{first[1]}, as the first exposure."
            )
    return checked.changed(by_readout=others)


def _as_photons(
    photons: Photons | ArrayLike, camera: Camera, wavelengths_nm: ArrayLike | None, check: bool
) -> Photons:
    """The photons of one exposure."""
    if not isinstance(photons, Photons):
        mean = _mean_photons(photons, camera)
        _refuse_pictures(photons, mean)
        checked = Photons(mean, _centres_nm(wavelengths_nm, mean, may_be_unknown=False))
        if check:
            check_light(checked)
        return checked
    check_polarizers(photons.polarizers, camera)
    checked = photons.changed(by_readout=None)
    filters = len(camera.quantum_efficiency.curves)
    if photons.factor is not None and wavelengths_nm is None:
        _require_positive("wavelengths_nm", photons.wavelengths_nm)
    else:
        mean = _mean_photons(photons.mean, camera)
        if photons.detected and mean.ndim == 2:  # of each pixel behind its own filter
            mean = np.broadcast_to(mean[..., None], (*mean.shape, filters))
        centres_nm = photons.wavelengths_nm if wavelengths_nm is None else wavelengths_nm
        bands_nm = _centres_nm(centres_nm, mean, may_be_unknown=photons.detected)
        checked = checked.changed(mean=mean, wavelengths_nm=bands_nm)
    shape = checked.shape
    is_channels = len(shape) == 3 and shape[2] == filters
    if photons.detected and (not is_channels or camera.quantum_efficiency.quantum_yield):
        raise InputError(
            f"photons has shape {shape} and is detected already; it must be (H, W), or (H, W, {filters}), one layer "
            "per colour filter, of a camera without quantum_yield: render it again for this camera."
        )
    if check:
        check_light(checked)
    checked = checked.changed(bandwidths_nm=None, in_band=None, in_band_of=None)
    centres_nm, widths_nm = checked.wavelengths_nm, photons.bandwidths_nm
    if centres_nm is None or wavelengths_nm is not None or widths_nm is None:
        return checked
    widths_nm, in_band = (
        _checked_array("photons.bandwidths_nm", widths_nm, centres_nm.shape),
        None,
    )
    if photons.in_band is not None and photons.in_band_of in (None, pixel_fingerprint(camera)):
        in_band = _checked_array("photons.in_band", photons.in_band, shape[:2])
    return checked.changed(
        bandwidths_nm=widths_nm, in_band=in_band, in_band_of=photons.in_band_of
    )


def _mean_photons(values: ArrayLike, camera: Camera) -> Float64Array:
    """Mean photons (H, W) or (H, W, B); a number is the light of the whole sensor."""
    mean = numbers("photons", values, ARRAYS["photons"].remedy)
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
    """Centres of the bands [nm], one for each; None where they are not known and need not be."""
    count = mean.shape[2] if mean.ndim == 3 else 1
    if wavelengths_nm is None and (mean.ndim == 2 or may_be_unknown):
        return None
    if wavelengths_nm is None and mean.shape[0] in (3, 4) and count > 4:
        raise InputError(
            f"photons has shape {mean.shape}, as a picture whose colour planes come first; photons are (H, W), or "
            "(H, W, B) with wavelengths_nm. Light of an RGB picture comes from ms.light_from_rgb."
        )
    given: Any = [] if wavelengths_nm is None else wavelengths_nm
    centres_nm = np.atleast_1d(
        numbers("wavelengths_nm", given, ARRAYS["wavelengths_nm"].remedy)
    )
    if centres_nm.shape != (count,):
        raise InputError(
            f"photons has {count} band(s) and wavelengths_nm {centres_nm.size or 'none'}; pass one wavelength per "
            "band; light of an RGB picture comes from ms.light_from_rgb."
        )
    _require_positive("wavelengths_nm", centres_nm)
    return centres_nm


def _checked_array(name: str, values: Any, shape: tuple[int, ...]) -> Float64Array:
    """Values of one of :data:`ARRAYS`, an array of this shape. Raises InputError."""
    array = numbers(name, values, ARRAYS[name].remedy)
    if array.shape != shape:
        raise InputError(
            f"{name} has shape {array.shape}; it must be {shape}, {ARRAYS[name].remedy}."
        )
    _require_positive(name, array)
    return array


def _require_positive(name: str, array: Float64Array | None) -> None:
    """Raise InputError for values that are not finite, negative, or 0 where that is not allowed."""
    if array is None:
        return
    bad = ~(np.isfinite(array) & (array >= 0 if ARRAYS[name].may_be_zero else array > 0))
    if bad.any():
        first = first_place(bad)
        raise InputError(
            f"{name} is {array[first]:g} in the first of {int(bad.sum())} bad place(s), {first}; pass "
            f"{ARRAYS[name].remedy}."
        )


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


def _refuse_pictures(photons: ArrayLike, mean: Float64Array) -> None:
    """Raise InputError for a mask or an 8-bit picture in place of photons, and for infinite photons in an array; a
    render's own (Photons) saturate their pixels."""
    kind = np.asarray(photons).dtype
    if kind.kind == "b" or kind.itemsize == 1:
        raise InputError(
            f"photons is of {kind.name}, as a mask or a picture has it; pass mean photons per pixel, 0 or more, as "
            "float64: photons.astype(float), if that is what the numbers are."
        )
    if mean.max() == np.inf:
        bad = np.isinf(mean)
        raise InputError(
            f"photons is infinite in {int(bad.sum())} place(s), first at {first_place(bad)}; pass a finite number, "
            "e.g. 1e9 for a pixel that saturates."
        )


def first_place(bad: NDArray[np.bool_]) -> tuple[int, ...]:
    """Index of the first one."""
    return tuple(int(i) for i in np.argwhere(bad)[0])


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
    old = light.origin
    new = require_pair("origin", old if first_pixel is None else first_pixel, ORIGIN)
    shift = new[0] - old[0], new[1] - old[1]
    periods = camera.sensor.polarizer_periods
    if light.polarizers is not None and any(
        by % n for by, n in zip(shift, periods, strict=True)
    ):
        raise InputError(
            f"origin is {new}, and the light was rendered behind the polarisers of the pixels from {old} "
            f"on; move it by a multiple of {periods[0]} rows and {periods[1]} columns, or render it there."
        )
    tile = len(camera.tile), len(camera.tile[0])
    is_other_filter = any(by % n for by, n in zip(shift, tile, strict=True))

    def at(one: Photons) -> Photons:
        in_band = None if is_other_filter else one.in_band
        return one.changed(origin=new, in_band=in_band).with_readouts(at)

    return at(light)


def check_numbers(frames: Any, first_frame: Any, seed: Any) -> tuple[int, int, int]:
    """The same as Python integers. Raises InputError where the random number generator's counters cannot hold them."""
    given = {"frames": frames, "first_frame": first_frame, "seed": seed}
    frames, first_frame, seed = (require_seed(name, number) for name, number in given.items())
    if frames < 1 or first_frame + frames > 2**32:
        raise InputError(
            f"frames is {frames} from {first_frame}; ask for at least 1, numbered from 0 to 2^32 - 1."
        )
    return frames, first_frame, seed
