"""Numbers of a camera and an exposure as variables: their values, and derivatives by central differences."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from ..camera.camera import Camera
from ..camera.datasheet_errors import fields_of
from ..core import Exposure, Float64Array, InputError, nearest
from ..stages.stage import Chain, converter_of

TIME, TEMPERATURE = "exposure.time_s", "exposure.temperature_k"

THRESHOLDS = ("dark_current.rts_fraction", "source_follower.rtn_pixel_fraction")
"""Fields that random numbers are compared with: the pixels that they select change in jumps."""

STEPS = {(1, -1): (0.5, -0.5), (0, 1, 2): (-1.5, 2.0, -0.5), (0, -1, -2): (1.5, -2.0, 0.5)}
"""Steps and their weights: central, or on the side that is in the range of the field."""


@dataclass(frozen=True)
class Parameters:
    """Camera and exposure whose numbers are changed.  step : of a difference, relative to the value."""

    camera: Camera
    exposure: Exposure
    step: float = 1e-4

    def value(self, name: str) -> float:
        """The value of a number. Raises InputError for a name that is none."""
        found: object = self if name in (TIME, TEMPERATURE) else self.camera
        known = (TIME, TEMPERATURE, *fields_of(Camera))
        if name not in known:
            raise InputError(
                f"parameters names {name!r}, no field of camera or exposure.{nearest(str(name), known)}"
            )
        for part in name.split("."):
            found = getattr(found, part)
        if not isinstance(found, float):
            raise InputError(
                f"parameters names {name!r}, which is {found!r}; only a number that can change by a little, such as "
                "'pixel.full_well_e', has a derivative."
            )
        return found

    def derivative(
        self,
        name: str,
        function: Callable[[Camera, Exposure], Float64Array],
        of_light: Collection[str] = (),
    ) -> Float64Array:
        """d function/d ``name``, with equal random numbers.  of_light : names on which more than the chain depends.

        Raises InputError for a number that no stage depends on, and where the camera jumps.
        """
        value = self.value(name)
        step = self.step * (abs(value) or 1.0)
        weights, changed = self._around(name, value, step)
        self._check(name, [camera.stages for camera, _ in changed], of_light)
        parts = (w * function(*each) for w, each in zip(weights, changed, strict=True))
        return np.asarray(sum(parts)) / step

    def _around(
        self, name: str, value: float, step: float
    ) -> tuple[tuple[float, ...], list[tuple[Camera, Exposure]]]:
        """Weights, cameras and exposures of the first scheme that stays in the range of the field."""
        for steps, weights in STEPS.items():
            with contextlib.suppress(InputError):
                return weights, [self._changed(name, value + count * step) for count in steps]
        raise InputError(
            f"parameters names {name!r}, which is {value:g} and cannot be changed; leave it out."
        )

    def _check(self, name: str, chains: list[Chain], of_light: Collection[str]) -> None:
        """Raise InputError where the chains of a changed camera differ in more than a number, or in none."""
        value, is_default = self.value(name), self.camera.adc.black_level_dn is None
        if len({tuple(map(type, stages)) for stages in (self.camera.stages, *chains)}) > 1:
            raise InputError(
                f"parameters names {name!r}, which is {value:g}, where the chain leaves a stage out; "
                f"choose a value beside it, e.g. {value + 1e-3 * (abs(value) or 1.0):g}."
            )
        blacks_dn = {converter_of(stages).black_level_dn for stages in chains}
        if is_default and len(blacks_dn) > 1:
            raise InputError(
                f"parameters names {name!r}, which is {value:g}, where the default black level jumps; "
                "set adc.black_level_dn."
            )
        same = all(stages == chains[0] for stages in chains)
        unmoved = same and name not in (TIME, TEMPERATURE, *of_light)
        if name in THRESHOLDS or unmoved:
            raise InputError(
                f"parameters names {name!r}, on which no number of this chain depends smoothly; leave it out, "
                "and compare frames of two values instead."
            )

    def _changed(self, name: str, value: float) -> tuple[Camera, Exposure]:
        if name in (TIME, TEMPERATURE):
            return self.camera, replace(self.exposure, **{name.partition(".")[2]: value})
        return self.camera.replace(**{name: value}), self.exposure
