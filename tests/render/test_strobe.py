"""Lamps that flicker while something moves: what moves is seen where it is at each flash."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.optics.shutter import Shutter, subframes
from mitsuba_sensor.optics.waveform import Waveform

WIDTH, HEIGHT, DISTANCE_M, FOV_DEG = 96, 32, 4.0, 50.0
PX_PER_M = WIDTH / (2 * DISTANCE_M * math.tan(math.radians(FOV_DEG / 2)))
GLOBAL = ms.load_camera("konnik_table1").replace(**{"lens.relative_illumination": None})
ROW_TIME_S = 1e-3
ROLLING = GLOBAL.replace(
    **{"sensor.shutter": "rolling", "sensor.row_time_us": 1e6 * ROW_TIME_S}
)
SPEED_PX_PER_S = 400.0
BAR_PX = 4.0
START_PX = 20.0
QUICK: dict[str, Any] = {
    "wavelength_nm": 550.0,
    "spp": 256,
    "denoise": False,
    "variant": "scalar_spectral",
    "progress": False,
}


def scene(level: float | None) -> str:
    """A bright vertical bar before a background that emits, too.

    level : of the background, over that of the bar; None: there is none.
    """
    half_m, x_m = BAR_PX / 2 / PX_PER_M, (WIDTH / 2 - START_PX) / PX_PER_M
    glow = '<emitter type="area"><spectrum name="radiance" value="{}"/></emitter>'
    field = (
        '<shape type="rectangle" id="field"><transform name="to_world"><scale value="20"/>'
        '<rotate y="1" angle="180"/><translate z="0.01"/></transform>{}</shape>'
    )
    return f"""<scene version="3.0.0"><integrator type="direct"/><sensor type="perspective">
    <float name="fov" value="{FOV_DEG}"/><transform name="to_world">
    <lookat origin="0, 0, {-DISTANCE_M}" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="{WIDTH}"/>
    <integer name="height" value="{HEIGHT}"/></film></sensor>
    <shape type="rectangle" id="bar"><transform name="to_world"><scale x="{half_m}" y="9"/>
    <rotate y="1" angle="180"/><translate x="{x_m}"/></transform>{glow.format(1.0)}</shape>
    {"" if level is None else field.format(glow.format(level))}</scene>"""


MOTION = {"objects": {"bar": {"velocity_m_per_s": [-SPEED_PX_PER_S / PX_PER_M, 0, 0]}}}


def cos4() -> np.ndarray:
    """Natural vignetting of each pixel, (H, W)."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    focal_px = PX_PER_M * DISTANCE_M
    off_axis = ((x - WIDTH / 2) ** 2 + (y - HEIGHT / 2) ** 2) / focal_px**2
    return np.asarray((1 + off_axis) ** -2.0)


def photons(
    camera: ms.Camera,
    exposure_s: float,
    lights: dict[str, Waveform],
    level: float | None = None,
    **options: Any,
) -> tuple[np.ndarray, ms.Capture]:
    captured = ms.capture(
        scene(level),
        camera,
        ms.Exposure(exposure_s),
        motion=MOTION,
        light_groups="auto",
        lights=lights or None,
        **{**QUICK, **options},
    )
    return captured.photons.total, captured


def test_the_flashes_show_the_bar_where_the_closed_form_says() -> None:
    """Flashes of 2 ms every 20 ms: the middle of flash k is at 1 + 20·k ms, 8 px after the one before; each image of
    the bar has a third of the light of a steady lamp. Positions within 0.25 px."""
    image, captured = photons(GLOBAL, 0.06, {"bar": ms.pwm(50, 0.1)}, spp=64)
    row = image.mean(axis=0)
    for flash in range(3):
        middle_px = START_PX + SPEED_PX_PER_S * (0.001 + 0.02 * flash)
        near = np.abs(np.arange(WIDTH) + 0.5 - middle_px) <= 4
        found_px = np.average(np.arange(WIDTH)[near] + 0.5, weights=row[near])
        assert found_px == pytest.approx(middle_px, abs=0.25)
        assert row[near].sum() == pytest.approx(row.sum() / 3, rel=0.1)
        dark = np.abs(np.arange(WIDTH) + 0.5 - middle_px - 4) < 1
        assert row[dark].max() < 0.02 * row.max()
    sampled = captured.metadata["render"]["motion"]
    assert sampled["step_px"] <= 0.5 and sampled["waveform_displaced_px"] <= 0.25


@pytest.mark.exhaustive
@pytest.mark.parametrize("waveform", [ms.pwm(60, 0.3, 0.2), ms.sine(60, 1.0, 0.4)])
def test_every_row_of_a_rolling_shutter_sees_the_flashes_of_its_own_exposure(
    waveform: Waveform,
) -> None:
    """Centroid of each row: v·∫t·w/∫w over its exposure, by 20 000 instants; within 0.25 px. The light of a row,
    without the cos⁴ of the lens, within 8 %: four σ of its render noise (2.0 % over four seeds); the seed is fixed."""
    exposure_s = 0.02
    image, _ = photons(ROLLING, exposure_s, {"bar": waveform})
    image = image / cos4()
    opens_s = np.arange(HEIGHT) * ROW_TIME_S
    instants = opens_s[:, None] + (np.arange(20_000) + 0.5) * exposure_s / 20_000
    weights = waveform.mean_over(instants, 0.0)
    middle_s = (instants * weights).sum(axis=1) / weights.sum(axis=1)
    found_px = image @ (np.arange(WIDTH) + 0.5) / image.sum(axis=1)
    np.testing.assert_allclose(found_px, START_PX + SPEED_PX_PER_S * middle_s, atol=0.25)
    light = image.sum(axis=1) / image.sum()
    np.testing.assert_allclose(light, weights.sum(axis=1) / weights.sum(), rtol=0.08)
    apart_px = SPEED_PX_PER_S * (middle_s - opens_s - exposure_s / 2)
    assert np.abs(apart_px).max() > 2 * 0.25  # from a steady lamp: more than what is allowed


@pytest.mark.exhaustive
@pytest.mark.parametrize("waveform", [ms.pwm(100, 0.4, 0.15), ms.mains(50)])
def test_a_still_field_beside_what_moves_has_the_profile_of_the_closed_integral(
    waveform: Waveform,
) -> None:
    """Within 0.1 %: an emitter that is seen itself has no render noise."""
    image, _ = photons(ROLLING, 0.0031, {"field": waveform}, 0.01, subframes=2, spp=8)
    rows = image[:, 60:].mean(axis=1)
    steady, _ = photons(ROLLING, 0.0031, {}, 0.01, subframes=2, spp=8)
    expected = waveform.mean_over(np.arange(HEIGHT) * ROW_TIME_S, 0.0031)
    np.testing.assert_allclose(rows / steady[:, 60:].mean(axis=1), expected, rtol=1e-3)
    assert np.ptp(expected) > 0.3


@pytest.mark.parametrize("waveform", [ms.pwm(70, 0.3, 0.4), ms.sine(33, 0.9), ms.mains(50)])
@pytest.mark.parametrize("count", [1, 4, 7])
def test_weights_of_sub_frames_are_the_parts_of_the_integral(
    waveform: Waveform, count: int
) -> None:
    """Each row adds up to 1, and a sub-frame has the weight of the part of the exposure in which it lies."""
    shutter, rows = Shutter(0.02, 1e-3, 0.4), (3, 19)
    for phase in (0.013, 0.37, 0.913):
        times_s, weights = subframes(shutter, rows, count, 0.02 / count, phase, waveform)
        np.testing.assert_allclose(weights.sum(axis=1), 1.0)
        for row, opens_s in enumerate(shutter.start_s(np.arange(*rows))):
            seen = np.flatnonzero((times_s >= opens_s) & (times_s < opens_s + 0.02))
            part = np.floor((times_s[seen] - opens_s) * count / 0.02)
            of_part = waveform.mean_over(opens_s + part * 0.02 / count, 0.02 / count) / count
            whole = waveform.mean_over(opens_s, 0.02)
            np.testing.assert_allclose(weights[row, seen] * whole, of_part, atol=1e-9)


def test_a_row_without_light_and_an_exposure_of_no_time_are_as_with_a_steady_lamp() -> None:
    steady, lamp = Shutter(1e-3, 1e-3), ms.pwm(100, 0.05)
    even = subframes(steady, (0, 12), 4, 2.5e-4, 0.3)
    flickering = subframes(steady, (0, 12), 4, 2.5e-4, 0.3, lamp)
    dark = lamp.mean_over(steady.start_s(np.arange(12)), 1e-3) == 0
    assert 0 < dark.sum() < 12
    np.testing.assert_array_equal(flickering[1][dark], even[1][dark])
    np.testing.assert_array_equal(lamp.shares([0.0, 0.004], 0.0, 5), np.full((2, 5), 0.2))
