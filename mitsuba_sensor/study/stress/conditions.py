"""Condition numbers: how far one float32 step of an input moves mean and noise, in float64 theory before rounding."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from ... import Camera, Exposure, InputError, Photons, list_cameras, load_camera
from ...core import Array, Float64Array
from ...sensor.datasheet_errors import fields_of
from .case import NAME, table1
from .whole import CURVES, NODE_OPTIONS

NOTICED_DN = 0.1  # A change of a mean that a careful measurement shows: a tenth of a code
LEVELS = {"dark": 0.0, "10 %": 0.1, "50 %": 0.5, "90 %": 0.9}  # shares of the full well of the most sensitive filter
EXPOSURES = (Exposure(0.1), Exposure(10.0))  # at 25 °C; the longer one lets the dark current fill a good part of a well
CURVED = {**NODE_OPTIONS, **CURVES, "adc.bits": 16, "source_follower.rtn_uv": 100.0}
UNUSED = ("name", "description", "sources", "lens", "sensor")  # by the chain: the lens is in the photons already


class Sensitivity(NamedTuple):
    """What one float32 step of one input does at one light level."""

    camera: str
    time_s: float
    level: str
    field: str
    value: float | None  # None where the input is many numbers
    mean_dn: float
    moved_dn: tuple[float, ...]  # mean, temporal σ and spatial σ

    @property
    def largest_dn(self) -> float:
        """The largest of the three."""
        return max(self.moved_dn)

    @property
    def number(self) -> float | None:
        """The condition number of the mean: its relative change over that of the input."""
        return self.moved_dn[0] / self.mean_dn * self.value / ulp(self.value) if self.mean_dn and self.value else None

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
    """Every shipped camera, and Table 1 with all curves and with 24 bits; the strongest input first."""
    cameras = {name: load_camera(name) for name in list_cameras()}
    cameras |= {"table 1, 16 bit, curved": load_camera(NAME).replace(**CURVED), "table 1, 24 bit": table1(adc__bits=24)}
    found = [one for name, camera in cameras.items() for e in EXPOSURES for one in of_camera(name, camera, e)]
    return sorted(found, key=lambda one: -one.largest_dn)


def of_camera(name: str, camera: Camera, exposure: Exposure) -> Iterator[Sensitivity]:
    """One camera and exposure, seen in a window with one tile of colour filters for each level, side by side."""
    tile, sensitivity = camera.tile, float(camera.qe([camera.quantum_efficiency.reference_nm or 0.0]).max())
    photons = np.array([*LEVELS.values()]) * camera.pixel.full_well_e / sensitivity
    light = Photons(np.tile(np.repeat(photons, len(tile[0])), (len(tile), 1)))
    here = outputs(light, camera, exposure)
    for field, value, changed in nudges(light, camera, exposure):
        moved = np.abs(outputs(*changed) - here)
        for k, level in enumerate(LEVELS):
            if moved[:, k].any():
                mean, change = float(here[0, k, moved[0, k].argmax()]), tuple(moved[:, k].max(axis=1).tolist())
                number = float(photons[k]) if field == "photons" else value
                yield Sensitivity(name, exposure.time_s, level, field, number, mean, change)


def outputs(light: Photons, camera: Camera, exposure: Exposure) -> Float64Array:
    """Mean, temporal σ and spatial σ, (3, levels, filters) [DN]."""
    shape = light.mean.shape[0], light.mean.shape[1]
    mean, temporal, spatial = expected_moments(camera.stages, light, exposure)
    whole = [mean, np.sqrt(temporal), np.sqrt(spatial)]
    return np.array([[part.ravel() for part in np.split(x, len(LEVELS), axis=1)] for x in whole])


Conditions = tuple[Photons, Camera, Exposure]


def nudges(light: Photons, camera: Camera, exposure: Exposure) -> Iterator[tuple[str, float | None, Conditions]]:
    """Every input, its value where that is one number, and everything with that input one float32 step away."""
    yield "photons", None, (replace(light, mean=light.mean + ulp(light.mean) * (light.mean > 0)), camera, exposure)
    for name in ("time_s", "temperature_k"):
        value = getattr(exposure, name)
        yield name, value, (light, camera, replace(exposure, **{name: nudged(value, 1)}))
    for field in (name for name in fields_of(Camera) if name.split(".")[0] not in UNUSED):
        value = attrgetter(field)(camera)
        if nudged(value, 1) == value:  # a table of fields, a switch, a text
            continue
        try:
            there = camera.replace(**{field: nudged(value, 1)})
        except InputError:  # the upper end of its range
            there = camera.replace(**{field: nudged(value, -1)})
        yield field, value if isinstance(value, float) else None, (light, there, exposure)


def ulp(value: Array) -> Array:
    """Distance to the next float32."""
    return np.spacing(np.abs(value).astype(np.float32)).astype(np.float64)


def nudged(value: Any, direction: int) -> Any:
    """Every float in it one float32 step away, but for zeros, which are switches; all else as it is."""
    match value:
        case float():
            return float(value + direction * ulp(value)) if value else value
        case tuple():
            return tuple(nudged(x, direction) for x in value)
        case dict():
            return {name: nudged(x, direction) for name, x in value.items()}
    return value


def strongest(found: Sequence[Sensitivity], each: int) -> list[Sensitivity]:
    """The inputs that move a camera most, so many of each camera, at the exposure and level where they do."""
    first: dict[tuple[str, str], Sensitivity] = {}
    for one in found:
        if (one.camera, one.field) in first or sum(camera == one.camera for camera, _ in first) < each:
            first.setdefault((one.camera, one.field), one)
    return list(first.values())
