"""Datasets of cameras with several readouts: combined and companded codes; polarisers; dual pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import mitsuba_sensor as ms
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.plan import load_plan
from mitsuba_sensor.render.variants import fastest_variant

SPLIT = "omnivision_split_pixel"
TEXT = f"""name = "hdr"
outputs = ["raw", "readouts", "companded", "dng", "clean", "noise_budget", "preview"]
render = {{ spp = 16, width = 40 }}
scenes = [{{ name = "cornell", file = "cornell_box" }}]
cameras = [{{ camera = "{SPLIT}" }}]
grid.exposure_s = [0.05]
"""


def written(folder: Path, text: str = TEXT) -> Path:
    (folder / "hdr.toml").write_text(text, "utf-8")
    return folder / "hdr.toml"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> ms.Dataset:
    folder = tmp_path_factory.mktemp("readouts")
    assert not make_dataset(written(folder), folder / "out", workers=0).failed
    return ms.Dataset(folder / "out")


def test_a_sample_has_its_readouts_and_what_they_are_combined_to(
    dataset: ms.Dataset, tmp_path: Path
) -> None:
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
        (tmp_path / "frame.dng").write_bytes(sample.files["frame.dng"])
        with tifffile.TiffFile(tmp_path / "frame.dng") as opened:
            pages = [page for page in opened.series if page.dtype == np.uint16]
            np.testing.assert_array_equal(pages[0].asarray(), sample.read("companded")[0])
        noise = sample.read("raw")[0] - sample.read("clean")
        assert abs(noise.mean()) < 0.1 * noise.std()


def test_the_card_has_the_noise_of_each_readout(dataset: ms.Dataset) -> None:
    """As in the EMVA metrics of its camera; the combined frame has no metrics."""
    rows = [
        line.split(" | ")
        for line in (dataset.folder / "README.md").read_text("utf-8").splitlines()
    ]
    found = {
        row[0].removeprefix("| "): ["".join(cell.split()) for cell in row[3:6]]  # 5 394.1
        for row in rows
        if row[2:3] == ["1"] and len(row) == 8
    }
    for name, camera in ms.load_camera(SPLIT).readout_cameras.items():
        figures = camera.emva1288()
        expected = (
            figures.system_gain_dn_per_e,
            figures.temporal_dark_noise_e,
            figures.saturation_e,
        )
        assert found.pop(f"{SPLIT}, readout {name}") == [f"{one:.5g}" for one in expected]
    assert [row[1:] for row in found.values()] == [["–", "–"]]


def test_staggered_cameras_of_a_moving_scene_have_a_render_of_their_own(tmp_path: Path) -> None:
    cameras = """cameras = [
    { camera = "sony_imx174", name = "plain" },
    { camera = "sony_imx174", name = "staggered", set = { readouts = [
        { name = "long" }, { name = "short", of = "exposure", exposure_ratio = 0.1 } ] } },
]"""
    still = TEXT.replace(f'cameras = [{{ camera = "{SPLIT}" }}]', cameras)
    still = still.replace(
        next(x for x in TEXT.splitlines() if x[:7] == "outputs"), 'outputs = ["raw"]'
    )
    moves = '"cornell_box", motion = { camera = { velocity_m_per_s = [0.1, 0, 0] } }'
    moving = still.replace('"cornell_box"', moves)
    for text, lights in ((still, 1), (moving, 2)):
        plan = load_plan(written(tmp_path, text))
        assert len({task.light_key for task in plan.tasks()}) == lights


POLARISED = """
name = "glass"
outputs = ["clean", "aovs"]
render = { spp = 128, width = 24, denoise = false }
scenes = [{ name = "table", file = "polarisation", ignore_polarization = IGNORE }]
cameras = [{ camera = "sony_imx250mzr" }, { camera = "sony_imx174" }]
grid = { exposure_s = [0.004] }
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(
    fastest_variant("llvm").backend == "scalar", reason="needs LLVM: the scalar render is slow"
)
def test_a_camera_with_polarisers_beside_another_sees_what_it_sees_alone(
    tmp_path: Path,
) -> None:
    """With and without polarisation, each dataset agrees with its own capture and differs from the other."""
    options: Any = {"spp": 1024, "width": 24, "denoise": False, "seed": 1, "clean": True}
    alone, seen = {}, {}
    for ignore in (False, True):
        captured = ms.capture(
            "polarisation",
            "sony_imx250mzr",
            ms.Exposure(0.004),
            ignore_polarization=ignore,
            **options,
        )
        alone[ignore] = np.asarray(captured.frames.clean)
        file = tmp_path / f"{ignore}.toml"
        file.write_text(POLARISED.replace("IGNORE", str(ignore).lower()), "utf-8")
        found = make_dataset(file, tmp_path / str(ignore), workers=0)
        assert found.made == 2 and not found.failed
        dataset = ms.Dataset(tmp_path / str(ignore))
        assert all(one.read("depth").shape == (16, 24) for one in dataset)
        (sample,) = dataset.where(camera="sony_imx250mzr")
        seen[ignore] = np.asarray(sample.read("clean"), float)
    for ignore in (False, True):
        near, far = (np.std(seen[ignore] - alone[one]) for one in (ignore, not ignore))
        assert near < 0.5 * far


HALVES = """
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


def test_dual_pixels_have_a_render_of_their_own(tmp_path: Path) -> None:
    """A camera with one photodiode renders the whole pupil, which has no halves."""
    assert len({task.light_key for task in load_plan(written(tmp_path, HALVES)).tasks()}) == 2


@pytest.mark.exhaustive
def test_samples_have_both_photodiodes_which_see_different_halves(tmp_path: Path) -> None:
    """Left and right differ far more than two photodiodes in the same light (shot noise of 4 % and
    less): so few light paths differ."""
    assert not make_dataset(written(tmp_path, HALVES), tmp_path / "out", workers=0).failed
    (sample,) = (one for one in ms.Dataset(tmp_path / "out") if one.has("readouts.tiff"))
    readouts = sample.readouts
    assert list(readouts) == ["left", "right", "left and right"]
    left, right = (readouts[name].astype(float) for name in ("left", "right"))
    np.testing.assert_array_equal(readouts["left and right"], sample.read("raw"))
    assert np.abs(left - right).mean() > 0.1 * (left + right).mean()
