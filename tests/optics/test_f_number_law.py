"""The lens: cos⁴ against Mitsuba's rays, solid angles and distortion against closed forms, K against renders."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import SKY, both_variants, scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.optics.f_number_law import solid_angle_sr, transmittance
from mitsuba_sensor.optics.intrinsics import View, aperture_f_number, intrinsics, magnification
from mitsuba_sensor.render.light.bands import box_bands
from mitsuba_sensor.render.load.scene import Scene, load_scene
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA = ms.load_camera("konnik_table1")
CROP = "".join(
    f'<integer name="crop_{k}" value="{v}"/>'
    for k, v in (("width", 5), ("height", 3), ("offset_x", 6), ("offset_y", 1))
)
SHIFT = '<float name="principal_point_offset_x" value="0.1"/><float name="principal_point_offset_y" value="-0.2"/>'
LENS = '<float name="aperture_radius" value="0.01"/><float name="focus_distance" value="3"/>'


def sensor(kind: str, more: str, width: int = 12, height: int = 8) -> str:
    return (
        f'<sensor type="{kind}">{more}<transform name="to_world"><lookat origin="1, 2, 3" target="0, 0.5, 0" '
        f'up="0, 1, 0"/></transform><film type="hdrfilm"><integer name="width" value="{width}"/>'
        f'<integer name="height" value="{height}"/>{{film}}</film></sensor>'
    )


def axis_fov(axis: str) -> str:
    return f'<float name="fov" value="60"/><string name="fov_axis" value="{axis}"/>'


@pytest.mark.parametrize(
    ("text", "film"),
    [
        *[
            (sensor("perspective", axis_fov(axis), 8, 12), "")
            for axis in ("diagonal", "larger")
        ],
        (sensor("perspective", '<string name="focal_length" value="35mm"/>'), ""),
        (sensor("perspective", axis_fov("x") + SHIFT), CROP),
        (sensor("thinlens", axis_fov("y") + LENS), CROP),
        (sensor("orthographic", ""), CROP),
    ],
)
def test_cos4_equals_that_of_mitsubas_rays(tmp_path: Path, text: str, film: str) -> None:
    """Mean of cos⁴ over 6 × 6 rays per pixel, to 5e-4 (error of the midpoint rule at 60° over 8 pixels: 2e-4)."""
    mi = use(choose_variant("scalar_spectral"))
    scene = load_scene(
        write_scene(tmp_path, scene_text(SKY, sensor=text, film=film)),
        box_bands(CAMERA, np.array([500.0, 510.0])),
        {},
    )
    axis = np.array(scene.sensor.world_transform().matrix)[:3, 2]
    columns, rows = scene.view.crop_size
    mean, at = np.zeros((rows, columns)), (np.arange(6) + 0.5) / 6
    for y in range(rows):
        for x in range(columns):
            places = [mi.Point2f((x + a) / columns, (y + b) / rows) for a in at for b in at]
            rays = [
                scene.sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5, 0.5))[0]
                for place in places
            ]
            mean[y, x] = np.mean([(np.array(ray.d) @ axis) ** 4 for ray in rays])
    infinity = replace(scene.view, focus_m=math.inf)
    found = solid_angle_sr(infinity, CAMERA) * 4 * CAMERA.lens.f_number**2 / math.pi
    np.testing.assert_allclose(found, mean, atol=5e-4)


ON_AXIS = View(size=(1, 1), crop_size=(1, 1))


@pytest.mark.parametrize("f_number", [1.4, 2.8, 8.0])
def test_the_axial_solid_angle_follows_its_convention(f_number: float) -> None:
    """π/(4N²), or EMVA's π/(1 + 4N²), 13 % less at f/1.4."""
    for convention, square in (("working", 4 * f_number**2), ("planar", 1 + 4 * f_number**2)):
        fields = {"lens.f_number": f_number, "lens.convention": convention}
        found = solid_angle_sr(ON_AXIS, CAMERA.replace(**fields))[0, 0]
        assert found == pytest.approx(math.pi / square, rel=1e-12)


def test_magnification_and_f_number_of_a_thin_lens() -> None:
    """At life size (|m| = 1) and P = 1 the working f-number doubles: a quarter of the light. f = 1/(1/image + 1/focus)
    and N = f/(2·radius); a pinhole has no N."""
    image_m = 0.5 * 12 * 5.7e-6 / 0.3
    view = View((12, 8), (12, 8), half_width=0.3, focus_m=image_m, aperture_radius_m=1e-5)
    assert magnification(view, CAMERA) == pytest.approx(1.0, rel=1e-12)
    far = solid_angle_sr(replace(view, focus_m=math.inf), CAMERA)
    np.testing.assert_allclose(solid_angle_sr(view, CAMERA), far / 4, rtol=1e-12)
    assert aperture_f_number(view, CAMERA) == pytest.approx(image_m / 2 / 2e-5, rel=1e-12)
    assert aperture_f_number(replace(view, aperture_radius_m=0.0), CAMERA) is None


def test_light_through_a_thin_lens_follows_cos4_and_the_f_number(tmp_path: Path) -> None:
    """E = π·L/(4·N_w²)·cos⁴θ in every pixel within 0.1 %; N_w = N·(1 + |m|). 9 × 9 nodes per pixel."""
    f_number = 1.4
    camera = CAMERA.replace(**{"lens.f_number": f_number})
    scene = write_scene(
        tmp_path, scene_text(SKY, sensor=sensor("thinlens", axis_fov("x") + LENS))
    )
    options = {"wavelength_nm": 550, "spp": 16, "variant": "scalar_spectral"}
    light = ms.render(scene, camera, ms.Exposure(0.1), **options).data[..., 0]
    half = math.tan(math.radians(30)) / 6
    x, y = np.meshgrid(half * (np.arange(12) - 5.5), half * (np.arange(8) - 3.5))
    at = (np.arange(9) - 4) / 9 * half
    fall_off = np.mean(
        [(1 + (x + a) ** 2 + (y + b) ** 2) ** -2.0 for a in at for b in at], axis=0
    )
    working = f_number * (1 + 5.7e-6 / half / 3.0)
    np.testing.assert_allclose(light, math.pi * 2e-4 / (4 * working**2) * fall_off, rtol=1e-3)


def test_transmission_is_a_factor_times_a_curve_over_all_wavelengths() -> None:
    """Linear between its points, undefined outside."""
    curve = {
        "lens.transmission_curve": [0.0, 1.0, 0.5],
        "lens.transmission_wavelengths_nm": [400, 500, 700],
    }
    camera = CAMERA.replace(**curve, **{"lens.transmission": 0.8})
    np.testing.assert_allclose(
        transmittance(camera, [400, 425, 500, 600]), [0.0, 0.2, 0.8, 0.6], rtol=1e-12
    )
    with pytest.raises(ms.InputError, match="400 to 700 nm but is needed at 705 nm"):
        transmittance(camera, [500.0, 705.0])


def test_measured_illumination_replaces_cos4() -> None:
    """π/(4N²)·(1 − h/4 mm) at the centre of each pixel except on the axis, where |h| has a kink."""
    heights = {
        "lens.relative_illumination_heights_mm": [0, 2.0],
        "lens.relative_illumination": [1.0, 0.5],
    }
    camera = CAMERA.replace(**heights, **{"pixel.pitch_x_um": 100.0, "pixel.pitch_y_um": 100.0})
    view = View(size=(31, 21), crop_size=(5, 3), crop_offset=(20, 15), half_width=1.0)
    x, y = np.meshgrid(np.arange(20, 25) + 0.5 - 15.5, np.arange(15, 18) + 0.5 - 10.5)
    expected = math.pi / (4 * 2.8**2) * (1 - np.hypot(x, y) * 0.1 / 4)
    np.testing.assert_allclose(solid_angle_sr(view, camera), expected, rtol=2e-4)


BROWN = [-0.18, 0.03, 0.004, -0.006, 0.002]
PERCENT = {
    "lens.distortion_percent": [0.0, -1.0, -4.0, -9.0],
    "lens.distortion_heights_mm": [0.0, 0.012, 0.024, 0.046],
}
DISTORTED = {"brown": {"lens.distortion": BROWN}, "table": PERCENT}


def opencv(point: np.ndarray, matrix: Any, k: Any) -> np.ndarray:
    """cv::projectPoints, written again: points (n, 3) with z forward → pixels (n, 2), centres at whole numbers."""
    x, y = point[:, 0] / point[:, 2], point[:, 1] / point[:, 2]
    r2 = x * x + y * y
    radial = 1 + k[0] * r2 + k[1] * r2**2 + k[4] * r2**3
    u = x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x)
    v = y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y
    return np.stack([u, v, np.ones_like(u)], axis=1) @ np.array(matrix).T[:, :2]


def loaded(
    tmp_path: Path,
    camera: ms.Camera,
    variant: str,
    sensor_xml: str,
    film: str = "",
    *elements: str,
) -> Scene:
    use(choose_variant(skip_unless_usable(variant)))
    text = scene_text(*(elements or (SKY,)), sensor=sensor_xml, film=film)
    return load_scene(
        write_scene(tmp_path, text), box_bands(camera, np.array([500.0, 510.0])), {}, camera
    )


def seen(scene: Scene, x: float, y: float) -> np.ndarray:
    """Direction of the ray at a position in the crop [pixels], in OpenCV's axes."""
    mi = use(choose_variant())
    (columns, rows), to_world = (
        scene.view.crop_size,
        np.array(scene.sensor.world_transform().matrix).reshape(-1),
    )
    ray, _ = scene.sensor.sample_ray(
        0.0, 0.5, mi.Point2f(x / columns, y / rows), mi.Point2f(0.5, 0.5)
    )
    return to_world.reshape(4, 4)[:3, :3].T @ np.ravel(ray.d) * [-1, -1, 1]


@both_variants
def test_opencv_projects_a_distorted_ray_back_to_its_pixel(
    tmp_path: Path, variant: str
) -> None:
    """Nine positions per film with an off-centre axis, within 0.004 pixels."""
    camera = CAMERA.replace(**DISTORTED["brown"])
    scene = loaded(
        tmp_path, camera, variant, sensor("perspective", axis_fov("x") + SHIFT), CROP
    )
    places = [(x, y) for x in (0.2, 2.5, 4.9) for y in (0.1, 1.5, 2.8)]
    found = intrinsics(scene.view, camera)
    back = opencv(
        np.array([seen(scene, *place) for place in places]),
        found["matrix"],
        found["distortion"],
    )
    np.testing.assert_allclose(back + 0.5, places, atol=4e-3)


@pytest.mark.parametrize("kind", DISTORTED)
def test_a_distorted_pixel_gathers_light_in_proportion_to_its_outline(
    tmp_path: Path, kind: str
) -> None:
    """Ω is π/(4N²) times the area of the pixel's outline in direction cosines, ∫cos θ dω, over that of an axial pixel
    of an ideal lens: the flux through the entrance pupil. 16 rays along each side, within 0.2 %."""
    camera = CAMERA.replace(**DISTORTED[kind])
    scene = loaded(tmp_path, camera, "scalar_spectral", sensor("perspective", axis_fov("x")))
    solid_angle = solid_angle_sr(scene.view, camera)
    for column, row in ((0, 0), (5, 3), (11, 4), (3, 7)):
        along = np.arange(16) / 16
        sides = [
            (along, 0 * along),
            (1 + 0 * along, along),
            (1 - along, 1 + 0 * along),
            (0 * along, 1 - along),
        ]
        outline = np.array(
            [
                seen(scene, column + x, row + y)
                for xs, ys in sides
                for x, y in zip(xs, ys, strict=True)
            ]
        )
        x, y, _ = outline.T
        area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
        expected = math.pi / (4 * 2.8**2) * area / scene.view.tangent_per_pixel**2
        assert solid_angle[row, column] == pytest.approx(expected, rel=2e-3)
    undistorted = solid_angle_sr(scene.view, CAMERA)
    assert abs(solid_angle[0, 0] / undistorted[0, 0] - 1) > 0.1


FINE = {"pixel.pitch_x_um": 750.0, "pixel.pitch_y_um": 750.0}
PLACE = zip(("width", "height", "offset_x", "offset_y"), (30, 20, 10, 8), strict=True)
CROP_48 = "".join(f'<integer name="crop_{name}" value="{value}"/>' for name, value in PLACE)
SENSORS: dict[str, tuple[dict[str, Any], str, str]] = {
    "crop": ({}, sensor("perspective", axis_fov("x") + SHIFT, 48, 32), CROP_48),
    "thin lens": ({}, sensor("thinlens", axis_fov("x") + LENS, 48, 32), ""),
    "distorted": (
        {"lens.distortion": BROWN},
        sensor("perspective", axis_fov("x") + SHIFT, 48, 32),
        "",
    ),
    "traced": (
        {"lens.prescription": "double_gauss", "lens.focus_m": 3.0},
        sensor("perspective", SHIFT, 48, 32),
        "",
    ),
}


@pytest.mark.parametrize("kind", one_in(2, SENSORS))
def test_a_point_appears_where_k_projects_it(tmp_path: Path, kind: str) -> None:
    """Centroid of a small luminous ball rendered in two corners, within 0.1 pixel of K with distortion.

    A traced lens uses its table of heights. The edges of a ball of 3 pixels cause a Monte Carlo error of 0.02 pixels.
    """
    fields, sensor_xml, film = SENSORS[kind]
    camera = CAMERA.replace(**fields, **FINE)
    dark = loaded(tmp_path, camera, "llvm_ad_spectral", sensor_xml, film)
    found, pose = (
        intrinsics(dark.view, camera),
        np.array(dark.sensor.world_transform().matrix).reshape(4, 4),
    )
    matrix = np.array(found["matrix"])
    (columns, rows), depth = found["image_size"], 3.0
    for place in ((0.3 * columns, 0.25 * rows), (0.75 * columns, 0.7 * rows)):
        point = np.linalg.inv(matrix) @ [*place, 1.0] * depth
        x, y, z = (pose @ [-point[0], -point[1], point[2], 1.0])[:3]
        radius = 1.6 * depth / matrix[0, 0]
        ball = (
            f'<shape type="sphere"><point name="center" value="{x}, {y}, {z}"/><float name="radius" value="{radius}"/>'
            '<emitter type="area"><spectrum name="radiance" value="360:1, 830:1"/></emitter></shape>'
        )
        image = loaded(tmp_path, camera, "llvm_ad_spectral", sensor_xml, film, ball).render(
            1, 256, (0, rows)
        )[..., 0]
        row, column = np.indices(image.shape)
        centroid = np.array([np.average(column, weights=image), np.average(row, weights=image)])
        np.testing.assert_allclose(centroid, projected(point[None], found), atol=0.1)


def projected(point: np.ndarray, found: dict[str, Any]) -> np.ndarray:
    """Return the image of a point by the intrinsics: by OpenCV's model or the table of heights."""
    if found["distortion"] is not None:
        return opencv(point, found["matrix"], found["distortion"])[0]
    centre, ideal = (
        np.array(found["matrix"])[:2, 2],
        opencv(point, found["matrix"], [0.0] * 5)[0],
    )
    height_mm = np.hypot(*(ideal - centre)) * FINE["pixel.pitch_x_um"] * 1e-3
    real = np.interp(height_mm, found["heights_mm"]["ideal"], found["heights_mm"]["real"])
    return centre + (ideal - centre) * real / height_mm


def test_intrinsics_contain_focal_length_and_field_of_view() -> None:
    """A thin lens focused at 3 m: f = 1/(1/image + 1/focus); 90° × 67.4°, in plain values."""
    view = View(
        size=(12, 8), crop_size=(12, 8), half_width=1.0, focus_m=3.0, aperture_radius_m=0.01
    )
    found = intrinsics(view, CAMERA)
    assert found["focal_length_mm"] == pytest.approx(
        1 / (1 / (6 * 5.7e-3) + 1 / 3000), rel=1e-12
    )
    np.testing.assert_allclose(
        found["field_of_view_deg"], [90.0, 2 * math.degrees(math.atan(2 / 3))], rtol=1e-12
    )
    assert found["matrix"] == [[6.0, 0.0, 5.5], [0.0, 6.0, 3.5], [0.0, 0.0, 1.0]]
    assert json.loads(json.dumps(found)) == found and found["model"] == "thin lens"
    shifted = intrinsics(replace(view, principal_point=(0.25, 0.0)), CAMERA)
    assert shifted["principal_point_mm"] == [pytest.approx(-3 * 5.7e-3), 0.0]
    assert intrinsics(View(size=(12, 8), crop_size=(12, 8)), CAMERA)["matrix"] is None
