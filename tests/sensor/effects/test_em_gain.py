"""Electron multiplication: gain, excess noise and the law of the register of an EMCCD."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.special
import scipy.stats
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.camera.figures import emva_figures, saturation_dn, saturation_e
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.output.dng import noise_profile
from mitsuba_sensor.stages.effects.em_gain import EmGain

GAIN, ELEMENTS = 300.0, 536
EXCESS = 1.9756  # 2·299·300^(−537/536) + 1/300
BASE = ms.load_camera("eev_44_82").replace(
    **{
        "adc.full_scale_v": None,
        "adc.bits": 14,
        "adc.black_level_dn": 200.0,
        "readout.gain_dn_per_e": 1 / 15,
        "source_follower.read_noise_e": 50.0,
        "pixel.prnu": 0.0,
    }
)
EMCCD = BASE.replace(**{"readout.em_gain": GAIN, "readout.em_stages": ELEMENTS})
COLD = ms.Exposure(0.01, 170.0)
K = GAIN / 15


def light_of(electrons: float, shape: tuple[int, int] = (256, 256)) -> NDArray[np.float64]:
    """Photons of so many photoelectrons."""
    qe = EMCCD.qe([EMCCD.quantum_efficiency.reference_nm]).item()
    return np.full(shape, electrons / qe)


@pytest.mark.parametrize(
    ("gain", "elements"), [(300.0, 536), (1000.0, 604), (1.5, 20), (2.0, 1)]
)
def test_the_excess_noise_is_that_of_a_branching_process(gain: float, elements: int) -> None:
    """Element by element: mean' = (1 + p)·mean and variance' = (1 + p)²·variance + p(1 − p)·mean."""
    chance, mean, variance = (
        gain ** (1 / elements) - 1,
        1.0,
        1.0,
    )  # one electron, of Poisson noise
    for _ in range(elements):
        mean, variance = (
            (1 + chance) * mean,
            (1 + chance) ** 2 * variance + chance * (1 - chance) * mean,
        )
    assert EmGain(gain, elements).excess_noise == pytest.approx(variance / gain**2, rel=1e-9)


def test_the_law_of_few_electrons_is_near_that_of_the_register() -> None:
    """Kolmogorov distance below 0.02 of 20 000 pixels of 3 electrons that are multiplied element by element; chance
    alone makes more than 0.0163 once in 100."""
    random, chance = np.random.default_rng(6), GAIN ** (1 / ELEMENTS) - 1
    register = np.full(20_000, 3)
    for _ in range(ELEMENTS):
        register = register + random.binomial(register, chance)
    sampled = behind(np.full((200, 100), 3.0), EmGain(GAIN, ELEMENTS))
    assert scipy.stats.ks_2samp(register, sampled.ravel()).statistic < 0.02
    gamma = scipy.stats.gamma(3, scale=GAIN)
    assert scipy.stats.kstest(sampled.ravel(), gamma.cdf).statistic < 0.02


def behind(
    count: NDArray[np.float64], stage: EmGain, precision: str = "float64"
) -> NDArray[np.float64]:
    """What leaves the register."""
    backend = NUMPY_FLOAT64 if precision == "float64" else NUMPY_FLOAT32
    frame = ms.stages.Frame(COLD, SensorWindow(1, count.shape, backend=backend))
    found = stage.sample(ms.stages.Electrons(count.astype(precision), 0.0), frame)
    return np.asarray(found.total, np.float64)


@pytest.mark.parametrize("shape", [1e-6, 0.3, 0.999, 1.0, 1.02, 1.7, 3.0, 40.0, 1e4, 1e8, 1e30])
def test_gamma_numbers_in_float32_are_those_of_scipy(shape: float) -> None:
    """Within 1e-4 of σ, over random bits of all sizes; 1e-3 at the ends of the distribution."""
    bits = np.random.default_rng(7).integers(0, 2**32, 20_000, dtype=np.uint64)
    bits[:4] = 0, 1, 2**32 - 2, 2**32 - 1
    shapes = np.full(bits.shape, shape, np.float32)
    single, double = (
        backend.gamma_of_shape(bits.astype(np.uint32), shapes)
        for backend in (NUMPY_FLOAT32, NUMPY_FLOAT64)
    )
    assert single.dtype == np.float32
    rounding = 3e-7 * double
    off = np.maximum(np.abs(single - double) - rounding, 0) / np.float32(shape) ** 0.5
    assert off[4:].max() < 2e-4 and off.max() < 2e-3


def test_light_and_dark_electrons_are_multiplied_together() -> None:
    """Their sum is the output of the register, and each has the share that it has in front of it."""
    light, dark = np.full((20, 30), 30.0), np.full((20, 30), 10.0)
    frame = ms.stages.Frame(COLD, SensorWindow(1, light.shape))
    found = EmGain(GAIN, ELEMENTS).sample(ms.stages.Electrons(light, dark), frame)
    np.testing.assert_allclose(found.light, 3 * found.dark, rtol=1e-12)
    np.testing.assert_allclose(found.total, behind(light + dark, EmGain(GAIN, ELEMENTS)))


@pytest.mark.usefixtures("few_windows")
def test_read_noise_is_divided_by_the_gain_and_k_multiplied() -> None:
    plain, em = (emva_figures(camera, ms.Exposure(0.0, 170.0)) for camera in (BASE, EMCCD))
    assert em.temporal_dark_noise_e == pytest.approx(
        plain.temporal_dark_noise_e / GAIN, rel=0.015
    )
    assert em.system_gain_dn_per_e == pytest.approx(GAIN * plain.system_gain_dn_per_e)
    assert EMCCD.system_gain_dn_per_e == pytest.approx(K)
    assert em.saturation_e == pytest.approx((2**14 - 1 - 200) / K, rel=1e-3)
    still_e2 = (50.0 / GAIN) ** 2 + 1 / 12 / K**2
    least_e = EXCESS / 2 + (EXCESS**2 / 4 + still_e2) ** 0.5
    assert em.absolute_sensitivity_e == pytest.approx(least_e, rel=1e-3)
    assert em.snr_max == pytest.approx((em.saturation_e / EXCESS) ** 0.5, rel=1e-3)
    frames = ms.expose(light_of(100.0), EMCCD, COLD)
    assert frames.digital.mean() == pytest.approx(200.0 + 100.0 * K, rel=2e-3)
    assert frames.report["K_dn_per_e"] == pytest.approx(K)
    profile = noise_profile(frames)
    assert profile is not None
    assert profile[0] == pytest.approx(EXCESS * K / (saturation_dn(EMCCD) - 200.0), rel=1e-3)


def test_a_full_register_saturates_the_pixel() -> None:
    camera = EMCCD.replace(**{"readout.em_full_well_e": 90_000.0})
    assert saturation_e(camera) == pytest.approx(300.0)
    assert saturation_dn(camera) == 6200
    with pytest.warns(UserWarning, match="saturated"):
        frames = ms.expose(light_of(1000.0), camera, COLD, keep="electrons")
    assert frames.electrons is not None
    np.testing.assert_array_equal(frames.electrons, 90_000.0)


@pytest.mark.parametrize(
    ("electrons", "fields", "off"),
    [
        (0.2, {}, 0.006),
        (1.0, {"adc.black_level_dn": 10.0}, 0.004),
    ],
)
def test_clean_frame_and_its_variance_are_near_the_frames(
    electrons: float, fields: dict[str, Any], off: float
) -> None:
    """Mean within 0.004 σ, σ within 0.3 % where nothing clips, which are 3 and 4 standard errors of 2^19 pixels (0.2
    electrons have a long tail: 0.6 %), also where the converter clips dark pixels."""
    light = light_of(electrons, (128, 128))
    frames = ms.expose(light, EMCCD.replace(**fields), COLD, frames=32)
    codes, sigma = frames.digital.astype(float), frames.temporal_variance.mean() ** 0.5
    assert codes.std() / sigma == pytest.approx(
        1.0, abs=off + 0.01
    )  # what 32 frames of a lattice lack
    assert abs(codes.mean() - frames.clean.mean()) < 0.004 * sigma
