"""Condition numbers: how far one float32 step of an input moves an output, in digital numbers.

Everything here is float64 and theory: the moments of the chain, before the converter rounds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.sensor_window import SensorWindow
from ...core.signals import Photons
from ...sensor.camera import Camera, list_cameras, load_camera
from ...sensor.chain import chain
from ...sensor.datasheet_errors import fields_of
from ...sensor.theory import final_moments

NOTICED_DN = 0.1
"""A change of a mean that a careful measurement shows: a tenth of a code."""

LEVELS = {"dark": 0.0, "10 %": 0.1, "50 %": 0.5, "90 %": 0.9}
"""Shares of the full well of the most sensitive filter."""

EXPOSURES = (Exposure(0.1), Exposure(10.0))
"""At 25 °C; the longer one lets the dark current fill a good part of a well."""

BENT = {
    "adc.bits": 16, "readout.reset": "hard", "readout.ve_nonlinearity": 0.5, "source_follower.vv_nonlinearity": 1.05,
    "adc.gamma": 1.04, "readout.dsnu_row": 5e-4, "readout.prnu_col": 2e-3, "pixel.dsnu_e": 20.0,
    "source_follower.rtn_uv": 100.0,
}  # fmt: skip

UNUSED = ("name", "description", "sources", "lens", "sensor")
"""Of a datasheet: what no number of the chain follows, and the lens, which is in the photons already."""


def cameras() -> dict[str, Camera]:
    """Shipped ones, and Table 1 with all curves bent and with as many bits as there may be."""
    table1 = load_camera("konnik_table1")
    more = {"table 1, 16 bit, bent": table1.replace(**BENT), "table 1, 24 bit": table1.replace(**{"adc.bits": 24})}
    return {name: load_camera(name) for name in list_cameras()} | more


@dataclass(frozen=True)
class Sensitivity:
    """What one float32 step of one input does at one light level.

    step : relative to the input, None where that is many numbers.  mean_dn : the mean itself.
    moved_dn : by how much mean, temporal σ and fixed σ move.
    """

    camera: str
    time_s: float
    level: str
    field: str
    value: str
    step: float | None
    mean_dn: float
    moved_dn: tuple[float, float, float]

    @property
    def largest_dn(self) -> float:
        """The largest of the three."""
        return max(self.moved_dn)

    @property
    def number(self) -> float | None:
        """The condition number of the mean: its relative change over that of the input."""
        return self.moved_dn[0] / self.mean_dn / self.step if self.mean_dn and self.step else None

    @property
    def why(self) -> str:
        """A sentence where the change shows, else nothing."""
        if self.largest_dn <= NOTICED_DN:
            return ""
        if self.number and self.number > 2:
            return f"the mean, {self.mean_dn:.0f} DN, follows this input with power {self.number:.0f}"
        if self.moved_dn[0] == self.largest_dn:
            return f"the mean, {self.mean_dn:.0f} DN, has float32 steps of {ulp(self.mean_dn):g} DN itself"
        return "a spread follows this input more than the mean does"


def sensitivities() -> list[Sensitivity]:
    """Every camera, exposure, level and input that moves anything, the strongest first."""
    found = [one for name, camera in cameras().items() for e in EXPOSURES for one in of_camera(name, camera, e)]
    return sorted(found, key=lambda one: -one.largest_dn)


def of_camera(name: str, camera: Camera, exposure: Exposure) -> Iterator[Sensitivity]:
    """One camera and exposure."""
    light = levels(camera)
    home = outputs(light, camera, exposure)
    for n in nudges(light, camera, exposure):
        there = outputs(n.light, n.camera, n.exposure)
        moved = [np.abs(x - here) for x, here in zip(there, home, strict=True)]
        for k, level in enumerate(LEVELS):
            change = tuple(float(x[k].max()) for x in moved)
            if any(change):
                mean = float(home[0][k][moved[0][k].argmax()])
                step = n.steps[k] if n.steps else None
                yield Sensitivity(name, exposure.time_s, level, n.field, n.value, step, mean, change)  # type: ignore[arg-type]


def strongest(found: Sequence[Sensitivity], each: int) -> list[Sensitivity]:
    """The inputs that move a camera most, so many of each camera, at the exposure and level where they do."""
    first: dict[tuple[str, str], Sensitivity] = {}
    for one in found:
        first.setdefault((one.camera, one.field), one)
    place = Counter[str]()
    chosen = []
    for one in first.values():
        place[one.camera] += 1
        if place[one.camera] <= each:
            chosen.append(one)
    return chosen


def levels(camera: Camera) -> Photons:
    """A window with one tile of colour filters for each level, side by side."""
    tile = camera.tile
    sensitivity = float(camera.qe([camera.quantum_efficiency.reference_nm]).max())
    photons = np.repeat(list(LEVELS.values()), len(tile[0])) * camera.pixel.full_well_e / sensitivity
    return Photons(np.tile(photons, (len(tile), 1)))


def outputs(light: Photons, camera: Camera, exposure: Exposure) -> tuple[NDArray[np.float64], ...]:
    """Mean, temporal σ and fixed σ, (levels, filters) each [DN]."""
    shape = light.mean.shape[0], light.mean.shape[1]
    m, _ = final_moments(chain(camera), light, Frame(exposure, SensorWindow(0, shape)))
    by_level = lambda x: np.array(np.split(np.broadcast_to(x, shape), len(LEVELS), axis=1))  # noqa: E731
    return tuple(by_level(x).reshape(len(LEVELS), -1) for x in (m.mean, np.sqrt(m.temporal), np.sqrt(m.spatial)))


@dataclass(frozen=True)
class Nudge:
    """Everything, with one input one float32 step away.  steps : relative to the input, for each level; or none."""

    field: str
    value: str
    steps: tuple[float, ...]
    light: Photons
    camera: Camera
    exposure: Exposure


def nudges(light: Photons, camera: Camera, exposure: Exposure) -> Iterator[Nudge]:
    """Light, exposure, and every number of the datasheet."""
    each = light.mean[0, :: len(camera.tile[0])]
    yield Nudge("photons", "", tuple(relative(x) for x in each), replace(light, mean=up(light.mean)), camera, exposure)
    for name in ("time_s", "temperature_k"):
        value = getattr(exposure, name)
        there = replace(exposure, **{name: nudged(value, 1)})
        yield Nudge(name, f"{value:g}", (relative(value),) * len(LEVELS), light, camera, there)
    for field in fields_of(Camera):
        value = value_of(camera, field)
        if field.split(".")[0] in UNUSED or nudged(value, 1) == value:  # a table of fields, a switch, a word
            continue
        one = isinstance(value, float)
        words, steps = (f"{value:g}", (relative(value),) * len(LEVELS)) if one else ("", ())
        yield Nudge(field, words, steps, light, changed(camera, field, value), exposure)


def changed(camera: Camera, field: str, value: Any) -> Camera:
    """One float32 step up; down at the upper end of a range."""
    try:
        return camera.replace(**{field: nudged(value, 1)})
    except InputError:
        return camera.replace(**{field: nudged(value, -1)})


def ulp(value: float) -> float:
    """Distance to the next float32."""
    return float(np.spacing(np.float32(abs(value))))


def relative(value: float) -> float:
    """That distance over the number; 0 for no number."""
    return ulp(value) / value if value else 0.0


def up(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Every number one float32 step up, but for zeros."""
    return np.array([nudged(x, 1) for x in values.ravel().tolist()]).reshape(values.shape)


def nudged(value: Any, direction: int) -> Any:
    """Every float in it one float32 step away, but for zeros, which are switches; all else as it is."""
    if isinstance(value, float):
        return value + direction * ulp(value) if value else value
    if isinstance(value, tuple):
        return tuple(nudged(x, direction) for x in value)
    if isinstance(value, dict):
        return {name: nudged(x, direction) for name, x in value.items()}
    return value


def value_of(camera: Camera, field: str) -> Any:
    """A field by its dotted name; None where a table of it is not there."""
    found: Any = camera
    for part in field.split("."):
        found = getattr(found, part, None)
    return found
