"""Requirements: which options a scene and camera need, measured on a render; a scene without some of its features."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...camera.camera import Camera
from ...core import Exposure, Float64Array
from ..light.irradiance import Irradiance, is_exact
from ..light.photons import photons_per_irradiance
from ..lint.lint import WRAPPERS
from ..scene.parsed_scene import ParsedScene
from ..variants import mitsuba
from .prepared import PreparedRender
from .renderer import Renderer

WITH_DEPTH = (
    "path",
    "volpath",
    "volpathmis",
    "prb",
    "prb_basic",
    "prb_projective",
    "prbvolpath",
)
"""Integrators of Mitsuba whose ``max_depth`` cuts off indirect light."""
PASSED = (
    "max_depth",
    "hide_emitters",
)  # what an integrator without indirect light takes from the scene's own
STOPPED_DOWN = (
    1e-6  # of the scene's aperture: what is left of it. Mitsuba refuses an aperture of 0
)


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


def grouped_electrons(
    light: Irradiance, camera: Camera, exposure: Exposure, size: int
) -> Float64Array:
    """Mean photoelectrons of every pixel with ``size`` neighbouring bands merged into one, (H, W)."""
    finite = np.where(np.isfinite(light.data), light.data, 0.0) * light.bandwidths_nm
    data = np.add.reduceat(finite, np.arange(0, finite.shape[2], size), axis=2)
    per_irradiance = _per_irradiance(camera, exposure, *_groups(light, size))
    filters = camera.filter_index((data.shape[0], data.shape[1]), light.origin)
    return np.asarray(np.einsum("hwb,hwb->hw", data, per_irradiance[filters]))


def without_depth_of_field(loaded: PreparedRender) -> PreparedRender:
    """The same, its thin lens stopped down to a point; the scene that was loaded is changed."""
    parameters = mitsuba().traverse(loaded.at_rest.sensor)
    parameters["aperture_radius"] = parameters["aperture_radius"] * STOPPED_DOWN
    parameters.update()
    return loaded


def without_indirect_light(loaded: PreparedRender) -> PreparedRender:
    """The same with the integrator of :func:`direct_integrator`, which must not be None."""
    scene = replace(
        loaded.at_rest, integrator=mitsuba().load_dict(direct_integrator(loaded.parsed))
    )
    return replace(
        loaded,
        scene=scene,
        renderer=Renderer(scene, loaded.camera, loaded.exposure, loaded.bands),
    )


def direct_integrator(scene: ParsedScene) -> dict[str, Any] | None:
    """The scene's integrator without indirect light, in Mitsuba's terms; None where it has no more to lose."""
    name, given = "path", dict[str, Any]()
    for _, node in scene.children(scene.root, "Integrator"):
        nested: list[Any] = [node]
        while nested:
            node, name = nested[0], nested[0].props.plugin_name()
            given = {key: node.props[key] for key in node.props if key in PASSED}
            nested = (
                [one for _, one in scene.children(node.props, "Integrator")]
                if name in WRAPPERS
                else []
            )
    if name in WRAPPERS:
        name, given = "path", {}
    if name not in WITH_DEPTH or 0 <= given.get("max_depth", -1) <= 2:
        return None
    return {"type": name, **given, "max_depth": 2}
