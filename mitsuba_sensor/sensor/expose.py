"""Mean photons per pixel → raw frames in digital numbers: an exposure is checked and prepared, then computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

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
from ..core.options import complete
from ..files.memory import free_memory_bytes
from ..stages.chain import whole_chain
from ..stages.stage import Chain, converter_of, detector_of
from .checks import (
    as_photons,
    check_compensation,
    check_numbers,
    checked_names,
)
from .choices import KEEP, PlannedChain, chain_of, precision_of
from .detection import Detected, checked_and_detected
from .frame_notes import exposure_notes
from .frames import RawFrames
from .map_checks import checked_maps
from .options import ExposeOptions
from .photon_checks import check_kept
from .placement import placed
from .readout_checks import check_options_of_readouts
from .run import FrameRunner, Observer, StripWindows, choose_backend, require_kept

Planner: TypeAlias = Callable[[Camera, Detected, Frame], PlannedChain]


@dataclass(frozen=True, eq=False)
class PreparedExposure:
    """Everything that an exposure needs but the light, checked: ``prepare_exposure(…).of(photons).frames()``.

    first : the first frame, whose window has the backend and the given FPN maps.  keep : names of signals to return.
    count : how many frames.  strips : of a sensor that keeps its maps.
    plan : what was left out of the chain.  planner : makes the plan for the light that the exposure gets.
    told : called with how many frames are done.
    """

    camera: Camera
    stages: Chain
    first: Frame
    count: int
    keep: tuple[str, ...]
    plan: PlannedChain | None = None
    planner: Planner | None = None
    light: Detected | None = None
    strips: StripWindows | None = None
    told: Callable[[int], object] | None = None

    def at(self, exposure: Exposure) -> PreparedExposure:
        """With another exposure."""
        return replace(self, first=replace(self.first, exposure=exposure, _blocks={}))

    def check_memory(self, count: int) -> None:
        """Raise InputError for so many frames that this machine has no memory for them."""
        shape = self.first.window.shape
        bytes_of_pixel = self._code_type.itemsize + 8 * len(self.keep)
        size, free = count * math.prod(shape) * bytes_of_pixel, free_memory_bytes()
        if size > free:
            raise InputError(
                f"frames is {count}, of {shape[1]} × {shape[0]} pixels each: {_gigabytes(size)}, and "
                f"{_gigabytes(free)} of memory are free; take them one by one from ms.stream, or fewer at a time: "
                "--first-frame (first_frame) goes on."
            )

    def of(self, light: Photons, number: int | None = None) -> PreparedExposure:
        """With this light, of the shape of the window. Raises InputError where its variance cannot be compensated.

        number : of the first frame, if it is another than before.
        """
        if number is None:
            first = self.first
        else:
            first = replace(self.first, index=number, _blocks={})
        check_kept(self.keep, light)
        once = self.count == 1 and self.plan is None and self.planner is None
        detected, plan = (
            checked_and_detected(light, detector_of(self.stages), first, once),
            self.plan,
        )
        if self.planner is not None:
            plan = self.planner(self.camera, detected, first)
        elif plan is not None:
            plan.check(detected, first)
        if plan is None:
            stages = self.stages
        else:
            stages = plan.stages
        check_compensation(light, stages, self.count)
        return replace(self, light=detected, first=first, plan=plan, stages=stages)

    def frames(self, observer: Observer | None = None) -> RawFrames:
        """All frames at once.  observer : sees the first one. Raises InputError for more than memory holds."""
        self.check_memory(self.count)
        kept = {name: np.empty((self.count, *self.first.window.shape)) for name in self.keep}
        kept["digital"] = np.empty((self.count, *self.first.window.shape), self._code_type)
        first = self.first.index
        light, runner = (
            self.detected,
            FrameRunner(self.stages, self.detected, self.first, observer, self.strips),
        )
        done = runner.frames(
            first, self.count, lambda i: {name: x[i - first] for name, x in kept.items()}
        )
        for number, _ in enumerate(done, 1):
            if self.told is not None:
                self.told(number)
        light.check()
        digital: NDArray[Any] = kept.pop("digital")
        backend = self.first.window.backend
        return RawFrames(
            digital,
            self.camera,
            light.photons,
            self.first_on_numpy,
            self.stages,
            light,
            backend,
            self.plan,
            **kept,
        )

    def stream(self) -> Iterator[NDArray[np.unsignedinteger]]:
        """One frame at a time."""
        shape, code_type = self.first.window.shape, self._code_type
        runner = FrameRunner(self.stages, self.detected.now(), self.first, strips=self.strips)
        done = runner.frames(
            self.first.index, self.count, lambda _: {"digital": np.empty(shape, code_type)}
        )
        return (
            sinks.pop("digital") for sinks in done
        )  # popped: nobody here keeps a frame that was delivered

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on this exposure, before any frame is computed."""
        return exposure_notes(self.camera, self.detected.now(), self.first)

    @property
    def detected(self) -> Detected:
        """Mean photoelectrons of the light. Raises TypeError before there is any."""
        if self.light is None:
            raise TypeError("an exposure needs its light: prepare_exposure(…).of(photons)")
        return self.light

    @property
    def _code_type(self) -> np.dtype[np.unsignedinteger]:
        return np.min_scalar_type(converter_of(self.stages).highest)

    @property
    def first_on_numpy(self) -> Frame:
        """The first frame on the NumPy backend of the same precision, which has the same bytes."""
        return on_numpy(self.first)


def on_numpy(frame: Frame) -> Frame:
    """A frame on the NumPy backend of the same precision, which has the same bytes."""
    if frame.window.backend is NUMPY_FLOAT64:
        return frame.on(NUMPY_FLOAT64)
    return frame.on(NUMPY_FLOAT32)


def _gigabytes(size: float) -> str:
    """A number of bytes, for people."""
    return f"{size / 1e9:.3g} GB"


def exposure_of_photons(
    photons: Photons | ArrayLike, camera: Camera, exposure: Exposure, options: ExposeOptions
) -> PreparedExposure:
    """An exposure with its light: mean photons as of :func:`mitsuba_sensor.expose`. Raises InputError."""
    check_types(camera, exposure)
    light = placed_photons(photons, camera, options)
    return prepare_exposure(camera, exposure, light.shape[:2], light.origin, options).of(light)


def placed_photons(
    photons: Photons | ArrayLike, camera: Camera, options: ExposeOptions
) -> Photons:
    """Mean photons with their bands, at their place on the sensor. Raises InputError."""
    light = as_photons(
        photons, camera, options.get("wavelengths_nm"), check=False
    )  # where it is detected
    return placed(light, options.get("origin"), camera)


def prepare_exposure(
    camera: Camera,
    exposure: Exposure,
    shape: tuple[int, ...],
    origin: tuple[int, int],
    options: ExposeOptions,
) -> PreparedExposure:
    """Check all that does not depend on the light, and build the chain.

    shape, origin : (rows, columns) of the window and its first pixel.  Raises InputError.
    """
    check_types(camera, exposure)
    chosen = complete(ExposeOptions, options)
    camera = camera.at_gain(chosen["gain"])
    if camera.readouts:
        check_options_of_readouts(camera, chosen)
    seed, serial = first_given(chosen["seed"], 1), first_given(chosen["serial"], 1)
    first_frame, frames = chosen["first_frame"], chosen["frames"]
    check_numbers(frames, first_frame, seed)
    keep = checked_names(chosen["keep"], KEEP)
    require_kept(keep, KEEP)
    stages = chain_of(camera, chosen["plan"])
    precision = precision_of(chosen["precision"], camera, chosen["plan"])
    backend = choose_backend(chosen["engine"], precision, frames * shape[0] * shape[1])
    window = SensorWindow(serial, (shape[0], shape[1]), origin, camera=camera.name)
    named = whole_chain(camera)  # also maps of what is left out
    maps = {} if chosen["maps"] is None else chosen["maps"]
    given = checked_maps(maps, named, window, camera)
    window = replace(window, given=given, backend=backend)
    first = Frame(exposure, window, seed, first_frame, camera.gain or "")
    return PreparedExposure(camera, stages, first, frames, keep, plan=chosen["plan"])
