"""Plans are right: twelve random cameras and scenes, the plan's frames against the whole chain's."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.shipped import ONE_READOUT

import mitsuba_sensor as ms

FRAMES, SIZE = 24, 96
PAIRS = range(12)
CMOS_ONLY = (
    "readout.reset",
    "readout.dsnu_col",
    "readout.dsnu_row",
    "readout.prnu_col",
    "pixel.dsnu_e",
)


def random_camera(chance: np.random.Generator) -> ms.Camera:
    """A shipped camera with some of its numbers thrown anew, from nothing to a lot."""
    name = str(chance.choice(ONE_READOUT))
    changes = {
        "pixel.prnu": float(chance.choice([0.0, 1e-6, 1e-4, 5e-3, 2e-2])),
        "dark_current.cv": float(chance.choice([0.0, 0.01, 0.4])),
        "readout.reset": str(chance.choice(["hard", "soft", "true_cds"])),
        "readout.dsnu_col": float(chance.choice([0.0, 1e-7, 1e-3])),
        "readout.dsnu_row": float(chance.choice([0.0, 1e-8, 5e-4])),
        "readout.prnu_col": float(chance.choice([0.0, 1e-7, 2e-3])),
        "pixel.dsnu_e": float(chance.choice([0.0, 1e-3, 3.0])),
        "source_follower.vv_nonlinearity": float(chance.choice([1.0, 1.0 + 1e-9, 1.05])),
        "adc.bits": int(chance.choice([8, 12, 14])),
    }
    if changes["adc.bits"] == 8:
        changes["adc.black_level_dn"] = None  # that of the camera may lie above 255
    camera = ms.load_camera(name)
    if camera.sensor.technology == "ccd":
        changes = {field: value for field, value in changes.items() if field not in CMOS_ONLY}
    return camera.replace(**changes)


def pair(number: int) -> tuple[ms.Camera, ms.Exposure, ms.Photons]:
    """Camera, exposure and scene: a ramp, a flat field or a starry night, from darkness to beyond saturation."""
    chance = np.random.default_rng(number)
    camera = random_camera(chance)
    exposure = ms.Exposure(float(10 ** chance.uniform(-4, 0)), float(chance.uniform(250, 320)))
    top = camera.pixel.full_well_e * 10 ** chance.uniform(-4, 0.3)
    scene = [
        np.tile(np.linspace(0, top, SIZE), (SIZE, 1)),
        np.full((SIZE, SIZE), top),
        np.where(chance.random((SIZE, SIZE)) < 0.01, top, 0.0),
    ][number % 3]
    return camera, exposure, ms.Photons(scene)


def statistics(frames: ms.Frames) -> tuple[float, float, float]:
    """Mean, temporal and fixed σ over the frame [DN]; the fixed one with the temporal remainder taken off."""
    digital = frames.digital.astype(np.float64)
    temporal = digital.var(axis=0, ddof=1).mean()
    return (
        digital.mean(),
        np.sqrt(temporal),
        np.sqrt(max(digital.mean(axis=0).var() - temporal / len(digital), 0.0)),
    )


@pytest.mark.parametrize("number", one_in(4, PAIRS))
def test_a_planned_frame_differs_by_no_more_than_the_tolerance(number: int) -> None:
    """Same seeds, so most of the noise is common. What is not is bounded by the tolerance and the sampling error.

    A stage left out of σ_t ≤ tolerance changes the frame mean by at most tolerance + 5·σ_t/√n, and the estimates of
    σ by their own sampling error of the part that is not common; 5 σ everywhere: a false alarm in 1e4 runs of the file.
    """
    camera, exposure, photons = pair(number)
    tolerance = 0.05
    plan = ms.plan(camera, exposure, photons, tolerance_dn=tolerance)
    whole = ms.expose(photons, camera, exposure, frames=FRAMES)
    planned = ms.expose(photons, camera, exposure, frames=FRAMES, plan=plan)
    differs = (whole.digital.astype(np.float64) - planned.digital).std()
    samples = SIZE if len(plan.stages) < len(plan.whole) else 1
    error = 5 * differs / np.sqrt(samples)
    for name, a, b in zip(
        ("mean", "temporal σ", "fixed σ"), statistics(whole), statistics(planned), strict=True
    ):
        assert abs(a - b) <= tolerance + error, (name, a, b, plan.explain())


@pytest.mark.parametrize("number", one_in(4, PAIRS))
def test_tolerance_zero_leaves_out_identities_alone_and_changes_no_byte(number: int) -> None:
    camera, exposure, photons = pair(number)
    plan = ms.plan(camera, exposure, photons, tolerance_dn=0.0)
    whole, planned = (
        ms.expose(photons, camera, exposure, plan=p, precision="float64") for p in (None, plan)
    )
    assert all(
        max(e.mean_dn, e.temporal_dn, e.spatial_dn) == 0 for e in plan.effects if not e.kept
    )
    assert np.array_equal(whole.digital, planned.digital)


@pytest.mark.exhaustive
def test_a_plan_leaves_something_out_and_says_what_it_would_have_changed() -> None:
    """At least one of the twelve pairs loses a stage that does something, and the plan names its size."""
    lost = []
    for number in PAIRS:
        camera, exposure, photons = pair(number)
        plan = ms.plan(camera, exposure, photons, tolerance_dn=0.05)
        lost += [
            e
            for e in plan.effects
            if not e.kept and max(e.mean_dn, e.temporal_dn, e.spatial_dn) > 0
        ]
    assert lost and all(max(e.mean_dn, e.temporal_dn, e.spatial_dn) <= 0.05 for e in lost)
