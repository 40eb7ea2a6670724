"""Strips of rows in which frames are computed: neither bytes nor memory depend on how high they are."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from helpers import KEEP

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import Backend
from mitsuba_sensor.sensor import run

TABLE1 = ms.load_camera("konnik_table1")
SHAPE = (13, 17)
TILE_EDGE = (506, 40)
"""Here two tiles of a coupled map meet inside the window."""

ONE_BAND = np.linspace(0.0, 70_000.0, SHAPE[0] * SHAPE[1]).reshape(SHAPE)
THREE_BANDS = ONE_BAND[..., None] * [0.2, 0.5, 0.3]
BANDS: dict[str, Any] = {"wavelengths_nm": [460.0, 550.0, 820.0]}
UNIFORM = {"weight": 0.2, "family": "uniform", "low": 45, "high": 440, "unit": "dn"}
NORMAL = {"weight": 0.3, "family": "normal", "mean": 400, "sigma": 50, "unit": "e_per_s"}
OPTIONS: dict[str, dict[str, Any]] = {
    "coupled maps": {
        "pixel.prnu_distribution": "ar",
        "pixel.prnu_coupling": 0.25,
        "pixel.dsnu_e": 20.0,
        "pixel.dsnu_coupling": 0.45,
        "dark_current.distribution": "ar",
        "dark_current.cv": 0.3,
        "dark_current.coupling": 0.4,
    },
    "coupled lines": {
        "readout.dsnu_col_coupling": 0.4999,
        "readout.dsnu_row": 0.002,
        "readout.dsnu_row_coupling": 0.25,
        "readout.prnu_col": 0.02,
        "readout.prnu_col_coupling": 0.25,
    },
    "RTS pixels": {
        "dark_current.rts_fraction": 0.5,
        "dark_current.rts_amplitude_e_per_s": 9000.0,
    },
    "superimposed components": {"dark_current.components": [UNIFORM, NORMAL]},
    "inverse Gaussian dark": {"dark_current.distribution": "wald", "dark_current.cv": 0.4},
    "curves and steps": {
        "source_follower.vv_nonlinearity": 1.05,
        "readout.ve_nonlinearity": 1.0,
        "adc.ile": 0.01,
        "adc.dnl_lsb": {"300": -1.0, "301": 0.7},
    },
    "quantum yield": {"quantum_efficiency.quantum_yield": [2.0, 1.2]},
}
EVERYTHING = {
    name: x
    for case, changes in OPTIONS.items()
    if case != "coupled maps"
    for name, x in changes.items()
}
CASES: dict[str, tuple[ms.Camera, Any, dict[str, Any]]] = {
    "coupled maps": (TABLE1.replace(**OPTIONS["coupled maps"]), ONE_BAND, {}),
    "everything at once": (TABLE1.replace(**EVERYTHING), ONE_BAND, {}),
    "bayer_2mp": (ms.load_camera("bayer_2mp"), THREE_BANDS, BANDS),
}


def signals(
    case: str, strip: int, monkeypatch: pytest.MonkeyPatch, **more: Any
) -> dict[str, bytes]:
    """Everything that expose() can return, byte by byte."""
    camera, light, options = CASES[case]
    monkeypatch.setattr(Backend, "strip_pixels", strip)
    asked: dict[str, Any] = {
        "seed": 3,
        "serial": 7,
        "frames": 2,
        "first_frame": 5,
        "origin": TILE_EDGE,
    }
    frames = ms.expose(light, camera, ms.Exposure(0.3), keep=KEEP, **(asked | options | more))
    return {name: getattr(frames, name).tobytes() for name in (*KEEP, "digital")}


@pytest.mark.parametrize("case", CASES)
def test_no_byte_depends_on_the_height_of_the_strips(
    case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One row at a time for a strip smaller than a row, four rows with one left over, and all at once."""
    whole = signals(case, 10**9, monkeypatch)
    for strip in (1, 4 * SHAPE[1] + 3):
        assert signals(case, strip, monkeypatch) == whole


def test_given_maps_are_cut_into_the_same_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    """Maps of pixels, of rows, of columns, and one number for all; each with the rows of its own strip."""
    draw = np.random.default_rng(2)
    height, width = SHAPE
    maps = {
        "prnu": draw.uniform(0.9, 1.1, (height, width)),
        "dark_fpn": draw.uniform(0.5, 1.5, (height, 1)),
        "dsnu_pixel_e": draw.normal(0, 20, (1, width)),
        "dsnu_row_e": draw.normal(0, 20, (height, 1)),
        "dsnu_col_e": draw.normal(0, 20, (1, width)),
        "prnu_col": np.full((1, 1), 1.1),
    }
    whole = signals("coupled maps", 10**9, monkeypatch, maps=maps)
    assert whole != signals("coupled maps", 10**9, monkeypatch)
    for strip in (1, 4 * width + 3):
        assert signals("coupled maps", strip, monkeypatch, maps=maps) == whole


def peak_mib(pixels: int) -> float:
    """Most memory in use at a time while a full-chain frame is made from one number, in MiB."""
    camera = TABLE1.replace(**{"sensor.rows": pixels // 2000, "sensor.columns": 2000})
    tracemalloc.start()
    try:
        ms.expose(20_000.0, camera, ms.Exposure(0.1))
        return tracemalloc.get_traced_memory()[1] / 2**20
    finally:
        tracemalloc.stop()


def test_twelve_megapixels_fit_into_400_mib(monkeypatch: pytest.MonkeyPatch) -> None:
    """From ½ and 1 Mpx on a straight line: 8 bytes of light, 4 of photoelectrons, 2 of mask, 2 of code per pixel.

    (And one strip in flight; without strips it is above 100 bytes per pixel. One thread, so that what is in flight is
    the same in both.)
    """
    monkeypatch.setattr(run, "processors", lambda: 1)
    one, two = peak_mib(500_000), peak_mib(1_000_000)
    per_pixel = (two - one) * 2**20 / 500_000
    assert per_pixel <= 16.5
    assert two + 11_000_000 * per_pixel / 2**20 < 400
