"""Condition numbers: what one float32 step of an input moves in the frames' mean and temporal σ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

import mitsuba_sensor as ms

from ...pages.page import Section, table
from ..kit import Array
from .case import table1
from .frames import EACH_KIND, electrons_per_photon

STEP = 1e-3
"""Relative change of an input; what it moves is scaled to a step of float32."""

LEVELS = {"dark": 0.0, "10 %": 0.1, "50 %": 0.5, "90 %": 0.9}
"""Shares of the full well behind the most sensitive filter."""

EXPOSURE = ms.Exposure(10.0)
"""At 25 °C; long enough for a dark current that shows."""

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
    photons = (
        np.array([*LEVELS.values()]) * camera.pixel.full_well_e / electrons_per_photon(camera)
    )
    rows, columns = np.shape(camera.tile)
    light = np.tile(np.repeat(photons, columns), (rows, 1))
    here = mean_and_sigma(light, camera, EXPOSURE)
    time_s, kelvin = EXPOSURE.time_s, EXPOSURE.temperature_k
    moves = [
        ("photons", 1.0, mean_and_sigma(light * (1 + STEP), camera, EXPOSURE)),
        (
            "time_s",
            time_s,
            mean_and_sigma(light, camera, ms.Exposure(time_s * (1 + STEP), kelvin)),
        ),
        (
            "temperature_k",
            kelvin,
            mean_and_sigma(light, camera, ms.Exposure(time_s, kelvin * (1 + STEP))),
        ),
    ]
    for field, value, changed in changed_cameras(camera):
        moves.append((field, value, mean_and_sigma(light, changed, EXPOSURE)))
    strongest = []
    for field, value, there in moves:
        step = float(np.spacing(np.float32(abs(value)))) / abs(value) / STEP
        moved = (
            np.abs(there - here).reshape(2, rows, len(LEVELS), columns).max(axis=(1, 3)) * step
        )
        level = int(moved.max(axis=0).argmax())
        mean_dn = float(here[0].reshape(rows, len(LEVELS), columns)[:, level].mean())
        moved_dn = float(moved[0, level]), float(moved[1, level])
        strongest.append(Sensitivity(name, field, value, [*LEVELS][level], mean_dn, moved_dn))
    return sorted(strongest, key=lambda one: -one.largest_dn)


def mean_and_sigma(light: Array, camera: ms.Camera, exposure: ms.Exposure) -> Array:
    """Mean and temporal σ of every pixel in its exact law, (2, H, W) [DN]."""
    frames = ms.expose(light, camera, exposure, engine="numpy", precision="float64")
    return np.stack([np.float64(frames.clean), np.sqrt(np.float64(frames.temporal_variance))])


def changed_cameras(camera: ms.Camera) -> Iterator[tuple[str, float, ms.Camera]]:
    """Every field of the chain that is a number, but for 0, which is a switch: its name, its value, and the camera with
    the field a step larger, or smaller at the upper end of its range."""
    for table_name, fields in camera.model_dump().items():
        numbers = (
            fields.items() if isinstance(fields, dict) and table_name not in UNUSED else ()
        )
        for name, value in numbers:
            field = f"{table_name}.{name}"
            for factor in (1 + STEP, 1 - STEP) if isinstance(value, float) and value else ():
                try:
                    yield field, value, camera.replace(**{field: value * factor})
                    break
                except ms.InputError:
                    continue


def condition_section(found: Sequence[Sensitivity]) -> Section:
    """The inputs that move each camera's output most: in a sentence and in a table."""
    strongest = max(found, key=lambda one: one.largest_dn)
    finding = (
        f"The last bit of an input in float32 changes a mean or σ by {strongest.largest_dn:.2g} DN at most: "
        f"{strongest.field} of {strongest.camera}, {EXPOSURE.time_s:g} s, light {strongest.level} of the full well."
    )
    rows = []
    for camera in dict.fromkeys(one.camera for one in found):
        rows += [one for one in found if one.camera == camera][:5]
    numbers = table(
        "Condition numbers: what the last bit of an input in float32 changes",
        "camera | light, share of well | input | value [as in a camera file] | mean [DN] | mean changes by [DN] | "
        "temporal σ changes by [DN] | condition number of the mean [1]",
        (
            (
                "",
                (
                    one.camera,
                    one.level,
                    one.field,
                    one.value,
                    one.mean_dn,
                    *one.moved_dn,
                    one.condition,
                ),
            )
            for one in rows
        ),
        f"Exact laws of pixels at {EXPOSURE.time_s:g} s and 25 °C; a change of {STEP:g} of the input, scaled to a step "
        "of float32.",
    )
    return Section((finding,), True, (numbers,))
