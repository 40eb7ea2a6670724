"""`dataset show`: one sample, found by its number, key or folder."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from PIL import Image
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor import cli
from mitsuba_sensor.cli.tables import number
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.read.shown import sample_called

TEXT = """
name = "shown"
outputs = ["raw", "variance", "preview"]
render = { width = 24, spp = 16 }
scenes = [{ name = "flat", file = "flat_field" }]
cameras = [{ camera = "konnik_table1" }]
grid = { exposure_s = [0.05], exposure_ev = [0, -2], serial = [1, 2, 3] }
splits = { shares = { all = 1.0 } }
"""


def shown(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli.app, ["dataset", "show", *arguments])
    return done.exit_code, " ".join((done.stdout + done.stderr).split())


def facts_of(*arguments: str) -> dict[str, Any]:
    code, text = shown(*arguments, "--json")
    assert code == 0
    found: dict[str, Any] = json.loads(text)
    return found


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shown")
    (folder / "shown.toml").write_text(TEXT)
    make_dataset(folder / "shown.toml", folder / "out", workers=0)
    return folder / "out"


def test_number_key_and_folder_are_the_same_sample(made: Path) -> None:
    samples, sample = ms.Dataset(made), ms.Dataset(made)[4]
    name = "flat/view_0000/konnik_table1,exposure_s=0.05,exposure_ev=-2,serial=2"
    ways = ["4", sample.key, sample.key[:8], sample.key.upper(), str(sample.folder), name]
    ways.append(f"samples/{name}/")
    for said in ways:
        assert sample_called(samples, said) == (4, sample)


@pytest.mark.parametrize("said", ["6", "-1", "abc", "f" * 24, "flat/view_0000", "../x", ""])
def test_what_is_no_sample_is_a_sentence(made: Path, said: str) -> None:
    code, text = shown(str(made), "--", said)
    assert code == 2 and "give a number from 0 to 5, a key, or the folder of a sample" in text


def test_a_key_that_begins_as_several_do_is_a_sentence(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mitsuba_sensor.dataset.read.shown.FEWEST_DIGITS", 0)
    code, text = shown(str(made), "")
    assert code == 2 and "6 samples have keys that begin with ''" in text


def test_paths_are_whole_lines_in_a_narrow_terminal(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    lines = CliRunner().invoke(cli.app, ["dataset", "show", str(made), "4"]).stdout.splitlines()
    sample = ms.Dataset(made)[4]
    assert f"folder: {sample.folder}" in lines
    assert f"picture: {sample.folder / 'frame.png'}" in lines


def test_the_numbers_are_those_of_the_sample(made: Path) -> None:
    found, sample = facts_of(str(made), "4"), ms.Dataset(made)[4]
    camera = ms.load_camera("konnik_table1")
    noise_dn = float(np.median(np.sqrt(sample.read("variance"))))
    assert found["settings"]["exposure_ev"] == -2 and found["image"]["exposure_s"] == 0.0125
    assert found["noise"]["system_gain_dn_per_e"] == pytest.approx(camera.system_gain_dn_per_e)
    assert found["noise"]["temporal_noise_dn"] == pytest.approx(noise_dn)
    signal_dn = np.median(sample.read("raw")) - found["image"]["black_level_dn"]
    assert found["noise"]["snr"] == pytest.approx(signal_dn / noise_dn)
    assert found["picture"] == str(sample.folder / "frame.png")
    assert found["files"]["frame.png"] == (sample.folder / "frame.png").stat().st_size
    code, text = shown(str(made), "4")
    assert code == 0 and f"sample 4 of 6, split all, key {sample.key}" in text
    assert f"temporal noise {number(noise_dn)} DN in the median pixel" in text


def test_a_picture_that_is_not_stored_is_written_on_request(made: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(made, tmp_path / "out"))
    stored = ms.Dataset(made)[4].read("preview")
    (ms.Dataset(copy)[4].folder / "frame.png").unlink()
    place = tmp_path / "four.png"
    assert (
        "picture: in no file of its own; --picture FILE.png writes one"
        in shown(str(copy), "4")[1]
    )
    assert shown(str(copy), "4", "--open")[0] == 2
    assert facts_of(str(copy), "4", "--picture", str(place))["picture"] == str(place)
    with Image.open(place) as picture:
        np.testing.assert_array_equal(np.asarray(picture), stored)


def test_of_a_sample_in_a_shard_the_shard_is_named_and_its_picture_is_written_on_request(
    tmp_path: Path,
) -> None:
    file, place = tmp_path / "shown.toml", tmp_path / "four.png"
    file.write_text("store = { shard_samples = 2 }" + TEXT)
    make_dataset(file, tmp_path / "out", workers=0)
    sample, found = ms.Dataset(tmp_path / "out")[4], facts_of(str(tmp_path / "out"), "4")
    assert found["folder"].startswith(f"{tmp_path / 'out' / 'shards'}/000002-")
    assert found["folder"].endswith(")") and found["picture"] is None
    with pytest.raises(
        ms.InputError, match=r"there is no .*\.tar: aovs\.exr; name what depth_m"
    ):
        sample.read("depth_m")
    assert found["files"]["frame.png"] == len(sample.files.content("frame.png"))
    code, text = shown(str(tmp_path / "out"), "4", "--open")
    assert code == 2 and "--picture FILE.png writes one" in text
    facts_of(str(tmp_path / "out"), "4", "--picture", str(place))
    with Image.open(place) as picture:
        np.testing.assert_array_equal(np.asarray(picture), sample.read("preview"))


def test_a_picture_is_opened_and_its_path_said_where_nothing_can(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, code = list[str](), 0

    def launch(path: str) -> int:
        opened.append(path)
        return code

    monkeypatch.setattr(typer, "launch", launch)
    assert "no program here" not in shown(str(made), "4", "--open")[1]
    code = 1
    assert "no program here shows pictures" in shown(str(made), "4", "--open")[1]
    assert opened == [str(ms.Dataset(made)[4].folder / "frame.png")] * 2
