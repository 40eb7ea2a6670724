"""How digital numbers change with the light and with the camera: derivatives of frames whose values do not change."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.backend import NUMPY_FLOAT32
from ..core.checks import check_types
from ..core.differentiable import SLOTS, Differentiable
from ..core.errors import InputError
from ..core.exposure import Exposure
from ..core.frame import Frame
from ..core.sensor_window import SensorWindow
from ..core.signals import Photons
from .camera import Camera
from .chain import chain
from .checks import as_photons, check_numbers, checked_maps, checked_origin
from .field_derivatives import Recording
from .run import begin, choose_backend, run_chain

PHOTONS = "photons"
"""The name of the light among the parameters."""

BACKENDS = {"drjit": "llvm", "cuda": "cuda"}


@dataclass(frozen=True, eq=False)
class DifferentiableFrame:
    """One frame and its derivatives.

    digital : digital numbers as floats, in one long array of Dr.Jit (H·W), from which a loss is made.
    """

    digital: Any
    of: DifferentiableFrames = field(repr=False)
    backend: Differentiable = field(repr=False)

    def backward(self, loss: Any) -> dict[str, Any]:
        """d Σloss/d parameter: a number for a field, good to about six digits, and for the photons one each.

        loss : an array of Dr.Jit made from ``digital``. Leave it one element per pixel: it is added up here, and runs
            in one kernel with the frame. Where it needs all pixels first, as a variance does, :meth:`hold` the frame.
        """
        if not self.backend.dr.grad_enabled(loss):
            raise InputError("loss has no derivative; make it from this frame's digital, e.g. digital * 1.0.")
        found = self.backend.backward(loss)
        light = found.pop(PHOTONS, None)
        sums = self.backend.totals(found) if found else self.digital
        self.backend.dr.eval(self.digital, light, sums)
        totals = sums.numpy().reshape(SLOTS, -1).sum(axis=0, dtype=np.float64).tolist() if found else ()
        named = dict.fromkeys(self.of.parameters, 0.0) | dict(zip(found, totals, strict=False))
        return named if light is None else named | {PHOTONS: self._per_photon(light)}

    def forward(self, name: str) -> NDArray[np.float32]:
        """d DN/d parameter of every pixel, (H, W); for the photons, by a pixel's own, in their shape."""
        known = self.of.parameters
        if name not in known:
            raise InputError(f"name is {name!r}; it must be one of the parameters: {', '.join(known)}.")
        (found,) = self.backend.forward(name, self.digital)
        return self._per_photon(found) if name == PHOTONS else self._on_host(found)

    def store(self) -> None:
        """Compute the frame now and keep what was drawn for it, so that no derivative draws again."""
        self.backend.dr.eval(self.digital, self.backend.distributions)

    @property
    def codes(self) -> NDArray[np.float32]:
        """Digital numbers (H, W) [DN]."""
        return self._on_host(self.backend.dr.detach(self.digital))

    def _on_host(self, x: Any) -> NDArray[np.float32]:
        return self.backend.to_numpy(x, self.of.first.window)

    def _per_photon(self, per_electron: Any) -> NDArray[np.float32]:
        """A derivative by the mean electrons of light → by the photons of every band."""
        x, efficiency = self._on_host(per_electron), self.of.efficiency
        return x[..., None] * efficiency if efficiency.ndim == 3 else x * efficiency


@dataclass(frozen=True, eq=False)
class DifferentiableFrames:
    """Frames of one camera under one light, with derivatives by ``parameters``."""

    parameters: tuple[str, ...]
    light: Photons
    stages: tuple[Any, ...] = field(repr=False)
    first: Frame = field(repr=False)
    start: Any = field(repr=False)

    def frame(self, index: int = 0) -> DifferentiableFrame:
        """Frame ``index``, whose digital numbers are those of ``expose(engine="drjit", first_frame=index)``."""
        check_numbers(1, index, self.first.seed)
        backend, window = self.first.window.backend.renewed(self.first.window)  # type: ignore[attr-defined]
        start = self.start
        if PHOTONS in self.parameters:
            start = replace(start, light=backend.follow(start.light, {PHOTONS: 1.0}))
        digital = run_chain(self.stages[1:], start, replace(self.first, index=index, window=window, _blocks={}))
        return DifferentiableFrame(digital, self, backend)

    @cached_property
    def efficiency(self) -> NDArray[np.float32]:
        """Mean electrons (interactions, where there is a yield) per photon, in the shape of the photons."""
        frame, shape, bands = self.first.on(NUMPY_FLOAT32), self.light.mean.shape, self.light.wavelengths_nm
        if bands is None or len(shape) == 2:
            return self.stages[0](Photons(np.ones(shape), bands), frame).light
        ones = [Photons(np.ones((*shape[:2], 1)), np.array([nm])) for nm in bands]
        return np.stack([self.stages[0](one, frame).light for one in ones], axis=-1)


def differentiable(
    photons: Photons | ArrayLike,
    camera: Camera,
    exposure: Exposure,
    parameters: Iterable[str],
    *,
    seed: int = 1,
    serial: int = 1,
    wavelengths_nm: ArrayLike | None = None,
    origin: tuple[int, int] | None = None,
    maps: Mapping[str, ArrayLike] | None = None,
    engine: Literal["drjit", "cuda"] = "drjit",
) -> DifferentiableFrames:
    """Frames of :func:`expose` that know how their digital numbers change with some parameters.

    parameters : names of fields of the camera (``"readout.sense_gain_uv_per_e"``), ``"exposure.time_s"`` and
        ``"exposure.temperature_k"`` at the same photons, and ``"photons"`` for the mean photons of every pixel.
    The rest as for :func:`expose`. Derivatives of means and of variances come out right where the noise hides the steps
    of the converter: to 1 % if σ is ¾ DN or more; tests/sensor/test_gradient.py has a table.
    Raises InputError for what ``expose`` refuses, and for a parameter that has no derivative.
    """
    check_types(camera, exposure)
    names = (parameters,) if isinstance(parameters, str) else tuple(dict.fromkeys(parameters))
    light, stages = as_photons(photons, camera, wavelengths_nm), chain(camera)
    _check(names, engine, light, camera)
    check_numbers(1, 0, seed)
    first_pixel = checked_origin(light.origin if origin is None else origin)
    window = SensorWindow(serial, (light.mean.shape[0], light.mean.shape[1]), first_pixel)
    window = replace(window, given=checked_maps({} if maps is None else maps, stages, window, camera))
    first = Frame(exposure, window, seed)
    numbers = Recording.of(light, camera, first).by(tuple(name for name in names if name != PHOTONS))
    first = first.on(Differentiable(BACKENDS[engine], numbers))
    return DifferentiableFrames(names, light, stages, first, begin(stages, light, first))


def _check(names: tuple[str, ...], engine: str, light: Photons, camera: Camera) -> None:
    """Raise InputError for names or an engine that give no derivatives at all."""
    if not names:
        raise InputError("parameters is empty; name what to differentiate by, e.g. 'photons' or 'pixel.prnu'.")
    if engine not in BACKENDS:
        raise InputError(f"engine is {engine!r}; derivatives need a compiled one: drjit or cuda.")
    if light.detected:
        raise InputError("photons is in channels, which hold the QE already; render a cube (spectral='cube').")
    bands = light.mean.shape[2] if light.mean.ndim == 3 else 1
    if PHOTONS in names and bands > 1 and camera.quantum_efficiency.quantum_yield:
        raise InputError(
            f"parameters names {PHOTONS!r}, of {bands} bands, and this camera has a quantum yield; pass one band."
        )
    choose_backend(engine, "float32", 0)  # refuses one that is not on this machine
