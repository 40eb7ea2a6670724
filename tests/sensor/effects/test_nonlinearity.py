"""The three curves of the signal path, all on the swing: V/e of the sense node, V/V of the follower, γ of the ADC.

Closed forms, inverses and slopes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.chain import chain
from mitsuba_sensor.stages.effects.integral_nonlinearity import (
    IntegralNonlinearity,
    end_point_ile,
    gamma_of_ile,
)
from mitsuba_sensor.stages.effects.sense_node import NonlinearSenseNode
from mitsuba_sensor.stages.effects.source_follower import (
    NonlinearSourceFollower,
)
from mitsuba_sensor.stages.gains import full_scale_v, gain_dn_per_e

TABLE1 = ms.load_camera("konnik_table1")
HERE = ms.stages.Frame(ms.Exposure(0.1), SensorWindow(3, (1, 5)))
A_SN, V_REF = 5e-6, 3.1


def swing_of(stage: Any, electrons: Any) -> Any:
    return np.ravel(
        stage.sample(
            ms.stages.Electrons(np.atleast_2d(np.asarray(electrons, dtype=float))), HERE
        )
    )


# V/e (4.6)


def test_the_full_sense_node_curve_loses_2_6_percent_at_table_1s_full_well() -> None:
    """α = 1, 33 000 e-, V_REF 3.1 V, 5 µV/e-: S/(A_SN·N) − 1 = −2.61469554e-2."""
    (swing,) = swing_of(NonlinearSenseNode(A_SN, V_REF, 1.0), 33_000)
    assert swing / (A_SN * 33_000) - 1 == pytest.approx(-2.61469554e-2, rel=1e-8)


@pytest.mark.parametrize("alpha", [1e-9, 0.01, 0.5, 1.0])
def test_the_inverse_of_the_sense_node_returns_the_electrons(alpha: float) -> None:
    """N = −V_REF/(α·A_SN)·log1p(−α·S/V_REF), from one electron to ten full wells."""
    electrons = np.array([0.0, 1.0, 100.0, 33_000.0, 330_000.0])
    swing = swing_of(NonlinearSenseNode(A_SN, V_REF, alpha), electrons)
    np.testing.assert_allclose(
        -V_REF / (alpha * A_SN) * np.log1p(-alpha * swing / V_REF), electrons, rtol=1e-12
    )


# V/V (4.5)


def test_the_follower_gains_5_percent_at_full_well_and_half_of_that_half_way() -> None:
    """γ = 1.05: ratio 1 for small signals, 1.025 at half scale, 1.05 at full well; A_SF in front."""
    stage, full = NonlinearSourceFollower(0.9, 1.05, 0.165), 0.165
    for share, ratio in ((1e-9, 1.0), (0.5, 1.025), (1.0, 1.05)):
        assert float(stage.sample(full * share, HERE)) / (0.9 * full * share) == pytest.approx(
            ratio, rel=1e-9
        )
    assert float(stage.sample(0.0, HERE)) == 0.0


CURVES = {
    "V/V 1.05": {"source_follower.vv_nonlinearity": 1.05},
    "V/V 0.8": {"source_follower.vv_nonlinearity": 0.8},
    "V/e": {"readout.ve_nonlinearity": 1.0, "readout.v_ref_v": 0.5},
    "all": {
        "readout.ve_nonlinearity": 0.7, "readout.v_ref_v": 1.0, "source_follower.vv_nonlinearity": 1.1,
        "source_follower.gain": 0.8, "readout.cds_gain": 3.0,
    },
}  # fmt: skip


def swings_of(camera: ms.Camera, electrons: Any) -> Any:
    """What the converter is given for these electrons, without noise: the deterministic stages of the chain [V]."""
    stages = chain(camera)
    first = next(i for i, stage in enumerate(stages) if stage.domain == "volts")
    quiet = [
        x
        for x in stages[first:-1]
        if type(x).__name__.endswith(("SenseNode", "Follower", "Gain"))
    ]
    signal: Any = ms.stages.Electrons(np.atleast_2d(electrons))
    for stage in quiet:
        signal = stage.sample(signal, HERE)
    return np.ravel(signal)


@pytest.mark.parametrize("name", CURVES)
def test_the_code_range_ends_at_the_swing_of_a_full_well_with_its_curves(name: str) -> None:
    """V_FS is what the stages make of a full well, to 1e-12; K stays the slope of small signals."""
    camera = TABLE1.replace(**CURVES[name])
    (full,) = swings_of(camera, [33_000.0])
    assert full_scale_v(camera) == pytest.approx(full, rel=1e-12)
    (small,) = swings_of(camera, [1e-4])
    assert small / 1e-4 * 4096 / full == pytest.approx(gain_dn_per_e(camera), rel=1e-6)


# ADC γ (4.4)


def deviation_from_end_points(gamma: float) -> Any:
    """The curve less the straight line through both its ends, over a fine ramp of full scale 1."""
    x = np.linspace(0, 1, 100_001)
    y = IntegralNonlinearity(gamma, 1.0).sample(x, HERE)
    return y - x * y[-1], y[-1]


def test_gamma_1_04_is_an_end_point_error_of_39_codes_and_4_percent_needs_1_16633() -> None:
    """The curve itself, on a ramp: 39.0 of 4095 codes, 0.99 % of its own end; the closed form says the same."""
    error, end = deviation_from_end_points(1.04)
    assert 4095 * error.max() == pytest.approx(39.0, abs=0.05)
    assert error.max() / end == pytest.approx(0.0099, abs=5e-5)
    assert end_point_ile(1.04) == pytest.approx(error.max() / end, rel=1e-8)
    assert gamma_of_ile(0.04) == pytest.approx(1.16633, abs=5e-6)
