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
NAMES = BAYER.filter_names
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


def random_pairs(seed: int, side: int, tile: NDArray[np.intp]) -> dict[str, dict[str, Any]]:
    """Shares for all pairs, 0 where no pixel of the second filter lies, that add up to less than 1."""
    random, reach = np.random.default_rng(seed), side // 2
    found: dict[str, dict[str, Any]] = {}
    for source, name in enumerate(NAMES):
        kernels = random.uniform(0, 0.9 / side**2, (len(NAMES), side, side))
        kernels[source, reach, reach] = 0.2
        for (number, row, column), _ in np.ndenumerate(kernels):
            places = np.argwhere(tile == source)
            at = [(y + row - reach, x + column - reach) for y, x in places]
            there = {tile[y % len(tile), x % len(tile[0])] for y, x in at}
            if number not in there:
                kernels[number, row, column] = 0.0
        found[name] = {other: kernels[k].tolist() for k, other in enumerate(NAMES)}
    return found


def mean_e(camera: ms.Camera, light: Any, **options: Any) -> NDArray[np.float64]:
    """Mean photoelectrons that the pixels collect."""
    frames = ms.expose(light, camera, SHORT, precision="float64", **options)
    return frames.theory.light.mean_e


def by_loop(
    freed: NDArray[np.float64], pairs: dict[str, dict[str, Any]], tile: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Every pixel gives its shares to each one about it, written out; light at the edges is that of a mirror."""
    side = max(len(kernel) for one in pairs.values() for kernel in one.values())
    reach = side // 2
    wider = np.pad(freed, 2 * reach, mode="reflect")
    found = np.zeros(wider.shape)
    for (y, x), electrons in np.ndenumerate(wider):
        source = NAMES[tile[(y - 2 * reach) % len(tile), (x - 2 * reach) % len(tile[0])]]
        for row in range(-reach, reach + 1):
            for column in range(-reach, reach + 1):
                to = y + row, x + column
                if not (0 <= to[0] < wider.shape[0] and 0 <= to[1] < wider.shape[1]):
                    continue
                place = (to[0] - 2 * reach) % len(tile), (to[1] - 2 * reach) % len(tile[0])
                kernel = np.array(pairs[source].get(NAMES[tile[place]], [[0.0]]))
                inside = row + len(kernel) // 2, column + len(kernel) // 2
                if min(inside) >= 0 and max(inside) < len(kernel):
                    found[to] += kernel[inside] * electrons
    return found[2 * reach : -2 * reach, 2 * reach : -2 * reach]


@pytest.mark.parametrize("side", [3, 5])
def test_a_loop_over_all_pairs_of_pixels_collects_the_same_electrons(side: int) -> None:
    """Within 1e-12, of shares without any symmetry."""
    tile = BAYER.filter_index((2, 2))
    pairs = random_pairs(side, side, tile)
    light = np.random.default_rng(1).uniform(0.0, 5e3, (11, 14))
    expected = by_loop(mean_e(BAYER, light), pairs, tile)
    np.testing.assert_allclose(
        mean_e(BAYER.replace(**{PAIRS_FIELD: pairs}), light), expected, rtol=1e-12
    )


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
