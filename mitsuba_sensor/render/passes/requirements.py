"""Requirements: which options a scene and camera need, measured on a render."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...camera.camera import Camera
from ...core import Exposure, Float64Array
from ..light.irradiance import Irradiance, is_exact
from ..light.photons import photons_per_irradiance


@dataclass(frozen=True)
class RenderRequirement:
    """An option of a render, whether it is needed, and its largest effect [DN]; None where that was not measured."""

    what: str
    kept: bool
    effect_dn: float | None
    reason: str


def render_requirements(
    light: Irradiance,
    camera: Camera,
    exposure: Exposure,
    k_dn_per_e: float,
    tolerance_dn: float,
) -> tuple[RenderRequirement, ...]:
    """Whether bands, depth of field and AOVs are needed, by a render of any quality and the overall system gain K."""
    why = "the render contains the channels of this camera's filters, and no bands"
    bands = RenderRequirement("colour channels", True, None, why)
    if not light.filters and is_exact(light, camera):
        why = "this camera's filters are rendered beside the bands: any number of them gives the same frame"
        bands = RenderRequirement(f"{len(light.wavelengths_nm)} bands", False, 0.0, why)
    elif not light.filters:
        bands = _bands(light, camera, exposure, k_dn_per_e, tolerance_dn)
    if (number := light.statistics.aperture_f_number) is None:
        why = "the scene's camera is a pinhole, which samples no lens"
        depth = RenderRequirement("depth of field", False, 0.0, why)
    else:
        why = f"the scene's thin lens is f/{number:.3g} on this sensor"
        depth = RenderRequirement("depth of field", True, None, why)
    return (
        bands,
        depth,
        RenderRequirement("AOVs", False, 0.0, "no depth, normals or albedo were asked for"),
    )


def _bands(
    light: Irradiance,
    camera: Camera,
    exposure: Exposure,
    k_dn_per_e: float,
    tolerance_dn: float,
) -> RenderRequirement:
    """The fewest equal groups of bands that change no pixel's mean signal by more than the tolerance.

    What the bands of a group change must not cancel, for another scene or frame has other spectra; nor may a full well
    hide it.
    """
    count, change = len(light.wavelengths_nm), 0.0
    for size in (s for s in range(count, 1, -1) if count % s == 0):
        change = k_dn_per_e * float(np.max(electrons_moved(light, camera, exposure, size)))
        if change <= tolerance_dn:
            reason = f"{count // size} are enough: --bandwidth-nm {float(np.sum(light.bandwidths_nm[:size])):g}"
            return RenderRequirement(f"{count} bands", False, change, reason)
    why = "fewer bands would change the image by more than the tolerance"
    return RenderRequirement(f"{count} bands", True, change, why)


def electrons_moved(
    light: Irradiance, camera: Camera, exposure: Exposure, size: int
) -> Float64Array:
    """Σ|E|·|Δ(QE·λ)| of every pixel, over the bands, where ``size`` neighbours become one, (H, W) [e-]."""
    widths = np.asarray(light.bandwidths_nm, dtype=np.float64)
    merged = (
        _per_irradiance(camera, exposure, *_groups(light, size))[
            :, np.arange(len(widths)) // size
        ]
        * widths
    )
    own = _per_irradiance(camera, exposure, widths, light.wavelengths_nm) * widths
    finite = np.where(np.isfinite(light.data), np.abs(light.data), 0.0)
    filters = camera.filter_index((finite.shape[0], finite.shape[1]), light.origin)
    return np.asarray(np.einsum("hwb,hwb->hw", finite, np.abs(merged - own)[filters]))


def _per_irradiance(
    camera: Camera, exposure: Exposure, widths_nm: Float64Array, centres_nm: Float64Array
) -> Float64Array:
    """Photoelectrons of 1 W m⁻² in each band, (F, B)."""
    photons = photons_per_irradiance(camera, exposure, centres_nm, np.ones(len(widths_nm)))
    return camera.qe(centres_nm, widths_nm) * photons


def _groups(light: Irradiance, size: int) -> tuple[Float64Array, Float64Array]:
    """Widths and centres of groups of ``size`` neighbouring bands."""
    widths = np.asarray(light.bandwidths_nm, dtype=np.float64)
    starts = np.arange(0, len(widths), size)
    grouped = np.add.reduceat(widths, starts)
    return grouped, np.add.reduceat(light.wavelengths_nm * widths, starts) / grouped
