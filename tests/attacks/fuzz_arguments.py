"""Calls the functions of the package with a strange value in the place of each of their arguments.

    python tests/attacks/fuzz_arguments.py

Each call is right or refused with InputError; anything else is a fault, and printed.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import mitsuba_sensor as ms

CAMERA, EXPOSURE, GREY = (
    ms.load_camera("konnik_table1"),
    ms.Exposure(0.01),
    np.full((4, 6), 100.0),
)
PHOTONS = ms.Photons(GREY[..., None], np.array([550.0]))
LIGHT = ms.uniform_light(1e-4, (4, 6))
VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        0,
        -1,
        2**70,
        1.5,
        -math.inf,
        math.nan,
        1j,
        "",
        "x",
        "9" * 5000,
        b"x",
        "\x00",
    ),
    *((), [], {}, {"a": 1}, [[1], [1, 2]], object(), int, len, range(3), Path("none"), CAMERA),
    *(np.zeros(0), np.zeros((0, 3)), np.full((4, 6), np.nan), np.array(["a"]), np.ma.zeros(3)),
    *(np.array([object()]), np.float32(1), np.datetime64("2020-01-01"), EXPOSURE, LIGHT),
)
CALLS: dict[Callable[..., Any], dict[str, Any]] = {
    ms.load_camera: {"name": "konnik_table1"},
    ms.check_camera: {"name": "konnik_table1"},
    ms.Exposure: {"time_s": 0.01, "temperature_k": 300.0},
    ms.Photons: {
        "values": GREY[..., None],
        "wavelengths_nm": np.array([550.0]),
        "detected": False,
    },
    ms.uniform_light: {"irradiance_w_per_m2": 1e-4, "shape": (4, 6)},
    ms.collect: {"light": LIGHT, "camera": CAMERA, "exposure": EXPOSURE},
    ms.expose: {
        **{"photons": PHOTONS, "camera": CAMERA, "exposure": EXPOSURE, "frames": 1, "seed": 1},
        **{"serial": 1, "engine": "numpy", "precision": "float32", "keep": ("volts",)},
        **{"maps": None, "origin": (0, 0), "tolerance_dn": None, "progress": False},
    },
    ms.capture: {"source": LIGHT, "camera": CAMERA, "exposure": EXPOSURE, "frames": 1},
    ms.plan: {"camera": CAMERA, "exposure": EXPOSURE, "photons": PHOTONS, "tolerance_dn": 0.1},
    ms.fpn_maps: {"camera": CAMERA, "shape": (4, 6), "serial": 1},
    ms.digital: {"image": GREY, "camera": CAMERA, "exposure": EXPOSURE, "sensor": None},
    ms.light_from_rgb: {"rgb": np.ones((4, 6, 3)), "camera": CAMERA, "unit": "cd_per_m2"},
    ms.read_irradiance: {
        "path": "none.exr",
        "unit": None,
        "wavelength_nm": None,
        "layer": None,
    },
    ms.Sensor: {"camera": CAMERA, "serial": 1},
    ms.AutoExposure: {"target": 0.18, "damping": 0.5, "delay": 2},
}
"""Function → right arguments, or those that are refused as they are, by name."""


def faults() -> tuple[list[str], Counter[str]]:
    """What is wrong, as sentences; and counts of results."""
    wrong, counts = list[str](), Counter[str]()
    for function, right in CALLS.items():
        for name in right:
            for value in VALUES:
                try:
                    with warnings.catch_warnings():
                        warnings.simplefilter("ignore")
                        function(**{**right, name: value})
                    counts["accepted"] += 1
                except ms.InputError as error:
                    counts["refused"] += 1
                    if "\n" in str(error) or len(str(error)) > 1500:
                        wrong.append(f"{function.__name__}({name}={value!r:.60}): {error}")
                except BaseException as error:  # what this is for
                    what = f"{type(error).__name__}: {str(error)[:200]}"
                    wrong.append(f"{function.__name__}({name}={value!r:.60}): {what}")
    return wrong, counts


if __name__ == "__main__":
    found, numbers = faults()
    print("\n".join([*found, str(dict(numbers))]))
    sys.exit(1 if found else 0)
