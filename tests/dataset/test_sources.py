"""What a dataset is made from is part of it: each change of a scene, mesh, motion, camera or curve is named."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.datasets import follow, here, whole
from helpers.marks import one_in

from mitsuba_sensor import InputError
from mitsuba_sensor.camera.lens_file import BUILT_IN
from mitsuba_sensor.camera.shipped import SHIPPED
from mitsuba_sensor.dataset.index.origin import origin_in, write_origin
from mitsuba_sensor.dataset.index.repair import discard, verify
from mitsuba_sensor.dataset.index.same_origin import check_same, plan_of
from mitsuba_sensor.dataset.plan.planned import DatasetPlan, load_plan
from mitsuba_sensor.dataset.store import keys
from mitsuba_sensor.dataset.store.faults import Fault
from mitsuba_sensor.dataset.store.record import FILE, INDEX, RECORD, sealed, unsealed
from mitsuba_sensor.dataset.store.store import Store
from mitsuba_sensor.files import durable

__all__ = ["here"]
Cli = Callable[..., Any]
TEXT = """
name = "cards"
outputs = ["raw"]
render = { width = 12, spp = 16 }
scenes = [
    { name = "card", file = "mine/card.xml", motion = "mine/card.toml" },
    { name = "grey", file = "flat_field" },
]
cameras = [
    { camera = "mine/cam.toml" },
    { camera = "bayer_2mp", set = { "lens.prescription" = "mine/lens.json" } },
]
grid = { exposure_s = [0.1, 0.2], "parameters.paint" = ["red.png", "blue.png"] }
"""
SCENE = """<scene version="3.0.0">
    <default name="paint" value="red.png"/>
    <integrator type="direct"/>
    <sensor type="perspective"><film type="hdrfilm"/></sensor>
    <include filename="lamp.xml"/>
    <shape type="obj" id="card"><string name="filename" value="card.obj"/>
        <bsdf type="diffuse"><texture type="bitmap" name="reflectance">
            <string name="filename" value="$paint"/></texture></bsdf></shape>
</scene>"""
FILES = {
    "card.xml": SCENE,
    "lamp.xml": '<scene version="3.0.0"><emitter type="constant"/></scene>',
    "card.obj": "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nf 1 2 3\n",
    "card.toml": "[objects.card]\nrotate_deg_per_s = 90\naxis = [0, 0, 1]\npivot_m = [0, 0, 0]\n",
    "red.png": "a red card",
    "blue.png": "a blue card, which is of other samples",
    "qe.csv": "wavelength_nm,mono_percent\n400,60\n700,60\n",
}
OF_CARD = ("card.xml", "lamp.xml", "card.obj", "card.toml", "red.png", "blue.png")
USES = dict.fromkeys((f"mine/{name}" for name in OF_CARD), "scene card") | {
    "mine/cam.toml": "camera mine",
    "mine/qe.csv": "camera mine",
    "mine/lens.json": "camera bayer_2mp",
}
OWN = {f"out/{FILE}": FILE, f"out/{RECORD}": RECORD}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all files of a dataset, and the dataset in out/, whose samples are stand-ins."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "mine").mkdir()
    for name, text in FILES.items():
        (folder / "mine" / name).write_text(text)
    shutil.copy(str(BUILT_IN / "singlet.json"), folder / "mine/lens.json")
    text = (SHIPPED / "konnik_table1.toml").read_text("utf-8").replace("konnik_table1", "mine")
    text = text.replace("curves.mono = [0.60, 0.60]", 'file = "qe.csv"')
    text = text.replace("wavelengths_nm = [400, 700]", "")
    (folder / "mine/cam.toml").write_text(text)
    (folder / "cards.toml").write_text(TEXT)
    make(load_plan(folder / "cards.toml"), folder / "out")
    return folder


def make(plan: DatasetPlan, folder: Path) -> None:
    """What a run does, with samples that are no pictures."""
    check_same(plan, Store(folder))
    write_origin(plan, folder)
    writer = whole(plan, Store(folder))
    follow(writer)
    writer.index()


def run_refuses(folder: Path) -> str:
    """What a run of the dataset file in a folder says, an empty text where it begins."""
    try:
        check_same(load_plan(folder / "cards.toml"), Store(folder / "out"))
    except InputError as error:
        return str(error)
    return ""


def repair_refuses(folder: Path) -> str:
    try:
        plan_of(folder / "out", [str(folder)])
    except InputError as error:
        return str(error)
    return ""


def faults(folder: Path) -> list[Fault]:
    return [*verify(folder / "out", roots=[folder])]


def found(folder: Path) -> set[tuple[str, bool]]:
    """Names of the files with a fault, and whether that is damage."""
    return {(fault.file, fault.is_damage) for fault in faults(folder)}


def test_every_file_is_recorded_with_what_is_made_from_it(made: Path) -> None:
    origin = origin_in(made / "out")
    assert origin is not None
    uses = {name: file.use for name, file in origin.sources.items()}
    assert uses == USES | {
        "mitsuba_sensor:cameras/bayer_2mp.toml": "camera bayer_2mp",
        "mitsuba_sensor:scenes/flat_field.xml": "scene grey",
    }
    assert not faults(made)


def spoilt(content: bytes, chance: random.Random) -> bytes:
    """The content with one bit flipped, its tail lost, more bytes, a block twice, or two blocks exchanged."""
    place, other = sorted(chance.sample(range(len(content)), 2))
    flipped = bytes([content[place] ^ 1 << chance.randrange(8)])
    kinds = [
        content[:place] + flipped + content[place + 1 :],
        content[:place],
        content + chance.randbytes(3),
        content[:other] + content[place:],
        content[other:] + content[:other],
    ]
    return chance.choice([kind for kind in kinds if kind != content])


@pytest.mark.parametrize("seed", one_in(4, range(4)))
def test_whatever_is_changed_is_named_and_never_mixed(
    seed: int, made: Path, here: Path
) -> None:
    """200 changes of the files that the samples are made from, and of those that say so: none is missed."""
    chance, names = random.Random(seed), [*USES, *OWN]
    right = load_plan(made / "cards.toml").digest
    for _ in range(50):
        name, other = chance.sample(names, 2)
        path, contents = here / name, [(here / one).read_bytes() for one in (name, other)]
        how = chance.choice(["spoil", "spoil", "delete", "swap", "folder", "link"])
        path.unlink()
        if how == "spoil":
            path.write_bytes(spoilt(contents[0], chance))
        elif how == "swap":
            path.write_bytes(contents[1])
            (here / other).write_bytes(contents[0])
        elif how == "folder":
            path.mkdir()
        elif how == "link":
            path.symlink_to(here / other)
        said = dict(found(here))
        touched = {OWN.get(one, one) for one in (name, *[other] * (how == "swap"))}
        assert touched <= said.keys() or RECORD in touched & said.keys(), (how, name)
        gone = name in USES and how in ("delete", "folder")
        assert any(said.values()) is not gone, "what is not here is no damage of the dataset"
        assert_never_mixed(right, here)
        durable.remove_folder(path)
        path.write_bytes(contents[0])
        (here / other).write_bytes(contents[1])


def assert_never_mixed(right: str, here: Path) -> None:
    """Run and repair refuse, or make the samples that are there.  right : digest of their plan."""
    if not run_refuses(here):
        assert load_plan(here / "cards.toml").digest == right
    if not repair_refuses(here):
        plan = plan_of(here / "out", [str(here)])
        assert plan.digest == right


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("card.xml", "direct", "path"),
        ("lamp.xml", "constant", "sky"),
        ("card.obj", "-1 -1", "-1 -2"),
        ("blue.png", "blue", "green"),
        ("card.toml", "90", "91"),
        ("cam.toml", "bits = 12", "bits = 10"),
        ("qe.csv", "400,60", "400,61"),
    ],
)
def test_run_and_repair_name_what_was_changed_and_write_nothing(
    name: str, old: str, new: str, here: Path, cli: Cli
) -> None:
    path = here / "mine" / name
    path.write_text(path.read_text().replace(old, new))
    before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}
    for command in (("run", "cards.toml", "-o"), ("repair",), ("status",)):
        done = cli("dataset", *command, "out")
        assert done.exit_code == 2 and done.stderr.count("\n") == 1
        said = (
            f"mine/{name} ({USES[f'mine/{name}']}) was changed. Samples of both would be mixed"
        )
        assert said in done.stderr and "a new folder" in done.stderr
    done = cli("dataset", "verify", "out")
    assert done.exit_code == 1
    assert f"made from another mine/{name}" in " ".join(done.stdout.split())
    assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before


def test_another_comment_of_a_camera_is_another_file_and_makes_the_same_samples(
    here: Path,
) -> None:
    camera = here / "mine/cam.toml"
    camera.write_text(f"# of 2026\n{camera.read_text()}")
    assert found(here) == {("mine/cam.toml", True)}
    assert not repair_refuses(here) and not run_refuses(here)
    frames = sorted((here / "out/samples").rglob("a.txt"))
    make(load_plan(here / "cards.toml"), here / "out")
    assert not found(here) and sorted((here / "out/samples").rglob("a.txt")) == frames


def test_a_dataset_grows_while_its_scenes_are_the_same(here: Path) -> None:
    text = (here / "cards.toml").read_text()
    (here / "cards.toml").write_text(text.replace("[0.1, 0.2]", "[0.1, 0.2, 0.4]"))
    make(load_plan(here / "cards.toml"), here / "out")
    assert not found(here)
    (here / "mine/red.png").write_text("a pink card")
    (here / "cards.toml").write_text(text.replace("[0.1, 0.2]", "[0.1]"))
    assert "mine/red.png (scene card) was changed" in run_refuses(here)


def test_a_scene_of_which_nothing_could_be_made_may_be_mended(made: Path, here: Path) -> None:
    shutil.rmtree(here / "out")
    plan = load_plan(here / "cards.toml")
    write_origin(plan, here / "out")
    writer = whole(plan, Store(here / "out"))
    lost = {
        number
        for view in plan.views()
        for number in range(view.first, view.first + len(view.samples))
        if view.scene == "card"
    }
    follow(writer, frozenset(lost))
    writer.index()
    for name in ("card.xml", "card.toml"):
        (here / "mine" / name).write_text(FILES[name].replace("direct", "path"))
    assert not run_refuses(here)
    camera = here / "mine/cam.toml"
    camera.write_text(camera.read_text().replace("bits = 12", "bits = 10"))
    assert "mine/cam.toml (camera mine) was changed" in run_refuses(here)


def test_without_its_record_a_dataset_takes_only_the_samples_of_its_index(here: Path) -> None:
    (here / "out" / RECORD).unlink()
    assert not run_refuses(here)
    (here / "mine/card.obj").write_text(FILES["card.obj"].replace("-1 -1", "-1 -2"))
    assert "the index is of other samples" in run_refuses(here)
    assert f"{RECORD}, which says" in repair_refuses(here)


def test_a_dataset_that_was_given_away_is_whole_without_the_files_it_was_made_from(
    here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    monkeypatch.chdir(tmp_path)
    done = cli("dataset", "verify", here / "out")
    said = " ".join(done.stdout.split())
    assert done.exit_code == 0 and "every file is as it was written" in said
    assert "Not compared, as they are not here: mine/blue.png, mine/cam.toml," in said
    assert "--root" in said and "and 6 more" in said
    done = cli("dataset", "verify", here / "out", "--root", here)
    assert done.exit_code == 0 and "Not compared" not in done.stdout
    (here / "mine/red.png").write_text("a pink card")
    assert cli("dataset", "verify", here / "out", "--root", here).exit_code == 1


def test_versions_that_made_it_are_named_where_others_are_installed(
    here: Path, monkeypatch: pytest.MonkeyPatch, cli: Cli
) -> None:
    monkeypatch.setattr(keys, "__version__", "9.9.9")
    done = cli("dataset", "verify", "out")
    assert done.exit_code == 0 and "Made by mitsuba-sensor 0." in done.stdout
    assert found(here) == {(f"mitsuba-sensor {version_of(here)}", False)}


def version_of(folder: Path) -> str:
    origin = origin_in(folder / "out")
    assert origin is not None
    return str(origin.made_by["mitsuba-sensor"])


@pytest.mark.parametrize("name", ["/etc/passwd", "../mine/red.png", "mine/\x1b[2J", "\0"])
def test_a_record_of_somebody_else_opens_nothing_beyond_the_roots(
    name: str, here: Path
) -> None:
    path = here / "out" / RECORD
    said = json.loads(unsealed(path.read_bytes()) or "")
    said["sources"][name] = [1, "0" * 64, "scene card"]
    path.write_bytes(sealed(json.dumps(said)))
    if name.isprintable():
        assert Fault("source", "scene card", name, "missing") in faults(here)
    else:
        assert Fault("dataset", "", RECORD, "changed") in faults(here)


def strays_and_rests(chance: random.Random, out: Path) -> Iterator[tuple[Path, str]]:
    """Places of files that are not of the dataset or unfinished, and what they are called."""
    poses = sorted((out / "samples").glob("*/*"))
    entries = sorted((out / "samples").glob("*/*/*"))
    scratch = f".unfinished-{chance.randbytes(8).hex()}"
    names = ("notes.txt", "roots.json", "Thumbs.db", "frame.tiff~", "x.parquet", ".DS_Store")
    name = chance.choice(names)
    yield out / name, "not of the dataset"
    yield chance.choice(entries) / name, "extra"
    yield chance.choice(poses) / name, "stray"
    yield out / INDEX / name.lstrip("."), "stray"
    yield out / scratch, "unfinished"
    yield out / chance.choice([f".{FILE}.7", f".{RECORD}.8", ".README.md.9"]), "unfinished"
    yield chance.choice(poses) / scratch, "unfinished"
    yield out / INDEX / f".{'0' * 12}.parquet.77", "unfinished"


@pytest.mark.parametrize("place", ["samples/notes.txt", "samples/card/notes.txt", "views/x"])
def test_files_in_the_place_of_scenes_and_poses_are_strays(place: str, here: Path) -> None:
    (here / "out/views").mkdir(exist_ok=True)
    (here / "out" / place).write_text("x")
    assert [(x.file, x.what) for x in faults(here)] == [(place.partition("/")[2], "stray")]


def test_what_no_run_wrote_and_what_none_finished_is_named_and_stays(
    made: Path, here: Path
) -> None:
    """200 of both, files and folders. A run removes the unfinished ones, an hour after they were written."""
    chance, out = random.Random(1), here / "out"
    for _ in range(25):
        for path, what in strays_and_rests(chance, out):
            path.write_text("x") if chance.random() < 0.5 else path.mkdir()

            (fault,) = faults(here)
            assert fault.what == what and fault.file.endswith(path.name)
            assert fault.is_damage is (what in ("stray", "extra"))
            if what != "extra":  # an entry is made again as a whole
                assert not discard(out, [fault])
            Store(out).clean()
            assert path.exists(), "nothing goes without being asked"
            Store(out).clean(-60)
            assert path.exists() is (what != "unfinished")
            durable.remove_folder(path)
