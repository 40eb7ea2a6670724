"""Exports that others read: Hugging Face's datasets, h5py, pykitti and evo find every sample as it is in the dataset.

A surface point of the AOV ``position_m`` is projected, by what was read, to the pixel that shows it.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from helpers.export_datasets import made_dataset
from helpers.marks import one_in
from numpy.typing import NDArray
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.core import DiskFull
from mitsuba_sensor.dataset.exports import job, parquet
from mitsuba_sensor.dataset.exports.export import export
from mitsuba_sensor.dataset.exports.job import PosedSample
from mitsuba_sensor.dataset.exports.kitti import projections
from mitsuba_sensor.dataset.exports.poses import TO_OPENCV, PosedImage, camera_to_world
from mitsuba_sensor.dataset.exports.sequences import ImageSequence, SequenceCamera, sequences
from mitsuba_sensor.dataset.plan.planned import load_plan
from mitsuba_sensor.files.parquet_shards import ParquetShards
from mitsuba_sensor.optics.calibration import Calibration
from mitsuba_sensor.output.exr import read_irradiance_exr
from mitsuba_sensor.render.motion.motion import KeyPose

Floats = NDArray[np.float64]
EXPORTS_PAGE = Path(__file__).parents[2] / "docs/dataset-exports.md"
MOST_PX, MOST_M = 0.002, 2e-6
"""Of a surface point beside its pixel, and beside where depth and pose have it: positions are float32."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_dataset(tmp_path_factory.mktemp("flight"))


def test_hugging_face_reads_the_bits_of_every_frame(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = pytest.importorskip("datasets")
    monkeypatch.setattr(library.config, "HF_HUB_OFFLINE", True)
    export(made, "parquet", tmp_path / "out", arrays=["raw", "clean", "depth_m"])
    found = library.load_dataset(str(tmp_path / "out"), cache_dir=str(tmp_path / "cache"))
    assert sorted(found) == ["test", "train_1"]
    for name, split in (("train_1", "train-1"), ("test", "test")):
        samples = ms.Dataset(made, split)
        assert len(found[name]) == len(samples) > 0
        for row, sample in zip(found[name], samples, strict=True):
            assert (row["key"], row["split"], row["exposure_ev"]) == (
                sample.key,
                sample.split,
                sample.values["exposure_ev"],
            )
            assert row["raw"].n_frames == len(sample.read("raw")) == 2
            for number, frame in enumerate(sample.read("raw")):
                row["raw"].seek(number)
                raw = np.array(row["raw"])
                assert raw.dtype == np.uint16
                np.testing.assert_array_equal(raw, frame)
            np.testing.assert_array_equal(np.array(row["clean"]), sample.read("clean"))
            depth_m = np.load(io.BytesIO(row["depth_m"]))
            np.testing.assert_array_equal(depth_m, sample.read("depth_m"))
            picture = Image.open(sample.folder / "frame.png")
            np.testing.assert_array_equal(np.array(row["preview"]), np.array(picture))
            assert json.loads(row["sample_json"]) == sample.facts
            if "pose" in sample.values:
                assert row["pose"] == json.loads(json.dumps(sample.values["pose"]))


IN_SHARDS = """name = "mixed"
outputs = ["raw", "clean", "companded"]
render = { width = 8, spp = 2, denoise = false }
scenes = [{ name = "Kiste", file = "perspective.xml" }]
cameras = [{ camera = "konnik_table1" }, { camera = "sony_imx490" }]
grid = { exposure_s = ["auto", 0.05], repetition = [0, 1] }
store = { shard_samples = 4 }
"""


@pytest.fixture(scope="module")
def in_shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_dataset(tmp_path_factory.mktemp("shards"), IN_SHARDS)


@pytest.mark.exhaustive
def test_hugging_face_reads_the_shards_of_a_dataset_whose_samples_differ(
    in_shards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As docs/dataset-exports.md says: without features it does not."""
    library = pytest.importorskip("datasets")
    monkeypatch.setattr(library.config, "HF_HUB_OFFLINE", True)
    samples = ms.Dataset(in_shards)
    files = sorted(map(str, (in_shards / "shards").glob("*.tar")))
    code = re.search(r"```\n(from datasets.*?)```", EXPORTS_PAGE.read_text("utf-8"), re.S)
    assert code is not None and len(files) == 2
    text = code[1].replace('"pairs/shards/*.tar"', f'{files}, cache_dir="{tmp_path}/cache"')
    names: dict[str, Any] = {}
    exec(text.replace('"frame.png"', '"companded.tiff"'), names)
    assert len(names["rows"]) == len(samples) == 8
    for row, sample in zip(names["rows"], samples, strict=True):
        np.testing.assert_array_equal(np.array(row["frame.tiff"]), sample.read("raw")[0])
        np.testing.assert_array_equal(np.array(row["clean.tiff"]), sample.read("clean"))
        for name in ("key", "values", "seeds", "image"):
            assert row["sample.json"][name] == sample.facts[name]
        assert (row["companded.tiff"] is None) == (sample.values["camera"] == "konnik_table1")
    arrow = pytest.importorskip("pyarrow")
    with pytest.raises(arrow.ArrowTypeError, match=r"exposure_s has incompatible types"):
        library.load_dataset(
            "webdataset", data_files=files, split="train", cache_dir=f"{tmp_path}/again"
        )


@pytest.mark.exhaustive
def test_shards_are_webdatasets_unless_others_are_asked_for(
    in_shards: Path, tmp_path: Path
) -> None:
    with pytest.raises(ms.InputError, match=r"give its readers .*made/shards/\*\.tar; --array"):
        export(in_shards, "webdataset", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert export(in_shards, "webdataset", tmp_path / "out", arrays=["raw"]).samples == 8


@pytest.mark.exhaustive
def test_codes_of_more_than_16_bits_are_no_pictures_of_kitti(
    in_shards: Path, tmp_path: Path
) -> None:
    with pytest.raises(ms.InputError, match=r"sony_imx490 have more than 16 bits.*or euroc"):
        export(in_shards, "kitti", tmp_path / "out")
    export(in_shards, "euroc", tmp_path / "euroc")
    assert len([*(tmp_path / "euroc").glob("*/mav0/cam*/data/*.tiff")]) == 4


def test_parquet_shards_are_bounded_and_keep_the_order(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    sizes = [300, 300, 300, 5000, 10, *[1] * 250]
    with ParquetShards(
        tmp_path, "a", {"x": "bytes", "n": "integer"}, {}, most_bytes=1000
    ) as shards:
        for number, size in enumerate(sizes):
            shards.add({"x": bytes(size), "n": number}, size)
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == [f"a-{n:05d}-of-00003.parquet" for n in range(3)]
    tables = [pq.read_table(file) for file in files]
    assert [n for table in tables for n in table["n"].to_pylist()] == [*range(len(sizes))]
    assert [len(table) for table in tables] == [3, 1, 251]
    metadata = pq.ParquetFile(files[2]).metadata
    groups = [metadata.row_group(n).num_rows for n in range(metadata.num_row_groups)]
    assert groups == [100, 100, 51]


def test_a_sample_that_is_too_large_for_a_row_is_refused(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parquet, "MOST_BYTES", 1000)
    with pytest.raises(ms.InputError, match=r"bytes of images, and a row of Parquet 1000 at"):
        export(made, "parquet", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_splits_that_are_one_for_hugging_face_are_refused() -> None:
    names = parquet.names_of_splits(["", "a.-b", "été"])
    assert names == {"": "train", "a.-b": "a__b", "été": "été"}
    with pytest.raises(ms.InputError, match=r"a-b, a_b are the same for Hugging Face.*--split"):
        parquet.names_of_splits(["a-b", "a_b"])


def test_hdf5_has_arrays_with_units_and_the_spectra_of_their_view(
    made: Path, tmp_path: Path
) -> None:
    h5py = pytest.importorskip("h5py")
    export(made, "hdf5", tmp_path / "out")
    units = {"raw": "DN", "clean": "DN", "variance": "DN^2", "electrons": "e-"}
    for split in ("train-1", "test"):
        samples = ms.Dataset(made, split)
        with h5py.File(tmp_path / f"out/{split}.h5") as file:
            assert [*file["samples"]] == [sample.key for sample in samples]
            assert file["samples"].attrs["title"] == "flight: Türme & 橋 | small"
            for sample in samples:
                group = file["samples"][sample.key]
                for name, unit in units.items():
                    np.testing.assert_array_equal(group[name][()], sample.read(name))
                    assert group[name].attrs["units"] == unit
                assert group.attrs["exposure_s"] == sample.facts["image"]["exposure_s"]
                assert group.attrs["camera"] == sample.values["camera"]
                assert json.loads(group["sample_json"][()]) == sample.facts
                light = read_irradiance_exr(sample.view_folder / "irradiance.exr")
                np.testing.assert_array_equal(group["light/irradiance"][()], light.data)
                np.testing.assert_array_equal(
                    group["light/wavelengths_nm"][()], light.wavelengths_nm
                )
                assert group["light/irradiance"].attrs["units"] == "W m-2 nm-1"
                assert group["light/wavelengths_nm"].attrs["units"] == "nm"
            views = {sample.view_folder.name for sample in samples}
            assert set(file["views"]) == views


def test_pykitti_reads_poses_that_take_points_to_their_pixels(
    made: Path, tmp_path: Path
) -> None:
    pykitti = pytest.importorskip("pykitti")
    out = tmp_path / "with space ü"
    assert export(made, "kitti", out).samples == len(ms.Dataset(made))
    about = json.loads((out / "sequences.json").read_text("utf-8"))
    samples = {sample.key: sample for sample in ms.Dataset(made)}
    assert sorted(about) == ["00", "01", "02", "03"]
    for name, said in about.items():
        found = pykitti.odometry(str(out), name)
        cameras = pykitti.utils.read_calib_file(out / f"sequences/{name}/calib_cam_to_cam.txt")
        first = np.array(said["world_from_first_camera"])
        times_s = [time.total_seconds() for time in found.timestamps]
        assert times_s == ([0, 1] if said["scene"] == "flight" else [0])
        for number, camera in enumerate(said["cameras"]):
            files = getattr(found, f"cam{number}_files")
            assert len(files) == len(found.poses) == len(camera["frames"])
            to_camera = np.eye(4)
            to_camera[:3, :3] = cameras[f"R_0{number}"].reshape(3, 3)
            to_camera[:3, 3] = cameras[f"T_0{number}"]
            matrix, distortion = (
                cameras[f"K_0{number}"].reshape(3, 3),
                cameras[f"D_0{number}"],
            )
            for pose, file, frame in zip(found.poses, files, camera["frames"], strict=True):
                sample = samples[frame["key"]]
                assert sample.values["camera"] == camera["camera"]
                np.testing.assert_array_equal(np.array(Image.open(file)), sample.read("raw")[0])
                from_world = to_camera @ np.linalg.inv(first @ pose)
                require_pixels(sample, from_world, matrix, distortion)
                if not distortion.any():
                    require_projection(sample, found.calib, number, first @ pose)


def test_evo_and_the_published_layout_of_euroc_take_points_to_their_pixels(
    made: Path, tmp_path: Path
) -> None:
    export(made, "euroc", tmp_path / "out")
    about = json.loads((tmp_path / "out/sequences.json").read_text("utf-8"))
    samples = {sample.key: sample for sample in ms.Dataset(made)}
    assert sorted(about) == ["flight_00", "flight_01", "still_02", "still_03"]
    for name, said in about.items():
        folder = tmp_path / "out" / name / "mav0"
        times_s, poses = states_of(folder)
        assert times_s.tolist() == ([0, 1] if said["scene"] == "flight" else [0])
        for number, camera in enumerate(said["cameras"]):
            sensor = yaml.safe_load((folder / f"cam{number}/sensor.yaml").read_text("utf-8"))
            fu, fv, cu, cv = sensor["intrinsics"]
            matrix = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
            distortion = np.pad(np.array(sensor["distortion_coefficients"]), (0, 1))[:5]
            body_from_camera = np.reshape(sensor["T_BS"]["data"], (4, 4))
            with (folder / f"cam{number}/data.csv").open(encoding="utf-8") as opened:
                (_, *rows) = csv.reader(opened)
            files = sorted((folder / f"cam{number}/data").iterdir())
            assert [row[1] for row in rows] == [file.name for file in files]
            assert [int(row[0]) / 1e9 for row in rows] == times_s.tolist()
            for pose, file, frame in zip(poses, files, camera["frames"], strict=True):
                sample = samples[frame["key"]]
                np.testing.assert_array_equal(np.array(Image.open(file)), sample.read("raw")[0])
                assert sensor["resolution"] == [20, 14]
                from_world = np.linalg.inv(pose @ body_from_camera)
                require_pixels(sample, from_world, matrix, distortion)


def states_of(folder: Path) -> tuple[Floats, list[Floats]]:
    """Times [s] and poses, body to world, by evo where it is installed."""
    path = folder / "state_groundtruth_estimate0/data.csv"
    rows = np.loadtxt(path, delimiter=",", comments="#", ndmin=2)
    assert rows.shape[1] == 17
    interface = pytest.importorskip("evo.tools.file_interface")
    trajectory = interface.read_euroc_csv_trajectory(str(path))
    velocity_m_per_s = rows[:, 8:11]
    if len(rows) > 1:  # (1, 1, 0) m in 1 s
        np.testing.assert_allclose(velocity_m_per_s, [[1, 1, 0]] * len(rows), atol=1e-9)
    return np.array(trajectory.timestamps), list(trajectory.poses_se3)


def require_pixels(
    sample: ms.Sample, from_world: Floats, matrix: Floats, distortion: Floats
) -> None:
    """The surface points of a sample are where it shows them: on the picture, and at their depth."""
    points, lit = sample.read("position_m").astype(float), np.isfinite(sample.read("depth_m"))
    middles = np.stack(np.meshgrid(*map(np.arange, lit.shape[::-1])), axis=-1)[lit]
    seen = points[lit] @ from_world[:3, :3].T + from_world[:3, 3]
    x, y = (seen[:, :2] / seen[:, 2:]).T
    k1, k2, p1, p2, k3 = distortion
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    bent_y = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    places = np.stack([bent_x, bent_y, np.ones_like(x)], axis=-1) @ matrix.T
    assert len(seen) > 50
    note("px", places[:, :2] - middles)
    np.testing.assert_allclose(places[:, :2], middles, atol=MOST_PX)
    depth_m = sample.read("depth_m")[lit]
    note("m", seen[:, 2] - depth_m)
    np.testing.assert_allclose(seen[:, 2], depth_m, atol=MOST_M)


def note(unit: str, differences: Any) -> None:
    """Print how far off points are at most: `pytest -s` shows it."""
    print(f"{np.abs(differences).max():.2g} {unit}")


def require_projection(sample: ms.Sample, calib: Any, number: int, pose: Floats) -> None:
    """calib.txt takes points before the first camera to the pixels of this one."""
    points, lit = sample.read("position_m").astype(float), np.isfinite(sample.read("depth_m"))
    middles = np.stack(np.meshgrid(*map(np.arange, lit.shape[::-1])), axis=-1)[lit]
    before_first = np.c_[points[lit], np.ones(lit.sum())] @ np.linalg.inv(pose).T
    places = before_first @ getattr(calib, f"P_rect_{number}0").T
    np.testing.assert_allclose(places[:, :2] / places[:, 2:], middles, atol=MOST_PX)


def test_cameras_of_a_rig_are_where_their_poses_have_them() -> None:
    """Datasets have cameras at one place only; cameras elsewhere are looked at here."""
    first = Calibration(50, 36, (61.25, 60.0), (24.125, 18.5))
    second = Calibration(64, 20, (50.0, 51.0), (30.0, 9.5))
    cameras, truths = [], []
    for calibration, origin in ((first, (1.0, 2.0, -3.0)), (second, (1.2, 2.1, -3.0))):
        pose = KeyPose(time_s=0, origin_m=origin, target_m=(0, 0.5, 4), up=(0, 1, 0.3)).pose
        sample: Any = None
        frame = PosedSample(sample, PosedImage("a", calibration, pose))
        cameras.append(SequenceCamera("a", [frame]))
        truths.append(camera_to_world(pose, TO_OPENCV))
    sequence = ImageSequence(0, "a", {}, np.zeros(1), cameras)
    np.testing.assert_allclose(
        truths[0] @ sequence.beside_first(cameras[1]), truths[1], atol=1e-9
    )
    lines = dict(line.split(": ") for line in projections(sequence))
    assert lines["P2"] == lines["P3"] == lines["P0"] != lines["P1"]
    point = np.array([0.3, 0.1, 4, 1])
    before_first = np.linalg.inv(truths[0]) @ point
    for name, calibration, truth in zip(("P0", "P1"), (first, second), truths, strict=True):
        before = (np.linalg.inv(truth) @ point)[:3]
        expected = calibration.matrix @ before / before[2]
        place = np.reshape([*map(float, lines[name].split())], (3, 4)) @ before_first
        np.testing.assert_allclose(place / place[2], expected, atol=1e-9)


def posed_sample(camera: str, view: int, **values: Any) -> PosedSample:
    """One that nothing is read from."""
    said = {"scene": "a", "camera": camera, "view": view, **values}
    sample: Any = SimpleNamespace(key=f"{camera}{view}", split="", values=said)
    calibration = Calibration(2, 2, (2.0, 2.0), (0.5, 0.5))
    return PosedSample(sample, PosedImage("a", calibration, np.eye(4)))


@pytest.mark.parametrize(
    ("views", "expected", "left_out"),
    [
        ({"x": [0, 1, 2], "y": [2, 0]}, [{"x": [0, 2], "y": [0, 2]}], ["x1"]),
        ({"x": [0, 1], "y": [2]}, [{"x": [0, 1]}, {"y": [2]}], []),
        ({"x": [3, 3, 1]}, [{"x": [1, 3]}, {"x": [3]}], []),
        ({"x": [0]}, [{"x": [0]}], []),
    ],
)
def test_cameras_of_a_sequence_have_frames_at_the_same_times(
    views: dict[str, list[int]], expected: Any, left_out: list[str]
) -> None:
    """Samples that are equal in all that varies, as two random draws may be, are in two sequences."""
    samples = [posed_sample(camera, view) for camera in views for view in views[camera]]
    keys: list[str] = []
    work: Any = SimpleNamespace(
        worlds=lambda: {"a": samples},
        leave_out=lambda rest, what, why: keys.extend(sample.key for sample in rest),
        file=SimpleNamespace(scenes=[SimpleNamespace(name="a", path=None)]),
        remarks=[],
    )
    found = sequences(work)
    assert [one.number for one in found] == [*range(len(expected))] and keys == left_out
    for sequence, cameras in zip(found, expected, strict=True):
        seen = {
            camera.name: [sample.values["view"] for sample, _ in camera.frames]
            for camera in sequence.cameras
        }
        assert seen == cameras
        views_s = [0.1 * view for view in next(iter(cameras.values()))]
        np.testing.assert_allclose(sequence.times_s, views_s)


def test_settings_that_differ_are_sequences_of_their_own() -> None:
    samples = [posed_sample("x", view, gain=gain) for view in (0, 1) for gain in (1, 2)]
    scenes = [SimpleNamespace(name="a", path=None)]
    work: Any = SimpleNamespace(
        worlds=lambda: {"a": samples}, file=SimpleNamespace(scenes=scenes), remarks=[]
    )
    assert [one.values for one in sequences(work)] == [
        {"scene": "a", "gain": 1},
        {"scene": "a", "gain": 2},
    ]
    (remark,) = work.remarks
    assert "scene a have no times of their own" in remark and "0.1 s apart" in remark


ORTHOGRAPHIC = """name = "worlds"
outputs = ["raw", "preview"]
render = { spp = 4, denoise = false, wavelength_nm = 550 }
cameras = [{ camera = "bayer_2mp" }]
scenes = [
    { name = "first", file = "perspective.xml" },
    { name = "flat", file = "orthographic.xml", parameters = { height = 0.2 } },
    { name = "last", file = "perspective.xml", parameters = { height = 0.5 } },
]
grid = { exposure_ev = [0, -1] }
"""


@pytest.fixture(scope="module")
def with_orthographic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_dataset(tmp_path_factory.mktemp("ortho"), ORTHOGRAPHIC)


@pytest.mark.parametrize(
    "format", one_in(3, ["nerfstudio", "colmap", "euroc", "kitti", "opencv", "ros"])
)
def test_an_orthographic_scene_is_left_out_by_name(
    with_orthographic: Path, tmp_path: Path, format: str
) -> None:
    steps: list[tuple[int, int]] = []
    done = export(
        with_orthographic,
        format,
        tmp_path / "out",
        progress=lambda step, of: steps.append((step, of)),
    )
    (remark,) = done.remarks
    assert (
        done.samples == 4 and "2 samples of scene flat: the scene's sensor is ortho" in remark
    )
    text = (tmp_path / "out/README.md").read_text("utf-8")
    assert "Left out are 2 samples of scene flat" in text and "| samples | 4 |" in text
    assert steps == [(number, 12) for number in range(1, 13)]
    names = " ".join(str(path) for path in (tmp_path / "out").rglob("*"))
    keys = {sample.key for sample in ms.Dataset(with_orthographic).where(scene="flat")}
    assert "flat" not in names and not any(key in names for key in keys)


def test_the_command_says_what_it_left_out(
    with_orthographic: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    command = "dataset", "export", "opencv", str(with_orthographic), "-o"
    done = cli(*command, str(tmp_path / "a"))
    first, second = done.stdout.splitlines()
    assert done.exit_code == 0 and first.endswith(
        "4 samples as opencv; README.md there says how to read them"
    )
    assert second.startswith("left out are 2 samples of scene flat: ")
    said = json.loads(cli(*command, str(tmp_path / "b"), "--json").stdout)
    assert (said["samples"], said["format"], said["remarks"]) == (4, "opencv", [second])


@pytest.mark.exhaustive
def test_a_dataset_of_orthographic_scenes_has_no_calibrations(tmp_path: Path) -> None:
    text = ORTHOGRAPHIC.replace("perspective.xml", "orthographic.xml")
    folder = made_dataset(tmp_path, text)
    with pytest.raises(ms.InputError, match=r"no sample can be exported; .*first.*flat.*last"):
        export(folder, "colmap", tmp_path / "out")
    assert export(folder, "webdataset", tmp_path / "out").remarks == []


@pytest.mark.parametrize("format", one_in(3, ["coco", "nerfstudio", "colmap"]))
def test_pictures_are_raw_on_request(made: Path, tmp_path: Path, format: str) -> None:
    export(made, format, tmp_path / "out", images="raw")
    for sample in ms.Dataset(made):
        (path,) = (tmp_path / "out").rglob(f"{sample.key}.png")
        frame = np.array(Image.open(path))
        assert frame.dtype == np.uint16
        np.testing.assert_array_equal(frame, sample.read("raw")[0])
    if format == "coco":
        path = tmp_path / "out/annotations/instances_test.json"
        picture = json.loads(path.read_text("utf-8"))["images"][0]
        assert picture["black_level_dn"] > 0 and picture["white_level_dn"] == 4095


@pytest.mark.parametrize(
    ("format", "options", "message"),
    [
        ("coco", {"arrays": ["raw"]}, "arrays is an option of parquet, webdataset, hdf5"),
        ("hdf5", {"shard_mb": 5}, "shard_mb is an option of parquet, webdataset, and"),
        ("ros", {"images": "raw"}, "images is an option of coco, .*the format is ros; leave"),
        ("coco", {"images": "jpeg"}, "images is 'jpeg'; it must be one of preview, raw"),
        ("hdf5", {"arrays": ["colour"]}, "a sample has no 'colour'"),
        ("parquet", {"arrays": ["companded"]}, "companded needs in the outputs"),
    ],
)
def test_options_that_a_format_does_not_take_are_refused(
    made: Path, tmp_path: Path, format: str, options: Any, message: str
) -> None:
    with pytest.raises(ms.InputError, match=message):
        export(made, format, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_an_incomplete_dataset_says_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A camera that no orthographic scene takes: its samples cannot be made."""
    text = ORTHOGRAPHIC.replace(
        '{ camera = "bayer_2mp" }',
        '{ camera = "bayer_2mp" }, { camera = "konnik_table1", set = { "lens.distortion" = [-0.1, 0, 0, 0, 0] } }',
    )
    folder = made_dataset(tmp_path, text)
    with pytest.raises(ms.InputError) as caught:
        export(folder, "card", tmp_path / "out")
    message = str(caught.value)
    assert "2 of 12 samples are missing; " in message and "--incomplete exports" in message
    assert f"dataset run FILE.toml -o {folder}`" in message
    monkeypatch.chdir(tmp_path)  # below which the scenes are
    done = export(folder, "card", tmp_path / "out", incomplete=True)
    (remark,) = done.remarks
    found = re.fullmatch(r"2 of 12 samples are missing \((\w{24}), (\w{24})\)", remark)
    assert done.samples == 10 and found is not None
    plan = load_plan(tmp_path / "dataset.toml")
    planned = {sample.key for view in plan.views() for sample in view.samples}
    assert planned - {sample.key for sample in ms.Dataset(folder)} == {*found.groups()}
    text = (tmp_path / "out/README.md").read_text("utf-8")
    assert "2 of 12 samples are missing" in text and str(folder) not in text


CODE = {
    "parquet": "datasets",
    "webdataset": "webdataset",
    "hdf5": "h5py",
    "coco": "pycocotools",
    "colmap": "pycolmap",
    "kitti": "pykitti",
    "euroc": "evo",
    "opencv": "cv2",
    "ros": "yaml",
}
"""Format → the library that the code of its card is for."""


@pytest.mark.parametrize("format", one_in(3, CODE))
def test_the_code_of_a_card_reads_the_export(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    pytest.importorskip(CODE[format])
    export(made, format, tmp_path / "out")
    monkeypatch.chdir(tmp_path / "out")
    text = (tmp_path / "out/README.md").read_text("utf-8")
    code = text.partition("## How to read\n\n```\n")[2].partition("```")[0]
    assert "import" in code
    if format == "parquet":
        code = code.replace('"DIR"', f'"DIR", cache_dir="{tmp_path}"')
    exec(code.replace("DIR", str(tmp_path / "out")), {})


@pytest.mark.parametrize("format", one_in(2, ["parquet", "webdataset", "hdf5"]))
@pytest.mark.parametrize("bytes_left", [0, 5000])
def test_a_file_that_may_not_grow_is_a_full_disk_and_leaves_nothing(
    made: Path, tmp_path: Path, format: str, bytes_left: int
) -> None:
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_left, before[1]))
    try:
        with pytest.raises(DiskFull, match="make space there"):
            export(made, format, tmp_path / "out")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_worlds_of_scenes_that_are_called_alike_stay_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A scene with variants would be called as another scene is."""
    intrinsics = {"matrix": np.eye(3), "image_size": [2, 2], "heights_mm": None}
    light = {
        "intrinsics": {**intrinsics, "distortion": [0.0] * 5},
        "camera_to_world": np.eye(4),
    }
    config = {"camera": {"pixel": {"pitch_x_um": 5.0}}}
    samples = []
    for scene, height in (("a", 0), ("a", 1), ("a-001", 0), ("b", 0)):
        view = {"scene": scene, "config": {"parameters": {"height": height}}}
        facts = {"view": view, "light": light, "config": config}
        samples.append(SimpleNamespace(key=scene, facts=facts))
    monkeypatch.setattr(job, "facts_of", lambda sample: sample.facts)
    named, unposed = job.worlds(samples)  # type: ignore[arg-type]
    assert unposed == {} and sorted(named) == ["a-001", "a-002", "a-003", "b"]
    assert [len(group) for group in named.values()] == [1] * 4
