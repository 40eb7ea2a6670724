"""Halves of the pupil: where a blurred point is in each, and that they add up to the whole."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.core import Float64Array

EXPOSURE = ms.Exposure(0.01)
FOV_DEG, COLUMNS, ROWS = 2.0, 64, 48
APERTURE, FOCUS = 0.05, 5.0
NEAR, FAR = 2.5, 40.0
TANGENT_PER_PIXEL = 2 * math.tan(math.radians(FOV_DEG / 2)) / COLUMNS
SENSOR = (
    f'<sensor type="thinlens"><float name="fov" value="{FOV_DEG}"/>'
    f'<float name="aperture_radius" value="{APERTURE}"/>'
    f'<float name="focus_distance" value="{FOCUS}"/>{{more}}<film type="hdrfilm">'
    f'<integer name="width" value="{COLUMNS}"/><integer name="height" value="{ROWS}"/>{{film}}</film></sensor>'
)


def spot(folder: Path, distance: float) -> Path:
    """A small disk of light on the axis."""
    size = 5 * distance * TANGENT_PER_PIXEL
    disk = (
        f'<shape type="disk"><transform name="to_world"><scale value="{size}"/><rotate y="1" angle="180"/>'
        f'<translate z="{distance}"/></transform><emitter type="area">'
        '<spectrum name="radiance" value="300:1, 1100:1"/></emitter></shape>'
    )
    return write_scene(folder, scene_text('<integrator type="direct"/>', disk, sensor=SENSOR))


def picture(
    scene: Any, half: str | None, camera: ms.Camera | None = None, **options: Any
) -> ms.Irradiance:
    if camera is None:
        camera = ms.load_camera("konnik_table1").replace(**{"lens.half_pupil": half})
    usual = {"spp": 384, "wavelength_nm": 550.0, "seed": 4, "denoise": False}
    usual |= {"progress": False, "variant": skip_unless_usable("llvm_ad_spectral")}
    return ms.render(scene, camera, EXPOSURE, **{**usual, **options})


def centroid(light: ms.Irradiance) -> tuple[float, float]:
    """Column and row [pixels]."""
    values: Float64Array = light.data[..., 0].astype(float)
    rows, columns = np.indices(values.shape)
    return float((values * columns).sum() / values.sum()), float(
        (values * rows).sum() / values.sum()
    )


@pytest.mark.parametrize(
    ("distance", "sign"), [(NEAR, 1), pytest.param(FAR, -1, marks=pytest.mark.exhaustive)]
)
def test_the_halves_of_a_blurred_point_are_0_8488_of_its_radius_apart(
    tmp_path: Path, distance: float, sign: int
) -> None:
    """2·4R/(3π), R the radius of the blur disk, within 1 %: of a point before the focus the left half is on the right
    of the picture, behind it on the left. Rows are the same. 30 000 rays meet the light: 0.04 pixels."""
    scene = spot(tmp_path, distance)
    left, right = (centroid(picture(scene, half)) for half in ("left", "right"))
    radius_px = APERTURE * abs(1 / distance - 1 / FOCUS) / TANGENT_PER_PIXEL
    assert radius_px > 8
    apart = left[0] - right[0]
    assert apart == pytest.approx(sign * 8 / (3 * math.pi) * radius_px, rel=0.01)
    assert left[1] == pytest.approx(right[1], abs=0.2)


@pytest.mark.exhaustive
def test_left_and_right_add_up_to_the_whole(tmp_path: Path) -> None:
    """Each half has half of the sum of the picture, of which 30 000 rays meet the light: within 2 %, and every pixel
    within six standard errors."""
    scene = spot(tmp_path, NEAR)
    left, right, whole = (picture(scene, half) for half in ("left", "right", None))
    total = whole.data.sum(dtype=float)
    assert left.data.sum(dtype=float) == pytest.approx(total / 2, rel=0.02)
    assert right.data.sum(dtype=float) == pytest.approx(total / 2, rel=0.02)
    variance = sum(light.standard_error.astype(float) ** 2 for light in (left, right, whole))
    apart = np.abs(left.data.astype(float) + right.data - whole.data)
    assert (apart <= 6 * np.sqrt(variance) + 1e-3 * whole.data.max()).all()


@pytest.mark.exhaustive
def test_the_halves_of_a_prescription_are_0_8488_of_its_blur_apart(tmp_path: Path) -> None:
    """A double Gauss of 50 mm at f/8, whose blur is that of its entrance pupil. Spherical aberration moves the focus
    a little, which points before and behind it have alike: the difference of both is within 1 %."""
    lens = {"lens.prescription": "double_gauss", "lens.focal_length_mm": 50.0}
    lens |= {"lens.f_number": 8.0, "lens.focus_m": FOCUS}
    camera = ms.load_camera("konnik_table1").replace(**lens)
    pitch_mm, principal_mm = camera.pixel.pitch_x_um * 1e-3, 50.0 * (1 + 50e-3 / FOCUS)
    apart, radius_px = dict[float, float](), dict[float, float]()
    for distance in (NEAR, FAR):
        scene, lights = spot(tmp_path, distance), list[ms.Irradiance]()
        for half in ("left", "right", None):
            own = camera.replace(**{"lens.half_pupil": half})
            lights.append(picture(scene, None, camera=own, wavelength_nm=587.6))
        left, right = (centroid(light) for light in lights[:2])
        apart[distance] = left[0] - right[0]
        radius_px[distance] = 50e-3 / 16 * (1 / distance - 1 / FOCUS) * principal_mm / pitch_mm
        assert left[1] == pytest.approx(right[1], abs=0.1)
        halves, whole = (sum(float(x.data.sum()) for x in y) for y in (lights[:2], lights[2:]))
        assert halves == pytest.approx(whole, rel=0.02)
    of_blur = (apart[NEAR] - apart[FAR]) / (radius_px[NEAR] - radius_px[FAR])
    assert of_blur == pytest.approx(8 / (3 * math.pi), rel=0.01)


def test_a_pinhole_has_no_halves() -> None:
    camera = ms.load_camera("konnik_table1").replace(**{"lens.half_pupil": "left"})
    with pytest.raises(ms.InputError, match=r"lens.half_pupil is 'left'.*sensor is a pinhole"):
        ms.render("cornell_box", camera, EXPOSURE, width=8, spp=1, progress=False)
    with pytest.raises(ms.InputError, match="half_pupil"):
        ms.load_camera("konnik_table1").replace(**{"lens.half_pupil": "top"})
    dual = ms.load_camera("konnik_table1").replace(**{"sensor.dual_pixel": True})
    with pytest.raises(ms.InputError, match=r"dual_pixel is true.*sensor is a pinhole"):
        ms.render("cornell_box", dual, EXPOSURE, width=8, spp=1, progress=False)
