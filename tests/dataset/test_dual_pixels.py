"""Datasets of dual pixels: renders of both halves of the pupil, and both photodiodes as readouts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.plan import load_plan

FILE = """
name = "halves"
outputs = ["raw", "readouts", "preview"]
render = { spp = 4, width = 24 }
scenes = [{ name = "still", file = "still_life" }]
cameras = [
    { name = "plain", camera = "sony_imx174" },
    { name = "dual", camera = "sony_imx174", set = { "sensor.dual_pixel" = true } },
]
grid.exposure_s = [0.01]
"""


def written(folder: Path, text: str = FILE) -> Path:
    (folder / "halves.toml").write_text(text, "utf-8")
    return folder / "halves.toml"


def test_dual_pixels_have_a_render_of_their_own(tmp_path: Path) -> None:
    """A camera with one photodiode renders the whole pupil, which has no halves."""
    assert len({task.light_key for task in load_plan(written(tmp_path)).tasks()}) == 2


@pytest.mark.exhaustive
def test_samples_have_both_photodiodes_which_see_different_halves(tmp_path: Path) -> None:
    """Differences of left and right are far above those of two photodiodes in the same light (shot noise of 4 % and
    less): so few light paths differ."""
    assert not make_dataset(written(tmp_path), tmp_path / "out", workers=0).failed
    (sample,) = (one for one in ms.Dataset(tmp_path / "out") if one.has("readouts.tiff"))
    readouts = sample.readouts
    assert list(readouts) == ["left", "right", "left and right"]
    left, right = (readouts[name].astype(float) for name in ("left", "right"))
    np.testing.assert_array_equal(readouts["left and right"], sample.read("raw"))
    assert np.abs(left - right).mean() > 0.1 * (left + right).mean()


@pytest.mark.parametrize(
    ("field", "said"),
    [
        ('"sensor.dual_pixel" = true', r"dual_pixel is true, .* sensor is a pinhole; take"),
        ('"lens.half_pupil" = "left"', "half_pupil is 'left', .* sensor is a pinhole; take"),
    ],
)
def test_a_plan_with_the_halves_of_a_pinhole_is_refused(
    tmp_path: Path, field: str, said: str
) -> None:
    """It was planned, and its samples failed one by one."""
    text = FILE.replace("still_life", "cornell_box").replace(
        '"sensor.dual_pixel" = true', field
    )
    text = text.replace('"readouts", ', "")
    with pytest.raises(ms.InputError, match=said):
        make_dataset(written(tmp_path, text), tmp_path / "out", workers=0)
    assert not (tmp_path / "out").exists()
