"""Expose a camera: check and prepare an exposure, then compute raw frames [DN] from mean photons per pixel."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..camera.camera import Camera
from ..core import (
    Exposure,
    Frame,
    InputError,
    Photons,
    SensorWindow,
    check_types,
    first_given,
)
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from ..core.errors import shown
from ..core.options import complete
from ..files.memory import free_memory_bytes
from ..stages.stage import Chain, converter_of, detector_of
from .checks import as_photons, check_numbers, placed
from .detection import Detected, DetectedByKernel, checked_and_detected, detected_by_kernel
from .fpn_maps import checked_maps
from .frame_notes import exposure_notes
from .frames import CLIPPED, KEEP, RawFrames
from .options import ExposeOptions
from .precision import precision_of
from .run import FrameRunner, StripWindows, choose_backend

if TYPE_CHECKING:
    from ..theory.plan import Plan

MEMORY_TO_ASK_FOR = 2**24
"""Frames below this size [byte] skip the look at free memory, which costs a tenth of a small frame."""
Planner: TypeAlias = Callable[[Camera, Detected, Frame], "Plan"]


@dataclass(frozen=True, eq=False)
class PreparedExposure:
    """A checked exposure, complete except for the light: ``prepare_exposure(…).of(photons).frames()``.

    first : the first frame; its window has the backend and the given FPN maps.  keep : names of signals to return.
    count : number of frames.  strips : strips of a sensor that keeps its maps.
    plan : the plan that shortened the chain.  planner : function that makes a plan for the light.
    told : function that is called with the number of completed frames.
    """

    camera: Camera
    stages: Chain
    first: Frame
    count: int
    keep: tuple[str, ...]
    plan: Plan | None = None
    planner: Planner | None = None
    light: Detected | DetectedByKernel | None = None
    strips: StripWindows | None = None
    told: Callable[[int], object] | None = None

    def at(self, exposure: Exposure) -> PreparedExposure:
        """Return this exposure with another time or temperature."""
        return replace(self, first=replace(self.first, exposure=exposure, _blocks={}))

    def check_memory(self, count: int) -> None:
        """Raise InputError if this many frames need more memory than is free."""
        shape = self.first.window.shape
        bytes_of_pixel = self._code_type.itemsize + 8 * len(self.keep)
        size = count * math.prod(shape) * bytes_of_pixel
        if size > MEMORY_TO_ASK_FOR and size > (free := free_memory_bytes()):
            raise InputError(
                f"frames is {count}; {count} × {shape[1]} × {shape[0]} pixels need {size / 1e9:.3g} GB, but "
                f"{free / 1e9:.3g} GB are free; use ms.stream, or fewer frames and continue with first_frame."
            )

    def of(self, light: Photons, number: int | None = None) -> PreparedExposure:
        """Return this exposure with light of the window's shape. Raises InputError for impossible light.

        number : number of the first frame, if it changes.
        """
        if number is None:
            first = self.first
        else:
            first = replace(self.first, index=number, _blocks={})
        if light.detected and "photons" in self.keep:
            raise InputError(
                "keep names 'photons', but this light has only photoelectrons; keep 'photoelectrons', or render "
                "bands (spectral='cube')."
            )
        plan, stages = self.plan, self.stages
        detected: Detected | DetectedByKernel | None = None
        if self.count == 1 and plan is None and self.planner is None:
            detected = detected_by_kernel(light, detector_of(stages), first)
        if detected is None:
            detected = checked_and_detected(light, detector_of(stages), first)
            if self.planner is not None:
                plan = self.planner(self.camera, detected, on_numpy(first))
                stages = plan.stages
            elif plan is not None:
                plan.check(detected, first)
        return replace(self, light=detected, first=first, plan=plan, stages=stages)

    def frames(self, counted: bool | None = None) -> RawFrames:
        """All frames at once. Raises InputError for more than memory holds.

        counted : whether the clipped pixels of the first frame are counted. None: on NumPy, where that is cheap; a
            compiled kernel that also counts takes 1.4 times as long.
        """
        self.check_memory(self.count)
        kept = {name: np.empty((self.count, *self.first.window.shape)) for name in self.keep}
        kept["digital"] = np.empty((self.count, *self.first.window.shape), self._code_type)
        first, light = self.first.index, self.detected
        counts = None
        if counted or (counted is None and not self.first.window.backend.compiled):
            counts = Counter(dict.fromkeys(CLIPPED, 0))
        runner = FrameRunner(self.stages, light, self.first, counts, self.strips)
        done = runner.frames(
            first, self.count, lambda i: {name: x[i - first] for name, x in kept.items()}
        )
        for number, _ in enumerate(done, 1):
            if self.told is not None:
                self.told(number)
        digital: NDArray[Any] = kept.pop("digital")
        return RawFrames(
            digital, self.camera, light.photons, on_numpy(self.first), self.stages, light.delivered(),
            self.first.window.backend, self.plan, counts, **kept,
        )  # fmt: skip

    def stream(self) -> Iterator[NDArray[np.unsignedinteger]]:
        """Yield one frame at a time, shape (H, W) [DN]."""
        shape, code_type = self.first.window.shape, self._code_type
        runner = FrameRunner(self.stages, self.detected.now(), self.first, strips=self.strips)
        done = runner.frames(
            self.first.index, self.count, lambda _: {"digital": np.empty(shape, code_type)}
        )
        # popped, so that no delivered frame stays in memory
        return (sinks.pop("digital") for sinks in done)

    @property
    def notes(self) -> tuple[str, ...]:
        """Return the notes on this exposure, before any frame is computed."""
        return exposure_notes(self.camera, self.detected.now(), self.first)

    @property
    def detected(self) -> Detected | DetectedByKernel:
        """Return the mean photoelectrons of the light. Raises TypeError without light."""
        if self.light is None:
            raise TypeError("an exposure needs its light: prepare_exposure(…).of(photons)")
        return self.light

    @property
    def _code_type(self) -> np.dtype[np.unsignedinteger]:
        return np.min_scalar_type(converter_of(self.stages).highest)


def on_numpy(frame: Frame) -> Frame:
    """Return the frame on the NumPy backend of the same precision, which gives the same bytes."""
    if frame.window.backend is NUMPY_FLOAT64:
        return frame.on(NUMPY_FLOAT64)
    return frame.on(NUMPY_FLOAT32)


def exposure_of_photons(
    photons: Photons | ArrayLike, camera: Camera, exposure: Exposure, options: ExposeOptions
) -> PreparedExposure:
    """Return an exposure with its light: mean photons as for :func:`mitsuba_sensor.expose`. Raises InputError."""
    check_types(camera, exposure)
    chosen = complete(ExposeOptions, options)
    light = placed_photons(photons, camera, chosen)
    return prepare_exposure(camera, exposure, light.shape[:2], light.origin, chosen).of(light)


def placed_photons(
    photons: Photons | ArrayLike, camera: Camera, options: ExposeOptions
) -> Photons:
    """Return mean photons with their bands, at their place on the sensor. Raises InputError.

    Their values are checked when they are detected.
    """
    light = as_photons(photons, camera, options["wavelengths_nm"], check=False)
    return placed(light, options["origin"], camera)


def prepare_exposure(
    camera: Camera,
    exposure: Exposure,
    shape: tuple[int, ...],
    origin: tuple[int, int],
    chosen: ExposeOptions,
) -> PreparedExposure:
    """Check everything that does not depend on the light, and build the chain. Raises InputError.

    shape, origin : (rows, columns) of the window and its first pixel.  chosen : completed options.
    """
    check_types(camera, exposure)
    camera, plan = camera.at_gain(chosen["gain"]), chosen["plan"]
    keep = _checked_names(chosen["keep"])
    if camera.readouts:
        _check_options_of_readouts(camera, keep, chosen["maps"])
    seed, serial = first_given(chosen["seed"], 1), first_given(chosen["serial"], 1)
    first_frame, frames = chosen["first_frame"], chosen["frames"]
    check_numbers(frames, first_frame, seed)
    stages = _chain_of(camera, plan)
    if plan is not None and chosen["tolerance_dn"] is not None:
        raise InputError(
            f"tolerance_dn is {chosen['tolerance_dn']:g}, but the given plan has its own tolerance; pass only one."
        )
    precision = precision_of(chosen["precision"], camera)
    backend = choose_backend(chosen["engine"], precision, frames * shape[0] * shape[1])
    window = SensorWindow(serial, (shape[0], shape[1]), origin, camera=camera.name)
    given = checked_maps(chosen["maps"], window, camera)
    window = replace(window, given=given, backend=backend)
    first = Frame(exposure, window, seed, first_frame, camera.gain or "")
    return PreparedExposure(camera, stages, first, frames, keep, plan=plan)


# -- checks of options -------------------------------------------------------------------------------------------------


def _checked_names(keep: Any) -> tuple[str, ...]:
    """Return the names of the signals to keep. Raises InputError."""
    try:
        wanted = (keep,) if isinstance(keep, str) else tuple(keep)
    except TypeError:  # not iterable
        wanted = (keep,)
    for name in wanted:
        if not isinstance(name, str) or name not in KEEP:
            raise InputError(
                f"keep names {shown(name)}; the signals that can be kept are {', '.join(KEEP)}."
            )
    return wanted


def _chain_of(camera: Camera, plan: Plan | None) -> Chain:
    """Return the chain that the plan leaves of this camera, or the whole chain. Raises InputError."""
    if plan is None:
        return camera.stages
    if not hasattr(plan, "whole"):
        raise InputError(
            f"plan is {plan!r}; pass what plan(camera, exposure, photons) returns."
        )
    if plan.whole != camera.stages:
        raise InputError(
            f"plan was made for another camera, {plan.camera}; make a new one with plan(camera, …)."
        )
    return plan.stages


def _check_options_of_readouts(camera: Camera, keep: tuple[str, ...], maps: object) -> None:
    """Raise InputError for options that need a single readout, and for an added stage before the readouts.

    Such a stage would change the charge that the readouts share.
    """
    names = ", ".join(one.name for one in camera.readouts)
    alone = f"camera.at_readout({camera.readouts[0].name!r})"
    of = f"{camera.name} combines the readouts {names}"
    kept = [name for name in keep if name != "photons"]
    if kept:
        raise InputError(
            f"keep names {kept[0]!r}, but {of}, each with its own signals; expose one of them, {alone}."
        )
    if maps:
        raise InputError(f"maps belong to one readout, but {of}; omit them, or expose {alone}.")
    for stage in camera.added:
        if stage.domain in ("photons", "electrons"):
            raise InputError(
                f"{camera.name} has several readouts, and the added {type(stage).__name__} would change their shared "
                "charge; add only stages in volts, or remove the stage."
            )
