"""What a render of a scene has that could be left out, and the scene loaded without it."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ...core.exposure import Exposure
from ...render.irradiance import Job, RenderOptions, prepare
from ...render.lint import WRAPPERS
from ...render.renderer import Renderer
from ...render.scene_file import parse_scene
from ...render.variants import mitsuba

if TYPE_CHECKING:
    from ...sensor.camera import Camera

WITH_DEPTH = ("path", "volpath", "volpathmis")
"""Integrators of Mitsuba whose ``max_depth`` cuts off the light that comes by way of other surfaces."""

PASSED = ("max_depth", "hide_emitters")
"""What an integrator without indirect light takes from the scene's own."""

CLOSED = 1e-6
"""Of the scene's aperture: what is left of it. Mitsuba refuses an aperture of 0."""

FLAT_TO_MM = 1e6
"""To this image height a lens without fall-off is as bright as on its axis: beyond any sensor."""

CHANNELS, FALL_OFF, INDIRECT, APERTURE = (
    "channels instead of bands",
    "lens fall-off",
    "indirect light",
    "depth of field",
)
DISTORTION, TRANSMISSION, PRESCRIPTION = "lens distortion", "lens transmission curve", "lens prescription"
ERROR_BARS, TRUTH = "error bars", "ground truth"


@dataclass(frozen=True, eq=False)
class Subject:
    """The scene, camera and exposure that are studied. wish : other words of :func:`render.irradiance.render`."""

    scene: str | os.PathLike[str]
    camera: Camera
    exposure: Exposure
    options: RenderOptions

    @cached_property
    def job(self) -> Job:
        """The scene as it is."""
        return prepare(self.scene, self.camera, self.exposure, self.options)

    def job_with(self, camera: Camera | None = None, **words: Any) -> Job:
        """The scene for another camera, or with other words."""
        return prepare(self.scene, camera or self.camera, self.exposure, replace(self.options, **words))

    def features(self) -> tuple[list[str], dict[str, str]]:
        """What can be left out here, in order; and what cannot, with the reason."""
        reasons = self._reasons()
        here = [banding(self._bands // size) for size in divisors(self._bands)]
        here += [name for name, reason in reasons.items() if reason is None]
        missing = {name: reason for name, reason in reasons.items() if reason is not None}
        return here, missing if self._bands > 1 else {"coarser bands": "there is one band, or channels", **missing}

    @property
    def _bands(self) -> int:
        return len(self.job.bands) if self.job.bands.kind == "cube" else 1

    def _reasons(self) -> dict[str, str | None]:
        """Why each feature is not in this scene; None where it is."""
        lens, view = self.camera.lens, self.job.scene.view
        curved = lens.distortion is not None or lens.distortion_percent is not None
        return {
            CHANNELS: self._no_channels(),
            APERTURE: None if view.aperture_radius_m > 0 and not view.traced else "no thin lens",
            INDIRECT: None if self._integrator() else "the integrator follows no path beyond the first surface",
            FALL_OFF: None if view.half_width > 0 and not view.traced else "telecentric, or traced through its lens",
            DISTORTION: None if curved else "the camera's lens has none",
            TRANSMISSION: None if lens.transmission_curve is not None else "the camera's lens has none",
            PRESCRIPTION: None if view.traced else "the camera's lens has none",
            "motion and subframes": "nothing moves unless a motion is given",
            ERROR_BARS: None,
            TRUTH: None,
        }

    def _no_channels(self) -> str | None:
        if self.job.bands.kind != "cube":
            return "the scene asks for one band, or for channels"
        yields = self.camera.quantum_efficiency.quantum_yield is not None
        return "electrons come in bursts, which needs bands" if yields else None

    def without(self, feature: str) -> Job:
        """The scene, loaded without a feature that it has; error bars and ground truth are no part of a scene."""
        if (size := self.group_of(feature)) is not None:
            return self.job_with(bandwidth_nm=float(self.job.bands.bandwidths_nm[0]) * size)
        return _WITHOUT[feature](self)

    def group_of(self, feature: str) -> int | None:
        """How many bands of the scene are one; None for a feature that is no banding."""
        return next((size for size in divisors(self._bands) if banding(self._bands // size) == feature), None)

    def _integrator(self) -> dict[str, Any] | None:
        """The scene's integrator without indirect light, in Mitsuba's words; None where it has no more to lose."""
        scene, mi = parse_scene(self.scene, self.options.parameters or {}), mitsuba()
        kind: tuple[str, dict[str, Any]] = "path", {}
        for _, node in scene.children(scene.root):
            while node.type == mi.ObjectType.Integrator:
                kind = node.props.plugin_name(), {k: node.props[k] for k in node.props if k in PASSED}
                inner = [one for _, one in scene.children(node.props) if one.type == node.type]
                if kind[0] not in WRAPPERS or not inner:
                    break
                node = inner[0]
        name, words = ("path", {}) if kind[0] in WRAPPERS else kind
        if name not in WITH_DEPTH or 0 <= words.get("max_depth", -1) <= 2:
            return None
        return {"type": name, **words, "max_depth": 2}


def _aperture(subject: Subject) -> Job:
    job = subject.job_with()
    parameters = mitsuba().traverse(job.scene.sensor)  # type: ignore[union-attr]
    parameters["aperture_radius"] = parameters["aperture_radius"] * CLOSED
    parameters.update()
    return job


def _indirect(subject: Subject) -> Job:
    job = subject.job_with()
    scene = replace(job.scene, integrator=mitsuba().load_dict(subject._integrator()))  # type: ignore[type-var]
    return replace(job, scene=scene, renderer=Renderer(scene, job.camera, job.exposure, job.bands))


def _fall_off(subject: Subject) -> Job:
    flat = {"lens.relative_illumination": (1.0, 1.0), "lens.relative_illumination_heights_mm": (0.0, FLAT_TO_MM)}
    return subject.job_with(subject.camera.replace(**flat))


def _distortion(subject: Subject) -> Job:
    none = dict.fromkeys(("lens.distortion", "lens.distortion_percent", "lens.distortion_heights_mm"))
    return subject.job_with(subject.camera.replace(**none))


def _transmission(subject: Subject) -> Job:
    """One number for all wavelengths: the average over the points of the curve."""
    lens = subject.camera.lens
    assert lens.transmission_curve is not None
    mean = lens.transmission * math.fsum(lens.transmission_curve) / len(lens.transmission_curve)
    flat = {
        "lens.transmission": mean, "lens.transmission_curve": None, "lens.transmission_wavelengths_nm": None
    }  # fmt: skip
    return subject.job_with(subject.camera.replace(**flat))


_WITHOUT: Mapping[str, Callable[[Subject], Job]] = {
    CHANNELS: lambda subject: subject.job_with(spectral="channels"),
    APERTURE: _aperture,
    INDIRECT: _indirect,
    FALL_OFF: _fall_off,
    DISTORTION: _distortion,
    TRANSMISSION: _transmission,
    PRESCRIPTION: lambda subject: subject.job_with(subject.camera.replace(**{"lens.prescription": None})),
}


def divisors(count: int) -> list[int]:
    """How many neighbouring bands may be one, from two on, so that all groups are equal."""
    return [size for size in range(2, count + 1) if count % size == 0]


def banding(count: int) -> str:
    """How a coarser grouping is called."""
    return "one band" if count == 1 else f"{count} bands"
