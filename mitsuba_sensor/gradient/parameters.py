"""Fields of a camera and an exposure as variables: values and derivatives by central differences."""

from __future__ import annotations

import contextlib
import operator
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from ..camera.camera import Camera
from ..camera.datasheet_errors import fields_of
from ..core import Exposure, Float64Array, InputError, nearest
from ..stages.stage import Chain, converter_of

TIME, TEMPERATURE = "exposure.time_s", "exposure.temperature_k"

THRESHOLDS = ("dark_current.rts_fraction", "source_follower.rtn_pixel_fraction")
"""Thresholds on random numbers: the selected pixels change in jumps."""

STEPS = {(1, -1): (0.5, -0.5), (0, 1, 2): (-1.5, 2.0, -0.5), (0, -1, -2): (1.5, -2.0, 0.5)}
"""Steps and their weights: central, or one-sided at the end of the range of the field."""


@dataclass(frozen=True)
class Parameters:
    """Camera and exposure with variable fields.  step : of a difference, relative to the value."""

    camera: Camera
    exposure: Exposure
    step: float = 1e-4

    def value(self, name: str) -> float:
        """Return the value of a field. Raises InputError for an unknown name, and for a value without derivative."""
        names = (TIME, TEMPERATURE, *fields_of(Camera))
        if name not in names:
            raise InputError(
                f"parameters has {name!r}, which is not a field of camera or exposure.{nearest(str(name), names)}"
            )
        value = operator.attrgetter(name)(self if name in (TIME, TEMPERATURE) else self.camera)
        if not isinstance(value, float):
            raise InputError(
                f"parameters has {name!r}, which is {value!r}; only continuous numbers have a derivative, e.g. "
                "'pixel.full_well_e'."
            )
        return value

    def derivative(
        self,
        name: str,
        function: Callable[[Camera, Exposure], Float64Array],
        of_light: Collection[str] = (),
    ) -> Float64Array:
        """Return d function/d ``name``, with equal random numbers.  of_light : names that change more than the chain.

        Raises InputError for a field without effect, and at a jump.
        """
        value = self.value(name)
        step = self.step * (abs(value) or 1.0)
        weights, changed = self._around(name, value, step)
        self._check(name, [camera.stages for camera, _ in changed], of_light)
        terms = (w * function(*pair) for w, pair in zip(weights, changed, strict=True))
        return np.asarray(sum(terms)) / step

    def _around(
        self, name: str, value: float, step: float
    ) -> tuple[tuple[float, ...], list[tuple[Camera, Exposure]]]:
        """Return weights, cameras and exposures of the first scheme within the range of the field."""
        for steps, weights in STEPS.items():
            with contextlib.suppress(InputError):
                return weights, [self._changed(name, value + count * step) for count in steps]
        raise InputError(
            f"parameters has {name!r}, which is {value:g} and cannot be changed; remove it."
        )

    def _check(self, name: str, chains: list[Chain], of_light: Collection[str]) -> None:
        """Raise InputError if the chains of the changed cameras differ in their stages, or do not differ."""
        value, is_default = self.value(name), self.camera.adc.black_level_dn is None
        if len({tuple(map(type, stages)) for stages in (self.camera.stages, *chains)}) > 1:
            raise InputError(
                f"parameters has {name!r}, which is {value:g}, where the chain gains or loses a stage; choose a nearby "
                f"value, e.g. {value + 1e-3 * (abs(value) or 1.0):g}."
            )
        blacks_dn = {converter_of(stages).black_level_dn for stages in chains}
        if is_default and len(blacks_dn) > 1:
            raise InputError(
                f"parameters has {name!r}, which is {value:g}, where the default black level jumps; set "
                "adc.black_level_dn."
            )
        same = all(stages == chains[0] for stages in chains)
        unmoved = same and name not in (TIME, TEMPERATURE, *of_light)
        if name in THRESHOLDS or unmoved:
            raise InputError(
                f"parameters has {name!r}, but the chain does not depend on it smoothly; remove it, and compare frames "
                "of two values."
            )

    def _changed(self, name: str, value: float) -> tuple[Camera, Exposure]:
        if name in (TIME, TEMPERATURE):
            return self.camera, replace(self.exposure, **{name.partition(".")[2]: value})
        return self.camera.replace(**{name: value}), self.exposure
