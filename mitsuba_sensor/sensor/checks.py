"""Checks of the arguments of expose() and plan(); each error has the value, the allowed range and the remedy."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.camera import Camera
from ..camera.fingerprint import pixel_fingerprint
from ..core import (
    Float64Array,
    Frame,
    InputError,
    Photons,
    PhotonsOfBands,
    SensorWindow,
    numbers,
    require_seed,
)
from ..core.backend import FLOAT32_LIMIT
from ..stages.combined_readouts import combined_of
from ..stages.gains import adc_gain_dn_per_v
from ..stages.stage import Chain, ElectronCounter
from .photon_checks import (
    check_channels,
    check_lengths,
    check_light,
    check_photons,
    check_polarizers,
    checked_channels,
    checked_widths,
    first_place,
)
from .readout_checks import check_light_of_readouts


def check_numbers(frames: Any, first_frame: Any, seed: Any) -> tuple[int, int, int]:
    """The same as Python integers. Raises InputError where the random number generator's counters cannot hold them."""
    given = {"frames": frames, "first_frame": first_frame, "seed": seed}
    frames, first_frame, seed = (require_seed(name, number) for name, number in given.items())
    if frames < 1 or first_frame + frames > 2**32:
        raise InputError(
            f"frames is {frames} from {first_frame}; ask for at least 1, numbered from 0 to 2^32 - 1."
        )
    return frames, first_frame, seed


def checked_names(keep: Any, known: tuple[str, ...]) -> tuple[str, ...]:
    """The signals to keep, one name or several."""
    try:
        if isinstance(keep, str):
            wanted = (keep,)
        else:
            wanted = tuple(keep)
    except TypeError:  # nothing that has elements
        wanted = (keep,)
    for name in wanted:
        if name not in known:
            raise InputError(
                f"keep names {name!r}; the signals that can be kept are {', '.join(known)}."
            )
    return wanted


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
    check_light_of_readouts(photons.by_readout, camera)
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
    """The same of one exposure."""
    if isinstance(photons, Photons):
        check_polarizers(photons.polarizers, camera)
    if isinstance(photons, PhotonsOfBands) and wavelengths_nm is None:
        return _checked_bands(photons, camera, check)
    if not isinstance(photons, Photons):
        mean = _mean_photons(photons, camera)
        _refuse_pictures(np.asarray(photons).dtype)
        _refuse_infinite(mean)
        return _photons_of_array(mean, wavelengths_nm, check)
    mean = _mean_photons(photons.mean, camera)
    if photons.detected:
        mean = checked_channels(mean, camera)
    centres_nm = wavelengths_nm
    if wavelengths_nm is None:
        centres_nm = photons.wavelengths_nm
    bands_nm = _checked_centres(centres_nm, mean, may_be_unknown=photons.detected)
    check_lengths(bands_nm)
    if check:
        check_photons(mean)
    variance_e2 = photons.variance_e2
    if variance_e2 is not None:
        variance_e2 = _checked_variance(variance_e2, Photons(mean), camera)
    checked = Photons(
        mean,
        bands_nm,
        variance_e2,
        photons.detected,
        photons.origin,
        illuminant=photons.illuminant,
    )
    checked = checked.changed(
        intrinsics=photons.intrinsics, source=photons.source, polarizers=photons.polarizers
    )
    if bands_nm is None or wavelengths_nm is not None or photons.bandwidths_nm is None:
        return checked
    widths_nm = checked_widths(photons.bandwidths_nm, bands_nm.shape)
    in_band = _in_band_of(photons, mean.shape[:2], camera)
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


def _photons_of_array(
    mean: Float64Array, wavelengths_nm: ArrayLike | None, check: bool
) -> Photons:
    """Photons of an array, of which nothing else is known."""
    bands_nm = _checked_centres(wavelengths_nm, mean, may_be_unknown=False)
    check_lengths(bands_nm)
    if check:
        check_photons(mean)
    return Photons(mean, bands_nm)


def _checked_centres(
    wavelengths_nm: ArrayLike | None, mean: Float64Array, may_be_unknown: bool
) -> Float64Array | None:
    """Centres of the bands [nm], one for each; None where they are not known and need not be."""
    count = 1
    if mean.ndim == 3:
        count = mean.shape[2]
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
    return centres_nm


def _wrong_count(bands: int, wavelengths: str) -> InputError:
    """The sentence about bands without a wavelength each."""
    return InputError(
        f"photons has {bands} band(s) and wavelengths_nm {wavelengths}; pass one wavelength per band; "
        "light of an RGB picture comes from ms.light_from_rgb."
    )


def _in_band_of(
    photons: Photons, shape: tuple[int, ...], camera: Camera
) -> Float64Array | None:
    """Factor within the bands, where it was made for pixels like those of this camera."""
    fits = photons.in_band_of in (None, pixel_fingerprint(camera))
    if photons.in_band is None or not fits:
        return None
    return _checked_factor(photons.in_band, shape)


def _checked_bands(photons: PhotonsOfBands, camera: Camera, check: bool) -> PhotonsOfBands:
    """Photons of a render, of which none are made but strip by strip."""
    if check:
        check_light(photons)
    check_lengths(photons.wavelengths_nm)
    if photons.bandwidths_nm is not None:
        checked_widths(photons.bandwidths_nm, photons.shape[2:])
    if photons.detected:
        check_channels(photons.shape, camera)
    in_band = _in_band_of(photons, photons.shape[:2], camera)
    variance_e2 = photons.variance_e2
    if variance_e2 is not None:
        variance_e2 = _checked_variance(variance_e2, photons, camera)
    return photons.changed(in_band=in_band, variance_e2=variance_e2)


def _refuse_pictures(kind: np.dtype[Any]) -> None:
    """Raise InputError for a mask or an 8-bit picture in place of photons."""
    if kind.kind == "b" or kind.itemsize == 1:
        raise InputError(
            f"photons is of {kind.name}, as a mask or a picture has it; pass mean photons per pixel, 0 or more, as "
            "float64: photons.astype(float), if that is what the numbers are."
        )


def _refuse_infinite(mean: NDArray[np.float64]) -> None:
    """Raise InputError for infinite photons in an array; a render's own (Photons) saturate their pixels."""
    if mean.size and mean.max() == np.inf:
        bad = np.isinf(mean)
        raise InputError(
            f"photons is infinite in {int(bad.sum())} place(s), first at {first_place(bad)}; pass a finite number, "
            "e.g. 1e9 for a pixel that saturates."
        )


def _checked_factor(values: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """One finite factor for every pixel, (H, W)."""
    found = numbers(
        "photons.in_band", values, "an array (H, W) of factors of the photoelectrons"
    )
    if found.shape != shape or not (np.isfinite(found) & (found >= 0)).all():
        raise InputError(
            f"photons.in_band has shape {found.shape}; it must be {shape}, finite and 0 or more."
        )
    return found


def _checked_variance(values: Any, photons: Photons, camera: Camera) -> NDArray[np.float64]:
    """One finite variance for every pixel, (H, W) [e-²]; 0 where the light is infinite and saturates anyway."""
    name, shape = "photons.variance_e2", photons.shape[:2]
    variance_e2 = numbers(
        name, values, "an array (H, W) of variances of the mean photoelectrons in e-²"
    )
    if variance_e2.shape != shape:
        raise InputError(
            f"{name} has shape {variance_e2.shape}; it must be {shape}, one variance per pixel in e-²."
        )
    if camera.quantum_efficiency.quantum_yield:
        raise InputError(
            f"{name} is given and quantum_efficiency.quantum_yield of {camera.name} too, whose electrons come in "
            "bursts; leave one of them out: photons without variance_e2 keep the render's noise beside the shot noise."
        )
    variance_e2 = np.where(photons.total == np.inf, 0.0, variance_e2)
    bad = ~((variance_e2 >= 0) & np.isfinite(variance_e2))
    if bad.any():
        first = first_place(bad)
        raise InputError(
            f"{name} is {variance_e2[first]:g} in the first of {int(bad.sum())} bad place(s), {first}; a variance is "
            "finite and 0 or more: a render of one pass has none, so pass None for it."
        )
    return variance_e2


def check_compensation(light: Photons, stages: Chain, frames: int) -> None:
    """Raise InputError where the render's variance cannot be counted within the shot noise of each frame."""
    if light.variance_e2 is None:
        return
    if combined_of(stages) is not None:
        raise InputError(
            "photons has variance_e2 and this camera has several read-outs of its shot noise; pass photons without it."
        )
    if not all(stage.compensates for stage in stages if isinstance(stage, ElectronCounter)):
        raise InputError(
            "photons has variance_e2 and this camera has pixel.partial_resets, which it would have to pass; pass "
            "photons without it."
        )
    if not any(stage.counts_electrons for stage in stages):
        raise InputError(
            "photons has variance_e2 and this chain has no shot noise to count it in; pass photons without it, or take "
            "the physical chain with its shot noise: no shot_noise in sensor.without, a smaller tolerance_dn."
        )
    if frames != 1:
        raise InputError(
            f"frames is {frames} and photons has variance_e2, which is for a frame with a render of its own; render "
            "and expose one frame at a time, numbered by first_frame, or pass photons without variance_e2."
        )


def checked_origin(origin: Any) -> tuple[int, int]:
    """(row, column) of the first pixel."""
    if not isinstance(origin, tuple | list) or len(origin) != 2:
        raise InputError(
            f"origin is {origin!r}; it must be (row, column) of the first pixel, e.g. (0, 0)."
        )
    return require_seed("origin", origin[0]), require_seed("origin", origin[1])


def check_reference_shape(shape: tuple[int, ...], reference: tuple[int, ...]) -> None:
    """Raise InputError unless a frame is subtracted from each frame, or one from all."""
    if shape[1:] != reference[1:] or reference[0] not in (1, shape[0]):
        raise InputError(
            f"the reference has shape {reference}; it must be {shape}, or (1, {shape[1]}, {shape[2]})."
        )


def check_chip(one: tuple[Camera, SensorWindow], other: tuple[Camera, SensorWindow]) -> None:
    """Raise InputError unless frames and their reference are of the same pixels, whose fixed patterns cancel."""
    pairs = {
        "the camera": (one[0].name, other[0].name),
        "the serial": (one[1].serial, other[1].serial),
        "the datasheet": (one[0].stages, other[0].stages),
        "the part of the sensor": (tuple(one[1].origin), tuple(other[1].origin)),
    }
    differs = " and ".join(what for what, (mine, its) in pairs.items() if mine != its)
    if not differs:
        return
    mine, its = (
        f"{camera.name}, serial {at.serial}, from pixel {tuple(at.origin)}"
        for camera, at in (one, other)
    )
    raise InputError(
        f"the frames are of {mine}, and the reference of {its} ({differs} differs), whose fixed patterns are others; "
        "expose the reference with the same camera, serial and origin."
    )


def check_streams(one: tuple[Frame, int], other: tuple[Frame, int]) -> None:
    """Raise InputError where frames and their reference share temporal noise, which would cancel in the difference.

    one, other : the first frame, and how many there are.
    """
    (first, count), (reference, references) = one, other
    begin, end = (
        max(first.index, reference.index),
        min(first.index + count, reference.index + references),
    )
    if first.key != reference.key or begin >= end:
        return
    raise InputError(
        f"the frames and the reference share frame {begin} of seed {first.seed} at the same exposure, whose temporal "
        f"noise would cancel; expose the reference with another seed, or with first_frame={first.index + count}."
    )


COUNTABLE_E, COUNTABLE_DN = 2**24, 2**23
"""What float32 counts: whole electrons; digital numbers, which are rounded and therefore need halves too."""


def float32_counts(camera: Camera) -> bool:
    """Whether float32 holds single electrons of a full well and the codes of this camera."""
    countable = camera.pixel.full_well_e <= COUNTABLE_E and 2**camera.code_bits <= COUNTABLE_DN
    return countable and adc_gain_dn_per_v(camera) <= FLOAT32_LIMIT


def check_float32(camera: Camera) -> None:
    """Raise InputError where float32, asked for, cannot compute this camera's codes."""
    gain = adc_gain_dn_per_v(camera)
    if gain > FLOAT32_LIMIT:
        raise InputError(
            f"precision is 'float32', which holds numbers up to {FLOAT32_LIMIT:g}, and the converter of {camera.name} "
            f"makes {gain:.3g} DN of a volt; leave the precision out, or mend the gains and adc.full_scale_v."
        )
    if camera.adc.dnl_lsb and 2**camera.adc.bits > COUNTABLE_DN:
        raise InputError(
            f"precision is 'float32', which has no halves between codes from {COUNTABLE_DN} on, and {camera.name} has "
            f"adc.dnl_lsb and {camera.adc.bits} bits; leave the precision out, or take 23 bits or fewer."
        )
