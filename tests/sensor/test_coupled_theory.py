"""Chains that couple neighbouring pixels: what they make of a scene is a picture, and no noise.

Oracle: the frames of many chips, whose pixels are compared with themselves. The random numbers are the same in every
run: what passes once passes always.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive

import mitsuba_sensor as ms

EXPOSURE = ms.Exposure(0.1)
SHAPE = 48, 64
CAMERA = ms.load_camera("konnik_table1").replace(
    **{"pixel.prnu": 0.01, "adc.black_level_dn": 64.0}
)
ROWS, COLUMNS = np.mgrid[: SHAPE[0], : SHAPE[1]]
CHECKERED = 10_000.0 + 15_000.0 * ((ROWS // 8 + COLUMNS // 8) % 2)
STAR = np.where((abs(ROWS - 20) < 2) & (abs(COLUMNS - 30) < 2), 8e5, 0.2 * CHECKERED)
CROSSTALK = [[0.0, 0.02, 0.0], [0.02, 0.92, 0.02], [0.0, 0.02, 0.0]]
CHIPS, FRAMES = 24, 4
CASES: dict[str, tuple[dict[str, Any], np.ndarray]] = {
    "inter-pixel capacitance": ({"readout.ipc_coupling": 0.02}, CHECKERED),
    "blooming": ({"pixel.blooming": 1.0}, STAR),
    "crosstalk": ({"quantum_efficiency.crosstalk": CROSSTALK}, CHECKERED),
    "nothing": ({}, CHECKERED),
}


def noise_of_chips(camera: ms.Camera, scene: np.ndarray, **options: Any) -> tuple[float, ...]:
    """Mean, temporal and spatial σ of each pixel over chips and frames, averaged over the pixels [DN]."""
    chips = [
        ms.expose(scene, camera, EXPOSURE, serial=serial, frames=FRAMES, **options).digital
        for serial in range(100, 100 + CHIPS)
    ]
    codes = np.array(chips, float)
    temporal = codes.var(axis=1, ddof=1).mean()
    spatial = codes.mean(axis=1).var(axis=0, ddof=1).mean() - temporal / FRAMES
    return float(codes.mean()), float(temporal**0.5), float(spatial**0.5)


@pytest.mark.parametrize(
    "case",
    [
        exhaustive("inter-pixel capacitance"),
        "blooming",
        exhaustive("crosstalk"),
        exhaustive("nothing"),
    ],
)
def test_the_picture_that_coupled_pixels_make_of_a_scene_is_no_noise(case: str) -> None:
    """σ temporal within 1 %, spatial within 3 %: the standard error of chips is 0.3 % and 0.7 %, in the tips of
    streaks more. Blooming counted 20 times as much before.
    """
    values, scene = CASES[case]
    camera = CAMERA.replace(**values)
    last = ms.expose(scene, camera, EXPOSURE).report["stages"][-1]
    mean, temporal, spatial = noise_of_chips(camera, scene)
    assert last["mean_expected"] == pytest.approx(mean, abs=0.5)
    assert last["sigma_temporal_expected"] == pytest.approx(temporal, rel=0.01)
    assert last["sigma_spatial_expected"] == pytest.approx(spatial, rel=0.03)
    of_one_chip = 0.05
    if case == "blooming":  # most of it is in the 8 tips of the streaks
        of_one_chip = 1.0
    assert last["sigma_frame"] == pytest.approx(last["sigma_expected"], rel=of_one_chip)


def test_measured_maps_of_coupled_pixels_are_spatial_noise_in_a_scene() -> None:
    """A map of 5 % of white noise behind a coupling of 2 %: √0.848 of its spatial noise without; 2 % is 4 standard
    errors, by 3072 values of the map."""
    white = np.random.default_rng(2).standard_normal(SHAPE)
    found = []
    for coupling in (0.0, 0.02):
        camera = CAMERA.replace(**{"pixel.prnu": 0.0, "readout.ipc_coupling": coupling})
        frames = ms.expose(CHECKERED, camera, EXPOSURE, maps={"prnu": 1 + 0.05 * white})
        found.append(frames.report["stages"][-1]["sigma_spatial_expected"])
    assert found[1] / found[0] == pytest.approx(0.848**0.5, rel=0.02)


@pytest.mark.exhaustive
def test_a_part_of_a_large_frame_is_sampled_and_its_errors_say_so() -> None:
    """Tiles of 32 × 32 pixels, each with 4 serial numbers; the sampled pixels are those that are followed."""
    scene = np.tile(CHECKERED, (16, 12))
    camera = CAMERA.replace(**{"readout.ipc_coupling": 0.02})
    frames = ms.expose(scene, camera, EXPOSURE, engine="numpy")
    report, small = frames.report, ms.expose(CHECKERED, camera, EXPOSURE).report
    assert report["sampled_pixels"] == report["theory"]["samples"] / 4
    for name in ("sigma_temporal", "sigma_spatial"):
        whole, part = (one["stages"][-1] for one in (report, small))
        error = np.hypot(whole[f"{name}_error"], part[f"{name}_error"])
        assert abs(whole[f"{name}_expected"] - part[f"{name}_expected"]) < 4 * error
        assert error < 0.02 * whole[f"{name}_expected"]
    json.dumps(report)


def test_pictures_that_are_expected_of_all_cameras_are_refused_with_the_way_out() -> None:
    frames = ms.expose(CHECKERED, CAMERA.replace(**{"readout.ipc_coupling": 0.02}), EXPOSURE)
    with pytest.raises(ms.InputError, match=r"couples neighbours.*several serial numbers"):
        _ = frames.spatial_mean
