"""Degree and angle of polarisation against what frames were made of, closed forms of their noise, and polanalyser."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.stats

from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.polarization import UNKNOWN_DEG, Polarization, polarization

ANGLES_DEG = ((90, 45), (135, 0))


def light_of(
    s0: float, dolp: float, aolp_deg: float, shape: tuple[int, int], ratio: float = 1e6
) -> np.ndarray:
    """Mean behind each polariser."""
    rows, columns = shape
    angles = np.radians(np.tile(ANGLES_DEG, (rows // 2, columns // 2)))
    contrast = (ratio - 1) / (ratio + 1)
    return s0 * (1 + contrast * dolp * np.cos(2 * (angles - math.radians(aolp_deg))))


@pytest.mark.parametrize("aolp_deg", [0.0, 77.0, 160.0])
@pytest.mark.parametrize(("dolp", "ratio"), [(0.05, 1e6), (0.4, 100.0), (1.0, 3.0)])
def test_degree_and_angle_are_those_of_the_light(
    dolp: float, ratio: float, aolp_deg: float
) -> None:
    stack = Stack(light_of(500.0, dolp, aolp_deg, (6, 8), ratio)[None] + 64, 0.1)
    known = {"black_dn": 64, "extinction_ratio": ratio, "variance_dn2": 0.0}
    measured = polarization(stack, ANGLES_DEG, **known)
    assert measured.s0.shape == (3, 4)
    np.testing.assert_allclose(measured.s0, 500, rtol=1e-12)
    for degree in (measured.dolp, measured.dolp_without_bias, measured.mean_dolp.value):
        np.testing.assert_allclose(degree, dolp, rtol=1e-9)
    for angle in (measured.aolp_deg, measured.mean_aolp.value):
        np.testing.assert_allclose((angle - aolp_deg + 90) % 180, 90, atol=1e-6)


@pytest.mark.parametrize("dolp", [0.0, 0.03, 0.5])
def test_error_bars_cover_and_the_bias_of_rice_is_taken_off(dolp: float) -> None:
    """Normal noise of one frame: mean of DoLP by Rice's law within three standard errors of 10 000 tiles, the estimate
    without bias nearer to the truth, and where the light is polarised well 66 to 70 % of degrees and angles within one
    error bar (68.3 %; three standard errors of 10 000 are 1.4 %)."""
    rng, sigma_dn, s0 = np.random.default_rng(7), 20.0, 1000.0
    light = light_of(s0, dolp, 25.0, (200, 200))
    frames = light + rng.normal(0, sigma_dn, (16, *light.shape))
    measured = polarization(Stack(frames[:1], 0.1), ANGLES_DEG, variance_dn2=sigma_dn**2)
    of_frames = polarization(Stack(frames, 0.1), ANGLES_DEG)
    sigma = sigma_dn / math.sqrt(2) / s0
    rice = scipy.stats.rice(dolp / sigma, scale=sigma)
    three = 3 * rice.std() / 100
    assert abs(measured.dolp.mean() - rice.mean()) < three + 1e-4 * dolp
    if not dolp:
        assert measured.dolp_without_bias.mean() < 0.85 * measured.dolp.mean()
        return
    bias = abs(rice.mean() - dolp)
    assert abs(np.mean(measured.dolp_without_bias) - dolp) < max(three, 0.2 * bias)
    assert of_frames.mean_dolp.covers(dolp) and of_frames.mean_aolp.covers(25.0)
    if dolp > 0.05:
        off_deg = (measured.aolp_deg - 25 + 90) % 180 - 90
        assert 0.66 < np.mean(abs(off_deg) < measured.aolp_error_deg) < 0.70
        assert 0.66 < np.mean(abs(measured.dolp - rice.mean()) < measured.dolp_error) < 0.70


@pytest.mark.exhaustive
def test_polanalyser_reads_the_frames_alike() -> None:
    """Its Stokes parameters of the four pictures behind each polariser."""
    polanalyser = pytest.importorskip("polanalyser")
    rng = np.random.default_rng(1)
    light = light_of(2000.0, 0.35, 110.0, (32, 48)) + rng.normal(0, 30, (32, 48))
    frame = np.clip(np.rint(light), 0, 4095)
    known = {"extinction_ratio": 1e9, "variance_dn2": 900.0}
    measured = polarization(Stack(frame[None], 0.1), ANGLES_DEG, **known)
    images = [frame[1::2, 1::2], frame[0::2, 1::2], frame[0::2, 0::2], frame[1::2, 0::2]]
    stokes = polanalyser.calcStokes(images, np.deg2rad([0, 45, 90, 135]))
    np.testing.assert_allclose(polanalyser.cvtStokesToDoLP(stokes), measured.dolp, rtol=1e-6)
    angle = np.rad2deg(polanalyser.cvtStokesToAoLP(stokes))
    np.testing.assert_allclose((angle - measured.aolp_deg + 90) % 180, 90, atol=1e-6)


def test_light_that_shows_no_polarisation_has_none() -> None:
    """No angle of light that is not polarised, no degree in the dark or where a pixel of the tile is saturated."""

    def of(frame: np.ndarray, **options: float) -> Polarization:
        stack = Stack(frame[None], 0.1, bits=12)
        return polarization(stack, ANGLES_DEG, variance_dn2=4.0, **options)

    assert of(np.full((2, 2), 100.0)).aolp_error_deg[0, 0] == pytest.approx(UNKNOWN_DEG)
    assert np.isnan([of(np.zeros((2, 2))).dolp, of(np.zeros((2, 2))).aolp_deg]).all()
    tile = np.array([[1000.0, 900.0], [900.0, 800.0]])
    frame = np.hstack([tile, np.minimum(10 * tile, 3935.0)])
    assert of(frame).dolp[0, 1] == pytest.approx(0.0, abs=1e-9)  # at the full well
    assert np.isnan(of(frame, saturation_dn=3900).dolp).tolist() == [[False, True]]
    full = of(np.hstack([tile, np.full((2, 2), 4095.0)]))
    assert np.isnan(full.dolp).tolist() == [[False, True]]
    assert full.mean_dolp.value == pytest.approx(of(tile).mean_dolp.value)
