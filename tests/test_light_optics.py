"""The lens: cos⁴ against Mitsuba's own rays, and the solid angle against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from light_scenes import SKY, scene_text, write_scene

from mitsuba_sensor.light.bands import box_bands
from mitsuba_sensor.light.optics import View, aperture_f_number, cos4, magnification, solid_angle_sr, transmittance
from mitsuba_sensor.light.scene import load_scene
from mitsuba_sensor.light.variants import choose_variant, use
from mitsuba_sensor.sensor.camera import load_camera

CAMERA = load_camera("konnik_table1")
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
        *[(sensor("perspective", axis_fov(axis)), "") for axis in ("x", "y", "diagonal", "smaller", "larger")],
        *[(sensor("perspective", axis_fov(axis), 8, 12), "") for axis in ("x", "diagonal", "smaller", "larger")],
        (sensor("perspective", '<string name="focal_length" value="35mm"/>'), ""),
        (sensor("perspective", axis_fov("x") + SHIFT), ""),
        (sensor("perspective", axis_fov("x") + SHIFT), CROP),
        (sensor("thinlens", axis_fov("y") + LENS), CROP),
        (sensor("orthographic", ""), CROP),
    ],
)
def test_cos4_is_that_of_mitsubas_own_rays(tmp_path: Path, text: str, film: str) -> None:
    """Mean of cos⁴ over 6 × 6 rays per pixel, to 5e-4 (the midpoint rule at 60° over 8 pixels is good to 2e-4)."""
    mi = use(choose_variant("scalar_spectral"))
    scene = load_scene(
        write_scene(tmp_path, scene_text(SKY, sensor=text, film=film)), box_bands(CAMERA, np.array([500.0, 510.0])), {}
    )
    axis = np.array(scene.sensor.world_transform().matrix)[:3, 2]
    columns, rows = scene.view.crop_size
    mean, at = np.zeros((rows, columns)), (np.arange(6) + 0.5) / 6
    for y in range(rows):
        for x in range(columns):
            places = [mi.Point2f((x + a) / columns, (y + b) / rows) for a in at for b in at]
            rays = [scene.sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5, 0.5))[0] for place in places]
            mean[y, x] = np.mean([(np.array(ray.d) @ axis) ** 4 for ray in rays])
    np.testing.assert_allclose(cos4(scene.view), mean, atol=5e-4)


def test_axial_solid_angle_is_pi_over_four_n_squared() -> None:
    """Ω = π·T/(4N²): 0.100178 sr at f/2.8 for a lens without loss, focused at infinity."""
    view = View(size=(1, 1), crop_size=(1, 1))
    camera = CAMERA.replace(**{"lens.transmission": 0.9, "lens.convention": "working"})
    assert (solid_angle_sr(view, camera) * transmittance(camera, [550.0]))[0, 0] == pytest.approx(
        0.9 * math.pi / (4 * 2.8**2), rel=1e-12
    )


@pytest.mark.parametrize(("f_number", "difference"), [(1.4, 0.13), (2.8, 0.032), (8.0, 0.004)])
def test_planar_convention_is_lower_by_the_known_amount(f_number: float, difference: float) -> None:
    """(1 + 4N²)/(4N²) − 1 is 13 % at f/1.4, 3.2 % at f/2.8, 0.4 % at f/8."""
    view, camera = View(size=(1, 1), crop_size=(1, 1)), CAMERA.replace(**{"lens.f_number": f_number})
    working = solid_angle_sr(view, camera.replace(**{"lens.convention": "working"}))[0, 0]
    planar = solid_angle_sr(view, camera.replace(**{"lens.convention": "planar"}))[0, 0]
    assert working / planar - 1 == pytest.approx(difference, rel=0.03)


def test_close_focus_dims_by_the_working_f_number() -> None:
    """At life size (|m| = 1) and P = 1 the working f-number doubles: a quarter of the light."""
    half = 0.3
    image_m = 0.5 * 12 * 5.7e-6 / half
    view = View(size=(12, 8), crop_size=(12, 8), half_width=half, focus_m=image_m)
    assert magnification(view, CAMERA) == pytest.approx(1.0, rel=1e-12)
    far = solid_angle_sr(replace(view, focus_m=math.inf), CAMERA)
    np.testing.assert_allclose(solid_angle_sr(view, CAMERA), far / 4, rtol=1e-12)


def test_aperture_means_an_f_number_on_this_sensor() -> None:
    """f = 1/(1/image + 1/focus), N = f/(2·radius); nothing for a pinhole."""
    view = View(size=(100, 100), crop_size=(100, 100), half_width=0.1, focus_m=1.0, aperture_radius_m=1e-3)
    image_m = 50 * 5.7e-6 / 0.1
    assert aperture_f_number(view, CAMERA) == pytest.approx(1 / (1 / image_m + 1) / 2e-3, rel=1e-12)
    assert aperture_f_number(replace(view, aperture_radius_m=0.0), CAMERA) is None


def test_telecentric_film_has_no_fall_off() -> None:
    assert (cos4(View(size=(4, 3), crop_size=(4, 3))) == 1).all()
