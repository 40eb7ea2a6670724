"""expose(): mean photons per pixel → raw frames in digital numbers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import Exposure, Frame, InputError, Photons, SensorWindow, check_types, first_given
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend
from ..core.options import complete, documents
from .camera import Camera
from .checks import (
    as_photons,
    check_chip,
    check_compensation,
    check_numbers,
    check_reference_shape,
    checked_maps,
    checked_names,
    placed,
)
from .choices import KEEP, KEPT_BY_PUBLISHED, chain_of, precision_of, tolerance_of
from .detection import Detected, checked_and_detected
from .frame_theory import FrameTheory
from .metering import AskedExposure, Light
from .noise_budget import NoiseBudget
from .options import ExposeOptions
from .pixel_moments import PixelMoments, pixel_moments
from .plan import Plan, plan_for
from .report import FrameObserver, report
from .run import FrameRunner, StripWindows, choose_backend, require_kept
from .stage import Chain, converter_of


@dataclass(frozen=True, eq=False)
class Frames:
    """Raw frames of one camera.

    digital : (N, H, W) uint8, uint16 or uint32, whichever holds ``adc.bits`` [DN].
    plan : what was left out of the chain, where ``plan`` or ``tolerance_dn`` was given.
    detected : mean photoelectrons of the light.  backend : what computed the frames.
    photons, photoelectrons, dark_electrons, electrons, volts : (N, H, W) float64 if asked for by ``keep``, else None.
    """

    digital: NDArray[np.unsignedinteger]
    camera: Camera
    light: Photons
    first: Frame
    stages: Chain
    detected: Detected
    backend: Backend
    plan: Plan | None = None
    photons: NDArray[np.float64] | None = None
    photoelectrons: NDArray[np.float64] | None = None
    dark_electrons: NDArray[np.float64] | None = None
    electrons: NDArray[np.float64] | None = None
    volts: NDArray[np.float64] | None = None

    @cached_property
    def theory(self) -> FrameTheory:
        """Theory of every pixel of these frames."""
        return self._observer.theory

    @cached_property
    def pixel_moments(self) -> PixelMoments:
        """``clean[0]`` and ``temporal_variance``, by the theory of every pixel with the FPN maps of this serial."""
        return pixel_moments(self.stages, self.detected, self.first)

    @cached_property
    def clean(self) -> NDArray[np.float32]:
        """Expectation of the raw frame over temporal noise, fixed patterns of this serial included, (1, H, W) [DN].

        Of frames with renders of their own (N, H, W). Not rounded. Raises InputError for chain konnik2014.
        """
        return self.pixel_moments.mean[None]

    @property
    def temporal_variance(self) -> NDArray[np.float32]:
        """Variance of every pixel from frame to frame in the light of the first, (H, W) [DN²]."""
        return self.pixel_moments.temporal

    @cached_property
    def spatial_mean(self) -> NDArray[np.float32]:
        """Expectation over temporal noise and over all cameras of this model, (H, W) [DN]: no fixed pattern."""
        return self.theory.digital_mean()

    @cached_property
    def report(self) -> dict[str, Any]:
        """Theory and sample of every stage in the first frame, ready for JSON (see report.py)."""
        self._observer.sample(self.first.window.backend)
        return report(self.camera, self._observer)

    @cached_property
    def _observer(self) -> FrameObserver:
        """Who saw the first frame; it is computed again unless :meth:`PreparedExposure.frames_with_report` made it."""
        observer = FrameObserver(FrameTheory(self.stages, self.detected, self.first))
        first = self.first.on(self.backend)
        PreparedExposure(self.camera, self.stages, first, 1, (), light=self.detected).frames(observer)
        return observer

    def minus(self, reference: Frames) -> NDArray[np.int64]:
        """Signed difference to a zero-exposure frame or a stack of as many, (N, H, W) [DN]: the paper's CDS.

        Fixed patterns cancel, temporal variances add (√2 in σ for equal frames), and nothing wraps below zero.
        Raises InputError when the frames do not fit, or are of another camera, serial number or part of the sensor.
        """
        if not isinstance(reference, Frames):
            raise InputError(f"the reference is a {type(reference).__name__}; pass the Frames of a zero exposure.")
        check_reference_shape(self.digital.shape, reference.digital.shape)
        check_chip((self.camera, self.first.window), (reference.camera, reference.first.window))
        return self.digital.astype(np.int64) - reference.digital.astype(np.int64)

    def preview(self, number: int = 0, gain: float = 1.0) -> NDArray[np.uint8]:
        """What frame.png shows: one of the frames, 8 bit, (H, W) grey or (H, W, 3) sRGB.  gain : brightens it."""
        from ..io.frame_files import preview_of

        return preview_of(self, number, gain)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write frame.tiff, frame.png and frame.json: all, or none; those of older frames go. Raises InputError."""
        from ..io.frame_files import save_frames

        save_frames(self, folder)

    def _repr_html_(self) -> str:
        from ..io.frame_files import frames_html

        return frames_html(self)

    def noise_budget(self) -> NoiseBudget:
        """What every source contributes to each pixel of the first frame, in DN; the sum is the frame."""
        theory = FrameTheory(self.stages, self.detected, self.first)
        return NoiseBudget(self.stages, self.detected, self.first, theory)


@documents(ExposeOptions)
def expose(
    photons: Photons | ArrayLike | Light,
    camera: Camera | None = None,
    exposure: AskedExposure | None = None,
    **options: Unpack[ExposeOptions],
) -> Frames:
    """Raw frames that ``camera`` delivers for these mean photons per pixel.

    photons : what :func:`collect` returns, or an array: a scalar (the whole sensor), (H, W), or (H, W, B) with
        ``wavelengths_nm`` of length B. Or the Irradiance itself, which is collected: then camera, exposure and serial
        number are by default those that it was rendered for, and the exposure may be "auto" (metered).
    Raises InputError for NaN or negative photons, naming how many there are and where the first one is.
    """
    return prepared(photons, camera, exposure, options).frames()


@documents(ExposeOptions)
def stream(
    photons: Photons | ArrayLike | Light,
    camera: Camera | None = None,
    exposure: AskedExposure | None = None,
    **options: Unpack[ExposeOptions],
) -> Iterator[NDArray[np.unsignedinteger]]:
    """The frames of :func:`expose` one at a time, each (H, W) [DN]: for more of them than memory holds.

    Everything is checked at once; light and maps are made with the first frame that is asked for.
    """
    return prepared(photons, camera, exposure, options).stream()


@dataclass(frozen=True, eq=False)
class PreparedExposure:
    """Everything that an exposure needs but the light, checked: ``prepare_exposure(…).of(photons).frames()``.

    first : the first frame, whose window has the backend and the given FPN maps.  keep : names of signals to return.
    count : how many frames.  strips : of a sensor that keeps its maps.
    told : called with how many frames are done.
    """

    camera: Camera
    stages: Chain
    first: Frame
    count: int
    keep: tuple[str, ...]
    plan: Plan | None = None
    tolerance_dn: float | None = None
    light: Detected | None = None
    strips: StripWindows | None = None
    told: Callable[[int], object] | None = None

    def at(self, exposure: Exposure) -> PreparedExposure:
        """With another exposure."""
        return replace(self, first=replace(self.first, exposure=exposure, _blocks={}))

    def of(self, light: Photons, number: int | None = None) -> PreparedExposure:
        """With this light, of the shape of the window. Raises InputError where its variance cannot be compensated.

        number : of the first frame, if it is another than before.
        """
        first = self.first if number is None else replace(self.first, index=number, _blocks={})
        once = self.count == 1 and self.plan is None and self.tolerance_dn is None
        detected, plan = checked_and_detected(light, self.stages[0], first, once), self.plan
        if self.tolerance_dn is not None:
            plan = plan_for(self.camera, detected, first, self.tolerance_dn)
        elif plan is not None:
            plan.check(detected, first)
        stages = self.stages if plan is None else plan.stages
        check_compensation(light, stages, self.count)
        return replace(self, light=detected, first=first, plan=plan, stages=stages)

    def frames(self, observer: FrameObserver | None = None) -> Frames:
        """All frames at once.  observer : sees the first one."""
        kept = {name: np.empty((self.count, *self.first.window.shape)) for name in self.keep}
        kept["digital"] = np.empty((self.count, *self.first.window.shape), self._code_type)
        first = self.first.index
        light, runner = self._light, FrameRunner(self.stages, self._light, self.first, observer, self.strips)
        done = runner.frames(first, self.count, lambda i: {name: x[i - first] for name, x in kept.items()})
        for number, _ in enumerate(done, 1):
            if self.told is not None:
                self.told(number)
        light.check()
        digital: NDArray[Any] = kept.pop("digital")
        backend = self.first.window.backend
        return Frames(
            digital, self.camera, light.photons, self._on_numpy, self.stages, light, backend, self.plan, **kept
        )

    def frames_with_report(self) -> Frames:
        """The same, with the report of the first frame made along with it: each frame is computed once."""
        observer = FrameObserver(FrameTheory(self.stages, self._light, self._on_numpy))
        frames = self.frames(observer)
        vars(frames)["_observer"] = observer
        return frames

    def stream(self) -> Iterator[NDArray[np.unsignedinteger]]:
        """One frame at a time."""
        shape, code_type = self.first.window.shape, self._code_type
        runner = FrameRunner(self.stages, self._light.now(), self.first, strips=self.strips)
        done = runner.frames(self.first.index, self.count, lambda _: {"digital": np.empty(shape, code_type)})
        return (sinks.pop("digital") for sinks in done)  # popped: nobody here keeps a frame that was delivered

    @property
    def _light(self) -> Detected:
        if self.light is None:
            raise TypeError("an exposure needs its light: prepare_exposure(…).of(photons)")
        return self.light

    @property
    def _code_type(self) -> np.dtype[np.unsignedinteger]:
        return np.min_scalar_type(converter_of(self.stages).highest)

    @property
    def _on_numpy(self) -> Frame:
        """The first frame on the NumPy backend of the same precision, which has the same bytes."""
        return self.first.on(NUMPY_FLOAT64 if self.first.window.backend is NUMPY_FLOAT64 else NUMPY_FLOAT32)


def prepared(
    photons: Any, camera: Camera | None, exposure: AskedExposure | None, options: ExposeOptions
) -> PreparedExposure:
    """An exposure with its light. Raises InputError."""
    if hasattr(photons, "collected"):
        photons, camera, exposure, serial = photons.collected(camera, exposure, options.get("serial"))
        options = {**options, "serial": serial}
    check_types(camera, exposure)
    assert camera is not None and isinstance(exposure, Exposure)
    light = as_photons(photons, camera, options.get("wavelengths_nm"), check=False)  # where it is detected
    light = placed(light, options.get("origin"), camera)
    return prepare_exposure(camera, exposure, light.mean.shape[:2], light.origin, options).of(light)


def prepare_exposure(
    camera: Camera, exposure: Exposure, shape: tuple[int, ...], origin: tuple[int, int], options: ExposeOptions
) -> PreparedExposure:
    """Check all that does not depend on the light, and build the chain.

    shape, origin : (rows, columns) of the window and its first pixel.  Raises InputError.
    """
    check_types(camera, exposure)
    chosen = complete(ExposeOptions, options)
    seed, serial = first_given(chosen["seed"], 1), first_given(chosen["serial"], 1)
    first_frame, frames = chosen["first_frame"], chosen["frames"]
    check_numbers(frames, first_frame, seed)
    keep = checked_names(chosen["keep"], KEEP)
    require_kept(keep, KEEP if chosen["chain"] == "physical" else KEPT_BY_PUBLISHED)
    stages = chain_of(camera, chosen["plan"], chosen["chain"])
    precision = precision_of(chosen["precision"], camera, chosen["plan"], chosen["chain"])
    backend = choose_backend(chosen["engine"], precision, frames * shape[0] * shape[1])
    window = SensorWindow(serial, (shape[0], shape[1]), origin)
    named = camera.stages if chosen["plan"] else stages  # a map of a stage that is left out is known, too
    given = checked_maps({} if chosen["maps"] is None else chosen["maps"], named, window, camera)
    window = replace(window, given=given, backend=backend)
    first = Frame(exposure, window, seed, first_frame)
    return PreparedExposure(camera, stages, first, frames, keep, plan=chosen["plan"], tolerance_dn=tolerance_of(chosen))
