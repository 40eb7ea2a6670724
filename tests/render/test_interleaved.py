"""Passes side by side on one film: the same light as one after the other, independent, with error bars that hold."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from helpers.scenes import SCENES, scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.render.passes import interleaved
from mitsuba_sensor.render.passes.prepared import PreparedRender, prepare
from mitsuba_sensor.render.passes.stop_criterion import StopCriterion, stop_criterion_of

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.02)
RENDERS = 20


def prepared(scene: object, width: int = 24, **options: object) -> PreparedRender:
    options = {"wavelength_nm": 550, **options}
    variant = skip_unless_usable("llvm_ad_spectral")
    return prepare(
        scene, CAMERA, EXPOSURE, variant=variant, width=width, denoise=False, **options
    )


def test_a_number_of_passes_is_shared_out_evenly_and_in_two_halves_where_it_can_be() -> None:
    """8 passes in halves, 9 in thirds, 13 at once; where anything else can end the render, one after the other."""
    for passes, most, count in (
        (8, 99, 4),
        (8, 3, 2),
        (9, 99, 3),
        (13, 99, 13),
        (13, 5, 1),
        (16, 1, 1),
        (2, 99, 2),
    ):
        assert StopCriterion(passes, 4).together(most) == count
    for stop in (
        StopCriterion(8, 4, goal=0.1),
        StopCriterion(8, 4, max_seconds=9.0),
        StopCriterion(8, 4, sized=False),
    ):
        assert stop.together(99) == 1


def test_each_pass_sees_the_pixels_of_the_crop_in_their_place() -> None:
    """A ramp of reflectance under even light: pixel (r, c) of every one of 7 passes is that of a pass by itself, to the
    noise of 256 samples within a pixel (1 %, differences of neighbours are 2 to 40 %)."""
    scene = prepared(SCENES / "step_wedge.xml", 32).scene
    columns, rows = scene.view.crop_size
    alone = scene.render(1, 256, (0, rows))
    seven = scene.render(2, 256, (0, rows), 7).reshape(rows, columns, 7, -1)
    lit = alone[..., 0] > 0.05 * alone.max()
    for k in range(7):
        np.testing.assert_allclose(seven[lit, k], alone[lit], rtol=0.02)


def test_passes_of_some_rows_are_a_window_of_the_whole() -> None:
    """Three passes of rows 2 … 10 of the crop: the sums of the rows agree with those of all rows to 8 %;
    neighbouring rows differ by up to 30 times."""
    scene = prepared(SCENES / "cornell_box.xml", 32).scene
    columns, rows = scene.view.crop_size
    whole = scene.render(3, 256, (0, rows))[..., 0].sum(axis=1)
    part = scene.render(4, 256, (2, 10), 3)[..., 0].reshape(8, columns, 3).sum(axis=1)
    np.testing.assert_allclose(part, np.repeat(whole[2:10, None], 3, axis=1), rtol=0.08)


def test_the_mean_is_that_of_single_passes_and_the_error_bars_are_of_independent_ones() -> None:
    """Cornell box, 24 × 24, 16 samples: over 20 renders the mean agrees with single passes within four standard errors
    of the picture's sum, and the variance of a pixel over the renders is what each render says, within 8 % (576 pixels
    of 19 degrees of freedom: 1.4 % at equal variances, a few where pixels differ)."""
    job, stop = prepared(SCENES / "cornell_box.xml"), stop_criterion_of({"spp": 16})

    def renders(first: int) -> tuple[np.ndarray, np.ndarray]:
        found = []
        for seed in range(first, first + RENDERS):
            job.renderer.run(seed, stop, lambda step: None)
            found.append(job.renderer.electrons())
        return np.array([mean for mean, _ in found]), np.array(
            [variance for _, variance in found]
        )

    mean, variance = renders(0)
    with patch.object(interleaved, "MOST_IN_FLIGHT", 1):
        single, _ = renders(1000)
    sums = mean.sum(axis=(1, 2)), single.sum(axis=(1, 2))
    apart = abs(sums[0].mean() - sums[1].mean())
    assert apart < 4 * np.hypot(sums[0].std(), sums[1].std()) / RENDERS**0.5
    assert mean.var(axis=0, ddof=1).sum() == pytest.approx(
        variance.mean(axis=0).sum(), rel=0.08
    )
    normal = (mean - mean.mean(axis=0)) / mean.std(
        axis=0
    )  # 11 040 pairs of neighbours: 0.01 is a standard error
    neighbours = np.corrcoef(normal[:, :, 1:].ravel(), normal[:, :, :-1].ravel())
    assert abs(neighbours[0, 1]) < 0.05


def test_a_render_of_few_samples_is_two_launches_of_one_kernel() -> None:
    """Of the film's kernel, which is the only one that hits the scene: eight passes in two launches."""
    job, dr = prepared(SCENES / "cornell_box.xml"), drjit()
    job.render(1, stop_criterion_of({"spp": 16}))
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        job.render(2, stop_criterion_of({"spp": 16}))
        sizes = [one["size"] for one in dr.kernel_history() if one["type"] == dr.KernelType.JIT]
    assert job.renderer.passes == 8 and sorted(sizes)[-2:] == [24 * 24 * 4 * 2] * 2


@pytest.mark.exhaustive
@pytest.mark.parametrize("spectral", ["auto", "cube", "channels"])
def test_every_kind_of_channels_has_the_same_light(spectral: str) -> None:
    """The whole picture's photoelectrons within 2 % of those of single passes, 128 samples."""
    options = {"spectral": spectral, "wavelength_nm": None, "bandwidth_nm": 50}
    job, stop, sums = (
        prepared(SCENES / "cornell_box.xml", **options),
        stop_criterion_of({"spp": 128}),
        [],
    )
    for most in (interleaved.MOST_IN_FLIGHT, 1):
        with patch.object(interleaved, "MOST_IN_FLIGHT", most):
            job.renderer.run(1, stop, lambda step: None)
        sums.append(job.renderer.electrons()[0].sum())
    assert sums[0] == pytest.approx(sums[1], rel=0.02)


@pytest.mark.exhaustive
def test_a_camera_within_a_medium_stays_within_it(tmp_path) -> None:
    """Absorption of 1 per unit over 3 units and more before a bright wall: below exp(−3) of the light, with one pass or
    many (of 6144 and 24 576 paths 300 and 1000 arrive: 7 %)."""
    wall = '<shape type="rectangle"><transform name="to_world"><scale value="99"/><rotate y="1" angle="180"/>'
    wall += '<translate z="3"/></transform><emitter type="area"><spectrum name="radiance" value="1"/></emitter></shape>'
    medium = '<medium type="homogeneous" id="water"><spectrum name="sigma_t" value="1"/>'
    medium += '<spectrum name="albedo" value="0"/></medium>'
    text, found = scene_text(medium, '<integrator type="volpath"/>', wall), []
    for inside in (False, True):
        here = text.replace(
            '<sensor type="perspective">',
            '<sensor type="perspective"><ref name="m" id="water"/>',
        )
        job = prepared(write_scene(tmp_path, here if inside else text), 12)
        rows = job.scene.view.crop_size[1]
        found.append([job.scene.render(5, 64, (0, rows), count).mean() for count in (1, 4)])
    assert found[0][0] == pytest.approx(found[0][1], rel=0.01)
    assert 0.02 < found[1][0] / found[0][0] < np.exp(-3)
    assert found[1][1] == pytest.approx(found[1][0], rel=0.3)


def test_pixels_with_more_samples_are_rendered_pass_by_pass() -> None:
    scene = prepared(SCENES / "cornell_box.xml").scene
    assert scene.most_together(4) > 8
    assert replace(scene, noisy=object()).most_together(4) == 1
