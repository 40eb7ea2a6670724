"""Chief-ray angles against closed forms and traced rays, and their effect on the pixels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.lens_oracle import DOUBLE_GAUSS, forward, vertices

import mitsuba_sensor as ms
from mitsuba_sensor.optics.f_number_law import chief_ray_deg, shading, solid_angle_sr
from mitsuba_sensor.optics.intrinsics import View
from mitsuba_sensor.optics.traced_lens import cardinal_points

ANGLES_DEG = (0.0, 10.0, 20.0, 40.0)
RESPONSE = tuple(math.cos(math.radians(2 * x)) for x in ANGLES_DEG)
PIXEL = {"pixel.angular_response": RESPONSE, "pixel.angular_response_deg": ANGLES_DEG}
VIEW = View((64, 48), (64, 48), half_width=0.5)
STOP, GAP_BEHIND_STOP_MM = 5, 4.5  # of the double Gauss
HEIGHTS_MM = np.array([0.0, 0.05, 0.2])


def camera_of(**fields: object) -> ms.Camera:
    return ms.load_camera("konnik_table1").replace(**{**PIXEL, **fields})


def test_a_pinhole_has_the_field_angle_and_a_larger_pupil_reduces_it() -> None:
    half_mm = 32 * 5.7e-3
    expected = np.degrees(np.arctan(HEIGHTS_MM / (half_mm / 0.5)))
    np.testing.assert_allclose(chief_ray_deg(VIEW, camera_of(), HEIGHTS_MM), expected)
    halved = chief_ray_deg(VIEW, camera_of(**{"lens.pupil_magnification": 2.0}), HEIGHTS_MM)
    tangents = np.tan(np.radians([halved, expected]))
    np.testing.assert_allclose(tangents[0], tangents[1] / 2)


@pytest.mark.parametrize("gap_mm", [30.0, 60.0, 80.0])
def test_chief_rays_of_a_stop_before_or_behind_the_front_focus(gap_mm: float) -> None:
    """Paraxial formula of a thick plano-convex lens; the rays converge if the stop is beyond the focus."""
    radius, thickness, n = 25.8, 5.3, 1.5168
    stop = {"thickness_mm": gap_mm, "semi_diameter_mm": 3.13, "stop": True}
    front = {
        "radius_mm": radius,
        "thickness_mm": thickness,
        "index": n,
        "semi_diameter_mm": 12.7,
    }
    table = {"name": "singlet", "surfaces": [stop, front, {"semi_diameter_mm": 12.7}]}
    camera = camera_of(**{"lens.prescription": table, "lens.f_number": 12.0})
    near = 1e-3  # slope of the chief ray in the stop
    slope = near / n - near * gap_mm * (n - 1) / (n * radius)  # in the glass
    behind, at_last = n * slope, near * gap_mm + thickness * slope
    focal = radius / (n - 1)
    height_mm = at_last + behind * (focal - thickness / n)
    found = chief_ray_deg(replace(VIEW, sequential=True), camera, np.array([0.0, height_mm]))
    np.testing.assert_allclose(found, [0, math.degrees(math.atan(behind))], rtol=1e-4)
    assert (found[1] < 0) == (gap_mm > focal)


@pytest.mark.parametrize("focus_m", [math.inf, 0.5])
def test_chief_rays_of_a_prescription_cross_the_centre_of_its_stop(focus_m: float) -> None:
    """Traced by independent code from the centre of the stop to the sensor, within 0.001°. The paraxial exit pupil
    would be 0.94° off at 21 mm."""
    camera = camera_of(**{"lens.prescription": "double_gauss", "lens.f_number": 4.0})
    slopes = np.linspace(0.0, math.tan(math.radians(27)), 40)
    size = np.sqrt(1 + slopes**2)
    ways = np.column_stack([slopes / size, 0 * slopes, 1 / size])
    start = np.tile([0.0, 0.0, -GAP_BEHIND_STOP_MM], (40, 1))
    rear = DOUBLE_GAUSS[STOP + 1 :]
    at, way, passes = forward(rear, start, ways, 100.0)
    assert passes.all()
    film_mm = vertices(rear)[-1] + cardinal_points(camera.lens).image_distance(focus_m)
    slope = way[:, 0] / way[:, 2]
    heights_mm = at[:, 0] + (film_mm - at[:, 2]) * slope
    assert heights_mm.max() > 15
    view = replace(VIEW, sequential=True, focus_m=focus_m)
    found = chief_ray_deg(view, camera, heights_mm)
    np.testing.assert_allclose(found, np.degrees(np.arctan(slope)), atol=1e-3)


def test_relative_illumination_includes_the_response_at_each_pixels_angle() -> None:
    """A linear response from 1 at 0° to 0 at 90° behind a pinhole of 53°, within 1e-4, the averaging over a pixel."""
    linear = {"pixel.angular_response": (1.0, 0.0), "pixel.angular_response_deg": (0.0, 90.0)}
    plain = ms.load_camera("konnik_table1")
    ratio = solid_angle_sr(VIEW, plain.replace(**linear)) / solid_angle_sr(VIEW, plain)
    y, x = np.mgrid[:48, :64] + 0.5
    angle_deg = np.degrees(np.arctan(np.hypot(x - 32, y - 24) / 64))
    np.testing.assert_allclose(ratio, 1 - angle_deg / 90, atol=2e-3)
    np.testing.assert_allclose(
        ratio[10:14, 50:54], (1 - angle_deg / 90)[10:14, 50:54], atol=1e-4
    )


def test_microlenses_matched_to_the_chief_ray_lose_nothing() -> None:
    heights = np.linspace(0, 0.3, 200)
    made_for = chief_ray_deg(VIEW, camera_of(), heights)
    table = {"pixel.microlens_cra_deg": made_for.tolist()}
    shifted = camera_of(**table, **{"pixel.microlens_cra_heights_mm": heights.tolist()})
    plain = ms.load_camera("konnik_table1")
    np.testing.assert_allclose(
        solid_angle_sr(VIEW, shifted), solid_angle_sr(VIEW, plain), rtol=1e-4
    )
    found, expected = (shading(VIEW, one) for one in (shifted, plain))
    assert found is not None and expected is not None
    np.testing.assert_allclose(
        found["relative_illumination"], expected["relative_illumination"], rtol=1e-4
    )


def test_a_render_includes_the_angular_response() -> None:
    """The ratio to a render with equal random numbers has the closed form, and a note says so."""
    options: Any = {"width": 24, "spp": 1, "wavelength_nm": 550.0, "denoise": False}
    options |= {"progress": False, "variant": "scalar_spectral"}
    plain = ms.load_camera("konnik_table1")
    slanted = plain.replace(
        **{"pixel.angular_response": (1.0, 0.0), "pixel.angular_response_deg": (0.0, 40.0)}
    )
    one, two = (
        ms.render("cornell_box", c, ms.Exposure(0.1), **options) for c in (plain, slanted)
    )
    lit = one.data > 0
    intrinsics = one.statistics.intrinsics
    half_width = 12 / intrinsics["matrix"][0][0]
    view = View((24, 24), (24, 24), half_width=half_width)
    expected = (solid_angle_sr(view, slanted) / solid_angle_sr(view, plain))[..., None]
    np.testing.assert_allclose(
        (two.data / np.where(lit, one.data, 1))[lit], expected[lit], rtol=1e-4
    )
    assert any("chief ray of the corner comes at 26" in note for note in two.notes)


def test_a_table_that_ends_inside_the_picture_is_refused() -> None:
    short = {"pixel.angular_response": (1.0, 0.9), "pixel.angular_response_deg": (0.0, 3.0)}
    with pytest.raises(ms.InputError, match=r"angular_response_deg \[°\] ends at 3"):
        solid_angle_sr(VIEW, camera_of(**short))
