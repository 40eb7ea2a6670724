"""What a study of a scene is about: the scene, the camera, the exposure, and how the scene is rendered."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from ..core import Exposure, check_types
from ..render.irradiance import Irradiance
from ..render.passes import SAMPLER
from ..render.prepared import PreparedRender, prepare, render
from ..sensor.camera import Camera
from .statistics import Known


@dataclass(frozen=True, eq=False)
class Subject:
    """Fields as in :func:`mitsuba_sensor.render`. options : of the render, by name, as given there."""

    scene: str | os.PathLike[str]
    camera: Camera
    exposure: Exposure
    options: Known = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_types(self.camera, self.exposure)

    @property
    def name(self) -> str:
        """Of the scene."""
        return Path(self.scene).stem

    @cached_property
    def job(self) -> PreparedRender:
        """The scene as it is."""
        return self.job_with()

    def job_with(self, camera: Camera | None = None, sampler: str = SAMPLER, **options: Any) -> PreparedRender:
        """The scene, loaded for another camera, with another sampler or with other options."""
        changed = {**self.options, **options}
        return prepare(self.scene, camera or self.camera, self.exposure, sampler=sampler, **changed)

    def render(self, seed: int, **options: Any) -> Irradiance:
        """One render, with these options changed."""
        return render(self.scene, self.camera, self.exposure, seed=seed, **{**self.options, **options})
