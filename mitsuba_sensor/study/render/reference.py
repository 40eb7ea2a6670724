"""The references: the same scene with many more samples, and the standard error that they still have.

Irradiance is held against bands that are exact each for itself ("cube"), electrons against bands whose sum is exact
("auto"), channels against channels: bands of finite width have an error of their own, which is told apart.
"""

from __future__ import annotations

import base64
import io
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow
from ...core.signals import Photons
from ...render.photons import photons_per_irradiance
from ...render.stop_criterion import StopCriterion
from ...sensor.chain import chain, mean_dark_e
from .series import Banding, Layers, Opened, Setting, Subject

if TYPE_CHECKING:
    from ...sensor.camera import Camera

REFERENCE_S = 15.0
"""Seconds that each reference may take, as its first passes tell."""
FEWEST_PASSES = 8
"""Of a reference: its variance is the spread of its passes, averaged over all pixels."""
SAMPLES, SAMPLES_OF_FOUR = 256, 64
"""Per pass, of all bands together and of four at a time: large passes have less noise (benchmarks/render_passes.py)."""
SEED = 0
"""Of the references; runs have 1, 2, …"""
DARKEST = 0.1
"""Of the mean: errors of darker pixels are relative to this level, or a few pixels in the dark would be all of it."""
STEP = 0.01
"""Relative step of the light by which the slope of the digital numbers is found."""


@dataclass(frozen=True, eq=False)
class Scale:
    """What errors are relative to, and where.

    seen : pixels with light and below full well, (H, W).  level : light of a pixel over their mean, (H, W); darker ones
    count as DARKEST.  mean_e : of their electrons.  bands : (B,) means of their irradiance.
    """

    seen: NDArray[np.bool_]
    level: NDArray[np.float64]
    mean_e: float
    bands: NDArray[np.float64]

    def of_electrons(self, squares: NDArray[np.float64]) -> float:
        """Mean of squared electrons (H, W), each relative to its pixel's light."""
        return float(np.mean(squares[self.seen] / (self.mean_e * self.level[self.seen]) ** 2))

    def of_irradiance(self, squares: NDArray[np.float64]) -> float:
        """Mean of squared irradiance (H, W, B), each relative to its pixel's light and its band's."""
        lit = self.bands > 0
        return float(np.mean(squares[self.seen][:, lit] / (self.level[self.seen][:, None] * self.bands[lit]) ** 2))

    def of_dn(self, squares: NDArray[np.float64]) -> float:
        """Mean of squared digital numbers (H, W) [DN²]."""
        return float(np.mean(squares[self.seen]))


def scale_of(subject: Subject, electrons: NDArray[np.float64], irradiance: NDArray[np.float64]) -> Scale:
    """The scale of this light; where all of it is above full well, of all."""
    dark = mean_dark_e(subject.camera, subject.exposure)
    seen = (electrons > 0) & (electrons + dark < subject.camera.pixel.full_well_e)
    seen = seen if seen.any() else electrons > 0
    mean_e = float(electrons[seen].mean())
    return Scale(seen, np.maximum(electrons / mean_e, DARKEST), mean_e, irradiance[seen].mean(axis=0))


@dataclass(frozen=True, eq=False)
class Truth:
    """What a setting is held against.

    irradiance : (H, W, B) [W m⁻² nm⁻¹].  electrons : (H, W).  variance_e2 : of these [e-²].
    photons : the light of the electrons.  mean_dn : (H, W).  scale : what errors are relative to.
    """

    irradiance: NDArray[np.float64]
    electrons: NDArray[np.float64]
    variance_e2: NDArray[np.float64]
    photons: Photons
    mean_dn: NDArray[np.float64]
    scale: Scale


def reference(subject: Subject, setting: Setting, scale: Scale | None = None) -> dict[str, Any]:
    """Render a reference: what the journal keeps of it.

    scale : what errors are relative to; by default as this reference itself has it.
    ``irradiance``, ``electrons`` and ``dn`` are its squared standard errors on that scale.
    """
    grouped = setting.banding == "cube"
    opened = subject.ready(replace(setting, samples=SAMPLES_OF_FOUR if grouped else SAMPLES))
    passes, seconds = _rendered(opened, grouped)
    renderer = opened.job.renderer
    irradiance = np.concatenate([strip.bands.mean for strip in renderer.strips])
    variance = np.concatenate([strip.bands.variance_of_mean for strip in renderer.strips])
    electrons, variance_e2 = renderer.electrons()
    if not electrons.any():
        raise InputError("the scene is black for this camera; give it an emitter with a spectrum in the camera's band.")
    slope = _dn_per_electron(subject, photons_of(subject, opened.layers, irradiance, electrons), electrons)
    scale = scale or scale_of(subject, electrons, irradiance)
    return {
        "passes": passes,
        "samples_per_pixel": renderer.samples_per_pixel,
        "seconds": seconds,
        "irradiance": scale.of_irradiance(variance),
        "electrons": scale.of_electrons(variance_e2),
        "dn": scale.of_dn(slope**2 * variance_e2),
        "layers": opened.layers.to_dict(),
        "arrays": _packed({"irradiance": irradiance, "electrons": electrons, "variance_e2": variance_e2}),
    }


def _rendered(opened: Opened, grouped: bool) -> tuple[int, float]:
    """Passes that were rendered within the time, and what they took."""
    renderer = opened.job.renderer

    def timed(passes: int) -> float:
        began = time.perf_counter()
        renderer.run(SEED, StopCriterion(passes, opened.samples, grouped=grouped), lambda step: None)
        return time.perf_counter() - began

    timed(1)  # compiles
    passes = max(math.ceil(REFERENCE_S / timed(1)), FEWEST_PASSES)
    return passes, timed(passes)


def truth_of(subject: Subject, entries: Mapping[str, dict[str, Any]], banding: Banding) -> Truth:
    """What a banding is held against. entries : the references, by banding."""
    of_electrons, of_bands = sources(entries, banding)
    arrays, irradiance = _unpacked(of_electrons["arrays"]), _unpacked(of_bands["arrays"])["irradiance"]
    electrons = arrays["electrons"]
    photons = photons_of(subject, Layers.from_dict(of_electrons["layers"]), arrays["irradiance"], electrons)
    return Truth(
        irradiance=irradiance,
        electrons=electrons,
        variance_e2=arrays["variance_e2"],
        photons=photons,
        mean_dn=mean_and_variance_dn2(photons, subject.camera, subject.exposure)[0],
        scale=scale_of(subject, electrons, arrays["irradiance"]),
    )


def sources(entries: Mapping[str, dict[str, Any]], banding: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The references that a banding's electrons and its irradiance are held against."""
    if banding == "channels":
        return entries["channels"], entries["channels"]
    return entries["auto"], entries.get("cube", entries["auto"])


def reference_photons(subject: Subject, entry: Mapping[str, Any]) -> Photons:
    """The light of a reference, for :func:`sensor.expose.expose`."""
    arrays = _unpacked(entry["arrays"])
    return photons_of(subject, Layers.from_dict(entry["layers"]), arrays["irradiance"], arrays["electrons"])


def difference(one: Mapping[str, Any], other: Mapping[str, Any]) -> tuple[float, float]:
    """Relative difference of the mean electrons of two references, and its standard error."""
    first, second = _unpacked(one["arrays"]), _unpacked(other["arrays"])
    mean = second["electrons"].mean()
    variance = sum(arrays["variance_e2"].sum() for arrays in (first, second)) / second["electrons"].size ** 2
    return float((first["electrons"].mean() - mean) / mean), float(math.sqrt(variance) / mean)


def photons_of(subject: Subject, layers: Layers, irradiance: NDArray[Any] | None, electrons: NDArray[Any]) -> Photons:
    """The light as :func:`render.photons.collect` has it; of channels each pixel's own electrons, behind any filter."""
    centres = np.array(layers.wavelengths_nm)
    if layers.detected or irradiance is None:
        mean = np.repeat(electrons[..., None], centres.size, axis=-1)
        return Photons(mean, centres, detected=True, origin=layers.origin)
    factor = photons_per_irradiance(subject.camera, subject.exposure, centres, np.array(layers.bandwidths_nm))
    return Photons(irradiance * factor, centres, origin=layers.origin)


def mean_and_variance_dn2(
    photons: Photons, camera: Camera, exposure: Exposure
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean [DN] and temporal variance [DN²] of every pixel, (H, W) each, from the moments of the whole chain."""
    shape = photons.mean.shape[0], photons.mean.shape[1]
    moments = Moments(photons, 0.0, 0.0, Frame(exposure, SensorWindow(0, shape, photons.origin)))
    for stage in chain(camera):
        moments = stage.moments(moments)
    return np.broadcast_to(moments.mean, shape), np.broadcast_to(moments.temporal, shape)


def electrons_of(photons: Photons, subject: Subject) -> NDArray[np.float64]:
    """Mean light electrons that every pixel detects, (H, W)."""
    shape = photons.mean.shape[0], photons.mean.shape[1]
    detection = chain(subject.camera)[0]
    return np.asarray(detection(photons, Frame(subject.exposure, SensorWindow(0, shape, photons.origin))).light)


def _dn_per_electron(subject: Subject, photons: Photons, electrons: NDArray[Any]) -> NDArray[np.float64]:
    """Slope of the mean digital number, (H, W); 0 in the dark and where it is clipped."""
    steps = (replace(photons, mean=photons.mean * (1 + step)) for step in (STEP, -STEP))
    more, less = (mean_and_variance_dn2(light, subject.camera, subject.exposure)[0] for light in steps)
    return np.asarray((more - less) / (2 * STEP * np.maximum(electrons, np.finfo(float).tiny)) * (electrons > 0))


def _packed(arrays: dict[str, NDArray[Any]]) -> str:
    """Arrays as text, float32: what is left of their error is a thousand times larger."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{name: array.astype(np.float32) for name, array in arrays.items()})
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _unpacked(text: str) -> dict[str, NDArray[np.float64]]:
    with np.load(io.BytesIO(base64.b64decode(text))) as found:
        return {name: found[name].astype(np.float64) for name in found.files}
