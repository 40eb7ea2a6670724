"""Derivatives of digital numbers by the photons, the exposure and the numbers of a camera (Dr.Jit)."""

from __future__ import annotations

import warnings
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
from ..core.backend import NUMPY_FLOAT32
from ..core.code_slope import LARGEST_DN, LEAST_DN
from ..core.differentiable import SLOTS, DifferentiableBackend
from ..core.errors import shown
from ..core.options import complete, documents
from ..sensor.checks import as_photons, check_numbers
from ..sensor.choices import check_law
from ..sensor.detection import Detected, detect, uploaded
from ..sensor.map_checks import checked_maps
from ..sensor.options import GradientOptions
from ..sensor.placement import placed
from ..sensor.run import begin, choose_backend, row_strips_of
from ..stages.chain import chain, whole_chain
from ..stages.stage import Chain, sample
from ..stages.usual_range import warn_of_temperature
from ..theory.response import least_noise_dn
from .conditional_slope import ConditionalSlope
from .field_derivatives import Recording

PHOTONS = "photons"
"""The name of the mean photons among the parameters."""

BACKENDS = {"drjit": "llvm", "cuda": "cuda"}


@dataclass(frozen=True, eq=False)
class DifferentiableFrame:
    """One frame and its derivatives.

    digital : digital numbers as floats, one Dr.Jit array (H·W), to compute a loss from.
    """

    digital: Array
    of: DifferentiableFrames = field(repr=False)
    backend: DifferentiableBackend = field(repr=False)

    def backward(self, loss: Array) -> dict[str, Array]:
        """d Σloss/d parameter: a number for a field, to about six digits, and for the photons one per pixel and band.

        loss : a Dr.Jit array computed from ``digital``, best with one element per pixel: it is summed here, in one
            kernel with the frame. If it needs all pixels first, as a variance does, call :meth:`store` before.
        """
        if not self.backend.dr.grad_enabled(loss):
            raise InputError(
                "loss has no derivative; compute it from this frame's digital, e.g. digital * 1.0."
            )
        found = self.backend.backward(loss)
        light = found.pop(PHOTONS, None)
        sums = self.backend.totals(found) if found else self.digital
        self.backend.dr.eval(self.digital, light, sums)
        totals = (
            sums.numpy().reshape(SLOTS, -1).sum(axis=0, dtype=np.float64).tolist()
            if found
            else ()
        )
        named = dict.fromkeys(self.of.parameters, 0.0) | dict(zip(found, totals, strict=False))
        return named if light is None else named | {PHOTONS: self._per_photon(light)}

    def forward(self, name: str) -> Float32Array:
        """d DN/d parameter of every pixel, (H, W); for ``"photons"`` by those of the same pixel, in their shape."""
        known = self.of.parameters
        if name not in known:
            raise InputError(
                f"name is {name!r}; it must be one of the parameters: {', '.join(known)}."
            )
        (found,) = self.backend.forward(name, self.digital)
        return self._per_photon(found) if name == PHOTONS else self._to_numpy(found)

    def store(self) -> None:
        """Compute the frame now and keep its random numbers, so that no derivative computes them again."""
        self.backend.dr.eval(self.digital, self.backend.random_numbers)

    @property
    def codes(self) -> Float32Array:
        """Digital numbers (H, W) [DN]."""
        return self._to_numpy(self.backend.dr.detach(self.digital))

    def _to_numpy(self, x: Array) -> Float32Array:
        values: Float32Array = self.backend.to_numpy(x, self.of.first.window)
        return values

    def _per_photon(self, per_electron: Array) -> Float32Array:
        """A derivative by the mean photoelectrons → by the photons of every band."""
        x, efficiency = self._to_numpy(per_electron), self.of.efficiency
        return x[..., None] * efficiency if efficiency.ndim == 3 else x * efficiency


@dataclass(frozen=True, eq=False)
class DifferentiableFrames:
    """Frames of one camera and one array of photons, with derivatives by ``parameters``.

    slope : of the expected code, where the noise does not hide the steps of the converter.
    """

    parameters: tuple[str, ...]
    light: Photons
    stages: Chain = field(repr=False)
    first: Frame = field(repr=False)
    detected: Detected = field(repr=False)
    slope: ConditionalSlope | None = field(repr=False)

    def frame(self, index: int = 0) -> DifferentiableFrame:
        """Frame ``index``, whose digital numbers are those of ``expose(engine="drjit", first_frame=index)``."""
        check_numbers(1, index, self.first.seed)
        start = self._start
        backend, window = _backend_of(self.first).renewed(self.first.window)
        if PHOTONS in self.parameters:
            start = replace(start, light=backend.with_slopes(start.light, {PHOTONS: 1.0}))
        frame = replace(self.first, index=index, window=window, _blocks={})
        digital = (
            self.slope.sample(start, frame)
            if self.slope
            else sample(self.stages[1:], start, frame)
        )
        return DifferentiableFrame(digital, self, backend)

    def backward(
        self, loss: Callable[[Array, slice], Array], index: int = 0
    ) -> dict[str, Array]:
        """d Σloss/d parameter of frame ``index``, in strips of rows: for windows that do not fit into memory at once.

        loss : takes ``digital`` of a strip, a Dr.Jit array, and its rows, a slice; returns the loss of its pixels.
        """
        found: dict[str, Array] = dict.fromkeys(self.parameters, 0.0)
        if PHOTONS in found:
            found[PHOTONS] = np.empty(self.light.mean.shape, dtype=np.float32)
        for rows, strip in self.strips():
            frame = strip.frame(index)
            for name, part in frame.backward(loss(frame.digital, rows)).items():
                if name == PHOTONS:
                    found[name][rows] = part
                else:
                    found[name] += part
        return found

    def strips(self) -> Iterator[tuple[slice, DifferentiableFrames]]:
        """The rows of every strip, and its frames; the whole window where it is one strip."""
        shape = self.first.window.shape
        strips = list(row_strips_of(shape, self.first.window.backend.strip_pixels))
        for rows in strips:
            yield rows, self if len(strips) == 1 else self.crop_rows(rows)

    def crop_rows(self, rows: slice) -> DifferentiableFrames:
        """The same frames of these rows of the window."""
        window = replace(
            self.first.window.crop_rows(rows), backend=_backend_of(self.first).unused()
        )
        light, detected = self.light.crop_rows(rows), self.detected.crop_rows(rows)
        return replace(
            self,
            light=light,
            detected=detected,
            first=replace(self.first, window=window, _blocks={}),
        )

    @cached_property
    def _start(self) -> Electrons:
        """Mean photoelectrons in the memory of the backend; the FPN maps are computed too."""
        found: Electrons = begin(
            self.stages, uploaded(self.detected.signal, self.first), self.first
        )
        return found

    @cached_property
    def efficiency(self) -> Float32Array:
        """Mean electrons (interactions, where there is a yield) per photon, in the shape of the photons."""
        frame, shape, bands = (
            self.first.on(NUMPY_FLOAT32),
            self.light.mean.shape,
            self.light.wavelengths_nm,
        )
        if bands is None or len(shape) == 2:
            light: Float32Array = (
                self.stages[0].sample(Photons(np.ones(shape), bands), frame).light
            )
            return light
        one = replace(self.light, mean=np.ones((*shape[:2], 1)), variance_e2=None)
        widths = (
            [None] * len(bands) if one.bandwidths_nm is None else one.bandwidths_nm[:, None]
        )
        ones = [
            replace(one, wavelengths_nm=bands[[k]], bandwidths_nm=width)
            for k, width in enumerate(widths)
        ]
        return np.stack([self.stages[0].sample(one, frame).light for one in ones], axis=-1)


def _names_of(parameters: object) -> tuple[str, ...]:
    """Names of what is differentiated by, one or several, each once. Raises InputError."""
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
    """Frames of :func:`expose` with the derivatives of their digital numbers by some parameters.

    ::

        frames = ms.differentiable(photons, camera, exposure, ("photons", "pixel.prnu"))
        frame = frames.frame()
        gradients = frame.backward(frame.digital**2)  # name → derivative of the sum

    parameters : names of fields of the camera (``"readout.sense_gain_uv_per_e"``), ``"exposure.time_s"`` and
        ``"exposure.temperature_k"`` at the same photons, and ``"photons"`` for the mean photons of every pixel.
    The rest as for :func:`expose`. The mean of a derivative over frames is the derivative of the expected code, to 1 %,
    at clips and code edges too. That of a squared error is off at a clip if the noise is 1 to 2 DN (docs/backends.md).
    Raises InputError for what ``expose`` refuses, and for a parameter that has no derivative.
    """
    camera = camera_of(camera)
    check_types(camera, exposure)
    warn_of_temperature(exposure.temperature_k)
    chosen = complete(GradientOptions, options)
    camera = camera.at_gain(chosen["gain"])
    names = _names_of(parameters)
    refuse_readouts(camera, "derivatives are those of one read-out")
    light, stages = as_photons(photons, camera, chosen["wavelengths_nm"]), chain(camera)
    _check(names, light, camera)
    _check_derivatives(stages)
    check_law(stages, "derivatives of the expected code are", "compute differences of frames")
    choose_backend(chosen["engine"], "float32", 0)  # refuses one that is not on this machine
    check_numbers(1, 0, seed)
    light = placed(light, chosen["origin"], camera)
    shape = light.mean.shape[0], light.mean.shape[1]
    window = SensorWindow(serial, shape, light.origin, camera=camera.name)
    window = replace(
        window, given=checked_maps(chosen["maps"] or {}, whole_chain(camera), window, camera)
    )
    first = Frame(exposure, window, seed, gain=camera.gain or "")
    numbers = Recording.of(light, camera, first).by(
        tuple(name for name in names if name != PHOTONS)
    )
    first = first.on(DifferentiableBackend(BACKENDS[chosen["engine"]], numbers))
    return DifferentiableFrames(
        names, light, stages, first, detect(light, stages[0], first), _slope(stages, first)
    )


def _slope(stages: Chain, first: Frame) -> ConditionalSlope | None:
    """None where the noise behind the count hides the steps of the converter."""
    slope = ConditionalSlope.of(stages)
    sigma = least_noise_dn(stages, first)
    if sigma < LEAST_DN:
        warnings.warn(
            f"the noise behind the count is {sigma:.2g} DN; derivatives by numbers behind the count (gains, offsets, "
            f"the ADC) are those of noise of {LEAST_DN} DN. {_of_light(slope)}",
            stacklevel=4,
        )
    return slope if sigma < LARGEST_DN else None


def _of_light(slope: ConditionalSlope) -> str:
    return (
        "Those by the light are exact."
        if slope.count
        else "Without shot noise so are those by the light."
    )


def _backend_of(frame: Frame) -> DifferentiableBackend:
    assert isinstance(frame.window.backend, DifferentiableBackend)
    return frame.window.backend


def _check_derivatives(stages: Chain) -> None:
    """Raise InputError for a stage whose random numbers depend on the signal in a way that has no derivatives here."""
    for stage in stages:
        if not stage.has_derivatives:
            raise InputError(
                f"{stage.label} of this camera has no derivatives; compute differences of frames, or {stage.no_noise}."
            )


def _check(names: tuple[str, ...], light: Photons, camera: Camera) -> None:
    """Raise InputError for parameters or photons that have no derivatives."""
    if not names:
        raise InputError(
            "parameters is empty; name what to differentiate by, e.g. 'photons' or 'pixel.prnu'."
        )
    if light.detected:
        raise InputError(
            "photons is in channels, to which the QE is applied already; render a cube (spectral='cube')."
        )
    if PHOTONS in names and chain(camera)[0].light_reach_px:
        raise InputError(
            f"parameters names {PHOTONS!r}, and crosstalk of {camera.name} gives them to neighbours, too; "
            "differentiate by fields of the camera, or unset quantum_efficiency.crosstalk, crosstalk_from, "
            "crosstalk_pairs and diffusion_um."
        )
    if PHOTONS in names and camera.quantum_efficiency.image_lag and light.by_readout:
        raise InputError(
            f"parameters names {PHOTONS!r}, and a part of these stays for the next frame; differentiate by fields of "
            "the camera, or pass photons.changed(by_readout=None)."
        )
    bands = light.mean.shape[2] if light.mean.ndim == 3 else 1
    if PHOTONS in names and bands > 1 and camera.quantum_efficiency.quantum_yield:
        raise InputError(
            f"parameters names {PHOTONS!r}, of {bands} bands, and this camera has a quantum yield; pass one band."
        )
