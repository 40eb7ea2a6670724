"""Codes of pixels in an external graph of derivatives that leads from a scene to mean photoelectrons."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..camera.camera import Camera
from ..camera.figures import refuse_readouts
from ..core import Array, Electrons, Exposure, Float64Array, Frame, InputError
from ..core.backend import NUMPY_FLOAT64
from ..core.drjit_backend import DrJitBackend
from ..core.llvm import drjit
from ..stages.stage import Chain, Detector, converter_of, sample
from ..stages.straight import NotStraight
from .law_slopes import (
    Law,
    Slopes,
    chance_of,
    mean_and_variance,
    slopes_by_light,
    slopes_by_names,
)


@dataclass(frozen=True, eq=False)
class AttachedPixels:
    """The pixels of a camera in given light.

    frame : exposure and window, on NumPy.  light_e : mean photoelectrons, a variable of the graph, shape (H·W,).
    changes : name → variable of the graph minus its value.  of_light : names that also change the light.
    """

    camera: Camera
    frame: Frame
    light_e: Array
    changes: Mapping[str, Array]
    of_light: Collection[str]
    backend: str

    @classmethod
    def of(
        cls,
        camera: Camera,
        frame: Frame,
        light_e: Array,
        changes: Mapping[str, Array],
        of_light: Collection[str],
        backend: str,
    ) -> AttachedPixels:
        """Return the pixels. Raises InputError for a camera with several readouts or coupled pixels."""
        refuse_readouts(camera, "derivatives need a single readout")
        for stage in camera.stages:
            if stage.reach_px or (isinstance(stage, Detector) and stage.light_reach_px):
                raise InputError(
                    f"light has no derivative through {stage.label}, which couples neighbouring pixels; compute "
                    f"differences of frames, or {stage.no_noise or 'use the camera without this stage'}."
                )
        return cls(camera, frame.on(NUMPY_FLOAT64), light_e, changes, of_light, backend)

    @property
    def highest(self) -> int:
        """Full-scale code."""
        return converter_of(self.stages).highest

    @property
    def stages(self) -> Chain:
        """Chain of the camera."""
        return self.camera.stages

    def expected(self) -> Array:
        """Return the expected codes, shape (H·W,)."""
        return self._slopes(mean_and_variance).attached(self.light_e, self.changes)

    def sampled(self, seed: int) -> Array:
        """Return the codes of the first frame of a seed, shape (H·W,)."""
        backend = DrJitBackend(self.backend, differentiable=True)
        frame = replace(self.frame, seed=seed).on(backend)
        light = Electrons(drjit().detach(self.light_e))
        codes = backend.to_numpy(sample(self.stages[1:], light, frame), frame.window)
        slopes = self._slopes(mean_and_variance)
        return slopes.attached(self.light_e, self.changes, codes.astype(np.float64))

    def log_likelihood(self, codes: Float64Array, render_e2: Float64Array) -> Array:
        """Return the log-probability of codes (H, W) for light with this render variance (H, W), shape (H·W,).

        Raises InputError for a chain without a closed form.
        """
        try:
            return self._slopes(chance_of(codes, render_e2)).attached(
                self.light_e, self.changes
            )
        except NotStraight as reason:
            raise InputError(
                f"{self.camera.name} has no closed-form likelihood, because {reason}; compare expected codes by "
                "ms.digital, or use the camera without it."
            ) from None

    def _slopes(self, law: Law) -> Slopes:
        light = self._light
        by_light = slopes_by_light(law, self.stages, light, self.frame)

        def light_of(camera: Camera, exposure: Exposure) -> Electrons:
            return light

        by_name = slopes_by_names(
            law, light_of, self.camera, self.frame, self.changes, self.of_light
        )
        return Slopes(law(self.stages, light, self.frame), by_light, by_name)

    @cached_property
    def _light(self) -> Electrons:
        light_e = drjit().detach(self.light_e).numpy()
        return Electrons(light_e.reshape(self.frame.window.shape).astype(np.float64))
