"""expose(): photons in, digital numbers out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.errors import InputError, nearest, require_seed
from ..engine.frame import Device, Exposure, Frame
from ..engine.quantities import Electrons, Photons
from .account import Ledger, account, ledger, plain
from .camera import Camera
from .chain import chain as physical_chain
from .konnik2014 import Konnik2014Settings, chain_of

if TYPE_CHECKING:
    from .plan import Plan

KEEP = ("photons", "light_electrons", "dark_electrons", "electrons", "volts")
"""Intermediate signals that ``expose(keep=…)`` can return: mean photons of all bands, electrons that light and dark
current left in the well, their sum [e-], swing at the converter [V]."""


STRIP = 2**17
"""Pixels that go through the chain at a time; the result does not depend on it."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Raw frames of one camera.

    digital : (N, H, W) uint8, uint16 or uint32, whichever holds ``adc.bits`` [DN].
    photons, light_electrons, dark_electrons, electrons, volts : (N, H, W) float64 if asked for by ``keep``, else None.
    """

    digital: NDArray[Any]
    camera: Camera
    light: Photons
    first: Frame
    stages: tuple[Any, ...]
    photons: NDArray[np.float64] | None = None
    light_electrons: NDArray[np.float64] | None = None
    dark_electrons: NDArray[np.float64] | None = None
    electrons: NDArray[np.float64] | None = None
    volts: NDArray[np.float64] | None = None

    @cached_property
    def report(self) -> dict[str, Any]:
        """The first frame's account, ready for JSON: what every stage must do on average, and what it did."""
        return account(self.light, self.camera, self.first, self.stages)

    def minus(self, reference: Frames) -> NDArray[np.int64]:
        """Signed difference to a zero-exposure frame or a stack of as many, (N, H, W) [DN]: the paper's CDS.

        Fixed patterns cancel, temporal variances add (√2 in σ for equal frames), and nothing wraps below zero.
        Raises InputError when the frames do not fit.
        """
        if not isinstance(reference, Frames):
            raise InputError(f"the reference is a {type(reference).__name__}; pass the Frames of a zero exposure.")
        one, other = self.digital.shape, reference.digital.shape
        if one[1:] != other[1:] or other[0] not in (1, one[0]):
            raise InputError(f"the reference has shape {other}; it must be {one}, or (1, {one[1]}, {one[2]}).")
        return self.digital.astype(np.int64) - reference.digital.astype(np.int64)

    def ledger(self) -> Ledger:
        """What every source put into each pixel of the first frame, in DN; the parts add up to the frame."""
        return ledger(self.light, self.first, self.stages)


def expose(
    photons: Photons | ArrayLike,
    camera: Camera,
    exposure: Exposure,
    *,
    seed: int = 1,
    serial: int = 1,
    frames: int = 1,
    first_frame: int = 0,
    keep: Iterable[str] = (),
    wavelengths_nm: ArrayLike | None = None,
    origin: tuple[int, int] = (0, 0),
    maps: Mapping[str, ArrayLike] | None = None,
    plan: Plan | None = None,
    chain: Literal["physical", "konnik2014"] = "physical",
) -> Frames:
    """Raw frames that ``camera`` delivers for these mean photons per pixel.

    photons : what :func:`collect` returns, or an array: a scalar (the whole sensor), (H, W), or (H, W, B) with
        ``wavelengths_nm`` of length B.
    seed : all noise that changes from frame to frame.  serial : the device, that is all patterns that never change.
    frames, first_frame : how many, and the number of the first; frame 12 is the same made alone or after eleven others.
    keep : any of "photons", "light_electrons", "dark_electrons", "electrons", "volts".
    maps : measured fixed patterns in place of the serial's own, by the names that :func:`patterns` returns; of this
        window, or of the whole sensor.
    origin : (row, column) of the first pixel on the sensor: a crop of a frame is the frame of the crop.
    plan : what :func:`plan` left of the chain; the whole chain without one.
    chain : "physical", or "konnik2014" for the published code's behaviour (comparison only; docs/konnik2014.md).
    Raises InputError for NaN or negative photons, naming how many there are and where the first one is.
    """
    check_types(camera, exposure)
    light = as_photons(photons, camera, wavelengths_nm)
    for name, number in zip(("frames", "first_frame"), (frames, first_frame), strict=True):
        require_seed(name, number)
    if frames < 1 or first_frame + frames > 2**32:
        raise InputError(f"frames is {frames} from {first_frame}; ask for at least 1, numbered from 0 to 2^32 - 1.")
    wanted = tuple(keep) if isinstance(keep, Iterable) and not isinstance(keep, str) else (keep,)
    for name in wanted:
        if name not in KEEP:
            raise InputError(f"keep names {name!r}; the signals that can be kept are {', '.join(KEEP)}.")
    require_seed("seed", seed)
    if plan is not None and not hasattr(plan, "whole"):
        raise InputError(f"plan is {plan!r}; pass what plan(camera, exposure, photons) returns.")
    if plan and chain != "physical":
        raise InputError(f"chain is {chain!r} and a plan is given; a plan is for the physical chain: pass one of them.")
    stages = plan.stages if plan else _stages(camera, chain)
    if plan and plan.whole != physical_chain(camera):
        raise InputError(
            f"plan was made for another camera, {plan.camera}; make one for this one with plan(camera, …)."
        )
    shape = light.mean.shape[0], light.mean.shape[1]
    window = Device(serial, shape, _checked_origin(origin))
    device = replace(window, given=_checked_maps({} if maps is None else maps, stages, window, camera))
    first = Frame(exposure, device, seed, first_frame)
    code_type = np.min_scalar_type(stages[-1].highest)
    kept = {name: np.empty((frames, *shape)) for name in wanted} | {"digital": np.empty((frames, *shape), code_type)}
    for rows in _strips(shape):
        strip = Photons(light.mean[rows], light.wavelengths_nm)
        part = device.rows_only(rows)
        for index in range(frames):
            for name, signal in _signals(stages, strip, Frame(exposure, part, seed, first_frame + index)):
                if name in kept:
                    kept[name][index, rows] = signal
    return Frames(kept.pop("digital"), camera, light, first, stages, **kept)


def _strips(shape: tuple[int, int]) -> Iterator[slice]:
    """Whole rows of about STRIP pixels: what is in flight fits into the cache, and 12 Mpx into 300 MB."""
    height = max(STRIP // shape[1], 1)
    for start in range(0, shape[0], height):
        yield slice(start, min(start + height, shape[0]))


def _stages(camera: Camera, chain: str) -> tuple[Any, ...]:
    if chain == "konnik2014":
        return chain_of(Konnik2014Settings.from_camera(camera))
    if chain != "physical":
        raise InputError(f"chain is {chain!r}; it must be 'physical', or 'konnik2014' for the published code.")
    return physical_chain(camera)


def run_chain(stages: tuple[Any, ...], light: Photons, frame: Frame) -> Any:
    """One frame through these stages: digital numbers (H, W), as float64."""
    signal: Any = light
    for stage in stages:
        signal = stage(signal, frame)
    return signal


def _signals(stages: tuple[Any, ...], light: Photons, frame: Frame) -> Iterator[tuple[str, Any]]:
    """One frame through the chain; yields (name, signal) at the door of each room."""
    shape = frame.device.shape
    signal: Any = light
    yield "photons", light.total
    for stage, following in zip(stages, (*stages[1:], None), strict=True):
        signal = stage(signal, frame)
        if following is not None and following.room == stage.room:
            continue
        if isinstance(signal, Electrons):
            yield "light_electrons", np.broadcast_to(signal.light, shape)
            yield "dark_electrons", np.broadcast_to(signal.dark, shape)
        if stage.room != "photons":
            yield stage.room.split()[0], np.broadcast_to(plain(signal), shape)


def patterns(
    camera: Camera, shape: tuple[int, int] | None = None, *, serial: int = 1, origin: tuple[int, int] = (0, 0)
) -> dict[str, NDArray[np.float64]]:
    """Every fixed pattern of one device, by name: gains (1 on average), dark factors (1), offsets in electrons (0).

    shape : (rows, columns) of the window; the whole sensor by default. What comes out goes into ``expose(maps=…)``.
    """
    check_types(camera, Exposure(0.0))
    size = (camera.sensor.rows, camera.sensor.columns) if shape is None else shape
    if not isinstance(size, tuple | list) or len(size) != 2 or 0 in size:
        raise InputError(f"shape is {size!r}; it must be (rows, columns) of the window, e.g. (480, 640).")
    device = Device(serial, (require_seed("shape", size[0]), require_seed("shape", size[1])), _checked_origin(origin))
    found: dict[str, NDArray[np.float64]] = {}
    for stage in physical_chain(camera):
        if hasattr(stage, "maps"):
            found |= stage.maps(device)
    return found


def _checked_maps(
    maps: Mapping[str, ArrayLike], stages: tuple[Any, ...], window: Device, camera: Camera
) -> dict[str, NDArray[np.float64]]:
    """Measured maps as arrays that fit the window, cut from the whole sensor's; a column's is (1, W), a row's (H, 1)."""
    shape, sensor = window.shape, (camera.sensor.rows, camera.sensor.columns)
    if not isinstance(maps, Mapping):
        raise InputError(f"maps is a {type(maps).__name__}; pass a dict of name → array, as patterns() returns.")
    if not maps:
        return {}
    known = {
        name: value.shape for s in stages if hasattr(s, "maps") for name, value in s.maps(Device(0, (2, 2))).items()
    }
    checked = {}
    for name, values in maps.items():
        if name not in known:
            there = ", ".join(known) or "none: the published chain draws its own"
            raise InputError(f"maps names {name!r}; this camera's maps are {there}.{nearest(str(name), known)}")
        array = _numbers(f"maps[{name!r}]", values, "an array of numbers")
        for axis, places in enumerate((window.rows, window.columns)):
            if array.ndim == 2 and 1 < array.shape[axis] == sensor[axis] > places[-1]:
                array = array.take(places, axis)
        fits = tuple(n if pixels > 1 else 1 for n, pixels in zip(shape, known[name], strict=True))
        if array.ndim != 2 or any(n not in (1, full) for n, full in zip(array.shape, fits, strict=True)):
            raise InputError(
                f"maps[{name!r}] has shape {array.shape}; it must be {fits}, the sensor's, or 1 along an axis."
            )
        if not np.isfinite(array).all() or (not name.endswith("_e") and (array < 0).any()):
            raise InputError(f"maps[{name!r}] holds NaN, infinite or negative values; mend the bad pixels first.")
        checked[name] = array
    return checked


def as_photons(photons: Photons | ArrayLike, camera: Camera, wavelengths_nm: ArrayLike | None = None) -> Photons:
    """Anything that ``expose`` accepts as mean photons, checked: shape, NaN, negative values."""
    given = photons if isinstance(photons, Photons) else None
    mean = _numbers("photons", given.mean if given else photons, "a number or an array of mean photons per pixel")
    wavelengths = given.wavelengths_nm if given and wavelengths_nm is None else wavelengths_nm
    if mean.ndim == 0:
        mean = np.full((camera.sensor.rows, camera.sensor.columns), float(mean))
    if mean.ndim not in (2, 3) or 0 in mean.shape:
        raise InputError(f"photons has shape {mean.shape}; it must be a number, (H, W) or (H, W, bands).")
    way_out = "numbers in nm, one per band, e.g. [550.0]"
    bands = None if wavelengths is None else np.atleast_1d(_numbers("wavelengths_nm", wavelengths, way_out))
    expected = mean.shape[2] if mean.ndim == 3 else 1
    if (bands is None and mean.ndim == 3) or (bands is not None and bands.shape != (expected,)):
        count = "none" if bands is None else str(bands.size)
        raise InputError(f"photons has {expected} band(s) and wavelengths_nm {count}; pass one wavelength per band.")
    if bands is not None and (wrong := bands[~(np.isfinite(bands) & (bands > 0))]).size:
        raise InputError(f"wavelengths_nm holds {wrong[0]}; every band needs a positive, finite length in nm.")
    _refuse(np.isnan(mean), "NaN")
    _refuse(mean < 0, "negative")
    return Photons(mean, bands)


def _numbers(name: str, values: Any, way_out: str) -> NDArray[np.float64]:
    """``values`` as float64; InputError for text, complex numbers, ragged lists and None."""
    try:
        array = np.asarray(values)
    except ValueError:
        array = np.asarray("ragged")
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name} is not numeric; pass {way_out}.")
    return np.asarray(array, dtype=np.float64)


def _refuse(bad: NDArray[np.bool_], kind: str) -> None:
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"photons is {kind} in {int(bad.sum())} place(s), first at {first}; a mean number of photons is 0 or more: "
            f"clamp or mend them before expose()."
        )


def check_types(camera: Any, exposure: Any) -> None:
    """Raise InputError for a name or a number where a Camera or an Exposure belongs."""
    if not isinstance(camera, Camera):
        raise InputError(f"camera is {camera!r}; pass a Camera, e.g. load_camera('konnik_table1').")
    if not isinstance(exposure, Exposure):
        raise InputError(f"exposure is {exposure!r}; pass an Exposure, e.g. Exposure(time_s=0.1).")


def _checked_origin(origin: Any) -> tuple[int, int]:
    if not isinstance(origin, tuple | list) or len(origin) != 2:
        raise InputError(f"origin is {origin!r}; it must be (row, column) of the first pixel, e.g. (0, 0).")
    return require_seed("origin", origin[0]), require_seed("origin", origin[1])
