"""Derivatives of digital numbers by photons, exposure and camera fields (Dr.Jit)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from ..camera.camera import Camera
from ..camera.camera_file import AnyCamera, camera_of
from ..camera.figures import refuse_readouts
from ..core import (
    Array,
    Electrons,
    Exposure,
    Float32Array,
    Frame,
    InputError,
    Photons,
    SensorWindow,
    check_types,
)
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from ..core.drjit_backend import DrJitBackend
from ..core.errors import shown
from ..core.options import complete, documents
from ..sensor.checks import as_photons, check_numbers, placed
from ..sensor.detection import Detected, detect, uploaded
from ..sensor.fpn_maps import checked_maps
from ..sensor.options import GradientOptions
from ..sensor.run import begin, choose_backend, row_strips_of
from ..stages.chain import chain
from ..stages.stage import Chain, detector_of, sample
from ..stages.usual_range import warn_of_temperature
from .law_slopes import Slopes, mean_and_variance, slopes_by_light, slopes_by_names
from .parameters import Parameters

PHOTONS = "photons"
"""Name of the mean photons among the parameters."""

BACKENDS = {"drjit": "llvm", "cuda": "cuda"}


@dataclass(frozen=True, eq=False)
class DifferentiableFrame:
    """A frame and its derivatives.

    digital : digital numbers as floats, a Dr.Jit array of shape (H·W,), for computing a loss.
    """

    digital: Array
    of: DifferentiableFrames = field(repr=False)
    backend: DrJitBackend = field(repr=False)

    def backward(self, loss: Array) -> dict[str, Array]:
        """Return d Σloss/d parameter: a number for a field; for photons, one per pixel and band.

        loss : a Dr.Jit array computed from ``digital``, preferably one element per pixel; it is summed here. If it
            needs all pixels first, as a variance does, call :meth:`store` before.
        """
        dr = self.backend.dr
        if not dr.grad_enabled(loss):
            raise InputError(
                "loss has no derivative; compute it from this frame's digital, e.g. digital * 1.0."
            )
        dr.backward(loss)
        weights = self._to_numpy(dr.grad(self.digital)).astype(np.float64)
        dr.clear_grad(self.digital)
        gradients: dict[str, Array] = {}
        for name in self.of.parameters:
            slope = weights * self._slope(name)
            gradients[name] = self._per_photon(slope) if name == PHOTONS else float(slope.sum())
        return gradients

    def forward(self, name: str) -> Float32Array:
        """Return d DN/d parameter of every pixel, shape (H, W); for ``"photons"`` of the same pixel, in their shape."""
        names = self.of.parameters
        if name not in names:
            raise InputError(
                f"name is {shown(name)}; it must be one of the parameters: {', '.join(names)}."
            )
        slope = self._slope(name)
        return self._per_photon(slope) if name == PHOTONS else np.asarray(slope, np.float32)

    def store(self) -> None:
        """Compute and keep the frame, so a loss does not compute it again."""
        self.backend.dr.eval(self.digital)

    @cached_property
    def codes(self) -> Float32Array:
        """Digital numbers, shape (H, W) [DN]."""
        return self._to_numpy(self.backend.dr.detach(self.digital))

    def _slope(self, name: str) -> Array:
        slopes = self.of.slopes
        slope = slopes.by_light if name == PHOTONS else slopes.by_name[name]
        assert slope is not None
        return slopes.of_code(slope, self.codes)

    def _to_numpy(self, x: Array) -> Float32Array:
        values: Float32Array = self.backend.to_numpy(x, self.of.first.window)
        return values

    def _per_photon(self, per_electron: Array) -> Float32Array:
        """Convert a derivative by mean photoelectrons to derivatives by the photons of every band."""
        x, efficiency = per_electron.astype(np.float32), self.of.efficiency
        per_photon = x[..., None] * efficiency if efficiency.ndim == 3 else x * efficiency
        return np.asarray(per_photon, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class DifferentiableFrames:
    """Frames of a camera and an array of photons, with derivatives by ``parameters``."""

    parameters: tuple[str, ...]
    camera: Camera = field(repr=False)
    light: Photons
    stages: Chain = field(repr=False)
    first: Frame = field(repr=False)
    detected: Detected = field(repr=False)

    def frame(self, index: int = 0) -> DifferentiableFrame:
        """Return frame ``index``, with the digital numbers of ``expose(engine="drjit", first_frame=index)``."""
        check_numbers(1, index, self.first.seed)
        backend = cast(DrJitBackend, self.first.window.backend)
        codes = sample(
            self.stages[1:], self._start, replace(self.first, index=index, _blocks={})
        )
        digital = backend.float(codes)
        backend.dr.enable_grad(digital)
        return DifferentiableFrame(digital, self, backend)

    def backward(
        self, loss: Callable[[Array, slice], Array], index: int = 0
    ) -> dict[str, Array]:
        """Return d Σloss/d parameter of frame ``index``, in row strips, for windows larger than the memory.

        loss : takes ``digital`` of a strip, a Dr.Jit array, and its rows, a slice; returns the loss of its pixels.
        """
        gradients: dict[str, Array] = dict.fromkeys(self.parameters, 0.0)
        if PHOTONS in gradients:
            gradients[PHOTONS] = np.empty(self.light.mean.shape, dtype=np.float32)
        for rows, strip in self.strips():
            frame = strip.frame(index)
            for name, gradient in frame.backward(loss(frame.digital, rows)).items():
                if name == PHOTONS:
                    gradients[name][rows] = gradient
                else:
                    gradients[name] += gradient
        return gradients

    def strips(self) -> Iterator[tuple[slice, DifferentiableFrames]]:
        """Yield the rows and the frames of every strip; a small window is a single strip."""
        shape = self.first.window.shape
        strips = list(row_strips_of(shape, self.first.window.backend.strip_pixels))
        for rows in strips:
            yield rows, self if len(strips) == 1 else self.crop_rows(rows)

    def crop_rows(self, rows: slice) -> DifferentiableFrames:
        """Return the frames of these rows of the window."""
        first = replace(self.first, window=self.first.window.crop_rows(rows), _blocks={})
        return replace(
            self, light=self.light.crop_rows(rows), detected=self.detected.crop_rows(rows), first=first
        )  # fmt: skip

    @cached_property
    def slopes(self) -> Slopes:
        """Mean and variance of every pixel's code, with derivatives by the parameters."""
        frame = self.first.on(NUMPY_FLOAT64)

        def light_of(camera: Camera, exposure: Exposure) -> Electrons:
            lit = replace(frame, exposure=exposure, _blocks={})
            signal: Electrons = detect(self.light, detector_of(camera.stages), lit).signal
            return signal

        light, names = self.detected.signal, [x for x in self.parameters if x != PHOTONS]
        by_light = None
        if PHOTONS in self.parameters:
            by_light = slopes_by_light(mean_and_variance, self.stages, light, frame)
        by_name = slopes_by_names(mean_and_variance, light_of, self.camera, frame, names)
        return Slopes(mean_and_variance(self.stages, light, frame), by_light, by_name)

    @cached_property
    def _start(self) -> Electrons:
        """Mean photoelectrons in the memory of the backend; also computes the FPN maps."""
        light = uploaded(self.detected.signal, self.first)
        signal: Electrons = begin(self.stages, light, self.first)
        return signal

    @cached_property
    def efficiency(self) -> Float32Array:
        """Mean electrons per photon (interactions, with a quantum yield), in the shape of the photons."""
        shape, bands = self.light.mean.shape, self.light.wavelengths_nm
        frame, detector = self.first.on(NUMPY_FLOAT32), self.stages[0]
        if bands is None or len(shape) == 2:
            light: Float32Array = detector.sample(Photons(np.ones(shape), bands), frame).light
            return light
        layer = self.light.changed(mean=np.ones((*shape[:2], 1)))
        widths = layer.bandwidths_nm
        layers = (
            replace(
                layer,
                wavelengths_nm=bands[[k]],
                bandwidths_nm=None if widths is None else widths[[k]],
            )
            for k in range(len(bands))
        )
        return np.stack([detector.sample(photons, frame).light for photons in layers], axis=-1)


def _names_of(parameters: object) -> tuple[str, ...]:
    """Return the names of one or several parameters, each once. Raises InputError."""
    names = (parameters,)
    if isinstance(parameters, list | tuple | set | frozenset | Mapping):
        names = tuple(parameters)
    for name in names:
        if not isinstance(name, str):
            raise InputError(
                f"parameters is {shown(parameters)}; pass names of fields, e.g. 'pixel.prnu', 'exposure.time_s' or "
                "'photons'."
            )
    return tuple(dict.fromkeys(cast(tuple[str, ...], names)))


@documents(GradientOptions)
def differentiable(
    photons: Photons | ArrayLike,
    camera: AnyCamera,
    exposure: Exposure,
    parameters: Iterable[str],
    *,
    seed: int = 1,
    serial: int = 1,
    **options: Unpack[GradientOptions],
) -> DifferentiableFrames:
    """Return frames of :func:`expose` with derivatives of their digital numbers by ``parameters``.

    ::

        frames = ms.differentiable(photons, camera, exposure, ("photons", "pixel.prnu"))
        frame = frames.frame()
        gradients = frame.backward(frame.digital**2)  # name → derivative of the sum

    parameters : names of camera fields (``"readout.sense_gain_uv_per_e"``), ``"exposure.time_s"`` and
        ``"exposure.temperature_k"`` at constant photons, and ``"photons"`` for the mean photons of every pixel.
    Other arguments as for :func:`expose`. The mean of a derivative over frames is the derivative of the expected code
    to 1 %, also at clips and code edges. The derivative of a squared error is biased at a clip if the noise is 1 to
    2 DN (docs/accuracy-and-limits.md).
    Raises InputError like ``expose``, and for a parameter without derivative.
    """
    camera = camera_of(camera)
    check_types(camera, exposure)
    warn_of_temperature(exposure.temperature_k)
    chosen = complete(GradientOptions, options)
    camera = camera.at_gain(chosen["gain"])
    names = _names_of(parameters)
    refuse_readouts(camera, "derivatives need a single readout")
    light, stages = as_photons(photons, camera, chosen["wavelengths_nm"]), chain(camera)
    _check(names, light, camera)
    choose_backend(chosen["engine"], "float32", 0)  # rejects a missing engine
    check_numbers(1, 0, seed)
    light = placed(light, chosen["origin"], camera)
    shape = light.mean.shape[0], light.mean.shape[1]
    window = SensorWindow(serial, shape, light.origin, camera=camera.name)
    window = replace(window, given=checked_maps(chosen["maps"], window, camera))
    first = Frame(exposure, window, seed, gain=camera.gain or "")
    for name in names:
        if name != PHOTONS:  # rejects fields without derivative
            Parameters(camera, exposure).derivative(name, lambda *_: np.zeros(1))
    detected = detect(light, detector_of(stages), first)
    first = first.on(DrJitBackend(BACKENDS[chosen["engine"]], differentiable=True))
    return DifferentiableFrames(names, camera, light, stages, first, detected)


def _check(names: tuple[str, ...], light: Photons, camera: Camera) -> None:
    """Raise InputError for parameters or photons without derivatives."""
    if not names:
        raise InputError(
            "parameters is empty; give at least one name, e.g. 'photons' or 'pixel.prnu'."
        )
    if light.detected:
        raise InputError(
            "photons already include the QE; render photons in bands with spectral='cube'."
        )
    coupling = [stage.label for stage in chain(camera) if stage.reach_px]
    if PHOTONS in names and coupling:
        raise InputError(
            f"{PHOTONS!r} has no derivative for {camera.name}, because {coupling[0]} couples neighbouring pixels; use "
            "camera fields, or the camera without this stage."
        )
    if PHOTONS in names and detector_of(chain(camera)).light_reach_px:
        raise InputError(
            f"{PHOTONS!r} has no derivative for {camera.name}, because crosstalk spreads light to neighbouring pixels; "
            "use camera fields, or unset quantum_efficiency.crosstalk (_from, _pairs) and diffusion_um."
        )
    if PHOTONS in names and camera.quantum_efficiency.image_lag and light.by_readout:
        raise InputError(
            f"{PHOTONS!r} has no derivative with light of a previous frame (image lag); use camera fields, or pass "
            "photons.changed(by_readout=None)."
        )
    bands = light.mean.shape[2] if light.mean.ndim == 3 else 1
    if PHOTONS in names and bands > 1 and camera.quantum_efficiency.quantum_yield:
        raise InputError(
            f"{PHOTONS!r} has {bands} bands, but a camera with quantum yield needs a single band; pass one band."
        )
