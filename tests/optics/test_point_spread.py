"""Point spread against textbook numbers, transforms between closed forms, and independent code."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy
from helpers.marks import one_in

from mitsuba_sensor.optics.point_spread import (
    airy_diameter_um,
    aperture_mtf,
    diffraction_mtf,
    encircled_energy,
    first_zero,
    point_spread,
    point_spread_tables,
)

OBSTRUCTIONS = [0.0, 0.5]
FREQUENCIES = np.linspace(0.02, 1.0, 50)


def test_encircled_energy_equals_born_and_wolf() -> None:
    """Table 8.2: 83.8 %, 91.0 % and 93.8 % inside the first three dark rings, at 1.220, 2.233 and 3.238 times π."""
    rings = scipy.special.jn_zeros(1, 3)
    np.testing.assert_allclose(rings / math.pi, [1.220, 2.233, 3.238], atol=5e-4)
    np.testing.assert_allclose(encircled_energy(rings), [0.838, 0.910, 0.938], atol=5e-4)
    assert first_zero() == pytest.approx(rings[0], rel=1e-12)
    assert airy_diameter_um(550, 8) == pytest.approx(2 * 1.219670 * 0.55 * 8, rel=1e-6)


@pytest.mark.parametrize("obstruction", OBSTRUCTIONS)
def test_encircled_energy_is_the_integral_of_the_density_and_tends_to_one(
    obstruction: float,
) -> None:
    """Averaged over the rings, 2/(π(1 − ε)x) lies outside x."""
    x = np.linspace(0.0, 2000.0, 400_001)
    density = 2 * math.pi * x * point_spread(x, obstruction)
    inside = scipy.integrate.cumulative_trapezoid(density, x, initial=0.0)
    energy = encircled_energy(x, obstruction)
    np.testing.assert_allclose(energy, inside, atol=1e-5)
    far = slice(300_000, None)
    left = np.mean((1 - energy[far]) * x[far])
    assert left == pytest.approx(2 / (math.pi * (1 - obstruction)), rel=0.02)


@pytest.mark.parametrize("obstruction", OBSTRUCTIONS)
def test_mtf_is_the_autocorrelation_of_the_pupil(obstruction: float) -> None:
    """Counted on a grid of 2000² points, whose edges cause an error of 1e-3 of the area."""
    grid = np.linspace(-1, 1, 2001)
    square = grid[:, None] ** 2 + grid[None] ** 2
    pupil = (square <= 1) & (square >= obstruction**2)
    for shift in (0, 100, 400, 900, 1500, 1900):
        shared = (pupil[:, shift:] & pupil[:, : pupil.shape[1] - shift]).sum() / pupil.sum()
        assert diffraction_mtf(shift / 2000, obstruction) == pytest.approx(shared, abs=2e-3)
    assert diffraction_mtf([1.0, 1.7], obstruction) == pytest.approx([0, 0], abs=1e-7)


def test_mtf_of_a_clear_pupil_equals_the_textbook_formula() -> None:
    s = np.linspace(0, 1, 101)
    closed = 2 / math.pi * (np.arccos(s) - s * np.sqrt(1 - s * s))
    np.testing.assert_allclose(diffraction_mtf(s), closed, atol=1e-12)
    np.testing.assert_allclose(diffraction_mtf(-s), closed, atol=1e-12)


@pytest.mark.parametrize("obstruction", one_in(2, OBSTRUCTIONS))
def test_drawn_offsets_have_the_mtf_of_the_pupil(obstruction: float) -> None:
    """Mean of J₀(2sx) over all fractions of the energy, the far tail in closed form, within 6e-4 of the overlap."""
    tables = point_spread_tables(obstruction)
    middles = (tables.radii[1:] + tables.radii[:-1]) / 2
    rest = (np.arange(200_000) + 0.5) / 200_000
    far = tables.edge / rest
    drawn = []
    for s in FREQUENCIES:
        near = scipy.special.j0(2 * s * middles).mean()
        tail = scipy.special.j0(2 * s * far).mean()
        drawn.append(tables.inside * near + (1 - tables.inside) * tail)
    error = np.abs(drawn - diffraction_mtf(FREQUENCIES, obstruction)).max()
    assert error < 6e-4


def test_mtf_of_a_map_is_the_transform_of_its_steps() -> None:
    """Summed over 12 000 positions; 1 at frequency 0, even for an asymmetric map."""
    fine = 4000
    for width, cells in ((1.0, [0.2, 1.0, 0.7]), (0.5, [1.0])):
        count = len(cells) * fine
        place, steps = width * (np.arange(count) + 0.5) / count, np.repeat(cells, fine)
        for frequency in (0.0, 0.25, 0.5, 1.5):
            waves = np.exp(-2j * math.pi * frequency * place)
            expected = abs((waves * steps).sum()) / steps.sum()
            assert aperture_mtf(frequency, width, cells) == pytest.approx(expected, abs=1e-6)
