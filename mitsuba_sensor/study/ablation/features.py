"""What a render of a scene has that could be left out, and the scene loaded without it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property

from ...render.lint import WRAPPERS
from ...render.prepared import PreparedRender
from ...render.renderer import Renderer
from ...render.scene_file import parse_scene
from ...render.variants import mitsuba
from ..statistics import Known, Values
from ..subject import Subject

WITH_DEPTH = ("path", "volpath", "volpathmis")
"""Integrators of Mitsuba whose ``max_depth`` cuts off the light that comes by way of other surfaces."""
PASSED = ("max_depth", "hide_emitters")  # what an integrator without indirect light takes from the scene's own
STOPPED_DOWN = 1e-6  # of the scene's aperture: what is left of it. Mitsuba refuses an aperture of 0
FLAT_TO_MM = 1e6  # to this image height a lens without fall-off is as bright as on its axis: beyond any sensor
CHANNELS, FALL_OFF, INDIRECT = "channels instead of bands", "lens fall-off", "indirect light"
APERTURE, ERROR_BARS, AOVS = "depth of field", "error bars", "AOVs"


class Features:
    """The features of one subject's render."""

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        bands = subject.job.bands
        self._bands = len(bands) if bands.kind == "cube" else 1
        self.groupings = {banding(self._bands // size): size for size in divisors(self._bands)}

    def found(self) -> tuple[list[str], dict[str, str]]:
        """What can be left out here, in order; and what cannot, with the reason."""
        reasons = self._reasons()
        here = [*self.groupings, *(name for name, reason in reasons.items() if reason is None)]
        missing = {name: reason for name, reason in reasons.items() if reason is not None}
        return here, missing if self._bands > 1 else {"coarser bands": "there is one band, or channels", **missing}

    def _reasons(self) -> dict[str, str | None]:
        """Why each feature is not in this scene; None where it is."""
        lens, view = self.subject.camera.lens, self.subject.job.scene.view
        curved = lens.distortion is not None or lens.distortion_percent is not None
        none = "the camera's lens has none"
        return {
            CHANNELS: self._no_channels(),
            APERTURE: None if view.aperture_radius_m > 0 and not view.sequential else "no thin lens",
            INDIRECT: None if self._integrator else "the integrator follows no path beyond the first surface",
            FALL_OFF: None if view.half_width > 0 and not view.sequential else "telecentric, or a sequential lens",
            "lens distortion": None if curved else none,
            "lens transmission curve": None if lens.transmission_curve is not None else none,
            "lens prescription": None if view.sequential else none,
            "motion and subframes": "nothing moves unless a motion is given",
            ERROR_BARS: None,
            AOVS: None,
        }

    def _no_channels(self) -> str | None:
        if self.subject.job.bands.kind != "cube":
            return "the scene asks for one band, or for channels"
        bursts = self.subject.camera.quantum_efficiency.quantum_yield is not None
        return "electrons come in bursts, which needs bands" if bursts else None

    @cached_property
    def _integrator(self) -> Values | None:
        """The scene's integrator without indirect light, in Mitsuba's terms; None where it has no more to lose."""
        scene, mi = parse_scene(self.subject.scene, self.subject.options.get("parameters") or {}), mitsuba()
        kind: tuple[str, Values] = "path", {}
        for _, node in scene.children(scene.root):
            while node.type == mi.ObjectType.Integrator:
                kind = node.props.plugin_name(), {k: node.props[k] for k in node.props if k in PASSED}
                inner = [one for _, one in scene.children(node.props) if one.type == node.type]
                if kind[0] not in WRAPPERS or not inner:
                    break
                node = inner[0]
        name, given = ("path", {}) if kind[0] in WRAPPERS else kind
        if name not in WITH_DEPTH or 0 <= given.get("max_depth", -1) <= 2:
            return None
        return {"type": name, **given, "max_depth": 2}

    def without(self, feature: str) -> PreparedRender:
        """The scene, loaded without a feature that it has; error bars and AOVs are no part of a scene."""
        subject, lens = self.subject, self.subject.camera.lens
        if feature in self.groupings:
            return subject.job_with(bandwidth_nm=float(subject.job.bands.bandwidths_nm[0]) * self.groupings[feature])
        curve = lens.transmission_curve or (1.0,)
        mean = lens.transmission * math.fsum(curve) / len(curve)  # one number for all wavelengths
        flat = {"relative_illumination": (1.0, 1.0), "relative_illumination_heights_mm": (0.0, FLAT_TO_MM)}
        plain = {"transmission": mean, "transmission_curve": None, "transmission_wavelengths_nm": None}
        lenses: Mapping[str, Known] = {
            FALL_OFF: flat,
            "lens distortion": dict.fromkeys(("distortion", "distortion_percent", "distortion_heights_mm")),
            "lens transmission curve": plain,
            "lens prescription": {"prescription": None},
        }
        if feature in lenses:
            changes = {f"lens.{name}": value for name, value in lenses[feature].items()}
            return subject.job_with(subject.camera.replace(**changes))
        others: Mapping[str, Callable[[], PreparedRender]] = {
            CHANNELS: lambda: subject.job_with(spectral="channels"),
            APERTURE: self._stopped_down,
            INDIRECT: self._direct,
        }
        return others[feature]()

    def _stopped_down(self) -> PreparedRender:
        job = self.subject.job_with()
        parameters = mitsuba().traverse(job.scene.sensor)  # type: ignore[union-attr]
        parameters["aperture_radius"] = parameters["aperture_radius"] * STOPPED_DOWN
        parameters.update()
        return job

    def _direct(self) -> PreparedRender:
        job = self.subject.job_with()
        scene = replace(job.scene, integrator=mitsuba().load_dict(self._integrator))  # type: ignore[type-var]
        return replace(job, scene=scene, renderer=Renderer(scene, job.camera, job.exposure, job.bands))


def divisors(count: int) -> list[int]:
    """How many neighbouring bands may be one, from two on, so that all groups are equal."""
    return [size for size in range(2, count + 1) if count % size == 0]


def banding(count: int) -> str:
    """How a coarser grouping is called."""
    return "one band" if count == 1 else f"{count} bands"
