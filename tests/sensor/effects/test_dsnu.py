"""Fixed offsets and gains of columns, rows and pixels: signal-independent, frame-independent, as strong as asked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.dsnu import DsnuColumn, DsnuPixel, DsnuRow
from mitsuba_sensor.stages.effects.prnu import PrnuColumn

TABLE1 = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)
SHAPE = (40, 60)
QUIET = {
    "readout.dsnu_col": 0.0,
    "pixel.prnu": 0.0,
    "dark_current.cv": 0.0,
    "adc.bits": 16,
    "adc.black_level_dn": 2000.0,
}
SOURCES = {
    "dsnu_col_e": ({"readout.dsnu_col": 0.001}, DsnuColumn),
    "dsnu_row_e": ({"readout.dsnu_row": 0.001}, DsnuRow),
    "dsnu_pixel_e": ({"pixel.dsnu_e": 33.0}, DsnuPixel),
    "coupled dsnu_col_e": (
        {"readout.dsnu_col": 0.001, "readout.dsnu_col_coupling": 0.25},
        DsnuColumn,
    ),
    "coupled dsnu_row_e": (
        {"readout.dsnu_row": 0.001, "readout.dsnu_row_coupling": 0.45},
        DsnuRow,
    ),
    "coupled dsnu_pixel_e": ({"pixel.dsnu_e": 33.0, "pixel.dsnu_coupling": 0.25}, DsnuPixel),
}
"""Each of 33 e-: 0.1 % of Table 1's full well."""


def camera_with(change: dict[str, Any]) -> ms.Camera:
    return TABLE1.replace(**QUIET | change)


def volts(camera: ms.Camera, light: Any, **how: Any) -> Any:
    """Swing at the converter, frame by frame, in float64."""
    return ms.expose(light, camera, EXPOSURE, keep=["volts"], precision="float64", **how).volts


@pytest.mark.parametrize("residual", [0.0, 0.25, 1.0])
def test_the_analogue_cds_leaves_its_share_of_dsnu_col_and_dsnu_pixel_and_all_of_dsnu_row(
    residual: float,
) -> None:
    """A row's offset comes after the CDS; residual 0 is, bit for bit, a camera without the offsets."""
    dark = np.zeros(SHAPE)
    for name in ("dsnu_col_e", "dsnu_pixel_e", "dsnu_row_e"):
        whole = camera_with(SOURCES[name][0])
        none = volts(camera_with({}), dark)
        left = volts(whole.replace(**{"readout.dsnu_residual": residual}), dark) - none
        share = 1.0 if name == "dsnu_row_e" else residual
        np.testing.assert_allclose(left, share * (volts(whole, dark) - none), atol=1e-15)
        if share == 0:
            np.testing.assert_array_equal(left, 0.0)


def test_the_four_patterns_of_one_camera_are_independent() -> None:
    """|ρ| < 5/√n between any two sources' lines and between neighbouring serials."""
    n = 20_000
    lines = [
        stage.fpn_maps(SensorWindow(serial, (1, n) if axis else (n, 1)))[name].ravel()
        for serial in (1, 2)
        for stage, name, axis in (
            (DsnuColumn(1.0, 1.0), "dsnu_col_e", 1),
            (DsnuRow(1.0, 1.0), "dsnu_row_e", 0),
            (DsnuPixel(1.0, 1.0), "dsnu_pixel_e", 1),
            (PrnuColumn(1.0), "prnu_col", 1),
        )
    ]
    rho = np.corrcoef(lines) - np.eye(8)
    assert np.abs(rho).max() < 5 / math.sqrt(n)


# The paper's CDS (4.9): subtract a frame, in signed numbers.
