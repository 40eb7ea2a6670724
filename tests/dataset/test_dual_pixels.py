"""Datasets of dual pixels: renders of both halves of the pupil, and both photodiodes as read-outs."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers.datasets import SCENES

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.plan.cameras import of_light
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.run.forecast import counts_of
from mitsuba_sensor.dataset.run.run import run

FILE = """
name = "halves"
outputs = ["raw", "readouts", "preview"]
render = { spp = 4, width = 24 }
scenes = [{ name = "still", file = "still_life.xml" }]
cameras = [
    { name = "plain", camera = "sony_imx174" },
    { name = "dual", camera = "sony_imx174", set = { "sensor.dual_pixel" = true } },
]
grid.exposure_s = [0.01]
"""


def test_dual_pixels_have_a_render_of_their_own() -> None:
    """A camera with one photodiode renders the whole pupil, which has no halves."""
    plain = ms.load_camera("sony_imx174")
    dual = plain.replace(**{"sensor.dual_pixel": True})
    assert of_light(plain, False) != of_light(dual, False)


@pytest.mark.exhaustive
def test_samples_have_both_photodiodes_which_see_different_halves(tmp_path: Path) -> None:
    """Differences of left and right are far above those of two photodiodes in the same light (shot noise of 4 % and
    less): so few light paths differ."""
    plan = DatasetPlan(read_dataset(tomllib.loads(FILE)), [SCENES], text=FILE)
    assert not run(plan, tmp_path / "out", workers=0).failed
    dataset = ms.Dataset(tmp_path / "out")
    samples = [one for one in dataset if (one.folder / "readouts.tiff").exists()]
    assert len(dataset) == 2
    assert len(samples) == 1
    readouts = samples[0].readouts
    assert list(readouts) == ["left", "right", "left and right"]
    left, right = (readouts[name].astype(float) for name in ("left", "right"))
    np.testing.assert_array_equal(readouts["left and right"], samples[0].read("raw"))
    assert np.abs(left - right).mean() > 0.1 * (left + right).mean()


@pytest.mark.parametrize(
    ("field", "said"),
    [
        ('"sensor.dual_pixel" = true', r"dual_pixel is true, .* sensor is a pinhole; take"),
        ('"lens.half_pupil" = "left"', "half_pupil is 'left', .* sensor is a pinhole; take"),
    ],
)
def test_a_plan_with_the_halves_of_a_pinhole_is_refused(field: str, said: str) -> None:
    """It was planned, and its samples failed one by one; a prescription has halves."""
    scene = "cornell_box.xml"
    text = FILE.replace("still_life.xml", scene).replace('"sensor.dual_pixel" = true', field)
    text = text.replace('"readouts", ', "")
    with pytest.raises(ms.InputError, match=said):
        counts_of(DatasetPlan(read_dataset(tomllib.loads(text)), [SCENES], text=text))
    lens = f'{field}, "lens.prescription" = "double_gauss", "lens.f_number" = 4'
    traced = text.replace(field, lens)
    assert counts_of(DatasetPlan(read_dataset(tomllib.loads(traced)), [SCENES], text=traced))
