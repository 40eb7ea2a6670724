"""Condition numbers: what one float32 step of an input moves in the frames' mean and temporal σ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

import mitsuba_sensor as ms

from ..kit import Array
from ..page import Bars, Section, table
from .case import table1
from .frames import EACH_KIND, electrons_per_photon

STEP = 1e-3
"""Relative change of an input; what it moves is scaled to a step of float32."""

LEVELS = {"dark": 0.0, "10 %": 0.1, "50 %": 0.5, "90 %": 0.9}
"""Shares of the full well behind the most sensitive filter."""

EXPOSURE = ms.Exposure(10.0)
"""At 25 °C; long enough for a dark current that shows."""

NOTICED_DN = 0.1
"""A change of a mean that a careful measurement shows: a tenth of a code."""

UNUSED = ("name", "description", "sources", "lens", "sensor", "gain", "gains")
"""Tables that the chain does not use: the lens is in the photons already."""

SHOWN_BARS, SHOWN_ROWS = 3, 5
QUANTITIES = ("mean", "temporal σ")


class Sensitivity(NamedTuple):
    """What one float32 step of one input does at one light level."""

    camera: str
    field: str
    value: float
    level: str
    mean_dn: float
    moved_dn: tuple[float, float]  # mean and temporal σ

    @property
    def largest_dn(self) -> float:
        """The larger of the two."""
        return max(self.moved_dn)

    @property
    def condition(self) -> float:
        """The condition number of the mean: its relative change over that of the input."""
        relative_step = float(np.spacing(np.float32(abs(self.value)))) / abs(self.value)
        return self.moved_dn[0] / self.mean_dn / relative_step if self.mean_dn else 0.0


def cameras() -> dict[str, ms.Camera]:
    """A shipped camera of each kind, and Table 1's with 24 bits."""
    shipped = {name: ms.load_camera(name) for name in EACH_KIND}
    return {**shipped, "table 1, 24 bit": table1(adc__bits=24)}


def sensitivities(name: str) -> list[Sensitivity]:
    """All inputs of a camera, the strongest first."""
    camera = cameras()[name]
    photons = np.array([*LEVELS.values()]) * camera.pixel.full_well_e / electrons_per_photon(camera)
    rows, columns = np.shape(camera.tile)
    light = np.tile(np.repeat(photons, columns), (rows, 1))
    here = mean_and_sigma(light, camera, EXPOSURE)
    moves = [
        ("photons", 1.0, mean_and_sigma(light * (1 + STEP), camera, EXPOSURE)),
        ("time_s", EXPOSURE.time_s, mean_and_sigma(light, camera, stretched(1 + STEP, 1.0))),
        ("temperature_k", EXPOSURE.temperature_k, mean_and_sigma(light, camera, stretched(1.0, 1 + STEP))),
    ]
    for field, value, changed in changed_cameras(camera):
        moves.append((field, value, mean_and_sigma(light, changed, EXPOSURE)))
    strongest = []
    for field, value, there in moves:
        step = float(np.spacing(np.float32(abs(value)))) / abs(value) / STEP
        moved = np.abs(there - here).reshape(2, rows, len(LEVELS), columns).max(axis=(1, 3)) * step
        level = int(moved.max(axis=0).argmax())
        mean_dn = float(here[0].reshape(rows, len(LEVELS), columns)[:, level].mean())
        moved_dn = float(moved[0, level]), float(moved[1, level])
        strongest.append(Sensitivity(name, field, value, [*LEVELS][level], mean_dn, moved_dn))
    return sorted(strongest, key=lambda one: -one.largest_dn)


def stretched(time: float, temperature: float) -> ms.Exposure:
    """The exposure with time and temperature times these."""
    return ms.Exposure(EXPOSURE.time_s * time, EXPOSURE.temperature_k * temperature)


def mean_and_sigma(light: Array, camera: ms.Camera, exposure: ms.Exposure) -> Array:
    """Mean and temporal σ of every pixel in its exact law, (2, H, W) [DN]."""
    frames = ms.expose(light, camera, exposure, engine="numpy", precision="float64")
    return np.stack([np.float64(frames.clean[0]), np.sqrt(np.float64(frames.temporal_variance))])


def changed_cameras(camera: ms.Camera) -> Iterator[tuple[str, float, ms.Camera]]:
    """Every field of the chain that is a number, but for 0, which is a switch: its name, its value, and the camera
    with a step of it."""
    for table_name, fields in camera.model_dump().items():
        numbers = fields.items() if isinstance(fields, dict) and table_name not in UNUSED else ()
        for name, value in numbers:
            if isinstance(value, float) and value:
                field = f"{table_name}.{name}"
                yield from ((field, value, changed) for changed in moved_field(camera, field, value))


def moved_field(camera: ms.Camera, field: str, value: float) -> list[ms.Camera]:
    """The camera with a field a step larger, or smaller at the upper end of its range."""
    for factor in (1 + STEP, 1 - STEP):
        try:
            return [camera.replace(**{field: value * factor})]
        except ms.InputError:
            continue
    return []


def condition_section(found: Sequence[Sensitivity]) -> Section:
    """The inputs that move each camera's output most: in a sentence, as bars and in a table."""
    strongest = max(found, key=lambda one: one.largest_dn)
    finding = (
        f"One float32 step of an input moves a mean or σ by {strongest.largest_dn:.2g} DN at most: {strongest.field} "
        f"of {strongest.camera}, {EXPOSURE.time_s:g} s, light {strongest.level} of the full well."
    )
    by_camera = {one.camera: [other for other in found if other.camera == one.camera] for one in found}
    bars = [one for some in by_camera.values() for one in some[:SHOWN_BARS]]
    rows = [one for some in by_camera.values() for one in some[:SHOWN_ROWS]]
    labels = tuple(f"{one.camera}: {one.field}, {one.level}" for one in bars)
    series = {name: tuple(one.moved_dn[k] or None for one in bars) for k, name in enumerate(QUANTITIES)}
    level = NOTICED_DN, f"{NOTICED_DN:g} DN"
    picture = Bars("What one float32 step of an input moves", "change [DN]", labels, series, log_x=True, level=level)
    numbers = table(
        "Condition numbers: what one float32 step of an input does",
        "camera | light, share of well | input | value [as in a camera file] | mean [DN] | mean moves [DN] | "
        "temporal σ moves [DN] | condition number of the mean [1]",
        (
            ("", (one.camera, one.level, one.field, one.value, one.mean_dn, *one.moved_dn, one.condition))
            for one in rows
        ),
        f"Exact laws of pixels at {EXPOSURE.time_s:g} s and 25 °C; a change of {STEP:g} of the input, scaled to a step "
        "of float32.",
    )
    return Section((finding,), True, (picture, numbers))
