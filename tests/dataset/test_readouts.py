"""Datasets of cameras with several read-outs: combined code, read-outs and companded codes, made and read back."""

from __future__ import annotations

import tarfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers.datasets import SCENES

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.exports.export import export
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.plan.planned import DatasetPlan
from mitsuba_sensor.dataset.run.run import run

SPLIT = "omnivision_split_pixel"
TEXT = f"""name = "hdr"
outputs = ["raw", "readouts", "companded", "dng", "clean", "noise_budget", "preview"]
render = {{ spp = 16, width = 40 }}
scenes = [{{ name = "cornell", file = "cornell_box.xml" }}]
cameras = [{{ camera = "{SPLIT}" }}]
grid.exposure_s = [0.002, 0.05]
"""


def plan_of(**changes: Any) -> DatasetPlan:
    tables = {**tomllib.loads(TEXT), **changes}
    return DatasetPlan(read_dataset(tables), [SCENES], text=f"{TEXT}# {changes!r}\n")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> ms.Dataset:
    folder = tmp_path_factory.mktemp("readouts") / "out"
    assert not run(plan_of(), folder, workers=0).failed
    return ms.Dataset(folder)


def test_a_sample_has_its_readouts_and_what_they_are_combined_to(dataset: ms.Dataset) -> None:
    camera = ms.load_camera(SPLIT)
    for sample in dataset:
        readouts = sample.readouts
        assert list(readouts) == [*camera.readout_cameras, "combined", "companded"]
        np.testing.assert_array_equal(readouts["combined"], sample.read("raw"))
        np.testing.assert_array_equal(readouts["companded"], sample.read("companded"))
        np.testing.assert_array_equal(
            camera.companding.compand(sample.read("raw")), sample.read("companded")
        )
        first = camera.combined_readouts.combination.readouts[0]
        counts = readouts["large_high"] < first.begin_dn
        expected = (readouts["large_high"] - first.black_dn) * first.electrons_per_dn
        black_dn = sample.facts["image"]["black_level_dn"]
        found = (sample.read("raw") - black_dn) / sample.facts["system_gain_dn_per_e"]
        assert counts.any()
        np.testing.assert_allclose(found[counts], expected[counts], atol=1)
        assert sorted(sample.noise_budget["readouts"]) == sorted(camera.readout_cameras)
        named = [one["name"] for one in sample.facts["readouts"]]
        assert named == list(camera.readout_cameras)
        noise = sample.read("raw")[0] - sample.read("clean")
        assert abs(noise.mean()) < 0.1 * noise.std()


def test_the_card_has_the_noise_of_each_readout(dataset: ms.Dataset) -> None:
    """As the figures of its camera say; those of the combined frame are no camera's."""
    rows = [
        line.split(" | ")
        for line in (dataset.folder / "README.md").read_text("utf-8").splitlines()
    ]
    found = {
        row[0].removeprefix("| "): ["".join(cell.split()) for cell in row[3:6]]  # 5 394.1
        for row in rows
        if row[2:3] == ["2"]
    }
    for name, camera in ms.load_camera(SPLIT).readout_cameras.items():
        figures = camera.emva1288()
        expected = (
            figures.system_gain_dn_per_e,
            figures.temporal_dark_noise_e,
            figures.saturation_e,
        )
        assert found.pop(f"{SPLIT}, read-out {name}") == [f"{one:.5g}" for one in expected]
    assert [row[1:] for row in found.values()] == [["–", "–"]]


def test_a_dng_of_a_sample_has_the_companded_codes(dataset: ms.Dataset) -> None:
    for sample in dataset:
        with tifffile.TiffFile(sample.folder / "frame.dng") as opened:
            pages = [page for page in opened.series if page.dtype == np.uint16]
            codes = pages[0].asarray()
        np.testing.assert_array_equal(codes, sample.read("companded")[0])


def test_shards_have_linear_and_companded_codes(dataset: ms.Dataset, tmp_path: Path) -> None:
    arrays = ["raw", "companded"]
    exported = export(dataset.folder, "webdataset", tmp_path / "shards", arrays=arrays)
    assert exported == (2, [])
    (shard,) = (tmp_path / "shards").glob("*.tar")
    with tarfile.open(shard) as tar:
        names = sorted(name.partition(".")[2] for name in tar.getnames())
    assert names == sorted(["raw.npy", "companded.npy", "json", "png"] * 2)
    with pytest.raises(ms.InputError, match=r"sample\.readouts"):
        dataset[0].read("readouts")


def test_what_no_camera_has_is_refused_before_anything_is_rendered() -> None:
    for output, said in (("readouts", "reads each pixel once"), ("companded", "knees")):
        with pytest.raises(ms.InputError, match=said):
            plan_of(cameras=[{"camera": "bayer_2mp"}], outputs=["raw", output])


def test_staggered_cameras_of_a_moving_scene_have_a_render_of_their_own() -> None:
    readouts = [
        {"name": "long"},
        {"name": "short", "of": "exposure", "exposure_ratio": 0.1},
    ]
    cameras = [
        {"camera": "sony_imx174", "name": "plain"},
        {"camera": "sony_imx174", "name": "staggered", "set": {"readouts": readouts}},
    ]
    motion = {"camera": {"velocity_m_per_s": [0.1, 0, 0]}}
    scene = {"name": "cornell", "file": "cornell_box.xml", "motion": motion}
    still = plan_of(cameras=cameras, outputs=["raw"])
    moving = plan_of(cameras=cameras, outputs=["raw"], scenes=[scene])
    assert len(list(still.views())) == 1
    assert len(list(moving.views())) == 4
