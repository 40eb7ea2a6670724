"""expose(): photons in, digital numbers out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engine.checks import check_types
from ..engine.errors import InputError, require_seed
from ..engine.frame import Device, Exposure, Frame
from ..engine.quantities import Electrons, Photons
from .account import Ledger, account, ledger, plain
from .camera import Camera
from .chain import chain as physical_chain
from .inputs import as_photons, check_numbers, checked_maps, checked_names, checked_origin
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
    check_numbers(frames, first_frame, seed)
    wanted = checked_names(keep, KEEP)
    stages = _stages(camera, plan, chain)
    shape = light.mean.shape[0], light.mean.shape[1]
    window = Device(serial, shape, checked_origin(origin))
    device = replace(window, given=checked_maps({} if maps is None else maps, stages, window, camera))
    first = Frame(exposure, device, seed, first_frame)
    code_type = np.min_scalar_type(stages[-1].highest)
    kept = {name: np.empty((frames, *shape)) for name in wanted} | {"digital": np.empty((frames, *shape), code_type)}
    for rows in strips_of(shape):
        strip = Photons(light.mean[rows], light.wavelengths_nm)
        part = device.rows_only(rows)
        for index in range(frames):
            for name, signal in _signals(stages, strip, Frame(exposure, part, seed, first_frame + index)):
                if name in kept:
                    kept[name][index, rows] = signal
    return Frames(kept.pop("digital"), camera, light, first, stages, **kept)


def strips_of(shape: tuple[int, int]) -> Iterator[slice]:
    """Whole rows of about STRIP pixels: what is in flight fits into the cache, and 12 Mpx into 300 MB."""
    height = max(STRIP // shape[1], 1)
    for start in range(0, shape[0], height):
        yield slice(start, min(start + height, shape[0]))


def _stages(camera: Camera, plan: Plan | None, chain: str) -> tuple[Any, ...]:
    """What the plan left of this camera's chain, or the whole chain of that name."""
    if plan is None:
        if chain == "konnik2014":
            return chain_of(Konnik2014Settings.from_camera(camera))
        if chain != "physical":
            raise InputError(f"chain is {chain!r}; it must be 'physical', or 'konnik2014' for the published code.")
        return physical_chain(camera)
    if not hasattr(plan, "whole"):
        raise InputError(f"plan is {plan!r}; pass what plan(camera, exposure, photons) returns.")
    if chain != "physical":
        raise InputError(f"chain is {chain!r} and a plan is given; a plan is for the physical chain: pass one of them.")
    if plan.whole != physical_chain(camera):
        raise InputError(
            f"plan was made for another camera, {plan.camera}; make one for this one with plan(camera, …)."
        )
    return plan.stages


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
    device = Device(serial, (require_seed("shape", size[0]), require_seed("shape", size[1])), checked_origin(origin))
    found: dict[str, NDArray[np.float64]] = {}
    for stage in physical_chain(camera):
        if hasattr(stage, "maps"):
            found |= stage.maps(device)
    return found
