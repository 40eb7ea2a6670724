"""Codes of pixels as a part of somebody else's graph of derivatives, which goes from a scene to mean photoelectrons."""

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
    """The pixels of one camera in some light.

    frame : conditions and place, on NumPy.  light_e : mean photoelectrons, a variable of the graph, (H·W).
    changes : by name, a variable of the graph minus its value.  of_light : names on which the light depends, too.
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
        """Raises InputError for a camera with several read-outs, and for pixels that give light to each other."""
        refuse_readouts(camera, "derivatives are those of one read-out")
        for stage in camera.stages:
            if stage.reach_px or (isinstance(stage, Detector) and stage.light_reach_px):
                raise InputError(
                    f"{stage.label} couples neighbouring pixels, and light has no derivative through it; "
                    f"compute differences of frames, or {stage.no_noise or 'take the camera without that stage'}."
                )
        return cls(camera, frame.on(NUMPY_FLOAT64), light_e, changes, of_light, backend)

    @property
    def highest(self) -> int:
        """The largest code."""
        return converter_of(self.stages).highest

    @property
    def stages(self) -> Chain:
        """The chain of the camera."""
        return self.camera.stages

    def expected(self) -> Array:
        """Expected codes, (H·W)."""
        return self._slopes(mean_and_variance).attached(self.light_e, self.changes)

    def sampled(self, seed: int) -> Array:
        """Codes of the first frame of a seed, (H·W)."""
        backend = DrJitBackend(self.backend, differentiable=True)
        frame = replace(self.frame, seed=seed).on(backend)
        light = Electrons(drjit().detach(self.light_e))
        codes = backend.to_numpy(sample(self.stages[1:], light, frame), frame.window)
        slopes = self._slopes(mean_and_variance)
        return slopes.attached(self.light_e, self.changes, codes.astype(np.float64))

    def log_likelihood(self, codes: Float64Array, render_e2: Float64Array) -> Array:
        """Logarithm of the probability of these codes (H, W), (H·W), if the light has this render variance (H, W).
        Raises InputError for a chain without a closed form."""
        try:
            return self._slopes(chance_of(codes, render_e2)).attached(
                self.light_e, self.changes
            )
        except NotStraight as reason:
            raise InputError(
                f"the likelihood of a code of {self.camera.name} is not known, because {reason}; "
                "compare expected codes with ms.digital, or take the camera without it."
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
