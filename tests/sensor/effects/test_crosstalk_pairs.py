"""Crosstalk between two colours: shares of pixels behind one filter for those behind another one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.camera.colour_matrix import colour_matrix, flat_field_qe, standard_light

BAYER = ms.load_camera("bayer_2mp")
SHORT = ms.Exposure(0.1)
PAIRS_FIELD = "quantum_efficiency.crosstalk_pairs"


def cross(own: float, sides: float, corners: float) -> list[list[float]]:
    """A kernel that is alike on all sides."""
    return [[corners, sides, corners], [sides, own, sides], [corners, sides, corners]]


PAIRS = {
    "R": {"R": cross(0.9, 0, 0), "G": cross(0, 0.02, 0), "B": cross(0, 0, 0.003)},
    "G": {"G": cross(0.88, 0, 0.004), "R": cross(0, 0.03, 0), "B": cross(0, 0.015, 0)},
    "B": {"B": cross(0.95, 0, 0), "G": cross(0, 0.01, 0)},
}
MIXED = BAYER.replace(**{PAIRS_FIELD: PAIRS})


def mean_e(camera: ms.Camera, light: Any, **options: Any) -> NDArray[np.float64]:
    """Mean photoelectrons that the pixels collect."""
    frames = ms.expose(light, camera, SHORT, precision="float64", **options)
    return frames.theory.light.mean_e


@pytest.mark.parametrize("origin", [(0, 0), (1, 0), (3, 5)])
def test_a_flat_field_and_the_colour_matrix_mix_the_filters_in_closed_form(
    origin: tuple[int, int],
) -> None:
    """Of PAIRS: R' = 0.9 R + 4·0.03 G, G' = (0.88 + 4·0.004) G + 2·0.02 R + 2·0.01 B, B' = 0.95 B + 4·0.015 G +
    4·0.003 R; the curves that colours are made by are those of this matrix."""
    matrix = np.array([[0.9, 0.12, 0.0], [0.04, 0.896, 0.02], [0.012, 0.06, 0.95]])
    nm = np.array([450.0, 550.0, 620.0])
    light = ms.Photons(np.full((6, 7, 3), 1e3), nm)
    mixed = matrix @ BAYER.qe(nm).sum(axis=1) * 1e3
    found = mean_e(MIXED, light, origin=origin)
    np.testing.assert_allclose(found, mixed[BAYER.filter_index((6, 7), origin)], rtol=1e-12)
    np.testing.assert_allclose(flat_field_qe(MIXED, nm), matrix @ BAYER.qe(nm), rtol=1e-12)
    day = standard_light(BAYER, "D65")
    white = [colour_matrix(camera, day).white_balance for camera in (MIXED, BAYER)]
    assert np.abs(np.subtract(*white)).max() > 0.01
