"""expose(): photons in, digital numbers out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.errors import InputError, require_seed
from ..engine.frame import Device, Exposure, Frame
from ..engine.quantities import Electrons, Photons
from .account import account
from .camera import Camera
from .chain import chain

if TYPE_CHECKING:
    from .plan import Plan

KEEP = ("electrons", "volts")
"""Intermediate signals that ``expose(keep=…)`` can return: electrons in the well [e-], swing at the converter [V]."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Raw frames of one camera.

    digital : (N, H, W) uint8, uint16 or uint32, whichever holds ``adc.bits`` [DN].
    electrons, volts : (N, H, W) float64 on request, else None.
    """

    digital: NDArray[Any]
    photons: Photons
    camera: Camera
    first: Frame
    electrons: NDArray[np.float64] | None = None
    volts: NDArray[np.float64] | None = None

    @cached_property
    def report(self) -> dict[str, Any]:
        """The first frame's account, ready for JSON: what every stage must do on average, and what it did."""
        return account(self.photons, self.camera, self.first)


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
    plan: Plan | None = None,
) -> Frames:
    """Raw frames that ``camera`` delivers for these mean photons per pixel.

    photons : what :func:`collect` returns, or an array: a scalar (the whole sensor), (H, W), or (H, W, B) with
        ``wavelengths_nm`` of length B.
    seed : all noise that changes from frame to frame.  serial : the device, that is all patterns that never change.
    frames, first_frame : how many, and the number of the first; frame 12 is the same made alone or after eleven others.
    keep : any of "electrons", "volts".
    origin : (row, column) of the first pixel on the sensor: a crop of a frame is the frame of the crop.
    plan : what :func:`plan` left of the chain; the whole chain without one.
    Raises InputError for NaN or negative photons, naming how many there are and where the first one is.
    """
    light = as_photons(photons, camera, wavelengths_nm)
    for name, number in zip(("frames", "first_frame", "origin", "origin"), (frames, first_frame, *origin), strict=True):
        require_seed(name, number)
    if frames < 1 or first_frame < 0 or first_frame + frames > 2**32:
        raise InputError(f"frames is {frames} from {first_frame}; ask for at least 1, numbered from 0 to 2^32 - 1.")
    wanted = tuple(keep)
    for name in wanted:
        if name not in KEEP:
            raise InputError(f"keep names {name!r}; the signals that can be kept are {', '.join(KEEP)}.")
    require_seed("seed", seed)
    shape = light.mean.shape[0], light.mean.shape[1]
    device = Device(serial, shape, origin)
    stages = plan.stages if plan else chain(camera)
    kept: dict[str, list[Any]] = {name: [] for name in (*wanted, "digital")}
    for index in range(first_frame, first_frame + frames):
        for name, signal in _rooms(stages, light, Frame(exposure, device, seed, index)):
            if name in kept:
                kept[name].append(signal)
    digital = np.stack(kept["digital"]).astype(code_type(camera.adc.bits))
    first = Frame(exposure, device, seed, first_frame)
    extra = {name: np.stack(kept[name]) for name in wanted}
    return Frames(digital, light, camera, first, **extra)


def _rooms(stages: tuple[Any, ...], light: Photons, frame: Frame) -> Iterator[tuple[str, Any]]:
    """One frame through the chain; yields (room, signal) at the door of each room."""
    signal: Any = light
    for stage, following in zip(stages, (*stages[1:], None), strict=True):
        signal = stage(signal, frame)
        if following is None or following.room != stage.room:
            value = signal.total if isinstance(signal, Electrons) else signal
            yield stage.room.split()[0], np.broadcast_to(value, frame.device.shape)


def as_photons(photons: Photons | ArrayLike, camera: Camera, wavelengths_nm: ArrayLike | None = None) -> Photons:
    """Anything that ``expose`` accepts as mean photons, checked: shape, NaN, negative values."""
    given = photons if isinstance(photons, Photons) else None
    try:
        mean = np.asarray(given.mean if given else photons, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("photons is not numeric; pass a number or an array of mean photons per pixel.") from None
    wavelengths = given.wavelengths_nm if given and wavelengths_nm is None else wavelengths_nm
    if mean.ndim == 0:
        mean = np.full((camera.sensor.rows, camera.sensor.columns), float(mean))
    if mean.ndim not in (2, 3) or 0 in mean.shape:
        raise InputError(f"photons has shape {mean.shape}; it must be a number, (H, W) or (H, W, bands).")
    bands = None if wavelengths is None else np.atleast_1d(np.asarray(wavelengths, dtype=np.float64))
    expected = mean.shape[2] if mean.ndim == 3 else 1
    if (bands is None and mean.ndim == 3) or (bands is not None and bands.shape != (expected,)):
        count = "none" if bands is None else str(bands.size)
        raise InputError(f"photons has {expected} band(s) and wavelengths_nm {count}; pass one wavelength per band.")
    if bands is not None and not (np.isfinite(bands) & (bands > 0)).all():
        raise InputError(f"wavelengths_nm holds {bands[~(bands > 0)][:1]}; every band needs a positive length in nm.")
    _refuse(np.isnan(mean), "NaN")
    _refuse(mean < 0, "negative")
    return Photons(mean, bands)


def _refuse(bad: NDArray[np.bool_], kind: str) -> None:
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"photons is {kind} in {int(bad.sum())} place(s), first at {first}; a mean number of photons is 0 or more: "
            f"clamp or mend them before expose()."
        )


def code_type(bits: int) -> type[np.unsignedinteger[Any]]:
    """The smallest unsigned integer type that holds ``bits`` bits."""
    return np.uint8 if bits <= 8 else np.uint16 if bits <= 16 else np.uint32
