"""Rays through surfaces against independent code and surfaces without aberration; ellipses of the pupil."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.lens_oracle import DOUBLE_GAUSS, backward, vertices
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor.camera.lens_datasheet import LensSection
from mitsuba_sensor.optics.ray_trace import Ray, ray_to
from mitsuba_sensor.optics.traced_lens import (
    cardinal_points,
    chief_ray_heights,
    exit_pupil_bounds,
    traced_lens,
)


def lens(**fields: Any) -> LensSection:
    fields = {"prescription": "double_gauss", **fields}
    return (
        ms.load_camera("konnik_table1")
        .replace(**{f"lens.{k}": v for k, v in fields.items()})
        .lens
    )


def rays(count: int, distance: float, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Return points on a full-frame sensor and directions to the rear of the lens, with z towards the scene."""
    random = np.random.default_rng(seed)
    film = np.column_stack(
        [random.uniform((-18, -12), (18, 12), (count, 2)), np.full(count, -distance)]
    )
    ways = np.column_stack([random.uniform(-10, 10, (count, 2)), np.zeros(count)]) - film
    return film, ways / np.linalg.norm(ways, axis=1, keepdims=True)


def as_ray(film: np.ndarray, ways: np.ndarray) -> Ray:
    return Ray(*film.T, *ways.T, np.ones(len(film), dtype=bool))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # rays that miss
def test_rays_through_a_double_gauss_equal_those_of_independent_code() -> None:
    """20 000 rays from the whole sensor to the whole rear surface: vignetting, position and direction within 1e-9."""
    section = lens()
    points = cardinal_points(section)
    film, ways = rays(20_000, points.back_focus)
    found = traced_lens(section).trace(as_ray(film, ways))
    flip, rear = np.array([1.0, 1.0, -1.0]), vertices(DOUBLE_GAUSS)[-1]
    start = film * flip + [0, 0, rear]
    p, d, passed = backward(DOUBLE_GAUSS, start, ways * flip, points.stop_radius)
    assert (found.unvignetted == passed).all() and 0.05 < passed.mean() < 0.5
    ours = np.column_stack(found[:3])[passed], np.column_stack(found[3:6])[passed]
    np.testing.assert_allclose(ours[0], (p[passed] - [0, 0, rear]) * flip, atol=1e-9)
    np.testing.assert_allclose(ours[1], d[passed] * flip, atol=1e-9)


def plano(conic: float, aspheric: tuple[float, ...] = ()) -> dict[str, Any]:
    """A plano-convex lens, convex towards the sensor: R = 20 mm, n = 1.5, f = 40 mm."""
    stop = {"semi_diameter_mm": 9.0, "stop": True}
    plane = {"semi_diameter_mm": 9.0, "thickness_mm": 4.0, "index": 1.5}
    back = {"radius_mm": -20.0, "semi_diameter_mm": 9.0, "conic": conic, "aspheric": aspheric}
    return {"name": "plano", "surfaces": [stop, plane, back]}


def slopes(section: LensSection) -> np.ndarray:
    """Return the slopes on the scene side of a fan of rays from the focal point, up to 10°."""
    sine = np.linspace(0.01, 0.17, 15)
    start = Ray(
        0 * sine,
        0 * sine,
        -cardinal_points(section).back_focus,
        sine,
        0 * sine,
        np.sqrt(1 - sine**2),
        sine > 0,
    )
    end = traced_lens(section).trace(start)
    assert end.unvignetted.all()
    return np.asarray(end.dx / end.dz)


def test_a_hyperbola_of_conic_minus_n_squared_collimates_light_from_its_focus() -> None:
    """Descartes: k = −n² has no spherical aberration; a sphere has."""
    hyperbola, sphere = (lens(prescription=plano(k), f_number=2.8) for k in (-(1.5**2), 0.0))
    assert np.abs(slopes(hyperbola)).max() < 1e-12 < 1e-3 < np.abs(slopes(sphere)).max()


def test_a_conic_written_as_a_polynomial_is_the_same_surface() -> None:
    """Sag of a conic, c·r²/2 + (1 + k)·c³·r⁴/8 + (1 + k)²·c⁵·r⁶/16 + …, minus that of the sphere."""
    c, k, terms, factor = -1 / 20.0, -(1.5**2), [], 0.5
    for n in range(2, 20):  # binomial series of (1 − √(1 − (1 + k)·c²·r²))/((1 + k)·c)
        factor *= (2 * n - 3) / (2 * n)
        terms.append(factor * c ** (2 * n - 1) * ((1 + k) ** (n - 1) - 1.0))
    assert (
        np.abs(slopes(lens(prescription=plano(0.0, tuple(terms)), f_number=2.8))).max() < 1e-9
    )


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("name", "f_number"),
    one_in(3, [("double_gauss", 2.05), ("double_gauss", 16.0), ("singlet", 8.0)], several=True),
)
def test_the_ellipses_contain_all_rays_that_pass_and_few_others(
    name: str, f_number: float
) -> None:
    """A ray outside would lose light. 300 000 rays over the whole rear surface from 200 image heights."""
    section = lens(prescription=name, f_number=f_number)
    traced, distance = traced_lens(section), cardinal_points(section).image_distance(np.inf)
    pupil = exit_pupil_bounds(traced, distance, 22.0)
    random = np.random.default_rng(11)
    heights = np.repeat(random.uniform(0, 22.0, 200), 1500)
    nodes = np.linspace(0, pupil.highest, len(pupil.centre))
    centre, a, b = (
        np.interp(heights, nodes, v) for v in (pupil.centre, pupil.radial, pupil.tangential)
    )
    wide = traced.reach(distance, 22.0)
    x, y = random.uniform(-wide, wide, (2, heights.size))
    passed = traced.trace(ray_to(distance, heights, x, y)).unvignetted
    assert (((x - centre) / a) ** 2 + (y / b) ** 2)[passed].max() <= 1
    radius, angle = (
        np.sqrt(random.uniform(size=heights.size)),
        random.uniform(0, 2 * np.pi, heights.size),
    )
    x, y = centre + a * radius * np.cos(angle), b * radius * np.sin(angle)
    assert traced.trace(ray_to(distance, heights, x, y)).unvignetted.mean() > 0.85


@pytest.mark.parametrize("focus_m", [math.inf, 0.3])
def test_distortion_of_a_double_gauss_equals_that_of_traced_chief_rays(focus_m: float) -> None:
    """By independent code: the ray from 15 mm on the sensor through the centre of the stop, found by bisection.

    Close to the lens, the height in the plane of focus counts, not the slope; they differ by 0.5 % at 0.3 m.
    """
    section = lens()
    points = cardinal_points(section)
    ideal, real = chief_ray_heights(section, focus_m, 17.0)
    rear, height = vertices(DOUBLE_GAUSS)[-1], 15.0
    low, high = -8.0, 12.0
    for _ in range(60):
        at = (low + high) / 2
        film = np.array([[height, 0.0, rear + points.image_distance(focus_m)]])
        way = np.array([[at, 0.0, rear]]) - film
        way /= np.linalg.norm(way)
        p, _, _ = backward(
            DOUBLE_GAUSS[5:], film - [0, 0, vertices(DOUBLE_GAUSS)[5]], way, 99.0
        )
        low, high = (at, high) if p[0, 0] < 0 else (low, at)
    p, d, passed = backward(DOUBLE_GAUSS, film, way, 8.0)
    assert passed.all()
    slope, far = d[0, 0] / d[0, 2], min(focus_m, 1e9) * 1e3
    tangent = (p[0, 0] + (points.entrance_pupil - far - p[0, 2]) * slope) / far
    expected = points.principal_distance(focus_m) * abs(tangent)
    assert np.interp(height, real, ideal) == pytest.approx(expected, rel=1e-4)
    assert 1e-3 < expected / height - 1 < 0.02
