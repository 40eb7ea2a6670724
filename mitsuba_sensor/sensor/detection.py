"""Detect the photons of a window: mean photoelectrons, computed once for all frames, report, theory and plan."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from ..core import Array, Electrons, Frame, InputError, Photons
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, aligned_float32
from ..core.signals import LAYERS, Filters
from ..core.types import Float64Array
from ..stages.effects.shot_noise import LEFT
from ..stages.image_lag import BEFORE
from ..stages.stage import Detector
from .checks import check_light, first_place
from .run import Strip, row_strips_of
from .threads import for_each

if TYPE_CHECKING:
    from ..core.drjit_backend import DrJitBackend  # imports Dr.Jit


@dataclass(frozen=True, eq=False)
class Detected:
    """Light on a window.

    photons : the mean photons as given.
    signal : mean photoelectrons (:class:`Electrons`) on NumPy, shape (H, W).
    """

    photons: Photons
    signal: Array

    @property
    def mean_e(self) -> Float64Array:
        """Return the mean photoelectrons, shape (H, W), float64; photons if the chain begins with them."""
        if isinstance(self.signal, Electrons):
            signal = self.signal.light
        else:
            signal = self.signal
        return np.asarray(signal, dtype=np.float64)

    def crop_rows(self, rows: slice) -> Detected:
        """Return the light of these rows."""
        photons = self.photons.crop_rows(rows)
        if not isinstance(self.signal, Electrons):
            return Detected(photons, self.signal[rows])
        return Detected(photons, self.signal.mapped(lambda values: values[rows]))

    def on_backend(self, rows: slice, frame: Frame) -> Array:
        """Return the signal of these rows as arrays of a compiled backend.  frame : the frame of these rows."""
        return uploaded(self.crop_rows(rows).signal, frame)

    def now(self) -> Detected:
        """Return this light."""
        return self

    delivered = now


@dataclass(frozen=True, eq=False)
class DetectedByKernel:
    """Light that the kernel of a single frame detects along with computing the frame.

    photons : mean photons, unchecked: the kernel marks negative photons and NaN, for :meth:`delivered`.
    filters : the filters of the stage in this light.
    found : photoelectrons and faulty pixels of each strip, by its first row.
    """

    photons: Photons
    stage: Detector
    frame: Frame
    filters: Filters
    found: dict[int, tuple[Array, Array]] = field(default_factory=dict)

    def on_backend(self, rows: slice, frame: Frame) -> Array:
        """Trace the photoelectrons of these rows; they are computed with the rest of the frame."""
        photons, backend = self.photons.crop_rows(rows), _compiled(frame)
        layers = np.atleast_3d(photons.mean)
        light = backend.filtered(layers, self.filters, frame.window)
        faulty = backend.faulty(layers)
        backend.schedule(light, faulty)
        self.found[rows.start] = light, faulty
        return Electrons(light)

    def now(self) -> Detected:
        """Return the light, detected by the host."""
        return checked_and_detected(self.photons, self.stage, self.frame)

    def delivered(self) -> Detected:
        """Return the light that the kernel detected. Raises InputError for photons that are NaN or negative."""
        backend = _compiled(self.frame)
        strips = [self.found[row] for row in sorted(self.found)]
        if any(backend.any(faulty) for _, faulty in strips):
            check_light(self.photons)
        signal = np.concatenate([light.numpy() for light, _ in strips])
        return Detected(self.photons, Electrons(signal.reshape(self.frame.window.shape)))


def detected_by_kernel(
    photons: Photons, stage: Detector, frame: Frame
) -> DetectedByKernel | None:
    """Return light that the kernel of one frame detects; None if the host must detect it."""
    if not frame.window.backend.compiled or photons.by_readout is not None:
        return None
    filters = stage.filters(photons)
    return None if filters is None else DetectedByKernel(photons, stage, frame, filters)


def checked_and_detected(photons: Photons, stage: Detector, frame: Frame) -> Detected:
    """Return the light of :func:`detect`. Raises InputError for photons that are NaN or negative."""
    for one in (photons, *(photons.by_readout or {}).values()):
        check_light(one)
    return detect(photons, stage, frame)


def _compiled(frame: Frame) -> DrJitBackend:
    return cast("DrJitBackend", frame.window.backend)


def uploaded(signal: Electrons, frame: Frame) -> Array:
    """Return electrons as arrays of the frame's backend."""
    window = frame.window
    return signal.mapped(lambda values: window.backend.from_numpy(values, window))


def detect(photons: Photons, stage: Detector, frame: Frame) -> Detected:
    """Return the light of all exposures of a frame, in the precision of its backend.

    photons : mean photons of the window of ``frame``.  stage : the first stage of the chain.
    """
    given = dict(photons.by_readout or {})
    of_lag = {BEFORE: given.pop(BEFORE)} if BEFORE in given else None
    own = photons.changed(by_readout=of_lag)
    signal = _detect(own, stage, frame)
    if not given and not stage.other_photodiodes:
        return Detected(photons, signal)
    others = {name: _detect(one, stage, frame) for name, one in given.items()}
    for name, exposure_ratio, detection in stage.other_photodiodes:
        others[name] = _detect(given.get(name, own), detection, frame)
        if name not in given and exposure_ratio != 1:
            others[name] = replace(others[name], light=exposure_ratio * others[name].light)
    if isinstance(signal, Electrons) and LEFT in others:
        share = _left_share(others.pop(LEFT).light, signal.light)
        signal = replace(signal, left_share=share)
    return Detected(photons, replace(signal, by_readout=others or None))


def _left_share(left_e: Array, whole_e: Array) -> Array:
    """Return the fraction of the mean photoelectrons in the left photodiodes, shape (H, W); 0.5 for unlit pixels.

    Raises InputError for a fraction above 1, beyond rounding in float32.
    """
    too_many = left_e > 1.001 * whole_e + 1e-4 * np.max(whole_e, initial=0)
    if too_many.any():
        raise InputError(
            "photons.by_readout['left'] exceeds the photons of both photodiodes in "
            f"{int(too_many.sum())} place(s), first at {first_place(too_many)}; give at most the light of the whole "
            "pupil."
        )
    lit = np.isfinite(whole_e) & (whole_e > 0)
    share = np.full(np.shape(whole_e), 0.5, np.asarray(whole_e).dtype)
    np.divide(left_e, whole_e, out=share, where=lit)
    return np.clip(share, 0.0, 1.0)


def _detect(photons: Photons, stage: Detector, frame: Frame) -> Array:
    """Return the signal after the first stage, computed strip by strip."""
    backend = NUMPY_FLOAT64 if frame.window.backend.precision == "float64" else NUMPY_FLOAT32
    whole, shape = frame.on(backend), frame.window.shape
    found: dict[str, Array] = {}

    def layers(rows: slice) -> dict[str, Array]:
        strip = Strip.of(rows, stage.light_reach_px, shape[0])
        part = replace(whole, window=whole.window.crop_rows(strip.around), _blocks={})
        signal = stage.sample(photons.crop_rows(strip.around), part)
        values = {"": signal}
        if isinstance(signal, Electrons):
            values = {name: getattr(signal, name) for name in LAYERS}
        return {name: x[strip.inside] if np.ndim(x) else x for name, x in values.items()}

    def write(rows: slice) -> None:
        for name, values in layers(rows).items():
            if np.ndim(values):
                found[name][rows] = values

    first, *others = row_strips_of(shape, backend.strip_pixels)
    for name, values in layers(first).items():
        if np.ndim(values) == 0:
            found[name] = values
        else:
            found[name] = (
                aligned_float32(shape)
                if values.dtype == np.float32
                else np.empty(shape, values.dtype)
            )
            found[name][first] = values
    for_each(write, others)
    return found[""] if "" in found else Electrons(**found)
