"""Requirements: which options of the renderer a scene and camera need, measured on a render of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core import Exposure, Float64Array
from ..optics.f_number_law import transmittance
from ..sensor.camera import Camera
from .irradiance import Irradiance
from .photons import photons_per_irradiance


@dataclass(frozen=True)
class RenderRequirement:
    """An option of a render, whether it is needed, and its largest effect [DN]; None where that was not measured."""

    what: str
    kept: bool
    effect_dn: float | None
    reason: str


def render_requirements(
    light: Irradiance, camera: Camera, exposure: Exposure, k_dn_per_e: float, tolerance_dn: float
) -> tuple[RenderRequirement, ...]:
    """Whether bands, depth of field and AOVs are needed.

    light : a render of the scene, at any quality.  k_dn_per_e : the camera's overall gain.
    """
    if light.filters:
        why = "the render contains the channels of this camera's filters, and no bands"
        bands = RenderRequirement("colour channels", True, None, why)
    else:
        bands = _bands(light, camera, exposure, k_dn_per_e, tolerance_dn)
    if (number := light.statistics.aperture_f_number) is None:
        why = "the scene's camera is a pinhole, which samples no lens"
        depth = RenderRequirement("depth of field", False, 0.0, why)
    else:
        why = f"the scene's thin lens is f/{number:.3g} on this sensor"
        depth = RenderRequirement("depth of field", True, None, why)
    return bands, depth, RenderRequirement("AOVs", False, 0.0, "no depth, normals or albedo were asked for")


def _bands(
    light: Irradiance, camera: Camera, exposure: Exposure, k_dn_per_e: float, tolerance_dn: float
) -> RenderRequirement:
    """The fewest equal groups of bands that change no pixel's mean signal by more than the tolerance."""
    count = len(light.wavelengths_nm)
    full = camera.pixel.full_well_e
    reference = np.minimum(grouped_electrons(light, camera, exposure, 1), full)
    change = 0.0
    for size in (s for s in range(count, 1, -1) if count % s == 0):
        coarse = np.minimum(grouped_electrons(light, camera, exposure, size), full)
        change = k_dn_per_e * float(np.max(np.abs(coarse - reference)))
        if change <= tolerance_dn:
            reason = f"{count // size} are enough: --bandwidth-nm {float(np.sum(light.bandwidths_nm[:size])):g}"
            return RenderRequirement(f"{count} bands", False, change, reason)
    return RenderRequirement(
        f"{count} bands", True, change, "fewer bands would change the image by more than the tolerance"
    )


def grouped_electrons(light: Irradiance, camera: Camera, exposure: Exposure, size: int) -> Float64Array:
    """Mean photoelectrons of every pixel with ``size`` neighbouring bands merged into one, (H, W).

    The lens's transmission is that at the centre of the merged band, as in a render with such bands.
    """
    widths = np.asarray(light.bandwidths_nm, dtype=np.float64)
    starts = np.arange(0, len(widths), size)
    grouped = np.add.reduceat(widths, starts)
    centres = np.add.reduceat(light.wavelengths_nm * widths, starts) / grouped
    transmission = transmittance(camera, light.wavelengths_nm)
    safe = np.where(transmission > 0, transmission, 1.0)
    before_lens = np.where(transmission > 0, light.data / safe, 0.0)
    finite = np.where(np.isfinite(before_lens), before_lens, 0.0)
    data = np.add.reduceat(finite * widths, starts, axis=2) / grouped
    per_irradiance = photons_per_irradiance(camera, exposure, centres, grouped) * camera.qe(centres)
    per_irradiance = per_irradiance * transmittance(camera, centres)
    filters = camera.filter_index((data.shape[0], data.shape[1]), light.origin)
    return np.asarray(np.einsum("hwb,hwb->hw", data, per_irradiance[filters]))
