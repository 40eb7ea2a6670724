"""What people read of a dataset: its card, contact sheet and table, and samples found by their values."""

from __future__ import annotations

import csv
import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.datasets import SCENES
from helpers.scenes import SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor import InputError
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.exports import summary
from mitsuba_sensor.dataset.exports.job import facts_of
from mitsuba_sensor.dataset.exports.sheet import caption, names_that_vary, sheet_rows
from mitsuba_sensor.dataset.index.origin import index_of
from mitsuba_sensor.dataset.index.part import Line
from mitsuba_sensor.dataset.index.repair import holdings, verify
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, load_plan
from mitsuba_sensor.dataset.read import reader
from mitsuba_sensor.dataset.read.reader import Sample
from mitsuba_sensor.dataset.run import overview
from mitsuba_sensor.dataset.run.forecast import forecast
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.dataset.store.keys import Facts
from mitsuba_sensor.dataset.store.record import FOR_PEOPLE
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.files.texts import json_object
from mitsuba_sensor.optics.spectra import inverse_srgb_curve, srgb_curve
from mitsuba_sensor.output.contact_sheet import GAP, MOST_LETTERS, brightened, text_picture

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


def test_cameras_of_one_name_and_two_gains_show_in_card_and_table(tmp_path: Path) -> None:
    """The full scale of the converter varies by a factor of 40; expected from the frames themselves."""
    text = """
name = "two"
outputs = ["raw"]
render = { spp = 1, width = 8, denoise = false }
cameras = [{ camera = "bayer_2mp" }]
grid = { exposure_s = [0.01], "camera.adc.full_scale_v" = [0.98, 0.0245] }
scenes = [{ name = "box", file = "cornell_box.xml" }]
"""
    assert not run(plan_in(tmp_path, text), tmp_path / "out", workers=0).remarks
    rows = rows_of(tmp_path / "out")
    samples = ms.Dataset(tmp_path / "out")
    for row, sample in zip(rows, samples, strict=True):
        assert float(row["system_gain_dn_per_e"]) == sample.facts["system_gain_dn_per_e"]
        assert float(row["black_level_dn"]) == sample.facts["image"]["black_level_dn"]
    gains, blacks = (
        sorted(float(row[name]) for row in rows)
        for name in ("system_gain_dn_per_e", "black_level_dn")
    )
    assert gains[1] > 30 * gains[0]
    card = (tmp_path / "out" / "README.md").read_text("utf-8")
    assert f"| 2 | {gains[0]:.5g} to {gains[1]:.5g} | " in card
    assert f"| {blacks[0]:.5g} to {blacks[1]:.5g} | " in card and "samples differ" in card


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


def for_people(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FOR_PEOPLE}


def test_they_are_no_part_of_what_is_verified_and_come_back(copy: Path) -> None:
    plan, before = plan_in(copy.parent), for_people(copy)
    size = holdings(Store(copy), plan).bytes
    for name in (*FOR_PEOPLE, "samples.csv"):
        (copy / name).unlink()
        if name == "samples.csv":
            (copy / name).write_text("edited")
        assert not list(verify(copy)) and holdings(Store(copy), plan).bytes == size
        assert run(plan, copy, workers=0).made == 0
        assert for_people(copy) == before


def test_a_run_that_changes_nothing_reads_no_sample_again(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(overview, "summary", None)
    assert not run(plan_in(copy.parent), copy, workers=0).remarks


def test_light_that_is_too_bright_is_a_remark_of_the_run_and_in_the_card(
    tmp_path: Path,
) -> None:
    """A sky of 7.3e9 cd/m² is metered to nanoseconds."""
    write_scene(tmp_path, scene_text(SKY.replace("2e-4", "1e5")))
    text = FILE[: FILE.index("grid")] + '[[scenes]]\nname = "sky"\nfile = "scene.xml"\n'
    (tmp_path / "views.toml").write_text(
        text.replace("spp = 4, width = 24", "spp = 1, width = 12"), "utf-8"
    )
    found = run(load_plan(tmp_path / "views.toml", [tmp_path]), tmp_path / "out", workers=0)
    (remark,) = found.remarks
    assert not found.failed and "metered exposure time is" in remark and "light_scale" in remark
    assert remark in (tmp_path / "out" / "README.md").read_text("utf-8")


def test_a_run_that_goes_on_ends_with_the_same_as_one(made: Path, tmp_path: Path) -> None:
    """Shards; after the first one the card says what is not there. Keys of three views say how many shards it takes
    that the first one has some of them and not all."""
    plan, shards = plan_in(tmp_path), 2
    while not 0 < (first := run(plan, tmp_path / f"{shards}", shard=(1, shards)).made) < 12:
        shards += 1
    out = tmp_path / f"{shards}"
    text = (out / "README.md").read_text("utf-8")
    assert 0 < first < 12 and f"\n{12 - first} of 12 samples are not there.\n" in text
    assert f"| samples | {first} |" in text and len(rows_of(out)) == first
    for number in range(2, shards + 1):
        run(plan, out, shard=(number, shards))
    assert for_people(out) == for_people(made)


def test_the_table_of_a_run_that_goes_on_reads_new_samples_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan, out = plan_in(tmp_path), tmp_path / "out"
    run(plan, out, shard=(1, 2))
    before = {row["key"] for row in rows_of(out)}
    read = list[str]()

    def noted(text: str | bytes, place: str, remedy: str) -> Facts:
        found = json_object(text, place, remedy)
        read.append(found["key"])
        return found

    monkeypatch.setattr(reader, "json_object", noted)
    run(plan, out, shard=(2, 2))
    new = {one.key for one in ms.Dataset(out)} - before
    assert sorted(read) == sorted(new) and before


def test_the_card_is_of_what_is_there_where_views_are_in_quarantine(tmp_path: Path) -> None:
    wrong = 'file = "cornell_box.xml"\nparameters = { lamp_cd_per_m2 = 0 }'
    text = FILE.replace('file = "cornell_box.xml"', wrong)
    found = run(plan_in(tmp_path, text), tmp_path / "out", workers=0)
    assert len(found.failed) == 2 and not found.remarks
    card = (tmp_path / "out" / "README.md").read_text("utf-8")
    assert "8 of 12 samples are not there, and 2 views are in quarantine." in card
    assert "| samples | 4 |" in card and (tmp_path / "out" / "contact_sheet.png").exists()


def test_the_card_of_a_big_dataset_reads_some_of_its_samples(
    copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Counts are of all, from the index; the card says how many were read for the rest."""
    read = list[str]()

    def noted(sample: Sample) -> Facts:
        read.append(sample.key)
        return facts_of(sample)

    monkeypatch.setattr(overview, "MOST_READ", 3)
    monkeypatch.setattr(summary, "facts_of", noted)
    (copy / "README.md").unlink()
    run(plan_in(copy.parent), copy, workers=0)
    text = (copy / "README.md").read_text("utf-8")
    assert len(read) == 3 and "| samples | 12 |" in text and "| renders | 3 |" in text
    assert "\n3 of the 12 samples, evenly chosen, were read" in text
    names = "".join(f"{path.name}\n" for path in (copy / "index").iterdir())
    index = hashlib.sha256(names.encode()).hexdigest()
    assert f"`index/`, a line each | {index} |" in text and "record.json" not in text


def test_the_card_says_how_large_the_render_noise_is_and_what_helps(
    made: Path, tmp_path: Path
) -> None:
    """Four samples per pixel are far above a tenth of the sensor's noise; in a millionth of the light they are not."""
    views = {one.view_folder.name: one.facts["light"] for one in ms.Dataset(made)}
    median = np.median([light["noise_ratio_median"] for light in views.values()])
    card = (made / "README.md").read_text("utf-8")
    assert len(views) == 3 and median > 0.1
    assert f"Render noise is {median:.3g} × " in card and "and over 3 views)" in card
    assert "`denoise = true`" in card
    text = FILE.split('[[scenes]]\nname = "box"')[0].replace("0.01 }, {", "1e-8 }, {")
    assert not run(plan_in(tmp_path, text), tmp_path / "out", workers=0).failed
    card = (tmp_path / "out" / "README.md").read_text("utf-8")
    assert "over the pixels of one view)" in card and "denoise" not in card


def test_the_sheet_is_developed_from_raw_frames_where_no_previews_are_stored(
    made: Path, tmp_path: Path
) -> None:
    """The same pictures of a camera without colour filters, whose white needs no light of the scene."""
    text = FILE.replace(', "preview"', "")
    run(plan_in(tmp_path, text), tmp_path / "out", workers=0)
    assert (tmp_path / "out" / "contact_sheet.png").exists()
    assert "![" in (tmp_path / "out" / "README.md").read_text("utf-8")
    for stored, developed in zip(ms.Dataset(made), ms.Dataset(tmp_path / "out"), strict=True):
        assert not (developed.folder / "frame.png").exists()
        one, other = stored.read("preview"), developed.read("preview")
        assert one.dtype == np.uint8 and one.shape == stored.read("raw")[0].shape
        np.testing.assert_array_equal(one, other)


def test_without_previews_and_raw_frames_the_card_says_why_there_is_no_sheet(
    tmp_path: Path,
) -> None:
    text = FILE.replace('["raw", "preview"]', '["clean"]').replace("[0, -2]", "[0]")
    run(plan_in(tmp_path, text), tmp_path / "out", workers=0)
    card = (tmp_path / "out" / "README.md").read_text("utf-8")
    assert "no contact sheet: neither `preview` nor `raw` is among the outputs" in card
    assert not (tmp_path / "out" / "contact_sheet.png").exists() and "![" not in card
    (sample, *_) = ms.Dataset(tmp_path / "out")
    with pytest.raises(
        ms.InputError, match=r"frame\.tiff; name what preview needs in the outputs"
    ):
        sample.read("preview")


@pytest.mark.parametrize("name", FOR_PEOPLE)
def test_what_cannot_be_written_is_a_remark_and_the_run_has_not_failed(
    copy: Path, name: str
) -> None:
    """A folder stands in its place."""
    (copy / name).unlink()
    (copy / name).mkdir()
    found = run(plan_in(copy.parent), copy, workers=0)
    assert found.there == 12 and not found.failed
    assert (
        len(found.remarks) == 1
        and not found.render_noise
        and f"was not written: cannot write {copy / name}" in found.remarks[0]
    )
    assert not list(verify(copy)) and not list(copy.glob(".*"))


def test_a_preview_that_was_changed_is_a_remark_that_says_what_to_do(copy: Path) -> None:
    picture = ms.Dataset(copy)[0].folder / "frame.png"
    picture.write_bytes(picture.read_bytes()[:-1] + b"x")
    (copy / "README.md").unlink()
    found = run(plan_in(copy.parent), copy, workers=0)
    assert (
        f"{picture} is not as it was written; `mitsuba-sensor dataset repair`"
        in found.remarks[0]
    )


def test_a_row_of_the_sheet_is_a_scene_and_view_and_says_the_exposures(made: Path) -> None:
    rows = sheet_rows(Store(made), index_of(made))
    assert [row.label for row in rows] == [["flat"], ["box", "view 0"], ["box", "view 1"]]
    for row in rows:
        lines = [line for one in row.pictures for line in one.caption]
        auto_s = {float(line.split()[0]) for line in lines} - {0.01, 0.0025}
        assert len(lines) == 4 and {"0.01 s", "0.0025 s, -2 EV"} < {*lines}
        assert max(auto_s) == pytest.approx(4 * min(auto_s), rel=0.01)
        assert f"{min(auto_s):.3g} s, -2 EV" in lines


@pytest.mark.parametrize(
    ("values", "lines"),
    [
        ({"exposure_s": 0.025, "gain": 100}, ["0.3 s"]),
        ({"exposure_ev": -1.5, "camera.adc.bits": 10}, ["0.3 s, -1.5 EV", "bits 10"]),
        ({"exposure_ev": 0, "camera": "bayer"}, ["0.3 s", "bayer"]),
        ({"traverse.lamp.value": [0.5, 1.0, 2.0], "view": 3}, ["0.3 s", "value 0.5 1 2"]),
    ],
)
def test_a_caption_is_the_time_that_was_exposed_and_what_varies(
    values: dict[str, object], lines: list[str]
) -> None:
    other = dict.fromkeys(values, "other")
    varied = names_that_vary([Line(0, "", "", "", "", False, x) for x in (values, other)])
    assert varied == [*values]
    assert caption(values, [name for name in varied if name != "gain"], 0.3) == lines


def test_a_text_is_as_wide_as_it_is_and_cut_where_it_has_no_end() -> None:
    lines = ["one", "a b", "i" * 1000, "\n\x1b"]
    widths = [text_picture([line]).width for line in lines]
    picture = np.asarray(text_picture(lines))
    assert picture.shape[1] == max(widths) and picture.min() < 100
    assert text_picture(["i" * MOST_LETTERS]).width < widths[2] + 10 * GAP < 200
    assert text_picture([]).size == (1, 1)


def test_a_run_ends_with_the_render_noise_and_leaves_no_empty_folder(tmp_path: Path) -> None:
    """The sentence of the card; a second run, which makes nothing, says nothing of it."""
    found = run(plan_in(tmp_path), tmp_path / "out", workers=0)
    assert found.render_noise.startswith("Render noise is ")
    assert found.render_noise in (tmp_path / "out" / "README.md").read_text("utf-8")
    assert not (tmp_path / "out" / "quarantine").exists()
    assert not run(plan_in(tmp_path), tmp_path / "out", workers=0).render_noise


def test_a_plan_forecasts_the_render_noise_and_says_why_nothing_is_denoised(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """Within a factor of two of that of the run: a variance falls about as one over the samples (32 of 64 here).
    The flat field has hardly any noise of light paths."""
    text = FILE.replace("spp = 4", "spp = 64")
    plan = plan_in(tmp_path, text)
    found = forecast(plan, 1)
    run(plan, tmp_path / "out", workers=0)
    samples = ms.Dataset(tmp_path / "out").where(scene="box")
    made = np.median([one.facts["light"]["noise_ratio_median"] for one in samples])
    assert 0.5 < found.scenes["box"].noise_ratio / made < 2
    said = " ".join(
        cli("dataset", "plan", tmp_path / "views.toml", "--root", SCENES).stdout.split()
    )
    assert "Render noise is" in said and "what a denoiser leaves" in said
    counted = cli(
        "dataset", "plan", tmp_path / "views.toml", "--root", SCENES, "--count-only"
    ).stdout
    assert "not denoised" in counted and "[MB]" not in counted and "[MB]" in said


def test_status_and_card_count_the_same_bytes(tmp_path: Path) -> None:
    """Those of the files that samples of a view share, too."""
    text = FILE.replace('"preview"]', '"preview", "irradiance"]')
    plan = plan_in(tmp_path, text)
    run(plan, tmp_path / "out", workers=0)
    held = holdings(Store(tmp_path / "out"), plan)
    card = (tmp_path / "out" / "README.md").read_text("utf-8")
    assert f"| bytes of the dataset | {held.bytes:,}".replace(",", " ") in card
    files = [p for kind in ("samples", "views") for p in (tmp_path / "out" / kind).rglob("*.*")]
    whole = sum(p.stat().st_size for p in files if p.is_file() and p.name != "record.json")
    assert held.bytes == whole


def test_make_dataset_is_the_run_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "views.toml").write_text(FILE, "utf-8")
    made = make_dataset(tmp_path / "views.toml", tmp_path / "out", roots=[SCENES], workers=0)
    assert made.made == 12 and len(ms.Dataset(tmp_path / "out")) == 12


@pytest.mark.parametrize(("code", "stops"), [(255, 0), (190, 0), (60, 3), (8, 6), (0, 0)])
def test_a_dark_picture_of_a_sheet_is_shown_brighter_by_whole_stops(
    code: int, stops: int
) -> None:
    """Half of white is 188 of 255 behind the curve of sRGB; 60 is 4.5 % of white, 8 is 0.24 %; black stays black."""
    picture, factor = brightened(np.full((4, 5, 3), code, np.uint8))
    assert factor == 2**stops
    expected = srgb_curve(inverse_srgb_curve(np.array(code / 255)) * factor)
    np.testing.assert_array_equal(picture, np.rint(255 * expected).astype(np.uint8))
