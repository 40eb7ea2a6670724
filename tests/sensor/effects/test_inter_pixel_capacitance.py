"""Inter-pixel capacitance: a 3 × 3 coupling of the charge behind the shot noise."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.engines import backend_of
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.inter_pixel_capacitance import InterPixelCapacitance

BASE = ms.load_camera("konnik_table1")
SIDE, CORNER = 0.02, 0.005
KERNEL = np.array([[CORNER, SIDE, CORNER], [SIDE, 0.9, SIDE], [CORNER, SIDE, CORNER]])
SHOT_NOISE_ALONE = BASE.replace(
    **{
        "pixel.prnu": 0.0,
        "dark_current.fom_na_per_cm2": 0.0,
        "readout.dsnu_col": 0.0,
        "source_follower.white_nv_per_rthz": 0.0,
        "adc.black_level_dn": 16.0,
    }
)
SHORT = ms.Exposure(0.1)


def coupled(
    charge: NDArray[np.float64], stage: InterPixelCapacitance, precision: str = "float64"
) -> NDArray[np.float64]:
    """What the sense nodes show of this charge."""
    backend = backend_of("float64" if precision == "float64" else "numpy")
    frame = ms.stages.Frame(SHORT, SensorWindow(1, charge.shape, backend=backend))
    found = stage.sample(ms.stages.Electrons(charge.astype(precision), 0.0), frame)
    return np.asarray(found.total, np.float64)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_one_bright_pixel_shows_the_kernel(precision: str) -> None:
    charge = np.zeros((7, 9))
    charge[3, 4] = 1e4
    shown = coupled(charge, InterPixelCapacitance(SIDE, CORNER), precision)
    expected = np.zeros_like(charge)
    expected[2:5, 3:6] = 1e4 * KERNEL
    np.testing.assert_allclose(shown, expected, rtol=1e-6)


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (1, 50), (50, 1), (2, 2), (30, 41)])
@pytest.mark.parametrize("stage", [(0.2, 0.0), (0.12, 0.1), (0.02, 0.005), (0.0, 0.1)])
def test_charge_is_conserved_and_a_flat_field_stays_flat_up_to_the_edge(
    shape: tuple[int, int], stage: tuple[float, float]
) -> None:
    """Also for the largest couplings that a camera file can have, on sensors of one pixel or one line."""
    charge = np.random.default_rng(4).uniform(0.0, 3e4, shape)
    assert coupled(charge, InterPixelCapacitance(*stage)).sum() == pytest.approx(
        charge.sum(), rel=1e-12
    )
    flat = coupled(np.full(shape, 1234.0), InterPixelCapacitance(*stage))
    np.testing.assert_allclose(flat, 1234.0, rtol=1e-12)
