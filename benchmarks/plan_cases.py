"""Draw random cameras, exposures and scenes that are hard for a plan: few bright pixels, lines, tails, mosaics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms

WIDEST, NARROWEST, PIXELS = 400, 16, 40_000
"""Columns of a window, and pixels at most."""

TOLERANCES_DN = 0.005, 5.0

OF_CMOS = "source_follower.rtn_uv", "readout.ktc_residual"

SCENES = (
    "flat",
    "dark",
    "ramp",
    "bright minority",
    "one saturated pixel",
    "bright line",
    "dim",
)


@dataclass(frozen=True)
class Case:
    """A camera, its exposure, a scene, and the tolerance of the plan."""

    number: int
    camera: ms.Camera
    exposure: ms.Exposure
    photons: ms.Photons
    tolerance_dn: float
    scene: str


def case(number: int) -> Case:
    """The same for the same number, on every machine."""
    chance = np.random.default_rng([13, number])
    base = ms.load_camera(str(chance.choice(one_readout())))
    exposure = ms.Exposure(float(10 ** chance.uniform(-4, 1)), float(chance.uniform(250, 330)))
    camera = base.replace(**_fields(chance, base, exposure))
    scene = str(chance.choice(SCENES))
    columns = int(np.exp(chance.uniform(np.log(NARROWEST), np.log(WIDEST + 1))))
    rows = int(np.exp(chance.uniform(np.log(8), np.log(min(WIDEST, PIXELS // columns) + 1))))
    photons = _photons(chance, camera, _scene(chance, scene, (rows, columns)))
    tolerance = float(np.exp(chance.uniform(*np.log(TOLERANCES_DN))))
    return Case(number, camera, exposure, photons, tolerance, scene)


def one_readout() -> list[str]:
    """Shipped cameras that can have a plan: those that read every pixel once."""
    return [name for name in ms.list_cameras() if not ms.load_camera(name).readouts]


def _fields(
    chance: np.random.Generator, base: ms.Camera, exposure: ms.Exposure
) -> dict[str, Any]:
    """Fields of the camera: each left as it is, set to zero, or drawn over many decades."""
    wide = {
        "pixel.prnu": (1e-6, 0.1),
        "source_follower.vv_nonlinearity": None,
        "source_follower.rtn_uv": (0.1, 1e3),
        "readout.ve_nonlinearity": (1e-6, 0.3),
        "readout.ktc_residual": (1e-4, 1.0),
        "dark_current.cv": (1e-3, 3.0),
        "dark_current.rts_fraction": (1e-5, 0.3),
    }
    if base.sensor.technology == "cmos":
        wide |= {
            "readout.dsnu_col": (1e-8, 1e-2),
            "readout.dsnu_row": (1e-8, 1e-2),
            "readout.prnu_col": (1e-7, 0.05),
            "pixel.dsnu_e": (1e-3, 100.0),
            "readout.row_noise_e": (1e-3, 30.0),
            "readout.column_noise_e": (1e-3, 30.0),
        }
    fields: dict[str, Any] = {}
    for name, ends in wide.items():
        kind = chance.integers(3)
        if name == "source_follower.vv_nonlinearity":
            fields[name] = float(chance.choice([1.0, 1 + 1e-7, 1.0005, 1.02, 1.1]))
        elif kind and ends is not None:
            fields[name] = float(np.exp(chance.uniform(*np.log(ends)))) if kind == 2 else 0.0
    if base.sensor.technology == "ccd":
        fields = {name: value for name, value in fields.items() if name not in OF_CMOS}
    if fields.get("dark_current.rts_fraction"):
        step_e = float(10 ** chance.uniform(-2, 4))
        fields["dark_current.rts_amplitude_e_per_s"] = step_e / exposure.time_s
        fields["dark_current.rts_duty"] = float(chance.uniform(0.01, 0.99))
        fields["dark_current.rts_switching"] = 1.0
    if fields.get("readout.ve_nonlinearity"):
        fields["readout.ve_nonlinearity"] = min(fields["readout.ve_nonlinearity"], 0.2)
    fields["pixel.prnu_distribution"] = str(chance.choice(["gaussian", "lognormal"]))
    fields["dark_current.distribution"] = str(
        chance.choice(["lognormal", "gamma", "wald", "logistic"])
    )
    if chance.random() < 0.25:
        weight, low = float(10 ** chance.uniform(-6, -1)), float(10 ** chance.uniform(-2, 5))
        part = {"weight": weight, "family": "uniform", "low": low, "high": low * 3, "unit": "e"}
        fields["dark_current.components"] = [part]
    fields["adc.bits"] = int(chance.choice([6, 8, 10, 12, 14, 16]))
    fields["adc.black_level_dn"] = None  # that of the camera may lie above these codes
    if chance.random() < 0.4:
        fields["adc.black_level_dn"] = float(
            chance.integers(0, 1 + 2 ** fields["adc.bits"] // 8)
        )
    return fields


def _scene(
    chance: np.random.Generator, name: str, shape: tuple[int, int]
) -> NDArray[np.float64]:
    """Light as a share of that which fills the well."""
    top = float(10 ** chance.uniform(-4, 0.5))
    low = top * float(10 ** chance.uniform(-4, -0.5)) * (chance.random() < 0.8)
    scene = np.full(shape, low)
    if name == "flat":
        scene[:] = top
    elif name == "dark":
        scene[:] = 0.0
    elif name == "dim":
        scene[:] = top * 1e-4
    elif name == "ramp":
        scene = np.tile(np.linspace(0, top, shape[1]), (shape[0], 1))
    elif name == "bright minority":
        scene[chance.random(shape) < 10 ** chance.uniform(-4, -1)] = top
    elif name == "one saturated pixel":
        scene[chance.random(shape) < 0.01] = low * 3
        scene[0, 0] = 3.0
    else:
        scene[shape[0] // 2] = top
    return scene


def _photons(
    chance: np.random.Generator, camera: ms.Camera, scene: NDArray[np.float64]
) -> ms.Photons:
    """Photons of no wavelength, or of one between the ends of the QE curves."""
    well = camera.pixel.full_well_e
    if chance.random() < 0.4:
        return ms.Photons(scene * well)
    low, high = camera.band_nm
    wavelength = float(chance.uniform(low, high))
    return ms.Photons((scene * well / 0.6)[..., None], np.array([wavelength]))
