"""What this scene and camera need of the renderer, measured on a render of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..engine.frame import Exposure
from .photons import photons_per_irradiance

if TYPE_CHECKING:
    from ..sensor.camera import Camera
    from .irradiance import Irradiance


@dataclass(frozen=True)
class Need:
    """One thing a render can have or leave out, with what it changes at most [DN]."""

    what: str
    kept: bool
    effect_dn: float
    reason: str


def render_needs(
    light: Irradiance, camera: Camera, exposure: Exposure, k_dn_per_e: float, tolerance_dn: float
) -> tuple[Need, ...]:
    """Bands, depth of field and ground truth: kept or left out.

    light : a render of the scene, at any quality.  k_dn_per_e : the camera's overall gain.
    """
    return (_bands(light, camera, exposure, k_dn_per_e, tolerance_dn), _depth_of_field(light), _GROUND_TRUTH)


_GROUND_TRUTH = Need("ground truth", False, 0.0, "no depth, normals or albedo were asked for")


def _depth_of_field(light: Irradiance) -> Need:
    number = light.certificate.aperture_f_number
    if number is None:
        return Need("depth of field", False, 0.0, "the scene's camera is a pinhole: no lens samples are drawn")
    return Need("depth of field", True, float("nan"), f"the scene's thin lens is f/{number:.3g} on this sensor")


def _bands(light: Irradiance, camera: Camera, exposure: Exposure, k_dn_per_e: float, tolerance_dn: float) -> Need:
    """The fewest equal groups of bands that move no pixel's mean signal by more than the tolerance."""
    count = len(light.wavelengths_nm)
    reference = _signal_dn(light, camera, exposure, 1) * k_dn_per_e
    fewest, effect = count, 0.0
    for size in (s for s in range(count, 1, -1) if count % s == 0 or s == count):
        moved = float(np.max(np.abs(_signal_dn(light, camera, exposure, size) * k_dn_per_e - reference)))
        if moved <= tolerance_dn:
            fewest, effect = -(-count // size), moved
            break
    if fewest == count:
        return Need(f"{count} bands", True, effect, "fewer bands would change the picture by more than the tolerance")
    return Need(f"{count} bands", False, effect, f"{fewest} do: --bandwidth-nm {_width(light, count // fewest):g}")


def _width(light: Irradiance, size: int) -> float:
    return float(np.sum(light.bandwidths_nm[:size]))


def _signal_dn(light: Irradiance, camera: Camera, exposure: Exposure, size: int) -> NDArray[Any]:
    """Mean light electrons of every pixel when ``size`` neighbouring bands are one, (H, W)."""
    widths = np.asarray(light.bandwidths_nm, dtype=np.float64)
    starts = np.arange(0, len(widths), size)
    grouped = np.add.reduceat(widths, starts)
    centres = np.add.reduceat(light.wavelengths_nm * widths, starts) / grouped
    finite = np.where(np.isfinite(light.data), light.data, 0.0)
    data = np.add.reduceat(finite * widths, starts, axis=2) / grouped
    per_irradiance = photons_per_irradiance(camera, exposure, centres, grouped) * camera.qe(centres)
    filters = camera.filter_index((data.shape[0], data.shape[1]))
    return np.asarray(np.einsum("hwb,hwb->hw", data, per_irradiance[filters]))
