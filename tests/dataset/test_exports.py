"""Exports of a dataset that is made here: everything in them is what the samples have, wherever they go.

Readers of others (webdataset, pycocotools, OpenCV, pycolmap, PyTorch) are asked where they are installed.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import shutil
import struct
import tarfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from helpers.datasets import write_index
from helpers.marks import one_in
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.exports.batches import batches
from mitsuba_sensor.dataset.exports.card import CameraNumbers, CardFacts, card_text
from mitsuba_sensor.dataset.exports.export import WRITERS, export
from mitsuba_sensor.dataset.exports.job import worlds
from mitsuba_sensor.dataset.exports.torch_dataset import TorchDataset
from mitsuba_sensor.dataset.index.origin import index_of
from mitsuba_sensor.dataset.options import EXPORT_FORMATS
from mitsuba_sensor.dataset.plan.planned import load_plan
from mitsuba_sensor.dataset.run.run import run
from mitsuba_sensor.dataset.store.record import Record, text_of
from mitsuba_sensor.files.durable import size_and_hash
from mitsuba_sensor.files.whole_folder import LISTING
from mitsuba_sensor.output.contact_sheet import Captioned, SheetRow, contact_sheet
from mitsuba_sensor.output.exr import read_aovs_exr

SCENE = """<scene version="3.0.0"><default name="height" value="0"/><integrator type="direct"/>
<sensor type="perspective"><float name="fov" value="50"/><film type="hdrfilm"><integer name="width" value="20"/>
<integer name="height" value="14"/></film><transform name="to_world">
<lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
<shape type="sphere" id="ball"><point name="center" value="0, $height, 0"/></shape>
<shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/>
<translate y="-1"/></transform></shape><emitter type="constant"/></scene>"""
FILE = """name = "pairs"
description = "two scenes | small"
licence = "CC0-1.0"
outputs = ["raw", "clean", "preview", "aovs"]
render = { spp = 4, denoise = false, wavelength_nm = 550 }
grid = { exposure_ev = [0, -2], "parameters.height" = [0, 0.5] }
[[scenes]]
name = "first"
file = "scene.xml"
views = [{ origin_m = [0, 1, 4], target_m = [0, 0, 0] }, { origin_m = [1, 2, 4], target_m = [0, 0, 0] }]
[[scenes]]
name = "second"
file = "scene.xml"
[[cameras]]
camera = "konnik_table1"
set = { "lens.distortion" = [-0.1, 0.02, 0, 0, 0] }
[[cameras]]
camera = "bayer_2mp"
[splits]
shares = { train = 0.5, test = 0.5 }
chips = 1
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    (folder / "scene.xml").write_text(SCENE, "utf-8")
    (folder / "pairs.toml").write_text(FILE, "utf-8")
    run(load_plan(folder / "pairs.toml", [folder]), folder / "pairs", workers=0)
    return folder / "pairs"


def tree(folder: Path) -> dict[str, str]:
    found = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in found
    }


@pytest.mark.parametrize("format", one_in(3, WRITERS))
def test_an_export_is_the_same_each_time_and_lists_its_files(
    made: Path, tmp_path: Path, format: str
) -> None:
    steps: list[tuple[int, int]] = []
    for name in ("a", "b"):
        export(
            made,
            format,
            tmp_path / name,
            progress=lambda done, total: steps.append((done, total)),
        )
    assert steps[: len(steps) // 2] == [(number, 48) for number in range(1, 49)]
    found = tree(tmp_path / "a")
    listed = json.loads((tmp_path / "a" / LISTING).read_text("utf-8"))
    assert found == tree(tmp_path / "b") and (listed["dataset"], listed["format"]) == (
        "pairs",
        format,
    )
    assert {name: digest for name, (_, digest) in listed["files"].items()} == {
        name: digest for name, digest in found.items() if name != LISTING
    }


def test_shards_hold_the_arrays_of_every_sample_by_split(made: Path, tmp_path: Path) -> None:
    export(made, "webdataset", tmp_path / "out", arrays=["raw", "clean", "depth_m"])
    for split in ("train", "test"):
        samples = {one.key: one for one in ms.Dataset(made, split)}
        with tarfile.open(tmp_path / f"out/{split}-000000.tar") as tar:
            members = {one.name: tar.extractfile(one).read() for one in tar}  # type: ignore[union-attr]
        assert [name.partition(".")[0] for name in members][::5] == sorted(samples)
        for key, sample in samples.items():
            for name in ("raw", "clean", "depth_m"):
                np.testing.assert_array_equal(
                    np.load(io.BytesIO(members[f"{key}.{name}.npy"])), sample.read(name)
                )
            assert json.loads(members[f"{key}.json"]) == sample.facts
            assert members[f"{key}.png"] == (sample.folder / "frame.png").read_bytes()


def test_webdataset_decodes_the_shards(made: Path, tmp_path: Path) -> None:
    wds = pytest.importorskip("webdataset")
    export(made, "webdataset", tmp_path / "out", split="train")
    stream = wds.WebDataset(str(tmp_path / "out/train-000000.tar"), shardshuffle=False).decode(
        "rgb8"
    )
    found = {one["__key__"]: one for one in stream}
    assert set(found) == {one.key for one in ms.Dataset(made, "train")}
    for sample in ms.Dataset(made, "train"):
        np.testing.assert_array_equal(found[sample.key]["clean.npy"], sample.read("clean"))
        assert found[sample.key]["png"].shape == (14, 20, 3)


def test_masks_of_coco_are_the_shapes_of_the_aovs(made: Path, tmp_path: Path) -> None:
    library = pytest.importorskip("pycocotools.coco")
    export(made, "coco", tmp_path / "out")
    for split in ("train", "test"):
        data, samples = (
            library.COCO(str(tmp_path / f"out/annotations/instances_{split}.json")),
            ms.Dataset(made, split),
        )
        assert [one["name"] for one in data.loadCats(data.getCatIds())] == ["ball", "floor"]
        pictures = data.loadImgs(data.getImgIds())
        assert [one["file_name"] for one in pictures] == [f"{one.key}.png" for one in samples]
        for picture, sample in zip(pictures, samples, strict=True):
            index, names = (
                sample.read("shape_index"),
                read_aovs_exr(sample.view_folder / "aovs.exr").shapes,
            )
            painted = np.full(index.shape, -1.0)
            for one in data.loadAnns(data.getAnnIds(imgIds=picture["id"])):
                name = data.loadCats(one["category_id"])[0]["name"]
                painted[data.annToMask(one) == 1] = names.index(name)
            np.testing.assert_array_equal(painted, index)
            assert Image.open(tmp_path / "out/images" / picture["file_name"]).size == (20, 14)


def test_poses_of_one_world_are_together_with_their_pictures_and_depths(
    made: Path, tmp_path: Path
) -> None:
    """The ball is elsewhere in half of the samples, which is another world."""
    export(made, "nerfstudio", tmp_path / "out")
    names = [f"{scene}-00{number}" for scene in ("first", "second") for number in (1, 2)]
    assert sorted(path.name for path in (tmp_path / "out").iterdir() if path.is_dir()) == names
    for world, posed in worlds(ms.Dataset(made))[0].items():
        samples = [sample for sample, _ in posed]
        data = json.loads((tmp_path / f"out/{world}/transforms.json").read_text("utf-8"))
        assert {one.values["parameters.height"] for one in samples} == {
            0.5 if world.endswith("2") else 0
        }
        assert len(data["frames"]) == len(samples) == (8 if world.startswith("first") else 4)
        for frame, sample in zip(data["frames"], samples, strict=True):
            assert (
                tmp_path / "out" / world / frame["file_path"]
            ).exists() and sample.key in frame["file_path"]
            depth_mm = np.asarray(
                Image.open(tmp_path / "out" / world / frame["depth_file_path"])
            )
            depth_m = np.nan_to_num(sample.read("depth_m"), posinf=0)
            np.testing.assert_allclose(depth_mm / 1000, depth_m, atol=0.0005 + 1e-6)
            origin = (
                [0, 1, 4] if "pose" not in sample.values else sample.values["pose"]["origin_m"]
            )
            np.testing.assert_allclose(
                np.array(frame["transform_matrix"])[:3, 3], origin, atol=1e-6
            )
        assert len({one.split for one in samples}) == 1 and not any(
            name.endswith("_filenames") for name in data
        )


def test_pycolmap_and_opencv_see_the_same_cameras(made: Path, tmp_path: Path) -> None:
    """Surface points of the AOVs, by COLMAP's poses and by OpenCV's, are in the pixels that show them."""
    cv2, pycolmap = pytest.importorskip("cv2"), pytest.importorskip("pycolmap")
    export(made, "colmap", tmp_path / "colmap")
    export(made, "opencv", tmp_path / "opencv")
    for world, posed in worlds(ms.Dataset(made))[0].items():
        samples = [sample for sample, _ in posed]
        model = pycolmap.Reconstruction(str(tmp_path / "colmap" / world / "sparse/0"))
        images = {one.name.removesuffix(".png"): one for one in model.images.values()}
        poses = {}
        for number in (1, 2):
            file = cv2.FileStorage(
                str(tmp_path / f"opencv/{world}/camera_{number}.yml"), cv2.FILE_STORAGE_READ
            )
            names = file.getNode("images")
            matrices = [
                file.getNode(x).mat() for x in ("camera_matrix", "distortion_coefficients")
            ]
            for row, pose in enumerate(file.getNode("extrinsic_parameters").mat()):
                poses[names.at(row).string()] = (pose[:3], pose[3:], *matrices)
        assert set(images) == set(poses) == {one.key for one in samples}
        for sample in samples:
            points, lit = sample.read("position_m"), np.isfinite(sample.read("depth_m"))
            middles = np.stack(np.meshgrid(np.arange(20), np.arange(14)), axis=-1)[lit]
            seen = np.array(
                [images[sample.key].project_point(point) for point in points[lit].astype(float)]
            )
            np.testing.assert_allclose(seen - 0.5, middles, atol=0.01)
            seen, _ = cv2.projectPoints(points[lit].astype(float), *poses[sample.key])
            np.testing.assert_allclose(seen[:, 0], middles, atol=0.01)


def test_ros_has_one_file_for_each_camera_and_says_whose_it_is(
    made: Path, tmp_path: Path
) -> None:
    export(made, "ros", tmp_path / "out")
    keys = json.loads((tmp_path / "out/samples.json").read_text("utf-8"))
    cameras = {one.key: one.values["camera"] for one in ms.Dataset(made)}
    assert len(keys) == 2 and sorted(key for mine in keys.values() for key in mine) == sorted(
        cameras
    )
    for name, mine in keys.items():
        info = yaml.safe_load((tmp_path / f"out/{name}.yaml").read_text("utf-8"))
        (camera,) = {cameras[key] for key in mine}
        assert (info["distortion_coefficients"]["data"][0] == -0.1) == (
            camera == "konnik_table1"
        )


def test_the_card_says_what_is_in_the_dataset(made: Path, tmp_path: Path) -> None:
    export(made, "card", tmp_path / "out", licence="CC-BY-4.0")
    text = (tmp_path / "out/README.md").read_text("utf-8")
    samples = [*ms.Dataset(made)]
    assert (
        "| samples | 24 |" in text
        and "| renders | 12 |" in text
        and "CC-BY-4.0" in text
        and "CC0" not in text
    )
    assert "two scenes | small" in text and "| scenes | first, second |" in text
    assert hashlib.sha256((made / "dataset.toml").read_bytes()).hexdigest() in text
    records = [one.folder / "record.json" for one in samples]
    records += [
        folder / "record.json" for folder in dict.fromkeys(one.view_folder for one in samples)
    ]
    assert hashlib.sha256(b"".join(path.read_bytes() for path in records)).hexdigest() in text
    total = sum(
        path.stat().st_size for path in made.rglob("*/*/*/*/*") if path.name != "record.json"
    )
    assert f"| bytes of the dataset | {total:,} |".replace(",", " ") in text
    raw = [one.read("raw") for one in samples if one.values["camera"] == "bayer_2mp"]
    lowest, highest = (f"{x:,}".replace(",", " ") for x in (np.min(raw), np.max(raw)))
    row = next(
        line
        for line in text.splitlines()
        if line.startswith("| bayer_2mp | – | raw frame [DN] |")
    )
    assert row.split(" | ")[3] == lowest and row.split(" | ")[-1].rstrip(" |") == highest
    sheet = Image.open(tmp_path / "out/contact_sheet.png")
    columns, rows = sheet.size
    picture, text, gap = (20, 14), 3 * 13, 4  # ev, camera and height above each
    assert rows == 3 * (picture[1] + text + gap) + gap  # scene first has two views
    assert columns > 8 * (picture[0] + gap)  # of each of which there are eight samples


def test_a_card_without_pictures_or_numbers_has_no_empty_parts() -> None:
    numbers = CameraNumbers("a|b", "–", 1, {"": [None] * 5}, [0] * 5, [0.5] * 5)
    text = card_text(CardFacts("name", "", "", {"samples": 1}, [numbers], {}))
    assert (
        "\n\n\n" not in text
        and "a\\|b" in text
        and "| – |" in text
        and "ask who made it" in text
    )


def test_numbers_of_a_card_have_their_thousands_apart_and_no_exponent() -> None:
    values = [154_620.3, 4095.0, 1234.56, 999.5, 0.125]
    numbers = CameraNumbers("camera", "–", 1, {"": [None] * 5}, values, values)
    text = card_text(CardFacts("name", "", "", {"samples": 1}, [numbers], {}))
    assert "| 154 620 | 4 095 | 1 234.6 | 999.5 | 0.125 |" in text and "e+" not in text


def test_batches_are_every_sample_once_in_an_order_of_each_epoch(made: Path) -> None:
    samples = ms.Dataset(made, "train")
    means = sorted(one.read("clean").mean() for one in samples)
    orders = []
    for epoch in (0, 1, 0):
        found = list(batches(samples, ("raw", "clean"), 5, seed=3, epoch=epoch))
        assert [len(one["raw"]) for one in found][:-1] == [5] * (len(found) - 1)
        orders.append([float(x.mean()) for one in found for x in one["clean"]])
        assert sorted(orders[-1]) == [pytest.approx(float(x)) for x in means]
    assert orders[0] == orders[2] != orders[1]
    (first, *_) = batches(samples, ("raw",), 2)
    np.testing.assert_array_equal(
        first["raw"], np.stack([samples[0].read("raw"), samples[1].read("raw")])
    )


def test_arrays_of_different_shapes_are_no_batch(made: Path) -> None:
    class Odd:
        def __init__(self, rows: int) -> None:
            self.rows = rows

        def read(self, name: str) -> np.ndarray:
            return np.zeros((self.rows, 2))

    with pytest.raises(ms.InputError, match=r"shapes \[\(2, 2\), \(3, 2\)\]; take size=1"):
        list(batches([Odd(2), Odd(3)], ("clean",)))  # type: ignore[list-item]


def test_pytorch_loads_samples_in_workers(made: Path) -> None:
    torch = pytest.importorskip("torch")
    samples = ms.Dataset(made, "test")
    data = TorchDataset(
        samples, ("raw", "clean", "shape_index"), transform=lambda found: found[:2]
    )
    loader = torch.utils.data.DataLoader(data, batch_size=4, num_workers=2)
    raw = torch.cat([raw for raw, _ in loader])
    assert raw.dtype == torch.float32 and raw.shape == (len(samples), 1, 14, 20)
    np.testing.assert_array_equal(
        raw.numpy(), np.stack([one.read("raw") for one in samples]).astype(np.float32)
    )
    assert TorchDataset(samples, ("shape_index",))[0][0].dtype == torch.int64
    assert len(pickle.loads(pickle.dumps(TorchDataset(samples)))) == len(samples)


@pytest.mark.parametrize(
    ("format", "out", "options", "message"),
    [
        ("hdf4", "x", {}, "format is 'hdf4'; it must be one of parquet"),
        ("card", "x", {"split": "val"}, "split is 'val'"),
        ("card", "../pairs/x", {}, "in the dataset itself"),
        ("card", "taken", {}, "taken exists and was not exported"),
        ("webdataset", "x", {"arrays": ["electrons"]}, "electrons.tiff"),
        ("webdataset", "x", {"arrays": ["colour"]}, "a sample has no 'colour'"),
    ],
)
def test_a_wrong_export_is_refused_and_leaves_nothing(
    made: Path, tmp_path: Path, format: str, out: str, options: dict[str, Any], message: str
) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "a").write_text("a", "utf-8")
    place = made.parent / "pairs" / "x" if out.startswith("..") else tmp_path / out
    with pytest.raises(ms.InputError) as caught:
        export(made, format, place, **options)
    assert message in str(caught.value) and "\n" not in str(caught.value)
    assert (
        tree(tmp_path) == {"taken/a": hashlib.sha256(b"a").hexdigest()}
        and len(list(tmp_path.iterdir())) == 1
    )


def flipped(path: Path) -> None:
    """One bit of the file, at the same size."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def linked(path: Path) -> None:
    """The same content, elsewhere."""
    elsewhere = path.parents[3] / f"elsewhere-{path.name}"
    os.rename(path, elsewhere)
    path.symlink_to(elsewhere)


@pytest.mark.parametrize("spoil", [flipped, linked, os.unlink])
@pytest.mark.parametrize(
    ("name", "format"),
    [
        ("sample.json", "ros"),
        ("record.json", "card"),
        ("frame.png", "colmap"),
        ("clean.tiff", "webdataset"),
        ("aovs.exr", "coco"),
        ("aovs.exr", "nerfstudio"),
    ],
)
def test_what_is_not_as_it_was_written_is_not_exported(
    made: Path, tmp_path: Path, name: str, format: str, spoil: Callable[[Path], object]
) -> None:
    shutil.copytree(made, tmp_path / "copy")
    sample = ms.Dataset(tmp_path / "copy")[3]
    spoil((sample.view_folder if name == "aovs.exr" else sample.folder) / name)
    with pytest.raises(ms.InputError, match=r"dataset (verify|repair)|make it again"):
        export(tmp_path / "copy", format, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_picture_that_is_none_or_too_large_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "frame.png"
    Image.fromarray(np.random.default_rng(1).integers(0, 256, (99, 99), np.uint8)).save(path)
    whole = path.read_bytes()
    for content, why in (
        (b"", "cannot identify"),
        (whole[:5000], "truncated"),
        (bomb(200_000), "40000000000 pixels"),
    ):
        path.write_bytes(content)
        with pytest.raises(
            ms.InputError, match=f"is no picture that can be read: .*{why}"
        ) as caught:
            contact_sheet([SheetRow(["a"], [Captioned(path, ["b"])])])
        assert "\n" not in str(caught.value)


def bomb(side: int) -> bytes:
    """The beginning of a picture with so many rows and columns, in a few bytes."""
    head = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    data = b"IDAT" + zlib.compress(bytes(1000))
    chunks = (
        struct.pack(">I", len(one) - 4) + one + struct.pack(">I", zlib.crc32(one))
        for one in (head, data)
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


@pytest.mark.parametrize("name", ["../evil", "a/../../evil", "ABSOLUTE/evil", "."])
@pytest.mark.parametrize(
    ("field", "format"),
    one_in(
        3,
        [
            ("split", "webdataset"),
            ("split", "coco"),
            ("scene", "nerfstudio"),
            ("split", "parquet"),
            ("split", "hdf5"),
            ("scene", "kitti"),
            ("scene", "euroc"),
        ],
        several=True,
    ),
)
def test_names_in_a_foreign_dataset_lead_nowhere_else(
    made: Path, tmp_path: Path, name: str, field: str, format: str
) -> None:
    """A dataset of somebody else, with valid hashes and malicious names of splits and scenes."""
    name = name.replace("ABSOLUTE", str(tmp_path))
    copy = tmp_path / "deep" / "copy"
    shutil.copytree(made, copy)
    lines = [*index_of(copy)]
    if field == "split":
        lines = [line._replace(split=name) for line in lines]
    write_index(copy, lines)
    if field == "scene":
        for sample in ms.Dataset(copy):
            facts = json.loads(json.dumps(sample.facts))
            facts["view"]["scene"] = name
            (sample.folder / "sample.json").write_text(json.dumps(facts), "utf-8")
            files = {
                one.name: size_and_hash(one)
                for one in sample.folder.iterdir()
                if one.name != "record.json"
            }
            (sample.folder / "record.json").write_bytes(
                text_of(
                    Record("samples", "/".join(sample.folder.parts[-3:]), sample.key, files)
                )
            )
    before = tree(tmp_path)
    with suppress(ms.InputError):
        export(copy, format, tmp_path / "deep" / "out")
    assert {
        one: digest for one, digest in tree(tmp_path).items() if not one.startswith("deep/out/")
    } == before


def test_the_command_exports_and_knows_every_format(
    made: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    assert set(EXPORT_FORMATS) == set(WRITERS)
    done = cli("dataset", "export", "ros", made, "-o", tmp_path / "out", "--split", "train")
    assert done.exit_code == 0 and "samples as ros" in done.stdout
    again = cli("dataset", "export", "ros", made, "-o", tmp_path / "out")
    assert again.exit_code == 2 and "--force replaces it" in again.stderr
    forced = cli("dataset", "export", "ros", made, "-o", tmp_path / "out", "--force", "--json")
    assert json.loads(forced.stdout)["samples"] == 24
