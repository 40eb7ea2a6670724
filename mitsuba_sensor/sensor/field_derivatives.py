"""How the numbers that meet the pixels change with a camera's fields: numeric derivatives, on the host, in float64.

Every number of a camera goes through ``number()``, always in the same order, so that the numbers of a changed camera
can be laid beside those of the camera itself.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.differentiable import Number, Recorder
from ..core.errors import InputError, nearest
from ..core.exposure import Exposure
from ..core.frame import Frame
from ..core.sensor_window import SensorWindow
from ..core.signals import Photons
from .camera import Camera
from .chain import chain
from .datasheet_errors import fields_of
from .run import begin, run_chain

TIME, TEMPERATURE = "exposure.time_s", "exposure.temperature_k"

DECIDES = ("dark_current.rts_fraction",)
"""Numbers that random words are compared with: how many pixels they choose jumps from one to the next."""

STEP = 1e-4
"""Distance of the places at which a slope is looked for, as a part of the value."""

SCHEMES = {
    tuple(weights): weights
    for weights in (
        {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12},
        {0: -25 / 12, 1: 4.0, 2: -3.0, 3: 4 / 3, 4: -1 / 4},
        {0: 25 / 12, -1: -4.0, -2: 3.0, -3: -4 / 3, -4: 1 / 4},
    )
}
"""Places → their weights in a slope to fourth order: about the value, or to one side where the other is forbidden."""

ROUNDING = 1e-12
"""Part of a number that is lost where it is computed; what changes less does not change."""

SMOOTH = 0.05
"""How much the slopes of a short and of a long secant may differ, as a part of the larger."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What one pixel of a run asks of its camera.

    light : one pixel, (1, 1) or (1, 1, B).  first : its frame, whose device holds one pixel of every given map.
    """

    light: Photons
    camera: Camera
    first: Frame

    @classmethod
    def of(cls, light: Photons, camera: Camera, first: Frame) -> Recording:
        """The first pixel of a run stands for all: numbers are the same everywhere."""
        given = {name: x[:1, :1] for name, x in first.window.given.items()}
        window = SensorWindow(first.window.serial, (1, 1), first.window.origin, given)
        corner = Photons(light.mean[:1, :1], light.wavelengths_nm)
        return cls(corner, camera, replace(first, window=window, _blocks={}))

    def by(self, names: tuple[str, ...]) -> list[Number]:
        """Every number of the camera, with its slopes by these names.

        Raises InputError for a name that is no field of camera and exposure, one that is no number, and one that no
        number follows smoothly.
        """
        home = self.numbers(self.camera, self.first.exposure)
        slopes = {name: self.slope(name, len(home)) for name in names}
        for name, slope in slopes.items():
            if not slope.any() or name in DECIDES:
                raise InputError(
                    f"parameters names {name!r}, which no number of this chain follows smoothly; leave it out, "
                    "and compare frames of two values instead."
                )
        return [
            Number(value, {name: float(slope[i]) for name, slope in slopes.items() if slope[i]})
            for i, value in enumerate(home)
        ]

    def slope(self, name: str, count: int) -> NDArray[np.float64]:
        """d number/d ``name`` of each of the ``count`` numbers."""
        value = self.value(name)
        step = STEP * (abs(value) or 1.0)
        places, changed = self._around(name, value, step)
        rows = [self.numbers(*each) for each in changed]
        if {len(row) for row in rows} != {count}:
            raise InputError(
                f"parameters names {name!r}, which is {value:g}, where the chain leaves a stage out; "
                f"start beside it, e.g. at {value + 1e-3 * (abs(value) or 1.0):g}."
            )
        there = dict(zip(places, np.array(rows), strict=True))
        slope = sum(weight * there[place] for place, weight in SCHEMES[places].items()) / step
        size = np.abs(there[places[1]])
        near, far = (_secant(there, reach) / step for reach in (1, 2))
        unsure = SMOOTH * np.maximum(np.abs(near), np.abs(far)) + 10 * ROUNDING * np.maximum(size, 1.0) / step
        if (np.abs(near - far) > unsure).any():
            raise InputError(
                f"parameters names {name!r}, and the camera jumps where it is {value:g}; move it a little."
            )
        return np.where(np.abs(slope) > ROUNDING * size / step, slope, 0.0)

    def value(self, name: str) -> float:
        """What the field is now."""
        found: Any = self.first if name in (TIME, TEMPERATURE) else self.camera
        known = (TIME, TEMPERATURE, *fields_of(Camera))
        if name not in known:
            raise InputError(f"parameters names {name!r}, no field of camera or exposure.{nearest(str(name), known)}")
        for part in name.split("."):
            found = getattr(found, part)
        if not isinstance(found, float):
            raise InputError(
                f"parameters names {name!r}, which is {found!r}; only a number that can change by a little, such as "
                "'pixel.full_well_e', has a derivative."
            )
        return found

    def numbers(self, camera: Camera, exposure: Exposure) -> list[float]:
        """Every number of this camera, in the order in which they meet the pixels."""
        backend, stages = Recorder(), chain(camera)
        frame = replace(self.first, exposure=exposure, window=replace(self.first.window, backend=backend, _maps={}))
        run_chain(stages[1:], begin(stages, self.light, frame), replace(frame, _blocks={}))
        return backend.numbers

    def _around(self, name: str, value: float, step: float) -> tuple[tuple[int, ...], list[tuple[Camera, Exposure]]]:
        """The first places that the field's range allows, in steps from the value, and the cameras there."""
        for places in SCHEMES:
            with contextlib.suppress(InputError):
                return places, [self._changed(name, value + place * step) for place in places]
        raise InputError(f"parameters names {name!r}, which is {value:g} and cannot change here; leave it out.")

    def _changed(self, name: str, value: float) -> tuple[Camera, Exposure]:
        if name in (TIME, TEMPERATURE):
            return self.camera, replace(self.first.exposure, **{name.partition(".")[2]: value})
        return self.camera.replace(**{name: value}), self.first.exposure


def _secant(there: Mapping[int, Any], reach: int) -> Any:
    """Slope between the two places that lie ``reach`` steps from the value, or between the one and the value."""
    a, b = (place if place in there else 0 for place in (reach, -reach))
    return (there[a] - there[b]) / (a - b)
