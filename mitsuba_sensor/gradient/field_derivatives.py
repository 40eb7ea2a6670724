"""Derivatives of the numbers that the stages use by the fields of a camera: finite differences in float64.

Every number of a camera that meets a pixel passes ``number()``, always in the same order, so that the numbers of a
changed camera can be compared one by one with those of the camera itself.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..camera.camera import Camera
from ..camera.datasheet_errors import fields_of
from ..core import Exposure, Float64Array, Frame, InputError, Photons, SensorWindow, nearest
from ..core.differentiable import CameraNumber, RecordingBackend
from ..sensor.detection import detect, uploaded
from ..sensor.run import begin
from ..stages.chain import chain
from ..stages.stage import sample

TIME, TEMPERATURE = "exposure.time_s", "exposure.temperature_k"

THRESHOLDS = ("dark_current.rts_fraction",)
"""Fields that random numbers are compared with: the pixels that they select change in jumps."""

STEP = 1e-4
"""Step of the finite differences, relative to the value."""

SCHEMES = {
    tuple(weights): weights
    for weights in (
        {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12},
        {0: -25 / 12, 1: 4.0, 2: -3.0, 3: 4 / 3, 4: -1 / 4},
        {0: 25 / 12, -1: -4.0, -2: 3.0, -3: -4 / 3, -4: 1 / 4},
    )
}
"""Steps → weights of a slope of fourth order: central, or one-sided where the other side is out of range."""

ROUNDING = 1e-12
"""Relative rounding error of a number; smaller changes count as none."""

SMOOTH = 0.05
"""Largest allowed difference of the slopes over one step and over two steps, relative to the larger."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One pixel of a run, whose stages are run to record the numbers that they use.

    light : one pixel, (1, 1) or (1, 1, B).  first : its frame, whose window has one pixel of every measured map.
    """

    light: Photons
    camera: Camera
    first: Frame

    @classmethod
    def of(cls, light: Photons, camera: Camera, first: Frame) -> Recording:
        """The first pixel of a run: the numbers are the same for all pixels."""
        given = {name: x[:1, :1] for name, x in first.window.given.items()}
        window = SensorWindow(first.window.serial, (1, 1), first.window.origin, given)
        alone = light.changed(variance_e2=None, in_band=None, by_readout=None)
        corner = replace(alone.crop_rows(slice(1)), mean=light.mean[:1, :1])
        return cls(corner, camera, replace(first, window=window, _blocks={}))

    def by(self, names: tuple[str, ...], of_light: Collection[str] = ()) -> list[CameraNumber]:
        """Every number of the camera, with its slopes by these parameters.

        of_light : those that the light depends on, so that the chain need not.

        Raises InputError for a name that is no field of camera or exposure, a field that is no number, and one on which
        no number depends smoothly.
        """
        unchanged = self.numbers(self.camera, self.first.exposure)
        slopes = {name: self.slope(name, len(unchanged)) for name in names}
        for name, slope in slopes.items():
            if name in THRESHOLDS or not (slope.any() or name in of_light):
                raise InputError(
                    f"parameters names {name!r}, on which no number of this chain depends smoothly; leave it out, "
                    "and compare frames of two values instead."
                )
        return [
            CameraNumber(
                value, {name: float(slope[i]) for name, slope in slopes.items() if slope[i]}
            )
            for i, value in enumerate(unchanged)
        ]

    def slope(self, name: str, count: int) -> Float64Array:
        """d number/d ``name`` of each of the ``count`` numbers."""
        value = self.value(name)
        step = STEP * (abs(value) or 1.0)
        steps, changed = self._around(name, value, step)
        rows = [self.numbers(*each) for each in changed]
        if {len(row) for row in rows} != {count}:
            raise InputError(
                f"parameters names {name!r}, which is {value:g}, where the chain leaves a stage out; "
                f"choose a value beside it, e.g. {value + 1e-3 * (abs(value) or 1.0):g}."
            )
        there = dict(zip(steps, np.array(rows), strict=True))
        slope = sum(weight * there[at] for at, weight in SCHEMES[steps].items()) / step
        size = np.abs(there[steps[1]])
        near, far = (_secant(there, reach) / step for reach in (1, 2))
        unsure = (
            SMOOTH * np.maximum(np.abs(near), np.abs(far))
            + 10 * ROUNDING * np.maximum(size, 1.0) / step
        )
        if (np.abs(near - far) > unsure).any():
            raise InputError(
                f"parameters names {name!r}, which is {value:g}, where the camera jumps; change it a little."
            )
        return np.where(np.abs(slope) > ROUNDING * size / step, slope, 0.0)

    def derivative(
        self, name: str, function: Callable[[Camera, Exposure], Float64Array]
    ) -> Float64Array:
        """d function/d ``name``."""
        value = self.value(name)
        step = STEP * (abs(value) or 1.0)
        steps, changed = self._around(name, value, step)
        weighted = (
            SCHEMES[steps][at] * function(*each)
            for at, each in zip(steps, changed, strict=True)
        )
        return np.asarray(sum(weighted)) / step

    def value(self, name: str) -> float:
        """The value of the field."""
        found: object = self.first if name in (TIME, TEMPERATURE) else self.camera
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

    def numbers(self, camera: Camera, exposure: Exposure) -> list[float]:
        """Every number of this camera, in the order in which the stages use them."""
        backend, stages = RecordingBackend(), chain(camera)
        frame = replace(
            self.first,
            exposure=exposure,
            window=replace(self.first.window, backend=backend, _maps={}),
        )
        sample(
            stages[1:],
            begin(
                stages, uploaded(detect(self.light, stages[0], self.first).signal, frame), frame
            ),
            replace(frame, _blocks={}),
        )
        return backend.numbers

    def _around(
        self, name: str, value: float, step: float
    ) -> tuple[tuple[int, ...], list[tuple[Camera, Exposure]]]:
        """The first scheme that stays in the range of the field, and the cameras and exposures at its steps."""
        for steps in SCHEMES:
            with contextlib.suppress(InputError):
                return steps, [self._changed(name, value + count * step) for count in steps]
        raise InputError(
            f"parameters names {name!r}, which is {value:g} and cannot be changed; leave it out."
        )

    def _changed(self, name: str, value: float) -> tuple[Camera, Exposure]:
        if name in (TIME, TEMPERATURE):
            return self.camera, replace(self.first.exposure, **{name.partition(".")[2]: value})
        return self.camera.replace(**{name: value}), self.first.exposure


def _secant(there: Mapping[int, Float64Array], reach: int) -> Float64Array:
    """Slope between ``reach`` steps above and below the value, or between the value and the one that is in range."""
    a, b = (at if at in there else 0 for at in (reach, -reach))
    return (there[a] - there[b]) / (a - b)
