"""Ray transfers in ISET's format of known lenses: an ideal thin lens and the double Gauss."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.ray_transfer import fitted_lens, thin_lens, written

import mitsuba_sensor as ms
from mitsuba_sensor.camera.lens_datasheet import LensSection
from mitsuba_sensor.optics.ray_trace import Ray, ray_to
from mitsuba_sensor.optics.traced_lens import (
    TracedLens,
    cardinal_points,
    chief_ray_heights,
    traced_lens,
)

FOCAL_MM, RADIUS_MM, OPEN = 50.0, 5.0, 5.03


def lens_of(prescription: object, f_number: float = OPEN, **more: Any) -> LensSection:
    fields = {"prescription": prescription, "f_number": f_number, **more}
    camera = ms.load_camera("konnik_table1")
    return camera.replace(**{f"lens.{name}": value for name, value in fields.items()}).lens


@pytest.fixture(scope="module")
def thin() -> dict[str, Any]:
    """Return the file of a thin lens of 50 mm."""
    data, residuals = thin_lens(FOCAL_MM, RADIUS_MM)
    assert (residuals[:2] < 1e-4).all() and (residuals[2:] < 1e-5).all()  # mm; cosines
    return data


@pytest.fixture
def thin_file(thin: dict[str, Any], tmp_path: Path) -> str:
    return written(tmp_path, thin)


def test_cardinal_points_equal_those_of_the_thin_lens(thin_file: str) -> None:
    points = cardinal_points(lens_of(thin_file))
    assert points.focal_length == pytest.approx(FOCAL_MM, rel=1e-4)
    assert points.back_focus == pytest.approx(FOCAL_MM, rel=1e-4)
    assert points.front_focus == pytest.approx(-FOCAL_MM, rel=1e-4)
    assert points.exit_pupil == pytest.approx(0, abs=1e-3)
    assert points.entrance_pupil == pytest.approx(0, abs=1e-3)
    assert points.image_distance(1.0) == pytest.approx(FOCAL_MM / 0.95, rel=1e-4)


def test_rays_from_an_image_point_meet_in_its_object_point(thin_file: str) -> None:
    """A film in focus at 1 m: within 0.01 mm of the point −h·1 m/b in every direction."""
    lens = lens_of(thin_file)
    distance = cardinal_points(lens).image_distance(1.0)
    across, along = np.meshgrid(np.linspace(-3, 3, 7), np.linspace(-3, 3, 7))
    for height in (0.0, 4.0, 12.0):
        for degrees in (0, 40, 90, 200):
            start = turned(ray_to(distance, np.array(height), along, across), degrees)
            end = traced_lens(lens).trace(start)
            away = (1000 - end.z) / end.dz
            x, y = end.x + away * end.dx, end.y + away * end.dy
            assert end.unvignetted.all()
            far = -height * 1000 / distance
            np.testing.assert_allclose(x, far * math.cos(math.radians(degrees)), atol=0.01)
            np.testing.assert_allclose(y, far * math.sin(math.radians(degrees)), atol=0.01)


def turned(ray: Ray, degrees: float) -> Ray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return ray._replace(
        x=c * ray.x - s * ray.y,
        y=s * ray.x + c * ray.y,
        dx=c * ray.dx - s * ray.dy,
        dy=s * ray.dx + c * ray.dy,
    )


def test_the_pupil_follows_the_f_number_when_stopped_down_and_scaled(thin_file: str) -> None:
    """sin u = 1/(2N) on the axis: rays inside pass, rays outside do not."""
    for f_number, focal_mm in (
        (OPEN, 50.0),
        (5.6, 50.0),
        (8.0, 50.0),
        (8.0, 25.0),
        (22.0, 75.0),
    ):
        lens = lens_of(thin_file, f_number, focal_length_mm=focal_mm)
        points = cardinal_points(lens)
        assert points.focal_length == pytest.approx(focal_mm, rel=1e-4)
        edge = points.back_focus * math.tan(math.asin(1 / (2 * f_number)))
        heights = np.array([0.99, 1.01]) * edge
        start = ray_to(points.back_focus, np.array(0.0), heights, 0 * heights)
        assert traced_lens(lens).unvignetted(start).tolist() == [True, False]


def test_the_pass_function_limits_the_f_number(thin_file: str) -> None:
    """N = 1/(2 sin u), tan u = R/f: 5.0249 in steps of 0.01."""
    with pytest.raises(ms.InputError, match=r"at least 5\.03"):
        cardinal_points(lens_of(thin_file, 2.8))


def test_the_image_of_the_thin_lens_has_no_distortion(thin_file: str) -> None:
    ideal, real = chief_ray_heights(lens_of(thin_file), 2.0, 10.0)
    np.testing.assert_allclose(ideal, real, rtol=2e-5)


@pytest.fixture(scope="module")
def gauss() -> tuple[LensSection, dict[str, Any]]:
    """Return the double Gauss at f/4, and a file of degree 7 fitted to its rays."""
    lens = lens_of("double_gauss", 4.0)
    points = cardinal_points(lens)
    pupil_mm = points.entrance_radius / points.focal_length
    pupil_mm *= points.back_focus - points.exit_pupil
    data, residuals = fitted_lens(traced_lens(lens), (9.0, pupil_mm, -points.exit_pupil), 7)
    assert (residuals[:2] < 0.005).all() and (residuals[2:] < 3e-5).all()  # mm; cosines
    return lens, data


def test_a_fitted_double_gauss_equals_the_double_gauss(
    gauss: tuple[LensSection, dict[str, Any]], tmp_path: Path
) -> None:
    """Focal length within 1e-4, focus 0.02 mm, image heights 2 µm, ray directions in a corner 3e-5."""
    lens, data = gauss
    fitted = lens_of(written(tmp_path, data), 4.03)
    ours, theirs = cardinal_points(fitted), cardinal_points(lens)
    before = theirs.exit_pupil  # its pass plane is there
    assert ours.focal_length == pytest.approx(theirs.focal_length, rel=1e-4)
    assert ours.back_focus == pytest.approx(theirs.back_focus - before, abs=0.02)
    (ideal, real), (expected, same) = (
        chief_ray_heights(section, 2.0, 11.0) for section in (fitted, lens)
    )
    np.testing.assert_allclose(ideal, expected, atol=2e-3)
    np.testing.assert_allclose(real, same)
    _same_rays(traced_lens(fitted), traced_lens(lens), theirs.back_focus, before)


def _same_rays(ours: TracedLens, theirs: TracedLens, focus: float, before: float) -> None:
    points = np.linspace(-3, 3, 13)
    start = ray_to(focus - before, np.array(9.0), points, points)
    end = ours.trace(start)
    other = theirs.trace(start._replace(z=start.z - before))
    np.testing.assert_allclose([end.dx, end.dy], [other.dx, other.dy], atol=3e-5)


def test_dr_jit_and_numpy_trace_the_same_rays(thin_file: str) -> None:
    """In float32 from the film, with the polynomials in float64: within 1e-5."""
    dr_type = pytest.importorskip("drjit.llvm")
    lens = traced_lens(lens_of(thin_file, 8.0))
    points = np.linspace(-3, 3, 13)
    start = ray_to(50.0, np.array(6.0), points, 0.7 * points)
    single = Ray(
        *(dr_type.Float(np.float32(v) + 0 * points) for v in start[:6]), dr_type.Bool(True)
    )
    for ours, theirs in zip(lens.trace(single), lens.trace(start), strict=True):
        np.testing.assert_allclose(np.array(ours), theirs, atol=1e-5)


def test_ellipses_are_interpolated_linearly_between_heights(
    thin: dict[str, Any], tmp_path: Path
) -> None:
    """Halfway between two heights: mean centre and mean axes. Above the last height nothing passes."""
    wavelength = thin["polynomials"][0]
    ellipses = {
        "method": "minimalellipse",
        "positions": [0, 1, 3],
        "centersX": [0.01, 0, 0],
        "centersY": [0, 0.5, 2.5],
        "radiiX": [5, 5, 3],
        "radiiY": [5, 5, 1],
        "intersectPlaneDistance": 10,
    }
    data = {**thin, "polynomials": [{**wavelength, "raypass": ellipses}]}
    lens = replace(traced_lens(lens_of(written(tmp_path, data), 9.0)), stop_radius=1e9)
    edges = [(0, 1.5 + s * 3.0 * 0.999) for s in (-1, 1)] + [(4.0 * 0.999, 1.5)]
    beyond = [(0, 1.5 + s * 3.0 * 1.001) for s in (-1, 1)] + [(4.0 * 1.001, 1.5)]
    for places, passes in ((edges, True), (beyond, False)):
        for x, y in places:
            start = Ray(0.0, 2.0, -10.0, x, y - 2.0, 10.0, np.array(True))
            size = math.sqrt(x * x + (y - 2.0) ** 2 + 100)
            unit = start._replace(dx=x / size, dy=(y - 2.0) / size, dz=10 / size)
            assert bool(lens.unvignetted(unit)) == passes
    outside = Ray(0.0, 3.01, -10.0, 0.0, 0.0, 1.0, np.array(True))
    assert not lens.unvignetted(outside)


SPOILED: dict[str, Callable[[Any, Any], object]] = {
    "has 2 wavelengths": lambda data, one: data["polynomials"].append(one),
    "'convexhull'; it must be": lambda data, one: one["raypass"].update(method="convexhull"),
    "has x, dx, dy; give one for each of x, y": lambda data, one: one["poly"].pop(1),
    "planeoffsetinput": lambda data, one: data.pop("planeoffsetinput"),
    "of 'outx' must have equal lengths": lambda data, one: one["poly"][0]["termr"].append(3),
    "pass function are empty or differ": lambda data, one: one["raypass"]["radii"].append(3),
    "pass_plane_mm": lambda data, one: one["raypass"].update(intersectPlaneDistance=0),
    "powers_r": lambda data, one: one["poly"][0]["termr"].__setitem__(0, -1),
}


@pytest.mark.parametrize("sentence", SPOILED)
def test_a_wrong_file_is_refused(thin: dict[str, Any], tmp_path: Path, sentence: str) -> None:
    data = copy.deepcopy(thin)
    SPOILED[sentence](data, data["polynomials"][0])
    with pytest.raises(ms.InputError, match=sentence) as caught:
        lens_of(written(tmp_path, data))
    assert "\n" not in str(caught.value)


def test_polynomials_that_do_not_describe_a_lens_are_refused(
    thin: dict[str, Any], tmp_path: Path
) -> None:
    data = copy.deepcopy(thin)
    y = data["polynomials"][0]["poly"][1]
    y["coeff"] = [1.2 * c for c in y["coeff"]]
    with pytest.raises(ms.InputError, match=r"have the determinant 1\.2"):
        cardinal_points(lens_of(written(tmp_path, data)))


def test_a_camera_file_keeps_the_ray_transfer(thin_file: str, tmp_path: Path) -> None:
    camera = ms.load_camera("konnik_table1").replace(
        **{"lens.prescription": thin_file, "lens.f_number": 8.0}
    )
    (tmp_path / "own.toml").write_text(camera.to_toml(), encoding="utf-8")
    assert ms.load_camera(tmp_path / "own.toml").lens == camera.lens
