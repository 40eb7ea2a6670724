"""Crosstalk: shares of the mean photoelectrons go to neighbours, behind the filters and before the shot noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.ndimage
from numpy.typing import NDArray

import mitsuba_sensor as ms

BASE = ms.load_camera("konnik_table1")
SHORT = ms.Exposure(0.1)
LOPSIDED = np.array([[0.005, 0.02, 0.01], [0.03, 0.85, 0.015], [0.0, 0.025, 0.002]])
FAR = np.pad(0.8 * LOPSIDED, 1) + np.diag([0.01, 0.0, 0.05, 0.0, 0.02])
MIXING = "quantum_efficiency.crosstalk"
MIXED = BASE.replace(**{MIXING: LOPSIDED.tolist()})


SPLIT = ms.load_camera("omnivision_split_pixel")
SMALL = np.array([[0.0, 0.04, 0.0], [0.05, 0.8, 0.02], [0.0, 0.06, 0.01]])
"""Of the small photodiode, which loses 2 % of its electrons."""


def split_pixel(large: Any = None, **of_small: Any) -> ms.Camera:
    """A split pixel: kernel of its large photodiode, and fields of its small one."""
    readouts = [readout.model_dump() for readout in SPLIT.readouts]
    readouts[-1]["fields"] |= {f"quantum_efficiency.{name}": x for name, x in of_small.items()}
    return SPLIT.replace(**{"readouts": readouts, MIXING: large})


def mean_e(
    camera: ms.Camera, light: Any, precision: str = "float64", **options: Any
) -> NDArray[np.float64]:
    """Mean photoelectrons that the pixels collect."""
    frames = ms.expose(light, camera, SHORT, precision=precision, **options)
    return frames.theory.light.mean_e


@pytest.mark.parametrize("kernel", [LOPSIDED, FAR])
@pytest.mark.parametrize("shape", [(30, 41), (1, 1), (1, 17), (17, 1), (2, 2), (3, 2)])
def test_scipy_convolves_the_mean_to_the_same_electrons(
    kernel: NDArray[np.float64], shape: tuple[int, int]
) -> None:
    """Also on sensors smaller than the kernel: its mirror is ours. A share that is lost is lost."""
    light = np.random.default_rng(2).uniform(0.0, 3e4, shape)
    alone = mean_e(BASE, light)
    mixed = mean_e(BASE.replace(**{MIXING: kernel.tolist()}), light)
    expected = scipy.ndimage.convolve(alone, kernel, mode="mirror")
    np.testing.assert_allclose(mixed, expected, rtol=1e-12)


def test_counts_stay_poisson_and_neighbours_independent() -> None:
    """Variance over mean is 1, and neighbours have no covariance, within 3 standard errors of 2^18 counts, √2/512 and
    1/512; a coupling of the counts would make them 0.79 and 0.06."""
    camera = MIXED.replace(
        **{"pixel.prnu": 0.0, "dark_current.fom_na_per_cm2": 0.0, "pixel.full_well_e": 1e9}
    )
    pair = ms.expose(
        np.full((512, 512), 4000.0), camera, SHORT, frames=2, keep="electrons"
    ).electrons
    assert pair is not None
    noise = (pair[1].astype(float) - pair[0]) / 2**0.5
    expected = 4000.0 * BASE.qe([550.0]).item() * LOPSIDED.sum()
    assert pair.mean() == pytest.approx(expected, rel=3 / np.sqrt(2 * expected) / 512)
    assert noise.var() / expected == pytest.approx(1.0, abs=3 * 2**0.5 / 512)
    for other in (np.roll(noise, 1, axis=0), np.roll(noise, 1, axis=1)):
        assert abs((noise * other).mean() / noise.var()) < 3 / 512


def readout_means_e(camera: ms.Camera, light: ms.Photons, **options: Any) -> dict[str, Any]:
    """Mean photoelectrons by read-out."""
    frames = ms.expose(light, camera, SHORT, precision="float64", **options)
    return {name: one.theory.light.mean_e for name, one in frames.readouts.items()}


@pytest.mark.parametrize("large", [None, LOPSIDED.tolist()])
def test_the_small_photodiode_of_a_split_pixel_has_a_crosstalk_of_its_own(large: Any) -> None:
    """SciPy convolves the means of each photodiode with its own kernel; both read-outs of the large one with its."""
    light_e = np.random.default_rng(5).uniform(0.0, 3e3, (20, 24))
    light = ms.Photons(light_e, detected=True)
    alone = readout_means_e(SPLIT, light)
    mixed = readout_means_e(split_pixel(large, crosstalk=SMALL.tolist()), light)
    kernels = dict.fromkeys(alone, np.eye(1) if large is None else LOPSIDED)
    kernels["small"] = SMALL
    for name, kernel in kernels.items():
        expected = scipy.ndimage.convolve(alone[name], kernel, mode="mirror")
        np.testing.assert_allclose(mixed[name], expected, rtol=1e-12)
