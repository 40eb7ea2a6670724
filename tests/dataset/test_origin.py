"""What a dataset is made from is part of it: a change of it is found, and nothing is rendered from anything else."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.datasets import SCENES, here, write_index
from helpers.marks import one_in

import mitsuba_sensor as ms
from mitsuba_sensor import InputError
from mitsuba_sensor.dataset.index.origin import index_of
from mitsuba_sensor.dataset.index.part import kinds_of
from mitsuba_sensor.dataset.index.repair import verify
from mitsuba_sensor.dataset.plan.file import read_dataset
from mitsuba_sensor.dataset.store import keys
from mitsuba_sensor.dataset.store.record import FILE, INDEX, RECORD, sealed, unsealed

TEXT = """
name = "tiny"
seed = 1
outputs = ["raw"]
render = { width = 16, spp = 16 }
scenes = [{ name = "flat", file = "mine/flat.xml" }]
cameras = [{ camera = "konnik_table1" }]
grid = { exposure_s = [0.1], serial = [1, 2] }
"""
__all__ = ["here"]
Cli = Callable[..., Any]


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a dataset file, its scene, and the dataset in out/, as `dataset run` made it there."""
    from mitsuba_sensor.dataset.plan.planned import load_plan
    from mitsuba_sensor.dataset.run.run import run

    folder = tmp_path_factory.mktemp("made")
    (folder / "tiny.toml").write_text(TEXT, "utf-8")
    (folder / "mine").mkdir()
    shutil.copy(SCENES / "flat_field.xml", folder / "mine" / "flat.xml")
    assert run(load_plan(folder / "tiny.toml"), folder / "out", workers=0).made == 2
    return folder


def damaged(content: bytes, chance: random.Random) -> bytes:
    """The content with one bit flipped, a tail lost, a block of zeros, more bytes or other ends of lines."""
    changed, place = bytearray(content), chance.randrange(len(content))
    match chance.randrange(5):
        case 0:
            changed[place] ^= 1 << chance.randrange(8)
        case 1:
            del changed[place:]
        case 2:
            changed[place : place + 16] = bytes(16)
        case 3:
            changed += chance.randbytes(chance.randint(1, 20))
        case 4:
            changed = changed.replace(b"\n", b"\r\n")
    return bytes(changed)


@pytest.mark.parametrize("name", [FILE, RECORD, INDEX])
def test_every_damage_of_what_says_what_a_dataset_is_is_found(name: str, here: Path) -> None:
    path, chance = here / "out" / name, random.Random(name)
    if name == INDEX:
        (path,) = path.iterdir()
        name = f"{INDEX}/{path.name}"
    content = path.read_bytes()
    assert not list(verify(here / "out"))
    for _ in range(100):
        path.write_bytes(damaged(content, chance))
        assert name in [fault.file for fault in verify(here / "out")], path.read_bytes()
    path.unlink()
    assert [(x.file[:12], x.what) for x in verify(here / "out")] == [
        (name[:12] if INDEX not in name else f"{INDEX}/000000", "missing")
    ]


@pytest.mark.parametrize(
    ("old", "new"),
    one_in(
        3,
        [
            ("seed = 1", "seed = 2"),
            ("0.1", "0.2"),
            ("[1, 2]", "[1, 3]"),
            ('"raw"', '"clean"'),
            ("tiny", "tidy"),
            ("= 1", "=1"),
        ],
        several=True,
    ),
)
def test_another_valid_dataset_file_is_found_and_nothing_is_rendered_from_it(
    old: str, new: str, here: Path, made: Path, cli: Cli
) -> None:
    path = here / "out" / FILE
    path.write_text(TEXT.replace(old, new, 1), "utf-8")
    before = contents(here)
    for command in ("repair", "status"):
        done = cli("dataset", command, "out")
        assert done.exit_code == 2 and "not what the samples were made from" in done.stderr
    done = cli("dataset", "verify", "out")
    assert (
        done.exit_code == 1
        and FILE in done.stdout
        and "run FILE.toml -o out" in " ".join(done.stdout.split())
    )
    assert cli("dataset", "export", "card", "out", "-o", "card").exit_code == 2
    assert contents(here) == before
    done = cli("dataset", "run", "tiny.toml", "-o", "out", "--workers", "0")
    assert done.exit_code == 0
    for name in ("README.md", "samples.csv"):
        assert f"{Path('out', name)}: " in done.stdout
    assert contents(here) == contents(made), "the file that it was made from restores it"


OTHER_VALUES: dict[str, Any] = {
    "name": "tidy",
    "file": [len(TEXT), "0" * 64],
    "made_by": {"mitsuba-sensor": "9.9.9"},
    "samples": 3,
    "parts": 2,
    "plan": "0" * 64,
}


@pytest.mark.parametrize("field", OTHER_VALUES)
def test_a_record_of_somebody_who_knows_how_its_hash_is_made_is_found_too(
    field: str, here: Path, made: Path, cli: Cli
) -> None:
    path = here / "out" / RECORD
    text = unsealed(path.read_bytes())
    assert text is not None
    path.write_bytes(sealed(json.dumps({**json.loads(text), field: OTHER_VALUES[field]})))
    assert list(verify(here / "out"))
    before = contents(here)
    assert cli("dataset", "repair", "out", "--workers", "0").exit_code == 2
    assert contents(here) == before


def test_a_record_that_leaves_out_what_the_samples_are_made_from_is_found_and_mended(
    here: Path, made: Path, cli: Cli
) -> None:
    path = here / "out" / RECORD
    path.write_bytes(
        sealed(json.dumps({**json.loads(unsealed(path.read_bytes()) or ""), "sources": {}}))
    )
    assert list(verify(here / "out"))
    assert cli("dataset", "repair", "out", "--workers", "0").exit_code == 0
    assert contents(here) == contents(made)


def test_an_index_of_somebody_who_knows_how_its_hash_is_made_is_found_and_written_again(
    here: Path, made: Path, cli: Cli
) -> None:
    """Splits and values that could be right are not told from those that are."""
    first, second = index_of(here / "out")
    for lines in (
        [second, first],
        [first, second._replace(key="0" * 24)],
        [first, second, second],
        [first._replace(number=10_000)],
    ):
        write_index(here / "out", lines)
        assert list(verify(here / "out"))
    assert cli("dataset", "repair", "out", "--workers", "0").exit_code == 0
    assert contents(here) == contents(made)


@pytest.mark.parametrize(
    ("kinds", "changes"),
    [
        ({}, {"key": "../../x"}),
        ({"key": "integer"}, {"key": 7}),
        ({"split": "integer"}, {"split": 1}),
        ({}, {"view": "0" * 23}),
        ({}, {"view": None}),
        ({"view_files": "integer"}, {"view_files": 1}),
        ({"number": "text"}, {"number": "0"}),
    ],
)
def test_an_index_with_a_line_that_no_run_writes_is_a_sentence(
    kinds: Any, changes: Any, here: Path
) -> None:
    known = kinds_of(read_dataset(here / "out" / FILE))
    first, _ = index_of(here / "out")
    write_index(here / "out", [first._replace(**changes)], {**known, **kinds})
    with pytest.raises(InputError, match=r"\.parquet was changed"):
        list(ms.Dataset(here / "out"))


@pytest.mark.parametrize("old", ["-000000-", "-2-of-2-", "-of-2-"])
def test_a_part_with_another_name_is_found(old: str, here: Path) -> None:
    (part,) = (here / "out" / INDEX).iterdir()
    part.rename(
        part.with_name(part.name.replace(old, old.replace("2", "1").replace("00-", "01-")))
    )
    assert list(verify(here / "out"))
    with pytest.raises(InputError, match="was changed"):
        list(ms.Dataset(here / "out"))


def test_a_scene_that_was_changed_since_is_not_rendered_in_place_of_the_one_that_was(
    here: Path, cli: Cli
) -> None:
    scene = here / "mine" / "flat.xml"
    scene.write_text(scene.read_text("utf-8").replace("</scene>", " </scene>"), "utf-8")
    next(iter(ms.Dataset(here / "out"))).folder.joinpath("frame.tiff").unlink()
    before = contents(here)
    done = cli("dataset", "repair", "out", "--workers", "0")
    assert done.exit_code == 2 and "mine/flat.xml (scene flat) was changed" in done.stderr
    assert contents(here) == before


def test_which_folders_are_read_is_for_the_user_to_say_and_not_for_the_data(
    here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    (here / "out" / "roots.json").write_text('{"roots": ["/"]}', "utf-8")
    monkeypatch.chdir(tmp_path)
    for command in ("status", "repair"):
        done = cli("dataset", command, here / "out")
        assert done.exit_code == 2 and "name its folder with --root" in done.stderr
        assert cli("dataset", command, here / "out", "--root", here).exit_code == 0


def test_another_version_neither_goes_on_with_a_dataset_nor_repairs_it(
    here: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    frames = [one.read("raw") for one in ms.Dataset(here / "out")]
    before, version = contents(here / "out"), keys.__version__
    monkeypatch.setattr(keys, "__version__", "9.9.9")
    for command in (["run", "tiny.toml", "-o", "out"], ["repair", "out"]):
        done = cli("dataset", *command, "--workers", "0")
        said = f"was made by mitsuba-sensor {version}, and this is mitsuba-sensor 9.9.9"
        assert done.exit_code == 2 and said in " ".join(done.stderr.split())
    assert cli("dataset", "verify", "out").exit_code == 0
    assert json.loads(cli("dataset", "status", "out", "--json").stdout)["there"] == 2
    assert contents(here / "out") == before

    assert cli("dataset", "run", "tiny.toml", "-o", "new", "--workers", "0").exit_code == 0
    old, new = ms.Dataset(here / "out"), ms.Dataset(here / "new")
    assert not {one.key for one in old} & {one.key for one in new}, "they could never be mixed"
    assert [one.facts["versions"]["mitsuba-sensor"] for one in new] == ["9.9.9", "9.9.9"]
    for frame, sample in zip(frames, new, strict=True):
        assert (sample.read("raw") == frame).all(), "a version is no seed"
