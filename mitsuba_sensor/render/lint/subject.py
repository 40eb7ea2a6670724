"""What is checked: a parsed scene, and the bands and the camera that it is to be rendered for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from ...camera.camera import Camera
from ...optics.intrinsics import View
from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject
from .electron_share import share_of_flat_light
from .finding import Range, lines_of
from .scene_spectra import SceneSpectra

TOLERANCE_NM = 1e-3


@dataclass(frozen=True, eq=False)
class Subject:
    """A parsed scene.  band_nm : ends of all bands together.  unit_m : metres per scene unit; None where not known."""

    scene: ParsedScene
    band_nm: Range
    camera: Camera | None
    unit_m: float | None

    @cached_property
    def spectra(self) -> SceneSpectra:
        """Of its emitters and materials."""
        return SceneSpectra(self.scene)

    @property
    def is_dark(self) -> bool:
        """Whether it has lights, and none of them has a spectrum in the bands."""
        low_nm, high_nm = self.band_nm
        lights = [data_nm for _, data_nm in self.spectra.lights]
        return bool(lights) and not any(low < high_nm and high > low_nm for low, high in lights)

    def is_covered_by(self, data_nm: Range) -> bool:
        """Whether there are data in all bands."""
        low_nm, high_nm = self.band_nm
        return data_nm[0] <= low_nm + TOLERANCE_NM and data_nm[1] >= high_nm - TOLERANCE_NM

    def beyond(self, data_nm: Range) -> str:
        """Where the bands are, and how much the camera detects where there are no data."""
        extent = f"the bands extend from {self.band_nm[0]:g} to {self.band_nm[1]:g} nm"
        if self.camera is None:
            return extent
        return extent + share_of_flat_light(self.camera, self.band_nm, data_nm)

    def lines(self, nodes: list[MitsubaObject]) -> str:
        """Where nodes are in the scene file."""
        return lines_of(self.scene, nodes)


class Built(NamedTuple):
    """What Mitsuba made of a scene.  world : its shapes and emitters.  view : through the lens of the camera."""

    world: MitsubaObject
    sensor: MitsubaObject
    integrator: MitsubaObject
    view: View
