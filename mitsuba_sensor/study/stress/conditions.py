"""Condition numbers: how far one float32 step of an input moves an output, in digital numbers.

Everything here is float64 and theory: the moments of the chain, before the converter rounds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.errors import InputError
from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.sensor_window import SensorWindow
from ...core.signals import Photons
from ...sensor.camera import Camera, list_cameras, load_camera
from ...sensor.chain import chain
from ...sensor.datasheet_errors import fields_of
from ...sensor.theory import final_moments
from ..statistics import Array
from .case import table1
from .chains import CURVES, NODE_OPTIONS

NOTICED_DN = 0.1  # A change of a mean that a careful measurement shows: a tenth of a code
LEVELS = {"dark": 0.0, "10 %": 0.1, "50 %": 0.5, "90 %": 0.9}  # shares of the full well of the most sensitive filter
EXPOSURES = (Exposure(0.1), Exposure(10.0))  # at 25 °C; the longer one lets the dark current fill a good part of a well
CURVED = {**NODE_OPTIONS, **CURVES, "adc.bits": 16, "source_follower.rtn_uv": 100.0}
UNUSED = ("name", "description", "sources", "lens", "sensor")
"""Of a datasheet: what no number of the chain follows, and the lens, which is in the photons already."""


@dataclass(frozen=True)
class Sensitivity:
    """What one float32 step of one input does at one light level.

    step : relative to the input, None where that is many numbers.  mean_dn : the mean itself.
    moved_dn : by how much mean, temporal σ and spatial σ move.
    """

    camera: str
    time_s: float
    level: str
    field: str
    value: str
    step: float | None
    mean_dn: float
    moved_dn: tuple[float, ...]

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
    """Every camera, exposure, level and input that moves anything, the strongest first.

    The cameras are the shipped ones, and Table 1 with all curves bent and with as many bits as there may be.
    """
    cameras = {name: load_camera(name) for name in list_cameras()}
    cameras |= {"table 1, 16 bit, bent": table1(**CURVED), "table 1, 24 bit": table1(adc__bits=24)}
    found = [one for name, camera in cameras.items() for e in EXPOSURES for one in of_camera(name, camera, e)]
    return sorted(found, key=lambda one: -one.largest_dn)


def of_camera(name: str, camera: Camera, exposure: Exposure) -> Iterator[Sensitivity]:
    """One camera and exposure, seen in a window with one tile of colour filters for each level, side by side."""
    tile, sensitivity = camera.tile, float(camera.qe([camera.quantum_efficiency.reference_nm or 0.0]).max())
    photons = np.array([*LEVELS.values()]) * camera.pixel.full_well_e / sensitivity
    light = Photons(np.tile(np.repeat(photons, len(tile[0])), (len(tile), 1)))
    here = outputs(light, camera, exposure)
    for n in nudges(photons, light, camera, exposure):
        moved = np.abs(outputs(n.light, n.camera, n.exposure) - here)
        for k, level in enumerate(LEVELS):
            if moved[:, k].any():
                mean, step = float(here[0, k, moved[0, k].argmax()]), n.steps[k] if n.steps else None
                change = tuple(moved[:, k].max(axis=1).tolist())
                yield Sensitivity(name, exposure.time_s, level, n.field, n.value, step, mean, change)


def outputs(light: Photons, camera: Camera, exposure: Exposure) -> Array:
    """Mean, temporal σ and spatial σ, (3, levels, filters) [DN]."""
    shape = light.mean.shape[0], light.mean.shape[1]
    m, _ = final_moments(chain(camera), light, Frame(exposure, SensorWindow(0, shape)))
    whole = [np.broadcast_to(x, shape) for x in (m.mean, np.sqrt(m.temporal), np.sqrt(m.spatial))]
    return np.array([[part.ravel() for part in np.split(x, len(LEVELS), axis=1)] for x in whole])


@dataclass(frozen=True)
class Nudge:
    """Everything, with one input one float32 step away.  steps : relative to the input, for each level; or none."""

    field: str
    value: str
    steps: tuple[float, ...]
    light: Photons
    camera: Camera
    exposure: Exposure


def nudges(photons: Array, light: Photons, camera: Camera, exposure: Exposure) -> Iterator[Nudge]:
    """Light, exposure, and every number of the datasheet. photons : of each level."""
    brighter = np.vectorize(lambda x: nudged(float(x), 1))(light.mean)
    yield Nudge("photons", "", tuple(map(relative, photons)), replace(light, mean=brighter), camera, exposure)
    for name in ("time_s", "temperature_k"):
        value = getattr(exposure, name)
        longer = replace(exposure, **{name: nudged(value, 1)})
        yield Nudge(name, f"{value:g}", (relative(value),) * len(LEVELS), light, camera, longer)
    for field in fields_of(Camera):
        value = value_of(camera, field)
        if field.split(".")[0] in UNUSED or nudged(value, 1) == value:  # a table of fields, a switch, a text
            continue
        one = isinstance(value, float)
        shown, steps = (f"{value:g}", (relative(value),) * len(LEVELS)) if one else ("", ())
        try:
            there = camera.replace(**{field: nudged(value, 1)})
        except InputError:  # the upper end of its range
            there = camera.replace(**{field: nudged(value, -1)})
        yield Nudge(field, shown, steps, light, there, exposure)


def ulp(value: float) -> float:
    """Distance to the next float32."""
    return float(np.spacing(np.float32(abs(value))))


def relative(value: float) -> float:
    """That distance over the number; 0 for no number."""
    return ulp(value) / value if value else 0.0


def nudged(value: Any, direction: int) -> Any:
    """Every float in it one float32 step away, but for zeros, which are switches; all else as it is."""
    match value:
        case float():
            return value + direction * ulp(value) if value else value
        case tuple():
            return tuple(nudged(x, direction) for x in value)
        case dict():
            return {name: nudged(x, direction) for name, x in value.items()}
    return value


def value_of(camera: Camera, field: str) -> Any:
    """A field by its dotted name; None where a table of it is not there."""
    found: Any = camera
    for part in field.split("."):
        found = getattr(found, part, None)
    return found


def strongest(found: Sequence[Sensitivity], each: int) -> list[Sensitivity]:
    """The inputs that move a camera most, so many of each camera, at the exposure and level where they do."""
    first: dict[tuple[str, str], Sensitivity] = {}
    for one in found:
        first.setdefault((one.camera, one.field), one)
    inputs = list(first.values())
    return [one for k, one in enumerate(inputs) if sum(x.camera == one.camera for x in inputs[:k]) < each]
