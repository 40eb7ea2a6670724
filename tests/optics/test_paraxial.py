"""First-order optics against closed forms and rays traced by independent code; glasses against their makers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.lens_oracle import (
    AXIAL_IRRADIANCE,
    DOUBLE_GAUSS,
    Table,
    axial_irradiance,
    forward,
    vertices,
)

import mitsuba_sensor as ms
from mitsuba_sensor.camera.lens_datasheet import LensSection
from mitsuba_sensor.optics.ray_trace import C_NM, D_NM, F_NM, Glass, glass_behind
from mitsuba_sensor.optics.traced_lens import CardinalPoints, cardinal_points

N_BK7 = (1.03961212, 0.231792344, 1.01046945, 0.00600069867, 0.0200179144, 103.560653)
ALONG = np.array([0.0, 0.0, 1.0])


def lens(**fields: Any) -> LensSection:
    fields = {"prescription": "double_gauss", **fields}
    return (
        ms.load_camera("konnik_table1")
        .replace(**{f"lens.{k}": v for k, v in fields.items()})
        .lens
    )


def glass_ball(
    radius: float = 10.0, index: float = 1.5, aperture: float = 1.0
) -> dict[str, Any]:
    """A biconvex lens with its stop in front, for which all has a closed form."""
    stop = {"semi_diameter_mm": aperture, "thickness_mm": 4.0, "stop": True}
    front = {"semi_diameter_mm": 6.0, "thickness_mm": 3.0, "radius_mm": radius, "index": index}
    return {
        "name": "biconvex",
        "surfaces": [stop, front, {"semi_diameter_mm": 6.0, "radius_mm": -radius}],
    }


def test_focal_points_of_a_thick_lens_follow_the_lensmakers_equation() -> None:
    """1/f = (n − 1)·(2/R − (n − 1)·t/(n·R²)); back focus f·(1 − (n − 1)·t/(n·R)); the stop is the entrance pupil."""
    n, r, t = 1.5, 10.0, 3.0
    focal = 1 / ((n - 1) * (2 / r - (n - 1) * t / (n * r * r)))
    found = cardinal_points(lens(prescription=glass_ball(), f_number=20.0))
    assert found.focal_length == pytest.approx(focal, rel=1e-12)
    assert found.back_focus == pytest.approx(focal * (1 - (n - 1) * t / (n * r)), rel=1e-12)
    assert found.front_focus == pytest.approx(
        4.0 - focal * (1 - (n - 1) * t / (n * r)), rel=1e-12
    )
    assert (found.entrance_pupil, found.length) == (0.0, 7.0)


def traced_double_gauss(
    heights: np.ndarray, stop: float, table: Table = DOUBLE_GAUSS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    start = np.column_stack([heights, 0 * heights, 0 * heights - 10])
    return forward(table, start, np.tile(ALONG, (len(heights), 1)), stop)


def test_focal_length_and_back_focus_equal_those_of_traced_rays() -> None:
    """Rays 0.5 mm from the axis, within 0.01 %."""
    found = cardinal_points(lens())
    points, ways, _ = traced_double_gauss(np.array([0.5]), 8.0)
    slope = ways[0, 0] / ways[0, 2]
    assert -0.5 / slope == pytest.approx(found.focal_length, rel=1e-4)
    focus = points[0, 2] - points[0, 0] / slope - vertices(DOUBLE_GAUSS)[-1]
    assert focus == pytest.approx(found.back_focus, rel=1e-4)


@pytest.mark.parametrize(("f_number", "irradiance"), AXIAL_IRRADIANCE.items())
def test_the_f_number_sets_the_stop_and_the_traced_cone_sets_the_irradiance(
    f_number: float, irradiance: float
) -> None:
    """The paraxial entrance pupil has the diameter f/N: rays near the axis cross the stop at the same fraction of its
    radius. The widest cone through the stop has π·sin²u′ as traced by Optiland."""
    points = cardinal_points(lens(f_number=f_number))
    pupil = points.focal_length / (2 * f_number)
    near, _, _ = traced_double_gauss(np.array([1e-3 * pupil]), 99.0, DOUBLE_GAUSS[:6])
    assert points.entrance_radius == pytest.approx(pupil, rel=1e-12)
    assert abs(near[0, 0]) == pytest.approx(1e-3 * points.stop_radius, rel=1e-5)
    assert axial_irradiance(
        DOUBLE_GAUSS, points.back_focus, points.stop_radius
    ) == pytest.approx(irradiance, rel=1e-4)


def test_the_pupils_are_the_images_of_the_centre_of_the_stop() -> None:
    """Rays from the centre of the stop at a small slope, traced both ways by independent code."""
    from helpers.lens_oracle import backward

    found, slope, z = cardinal_points(lens()), 1e-3, vertices(DOUBLE_GAUSS)
    start = np.array([[0.0, 0.0, z[5]]])
    way = np.array([[slope, 0.0, math.sqrt(1 - slope**2)]])
    front, behind = DOUBLE_GAUSS[:6], ((0.0, 4.5, 1.0, 17.1), *DOUBLE_GAUSS[6:])
    p, d, _ = backward(front, start, way * [1, 1, -1], 8.0)
    assert p[0, 2] - p[0, 0] / d[0, 0] * d[0, 2] == pytest.approx(
        found.entrance_pupil, rel=1e-4
    )
    p, d, _ = forward(behind, start - [0, 0, z[5]], way, 8.0)
    assert p[0, 2] - p[0, 0] / d[0, 0] * d[0, 2] - vertices(behind)[-1] == pytest.approx(
        found.exit_pupil, rel=1e-4
    )


@pytest.mark.parametrize("focus_m", [0.3, 1.0, 20.0])
def test_image_height_is_the_principal_distance_times_the_tangent(
    focus_m: float,
) -> None:
    """Near-axis rays from a point 1 mrad off axis, ``focus_m`` before the entrance pupil, by independent code."""
    found = cardinal_points(lens(f_number=8.0))
    point = np.array([focus_m * 1e3 * 1e-3, 0.0, found.entrance_pupil - focus_m * 1e3])
    entrance = np.array([[x, 0.0, found.entrance_pupil] for x in (-0.2, 0.2)])
    ways = (entrance - point) / np.linalg.norm(entrance - point, axis=1, keepdims=True)
    p, d, passed = forward(DOUBLE_GAUSS, np.tile(point, (2, 1)), ways, 8.0)
    plane = vertices(DOUBLE_GAUSS)[-1] + found.image_distance(focus_m)
    x = p[:, 0] + (plane - p[:, 2]) * d[:, 0] / d[:, 2]
    assert passed.all() and x[0] == pytest.approx(x[1], rel=1e-3)
    np.testing.assert_allclose(-x, found.principal_distance(focus_m) * 1e-3, rtol=1e-3)


def test_scaling_scales_every_length_but_not_the_f_number() -> None:
    plain, half = (
        cardinal_points(lens()),
        cardinal_points(lens(focal_length_mm=cardinal_points(lens()).focal_length / 2)),
    )
    for name in (
        "focal_length",
        "front_focus",
        "back_focus",
        "entrance_pupil",
        "exit_pupil",
        "stop_radius",
        "length",
    ):
        assert getattr(half, name) == pytest.approx(getattr(plain, name) / 2, rel=1e-9)
    assert half.entrance_radius == pytest.approx(plain.entrance_radius / 2, rel=1e-9)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"f_number": 1.4}, "lens.f_number is 1.4; it must be at least 2.05"),
        ({"f_number": 0.3}, "it must be at least 2.05"),
        ({"prescription": glass_ball(aperture=1e-9)}, "'biconvex' passes no light"),
        ({"prescription": glass_ball(-10.0)}, "negative or infinite focal length"),
    ],
)
def test_an_impossible_lens_is_refused(fields: dict[str, Any], says: str) -> None:
    with pytest.raises(ms.InputError, match=says):
        cardinal_points(lens(**fields))


def test_an_object_within_the_front_focal_point_cannot_be_in_focus() -> None:
    found: CardinalPoints = cardinal_points(lens())
    with pytest.raises(ms.InputError, match=r"distance is 0.04 m; it must be above 0.0471 m"):
        found.image_distance(0.04)


def test_sellmeier_gives_schotts_n_bk7() -> None:
    """n_d 1.51680, n_F 1.52238, n_C 1.51432 in Schott's datasheet."""
    for wavelength, index in ((D_NM, 1.51680), (F_NM, 1.52238), (C_NM, 1.51432)):
        assert Glass(N_BK7).index(wavelength) == pytest.approx(index, abs=6e-6)


def test_index_and_abbe_number_give_the_dispersion_of_a_glass() -> None:
    """Against the Sellmeier formula of N-BK7: 0.0003 from 400 to 700 nm."""
    found = glass_behind(
        lens(prescription=glass_ball())
        .prescription.surfaces[1]
        .model_copy(update={"abbe": 64.17})
    )
    spread = found.index(F_NM) - found.index(C_NM)
    assert (found.index(D_NM) - 1) / spread == pytest.approx(64.17, rel=1e-12)
    surface = (
        lens(prescription=glass_ball(index=1.5168))
        .prescription.surfaces[1]
        .model_copy(update={"abbe": 64.17})
    )
    nm = np.linspace(400, 700, 31)
    np.testing.assert_allclose(
        glass_behind(surface).index(nm), Glass(N_BK7).index(nm), atol=3e-4
    )
    assert abs(glass_behind(surface).index(1000.0) - Glass(N_BK7).index(1000.0)) < 2.1e-3
