"""What people read of a dataset: its table of samples, and samples found by their values."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest
from helpers.datasets import SCENES

import mitsuba_sensor as ms
from mitsuba_sensor import InputError
from mitsuba_sensor.dataset.planned import DatasetPlan, load_plan
from mitsuba_sensor.dataset.repair import holdings, verify
from mitsuba_sensor.dataset.run import run
from mitsuba_sensor.dataset.store import Store

FILE = """
name = "views"
outputs = ["raw", "preview"]
render = { spp = 4, width = 24, denoise = false }
cameras = [{ camera = "konnik_table1" }]
grid = { exposure_ev = [0, -2] }
list = [{ exposure_s = 0.01 }, { exposure_s = "auto" }]
[[scenes]]
name = "flat"
file = "flat_field.xml"
[[scenes]]
name = "box"
file = "cornell_box.xml"
views = [{ origin_m = [0, 1, 3.9], target_m = [0, 1, 0] }, { origin_m = [0, 1.5, 3.9], target_m = [0, 1, 0] }]
"""


def plan_in(folder: Path, text: str = FILE) -> DatasetPlan:
    (folder / "views.toml").write_text(text, "utf-8")
    return load_plan(folder / "views.toml", [SCENES])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("overview")
    found = run(plan_in(folder), folder / "out", workers=0)
    assert not found.failed and not found.remarks
    return folder / "out"


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "out"))


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "samples.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_has_a_row_of_each_sample_with_the_time_that_it_was_exposed(
    made: Path,
) -> None:
    """Metered or not, stops included; a sample's folder is found by its row."""
    samples, rows = ms.Dataset(made), rows_of(made)
    assert [row["key"] for row in rows] == [one.key for one in samples]
    for sample, row in zip(samples, rows, strict=True):
        assert made / row["folder"] == sample.folder
        assert float(row["exposure_s"]) == sample.facts["image"]["exposure_s"]
        assert row["exposure_ev"] == str(sample.values["exposure_ev"])
        assert row["view"] == str(sample.values.get("view", ""))
    assert [row["scene"] for row in rows] == ["flat"] * 4 + ["box"] * 8
    assert rows[-1]["pose.origin_m"] == "0.0 1.5 3.9" and rows[0]["pose.origin_m"] == ""


def test_pandas_reads_numbers_as_numbers(made: Path) -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.read_csv(made / "samples.csv")
    assert len(table[(table.scene == "box") & (table.view == 1) & (table.exposure_ev < 0)]) == 2
    assert table.exposure_s.dtype == float


def test_samples_are_found_by_scene_view_and_exposure(made: Path) -> None:
    samples = ms.Dataset(made)
    found = samples.where(scene="box", view=1, exposure_s=0.01)
    assert isinstance(found, ms.Dataset) and [one.values["exposure_ev"] for one in found] == [
        0,
        -2,
    ]
    assert {one.values["view"] for one in found} == {1} and len(samples) == 12
    metered = samples.where(exposure_s="auto", exposure_ev=-2.0, view=0)
    assert [one.key for one in metered] == [samples[7].key]
    assert len(found.where(exposure_ev=0)) == 1 and not len(samples.where(scene="flat", view=0))
    assert len(samples.where(exposure_s=0.1 / 10 * (1 + 1e-15))) == 6, "as arithmetic gives it"


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"scene": "boxx"}, "scene is 'boxx'; the samples have flat, box. Did you mean 'box'?"),
        ({"scene": "box", "view": 7}, "view is 7; the samples have 0, 1."),
        ({"exposure_s": 0.02}, "exposure_s is 0.02; the samples have 0.01, auto."),
        ({"split": "train"}, "split is 'train'; the samples have none."),
        ({"exposure": 1}, "no sample has 'exposure'; what they have: scene, camera, "),
    ],
)
def test_what_no_sample_has_is_a_sentence_with_what_there_is(
    made: Path, asked: dict[str, object], sentence: str
) -> None:
    with pytest.raises(InputError) as caught:
        ms.Dataset(made).where(**asked)
    assert str(caught.value).startswith(sentence)


def test_the_table_is_no_part_of_what_is_verified_and_comes_back(copy: Path) -> None:
    plan, table = plan_in(copy.parent), copy / "samples.csv"
    before, size = table.read_bytes(), holdings(Store(copy), plan).bytes
    table.write_text("edited")
    assert not list(verify(copy)) and holdings(Store(copy), plan).bytes == size
    assert run(plan, copy, workers=0).made == 0
    assert table.read_bytes() == before


def test_a_table_that_cannot_be_written_is_a_remark(copy: Path) -> None:
    """A folder stands in its place."""
    (copy / "samples.csv").unlink()
    (copy / "samples.csv").mkdir()
    found = run(plan_in(copy.parent), copy, workers=0)
    assert found.there == 12 and not found.failed
    assert len(found.remarks) == 1 and "samples.csv was not written: " in found.remarks[0]
    assert not list(verify(copy))
