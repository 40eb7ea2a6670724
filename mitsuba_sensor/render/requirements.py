"""What this scene and camera need of the renderer, measured on a render of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.exposure import Exposure
from ..optics.f_number_law import transmittance
from .photons import photons_per_irradiance

if TYPE_CHECKING:
    from ..sensor.camera import Camera
    from .irradiance import Irradiance


@dataclass(frozen=True)
class Requirement:
    """One thing a render can have or leave out, with what it changes at most [DN]; None where that was not measured."""

    what: str
    kept: bool
    effect_dn: float | None
    reason: str


def render_requirements(
    light: Irradiance, camera: Camera, exposure: Exposure, k_dn_per_e: float, tolerance_dn: float
) -> tuple[Requirement, ...]:
    """Bands, depth of field and ground truth: kept or left out.

    light : a render of the scene, at any quality.  k_dn_per_e : the camera's overall gain.
    """
    bands = _CHANNELS if light.filters else _bands(light, camera, exposure, k_dn_per_e, tolerance_dn)
    return (bands, _depth_of_field(light), _GROUND_TRUTH)


_CHANNELS = Requirement(
    "colour channels", True, None, "the render holds what this camera's filters detect, and no bands"
)
_GROUND_TRUTH = Requirement("ground truth", False, 0.0, "no depth, normals or albedo were asked for")


def _depth_of_field(light: Irradiance) -> Requirement:
    number = light.statistics.aperture_f_number
    if number is None:
        return Requirement("depth of field", False, 0.0, "the scene's camera is a pinhole: no lens samples are drawn")
    return Requirement("depth of field", True, None, f"the scene's thin lens is f/{number:.3g} on this sensor")


def _bands(
    light: Irradiance, camera: Camera, exposure: Exposure, k_dn_per_e: float, tolerance_dn: float
) -> Requirement:
    """The fewest equal groups of bands that move no pixel's mean signal by more than the tolerance."""
    count = len(light.wavelengths_nm)
    full = camera.pixel.full_well_e
    reference = np.minimum(grouped_electrons(light, camera, exposure, 1), full)
    moved = 0.0
    for size in (s for s in range(count, 1, -1) if count % s == 0):
        coarse = np.minimum(grouped_electrons(light, camera, exposure, size), full)
        moved = k_dn_per_e * float(np.max(np.abs(coarse - reference)))
        if moved <= tolerance_dn:
            reason = f"{count // size} do: --bandwidth-nm {_width(light, size):g}"
            return Requirement(f"{count} bands", False, moved, reason)
    return Requirement(f"{count} bands", True, moved, "fewer bands would change the picture by more than the tolerance")


def _width(light: Irradiance, size: int) -> float:
    return float(np.sum(light.bandwidths_nm[:size]))


def grouped_electrons(light: Irradiance, camera: Camera, exposure: Exposure, size: int) -> NDArray[Any]:
    """Mean light electrons of every pixel when ``size`` neighbouring bands are one, (H, W).

    The lens's transmission is then that of the middle of the coarser band, as a render with such bands has it.
    """
    widths = np.asarray(light.bandwidths_nm, dtype=np.float64)
    starts = np.arange(0, len(widths), size)
    grouped = np.add.reduceat(widths, starts)
    centres = np.add.reduceat(light.wavelengths_nm * widths, starts) / grouped
    through = transmittance(camera, light.wavelengths_nm)
    given = np.where(through > 0, light.data / np.where(through > 0, through, 1.0), 0.0)  # before the lens
    finite = np.where(np.isfinite(given), given, 0.0)
    data = np.add.reduceat(finite * widths, starts, axis=2) / grouped
    per_irradiance = photons_per_irradiance(camera, exposure, centres, grouped) * camera.qe(centres)
    per_irradiance = per_irradiance * transmittance(camera, centres)
    filters = camera.filter_index((data.shape[0], data.shape[1]), light.origin)
    return np.asarray(np.einsum("hwb,hwb->hw", data, per_irradiance[filters]))
