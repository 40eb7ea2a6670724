"""Exports that other programs read: samples are unchanged, and surface points are on their pixels.

Judges: Hugging Face's datasets, webdataset, h5py, pycocotools, pykitti, evo, pycolmap, OpenCV, PyYAML.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import tarfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeAlias

import numpy as np
import pytest
import yaml
from helpers.export_datasets import BASELINE_M, made_dataset
from helpers.marks import one_in
from numpy.typing import NDArray
from PIL import Image

import mitsuba_sensor as ms
from mitsuba_sensor.core import DiskFull
from mitsuba_sensor.dataset import make_dataset
from mitsuba_sensor.dataset.exports import export as export_module
from mitsuba_sensor.dataset.exports import parquet
from mitsuba_sensor.dataset.exports.export import export
from mitsuba_sensor.dataset.exports.formats import FORMATS
from mitsuba_sensor.dataset.exports.poses import Posed, sequences
from mitsuba_sensor.dataset.store import Store
from mitsuba_sensor.files.parquet_shards import write_parquet_shards
from mitsuba_sensor.optics.calibration import Calibration
from mitsuba_sensor.output.exr import read_irradiance_exr
from mitsuba_sensor.output.importers.import_camera import import_camera

Floats: TypeAlias = NDArray[np.float64]
Found: TypeAlias = Iterator[tuple[str, Callable[[Floats], Floats], Path | None]]
"""Key of a sample, the projection from the world to its pixels, and its picture."""
DOCS = Path(__file__).parents[2] / "docs"
NAMES = [row.name for row in FORMATS]
OFF_PX_MAX = 0.0008
"""Distance of a surface point from its pixel: positions are float32."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_dataset(tmp_path_factory.mktemp("flight"))


def tree(folder: Path) -> dict[str, str]:
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {
        str(x.relative_to(folder)): hashlib.sha256(x.read_bytes()).hexdigest() for x in paths
    }


def test_the_table_of_formats_is_that_of_help_docs_and_modules(cli: Callable[..., Any]) -> None:
    page = (DOCS / "exports-and-training.md").read_text("utf-8")
    said = " ".join(cli("dataset", "export", "--help").stdout.split())
    for row in FORMATS:
        assert f"\n| `{row.name}` |" in page and f"{row.name}:" in said
        assert callable(import_module(f"mitsuba_sensor.dataset.exports.{row.name}").write)
    with pytest.raises(ms.InputError, match=f"must be one of {', '.join(NAMES)}"):
        export("nowhere", "koko", "out")


@pytest.mark.parametrize("format", one_in(5, NAMES))
def test_an_export_is_the_same_each_time_and_lists_its_files(
    made: Path, tmp_path: Path, format: str
) -> None:
    steps: list[tuple[int, int]] = []
    count = len(ms.Dataset(made))
    for name in ("a", "b"):
        export(made, format, tmp_path / name, progress=lambda *step: steps.append(step))
    assert steps[-1] == (count, count) and steps == sorted(steps[: len(steps) // 2]) * 2
    found = tree(tmp_path / "a")
    listed = json.loads((tmp_path / "a/files.json").read_text("utf-8"))
    assert found == tree(tmp_path / "b") and listed["dataset"] == "flight"
    found.pop("files.json")
    assert {name: digest for name, (_, digest) in listed["files"].items()} == found


def projects(from_world: Floats, matrix: Floats, distortion: Any) -> Callable[[Floats], Floats]:
    cv2 = pytest.importorskip("cv2")
    turn, _ = cv2.Rodrigues(np.ascontiguousarray(from_world[:3, :3]))

    def pixels(points: Floats) -> Floats:
        coefficients = np.array(distortion, float)
        return cv2.projectPoints(points, turn, from_world[:3, 3], matrix, coefficients)[0][:, 0]

    return pixels


def by_nerfstudio(made: Path, out: Path) -> Found:
    """Read OpenGL's axes, and pixel centres at half integers."""
    for path in out.rglob("transforms.json"):
        for frame in json.loads(path.read_text("utf-8"))["frames"]:
            from_world = np.diag([1, -1, -1, 1]) @ np.linalg.inv(frame["transform_matrix"])
            cx, cy = frame["cx"] - 0.5, frame["cy"] - 0.5
            matrix = np.array([[frame["fl_x"], 0, cx], [0, frame["fl_y"], cy], [0, 0, 1]])
            distortion = [frame[name] for name in ("k1", "k2", "p1", "p2", "k3")]
            picture = path.parent / frame["file_path"]
            yield picture.stem, projects(from_world, matrix, distortion), picture


def by_colmap(made: Path, out: Path) -> Found:
    pycolmap = pytest.importorskip("pycolmap")
    for path in out.rglob("cameras.txt"):
        for image in pycolmap.Reconstruction(str(path.parent)).images.values():

            def pixels(points: Floats, image: Any = image) -> Floats:
                return np.array([image.project_point(point) for point in points]) - 0.5

            picture = path.parents[2] / "images" / image.name
            yield picture.stem, pixels, picture


def by_opencv(made: Path, out: Path) -> Found:
    cv2 = pytest.importorskip("cv2")
    for path in out.rglob("camera_*.yml"):
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        names = file.getNode("images")
        matrix, distortion, poses = (
            file.getNode(x).mat()
            for x in ("camera_matrix", "distortion_coefficients", "extrinsic_parameters")
        )
        for row, pose in enumerate(poses):
            from_world = np.eye(4)
            from_world[:3, :3], from_world[:3, 3] = cv2.Rodrigues(pose[:3])[0], pose[3:]
            yield names.at(row).string(), projects(from_world, matrix, distortion), None


def by_ros(made: Path, out: Path) -> Found:
    """Take the poses of the samples (axes left, up, forward), because the files have no poses."""
    samples = {sample.key: sample for sample in ms.Dataset(made)}
    for name, keys in json.loads((out / "samples.json").read_text("utf-8")).items():
        info = yaml.safe_load((out / f"{name}.yaml").read_text("utf-8"))
        matrix = np.reshape(info["camera_matrix"]["data"], (3, 3))
        distortion = info["distortion_coefficients"]["data"]
        assert info["distortion_model"] == "plumb_bob"
        for key in keys:
            to_world = np.array(samples[key].facts["light"]["camera_to_world"])
            from_world = np.linalg.inv(to_world @ np.diag([-1, -1, 1, 1]))
            yield key, projects(from_world, matrix, distortion), None


def by_kitti(made: Path, out: Path) -> Found:
    """calib.txt maps points in front of the first camera to the undistorted pixels of each camera."""
    pykitti = pytest.importorskip("pykitti")
    for name, said in json.loads((out / "sequences.json").read_text("utf-8")).items():
        found, first = (
            pykitti.odometry(str(out), name),
            np.array(said["world_from_first_camera"]),
        )
        cameras = pykitti.utils.read_calib_file(out / f"sequences/{name}/calib_cam_to_cam.txt")
        times_s = [time.total_seconds() for time in found.timestamps]
        assert times_s == ([0, 1] if said["scene"].startswith("flight") else [0])
        for number, camera in enumerate(said["cameras"]):
            to_camera, distortion = np.eye(4), cameras[f"D_0{number}"]
            to_camera[:3, :3] = cameras[f"R_0{number}"].reshape(3, 3)
            to_camera[:3, 3] = cameras[f"T_0{number}"]
            beside_m = BASELINE_M * camera["camera"].endswith("right")
            np.testing.assert_allclose(to_camera[:3, 3], [-beside_m, 0, 0], atol=1e-6)
            matrix = cameras[f"K_0{number}"].reshape(3, 3)
            projection = getattr(found.calib, f"P_rect_{number}0")
            np.testing.assert_allclose(projection, matrix @ to_camera[:3], atol=1e-9)
            files = getattr(found, f"cam{number}_files")
            for pose, file, frame in zip(found.poses, files, camera["frames"], strict=True):
                from_world = to_camera @ np.linalg.inv(first @ pose)
                yield frame["key"], projects(from_world, matrix, distortion), Path(file)


def by_euroc(made: Path, out: Path) -> Found:
    """evo reads the poses of the body; Kalibr's chain has the same cameras as the files of EuRoC."""
    interface = pytest.importorskip("evo.tools.file_interface")
    for name, said in json.loads((out / "sequences.json").read_text("utf-8")).items():
        folder, before = out / name / "mav0", np.eye(4)
        states = str(folder / "state_groundtruth_estimate0/data.csv")
        trajectory = interface.read_euroc_csv_trajectory(states)
        chain = yaml.safe_load((out / name / "camchain.yaml").read_text("utf-8"))
        if len(trajectory.timestamps) > 1:  # (1, 1, 0) m in 1 s
            velocities = np.loadtxt(states, delimiter=",")[:, 8:11]
            np.testing.assert_allclose(velocities, [[1, 1, 0]] * 2, atol=1e-6)
        for number, camera in enumerate(said["cameras"]):
            sensor = yaml.safe_load((folder / f"cam{number}/sensor.yaml").read_text("utf-8"))
            fu, fv, cu, cv = sensor["intrinsics"]
            matrix = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
            body = np.reshape(sensor["T_BS"]["data"], (4, 4))
            kalibr = chain[f"cam{number}"]
            before = np.array(kalibr.get("T_cn_cnm1", np.eye(4))) @ before
            np.testing.assert_allclose(before, np.linalg.inv(body), atol=1e-9)
            assert kalibr["intrinsics"] == sensor["intrinsics"]
            with (folder / f"cam{number}/data.csv").open(encoding="utf-8") as opened:
                (_, *rows) = csv.reader(opened)
            assert [int(row[0]) / 1e9 for row in rows] == trajectory.timestamps.tolist()
            frames = zip(trajectory.poses_se3, rows, camera["frames"], strict=True)
            for pose, (_, file), frame in frames:
                from_world, picture = (
                    np.linalg.inv(pose @ body),
                    folder / f"cam{number}/data" / file,
                )
                distortion = sensor["distortion_coefficients"]
                yield frame["key"], projects(from_world, matrix, distortion), picture


CALIBRATIONS = {
    "opencv": ["camera_1.yml"],
    "ros": ["camera_1.yaml"],
    "nerfstudio": ["transforms.json"],
    "colmap": ["cameras.txt"],
    "euroc": ["cam0/sensor.yaml", "camchain.yaml"],
}


@pytest.mark.parametrize(
    "read", [by_nerfstudio, by_colmap, by_opencv, by_ros, by_kitti, by_euroc]
)
def test_points_are_on_their_pixels(
    made: Path, tmp_path: Path, read: Callable[[Path, Path], Found]
) -> None:
    out, format = tmp_path / "with space ü", read.__name__.removeprefix("by_")
    assert export(made, format, out).remarks == []
    samples = {sample.key: sample for sample in ms.Dataset(made)}
    seen = []
    for key, project, picture in read(made, out):
        sample = samples[key]
        lit = np.isfinite(sample.read("depth"))
        middles = np.stack(np.meshgrid(*map(np.arange, lit.shape[::-1])), axis=-1)[lit]
        found = project(sample.read("position_m")[lit].astype(float))
        assert len(found) > 50
        np.testing.assert_allclose(found, middles, atol=OFF_PX_MAX)
        if picture is not None:
            raw = format in ("kitti", "euroc")
            expected = sample.read("raw")[0] if raw else sample.read("preview")
            np.testing.assert_array_equal(np.array(Image.open(picture)), expected)
        seen.append(key)
    assert sorted(seen) == sorted(samples)
    for pattern in CALIBRATIONS.get(format, ()):  # which are imported as cameras
        camera = import_camera(sorted(out.rglob(pattern))[0])
        assert (camera.sensor.columns, camera.sensor.rows) == (20, 14)
        assert camera.lens.distortion == pytest.approx((-0.1, 0.02, 0.002, -0.001, 0))


def test_poses_of_one_world_are_together_with_their_depths(made: Path, tmp_path: Path) -> None:
    """The ball has another place in half of the samples, which is another world."""
    export(made, "nerfstudio", tmp_path / "out", images="raw")
    samples = {sample.key: sample for sample in ms.Dataset(made)}
    worlds = [f"{scene}/00{number}" for scene in ("flight", "still") for number in (1, 2)]
    for world in worlds:
        data = json.loads((tmp_path / f"out/{world}/transforms.json").read_text("utf-8"))
        for frame in data["frames"]:
            path = tmp_path / "out" / world / frame["file_path"]
            sample = samples[path.stem]
            assert sample.values["parameters.height"] == (0.5 if world.endswith("2") else 0)
            assert sample.values["scene"] == world.partition("/")[0]
            np.testing.assert_array_equal(np.array(Image.open(path)), sample.read("raw")[0])
            depth_mm = np.array(Image.open(tmp_path / "out" / world / frame["depth_file_path"]))
            depth_m = np.nan_to_num(sample.read("depth"), posinf=0)
            np.testing.assert_allclose(depth_mm / 1000, depth_m, atol=0.0005 + 1e-6)
    assert len([*(tmp_path / "out").rglob("transforms.json")]) == len(worlds)


@pytest.mark.exhaustive
def test_hugging_face_reads_the_bits_of_every_frame(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = pytest.importorskip("datasets")
    monkeypatch.setattr(library.config, "HF_HUB_OFFLINE", True)
    export(made, "parquet", tmp_path / "out", arrays=["raw", "clean", "depth"])
    found = library.load_dataset(str(tmp_path / "out"), cache_dir=str(tmp_path / "cache"))
    assert sorted(found) == ["test", "train_1"]
    for name, split in (("train_1", "train-1"), ("test", "test")):
        samples = ms.Dataset(made, split)
        for row, sample in zip(found[name], samples, strict=True):
            facts = sample.facts
            assert (row["key"], row["split"], row["gain"]) == (sample.key, split, None)
            assert row["exposure_s"] == facts["image"]["exposure_s"]
            assert row["system_gain_dn_per_e"] == facts["system_gain_dn_per_e"]
            assert row["black_level_dn"] == facts["image"]["black_level_dn"]
            assert row["serial"] == sample.values["serial"]
            assert row["parameters.height"] == sample.values["parameters.height"]
            for number, frame in enumerate(sample.read("raw")):
                row["raw"].seek(number)
                np.testing.assert_array_equal(np.array(row["raw"]), frame)
            np.testing.assert_array_equal(np.array(row["clean"]), sample.read("clean"))
            depth_m = np.load(io.BytesIO(row["depth"]))
            np.testing.assert_array_equal(depth_m, sample.read("depth_m"))
            np.testing.assert_array_equal(np.array(row["preview"]), sample.read("preview"))
            assert json.loads(row["sample_json"]) == facts


def test_webdataset_decodes_its_shards_and_those_of_the_dataset(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An export has several shards, sorted by key; the dataset's own shards have the unchanged files."""
    wds = pytest.importorskip("webdataset")
    samples = {sample.key: sample for sample in ms.Dataset(made, "train-1")}
    monkeypatch.setattr(export_module, "MB", 30_000)
    export(made, "webdataset", tmp_path / "out", shard_mb=1, arrays=["raw", "clean", "depth"])
    files = sorted(map(str, (tmp_path / "out").glob("train-1-*.tar")))
    found = [*wds.WebDataset(files, shardshuffle=False).decode("rgb8")]
    assert len(files) > 2 and [one["__key__"] for one in found] == sorted(samples)
    assert max(Path(file).stat().st_size for file in files) <= 30_000
    for one in found:
        sample = samples[one["__key__"]]
        for name in ("raw", "clean", "depth"):
            np.testing.assert_array_equal(one[f"{name}.npy"], sample.read(name))
        assert one["json"] == sample.facts and one["png"].shape == (14, 20, 3)
    stored = sorted(map(str, (made / "shards").glob("*.tar")))
    own = {one["__key__"]: one for one in wds.WebDataset(stored, shardshuffle=False)}
    for key, sample in samples.items():
        assert own[key]["frame.tiff"] == sample.files["frame.tiff"]
    with tarfile.open(stored[0]) as tar:
        assert {member.mtime for member in tar} == {0}


def test_hdf5_has_arrays_with_units_and_the_spectra_of_their_light(
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
            assert {*file["lights"]} == {sample.task for sample in samples}
            for sample in samples:
                group = file["samples"][sample.key]
                for name, unit in units.items():
                    np.testing.assert_array_equal(group[name][()], sample.read(name))
                    assert group[name].attrs["units"] == unit
                assert group.attrs["exposure_s"] == sample.facts["image"]["exposure_s"]
                assert group.attrs["camera"] == sample.values["camera"]
                assert json.loads(group["sample_json"][()]) == sample.facts
                with sample.opened("irradiance.exr") as path:
                    light = read_irradiance_exr(path)
                np.testing.assert_array_equal(group["light/irradiance"][()], light.data)
                assert group["light/irradiance"].attrs["units"] == "W m-2 nm-1"
                wavelengths = group["light/wavelengths_nm"]
                np.testing.assert_array_equal(wavelengths[()], light.wavelengths_nm)


def test_masks_of_coco_are_the_shapes_of_the_aovs(made: Path, tmp_path: Path) -> None:
    library = pytest.importorskip("pycocotools.coco")
    export(made, "coco", tmp_path / "out", images="raw")
    for split in ("train-1", "test"):
        data = library.COCO(str(tmp_path / f"out/annotations/instances_{split}.json"))
        assert [one["name"] for one in data.loadCats(data.getCatIds())] == ["ball", "floor"]
        pictures = data.loadImgs(data.getImgIds())
        assert data.getAnnIds() == [*range(1, len(data.getAnnIds()) + 1)]
        for picture, sample in zip(pictures, ms.Dataset(made, split), strict=True):
            assert picture["file_name"] == f"{sample.key}.png"
            assert picture["black_level_dn"] == sample.facts["image"]["black_level_dn"]
            index, names = sample.read("shape_index"), sample.aovs().shapes
            painted = np.full(index.shape, -1.0)
            for one in data.loadAnns(data.getAnnIds(imgIds=picture["id"], iscrowd=False)):
                mask = data.annToMask(one) == 1
                painted[mask] = names.index(data.loadCats(one["category_id"])[0]["name"])
                rows, columns = np.nonzero(mask)
                box = columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1
                assert (one["area"], tuple(one["bbox"])) == (mask.sum(), box)
            np.testing.assert_array_equal(painted, index)


def test_files_are_those_of_the_samples(
    made: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    command = "dataset", "unpack", made, "-o", tmp_path / "out", "--split", "test"
    assert cli(*command).exit_code == 0
    assert cli(*command).exit_code == 2  # it is there already
    found = json.loads(cli(*command, "--force", "--json").stdout)
    samples = ms.Dataset(made, "test")
    assert found["samples"] == len(samples)
    for number, sample in enumerate(samples):
        folder = tmp_path / "out" / sample.values["scene"]
        for name, content in sample.files.items():
            path = folder / f"{number:06d}-{sample.key[:8]}" / name
            assert path.read_bytes() == content
        for name, content in sample.view_files.items():
            assert (folder / f"light-{sample.task[:8]}" / name).read_bytes() == content


LIBRARIES = {
    "parquet": "datasets",
    "webdataset": "webdataset",
    "hdf5": "h5py",
    "coco": "pycocotools",
    "colmap": "pycolmap",
    "kitti": "pykitti",
    "euroc": "evo",
    "opencv": "cv2",
    "ros": "yaml",
    "files": "json",
}
"""Format → the library in the code of its card."""


@pytest.mark.parametrize("format", one_in(3, LIBRARIES))
def test_the_code_of_a_card_reads_the_export(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    pytest.importorskip(LIBRARIES[format])
    export(made, format, tmp_path / "out")
    monkeypatch.chdir(tmp_path / "out")
    text = (tmp_path / "out/README.md").read_text("utf-8")
    code = text.partition("## How to read\n\n```\n")[2].partition("```")[0]
    assert "import" in code
    if format == "parquet":
        code = code.replace('"DIR"', f'"DIR", cache_dir="{tmp_path}"')
    exec(code.replace("DIR", str(tmp_path / "out")), {})


def posed(camera: str, view: int, **values: Any) -> Posed:
    """Return a sample without files.  x_m : place of its camera."""
    pose = np.eye(4)
    pose[0, 3] = values.pop("x_m", 0.0)
    known = {"scene": "a", "camera": camera, "view": view, **values}
    sample: Any = SimpleNamespace(key=f"{camera}{view}", split="", values=known)
    return Posed(sample, Calibration(2, 2, (2.0, 2.0), (0.5, 0.5)), pose)


X, Y = posed("x", 0), posed("y", 0)


@pytest.mark.parametrize(
    ("samples", "expected", "remark"),
    [
        (
            [*(posed("x", v) for v in (0, 1, 2)), *(posed("y", v) for v in (2, 0))],
            [{"x": [0, 1, 2]}, {"y": [0, 2]}],
            "have no times",
        ),
        (
            [posed("x", 3), posed("x", 3), posed("x", 1)],
            [{"x": [1, 3]}, {"x": [3]}],
            "0.1 s",
        ),
        (
            [posed("x", v, time_s=t) for v, t in enumerate((3.0, 1.0, 2.0))],
            [{"x": [1, 2, 0]}],
            None,
        ),
        (
            [X, posed("x", 1), Y, posed("y", 1, x_m=1e-3)],
            [{"x": [0, 1]}, {"y": [0, 1]}],
            "0.1 s apart",
        ),
    ],
    ids=["other views", "equal settings", "times", "no rig"],
)
def test_cameras_of_a_sequence_have_frames_at_the_same_times(
    samples: list[Posed],
    expected: Any,
    remark: str | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "mitsuba_sensor.dataset.exports.poses.worlds", lambda job: {"a": samples}
    )
    remarks = list[str]()
    job: Any = SimpleNamespace(remark=remarks.append)
    found = sequences(job)
    assert (remark is None) == (not remarks)
    assert remark is None or remark in " ".join(remarks)
    for sequence, cameras in zip(found, expected, strict=True):
        views = {
            name: [frame.sample.values["view"] for frame in frames]
            for name, frames in sequence.cameras.items()
        }
        assert views == cameras
        steps_s = np.diff(next(iter(cameras.values()))) * 0.1
        np.testing.assert_allclose(
            np.diff(sequence.times_s), [1, 1] if not remarks else steps_s
        )


ORTHOGRAPHIC = """name = "worlds"
outputs = ["raw", "preview"]
render = { spp = 4, denoise = false, wavelength_nm = 550 }
cameras = [{ camera = "konnik_table1", set = { "adc.bits" = 20 } }]
scenes = [
    { name = "first", file = "perspective.xml" },
    { name = "flat", file = "orthographic.xml" },
]
grid = { exposure_s = [0.01] }
"""


def test_what_a_format_cannot_have_is_left_out_by_name_or_refused(
    tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """An orthographic scene and a camera with more than 16 bits."""
    folder = made_dataset(tmp_path, ORTHOGRAPHIC)
    done = cli("dataset", "export", "opencv", folder, "-o", tmp_path / "a", "--json")
    (remark,) = json.loads(done.stdout)["remarks"]
    assert "one sample of scene flat: the scene's sensor is orthographic" in remark
    text = (tmp_path / "a/README.md").read_text("utf-8")
    assert "Left out: one sample of scene flat" in text and "| samples | 1 |" in text
    with pytest.raises(ms.InputError, match=r"more than 16 bits.*or euroc"):
        export(folder, "kitti", tmp_path / "b")
    export(folder, "euroc", tmp_path / "c")
    assert len([*(tmp_path / "c").rglob("*.tiff")]) == 1


@pytest.mark.parametrize(
    ("format", "options", "message"),
    [
        ("torch", {}, "For PyTorch use .*TorchDataset"),
        ("coco", {"arrays": ["raw"]}, "arrays is an option of parquet, webdataset, hdf5"),
        ("ros", {"images": "raw"}, "images is an option of coco, .*the format is ros; omit"),
        ("hdf5", {"arrays": ["colour"]}, "a sample has no 'colour'"),
        ("parquet", {"arrays": ["companded"]}, "add 'companded' to outputs"),
    ],
)
def test_options_that_a_format_does_not_take_are_refused(
    made: Path, tmp_path: Path, format: str, options: Any, message: str
) -> None:
    with pytest.raises(ms.InputError, match=message):
        export(made, format, tmp_path / "out", **options)
    with pytest.raises(ms.InputError, match="is in the dataset itself"):
        export(made, "files", made / "out")
    assert not (tmp_path / "out").exists()


def test_rows_and_splits_are_those_that_hugging_face_can_have(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    names = parquet.names_of_splits(["", "a.-b", "été"])
    assert names == {"": "train", "a.-b": "a__b", "été": "été"}
    with pytest.raises(ms.InputError, match=r"a-b, a_b are the same for Hugging Face"):
        parquet.names_of_splits(["a-b", "a_b"])
    monkeypatch.setattr(parquet, "ROW_BYTES_MAX", 1000)
    with pytest.raises(
        ms.InputError, match=r"bytes of images, but a row of Parquet takes at most 1000"
    ):
        export(made, "parquet", tmp_path / "out")
    sizes = [300, 300, 300, 5000, 10, *[1] * 250]
    rows = (({"x": bytes(size), "n": n}, size) for n, size in enumerate(sizes))
    write_parquet_shards(tmp_path, "a", {"x": "bytes", "n": "integer"}, {}, rows, 1000)
    files = sorted(tmp_path.glob("*.parquet"))
    assert [file.name for file in files] == [f"a-{n:05d}-of-00003.parquet" for n in range(3)]
    tables = [pq.read_table(file) for file in files]
    assert [n for table in tables for n in table["n"].to_pylist()] == [*range(len(sizes))]
    assert [len(table) for table in tables] == [3, 1, 251]


@pytest.mark.parametrize("format", one_in(2, ["parquet", "webdataset", "hdf5"]))
@pytest.mark.parametrize("bytes_left", [0, 5000])
def test_a_file_that_may_not_grow_is_a_full_disk_and_leaves_nothing(
    made: Path, tmp_path: Path, format: str, bytes_left: int
) -> None:
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    len(ms.Dataset(made))  # its table is there
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_left, before[1]))
    try:
        with pytest.raises(DiskFull):
            export(made, format, tmp_path / "out")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def forged(made: Path, folder: Path, **changes: Any) -> Path:
    """Return a foreign dataset whose shards have valid names, and these values in rows and sample.json."""
    store, copy = Store(made), Store(folder)
    record = store.require_record()
    copy.write_record(record)
    for shard in store.finished().values():
        samples = []
        for row in store.rows(shard):
            files = store.members(shard.name, row.offset, row.bytes)
            facts = json.loads(files["sample.json"]) | changes.get("facts", {})
            facts["view"] = facts["view"] | changes.get("view", {})
            files["sample.json"] = json.dumps(facts).encode()
            samples.append(({**row.model_dump(), **changes.get("row", {})}, files))
        light = store.members(shard.name, row.light_offset, row.light_bytes)
        copy.commit(shard.task, record, light, samples)
    return folder


@pytest.mark.parametrize("name", one_in(4, ["../evil", "a/../../evil", "ABSOLUTE/evil", "."]))
@pytest.mark.parametrize("format", one_in(2, NAMES[:-1]))
def test_names_in_a_foreign_dataset_lead_nowhere_else(
    made: Path, tmp_path: Path, name: str, format: str
) -> None:
    name = name.replace("ABSOLUTE", str(tmp_path))
    copy = forged(made, tmp_path / "deep/copy", row={"split": name}, view={"scene": name})
    before = tree(tmp_path)
    with suppress(ms.InputError):
        export(copy, format, tmp_path / "deep/out")
    after = {x: digest for x, digest in tree(tmp_path).items() if not x.startswith("deep/out/")}
    assert {**after, "deep/copy/index.parquet": ""} == {**before, "deep/copy/index.parquet": ""}


NO_LENS = {"matrix": [[1, 0, 1], [0, 1, 1], [0, 0, 1]], "image_size": [2, 2]}
NO_LENS |= {"distortion": None, "heights_mm": None}


@pytest.mark.parametrize(
    "changes",
    one_in(
        3,
        [
            {"image": 3},
            {"image": None},
            {"config": {}},
            {"light": {"intrinsics": []}},
            {
                "light": {
                    "noise_ratio_median": 1,
                    "metering": None,
                    "camera_to_world": None,
                    "intrinsics": NO_LENS,
                }
            },
            {"digital_quantiles_dn": [1]},
            {"versions": [1]},
            {"readouts": [{}]},
        ],
    ),
)
def test_forged_facts_of_a_sample_are_a_sentence(
    made: Path, tmp_path: Path, cli: Callable[..., Any], changes: dict[str, Any]
) -> None:
    copy = forged(made, tmp_path / "copy", facts=changes)
    for format in ("card", "kitti"):
        with pytest.raises(ms.InputError, match=r"sample\.json is not as a run writes it"):
            export(copy, format, tmp_path / "out")
    assert cli("dataset", "show", copy, "0").exit_code == 2


def test_a_damaged_shard_is_not_exported_and_a_missing_one_only_on_request(
    made: Path, tmp_path: Path
) -> None:
    copy = forged(made, tmp_path / "copy")
    shard, count = sorted((copy / "shards").iterdir())[0], len(ms.Dataset(made))
    content = bytearray(shard.read_bytes())
    content[len(content) // 2] ^= 1
    shard.write_bytes(content)
    with pytest.raises(ms.InputError, match=f"{shard.name} has changed"):
        export(copy, "card", tmp_path / "out")
    shard.unlink()
    there = len(ms.Dataset(copy))
    missing = f"{count - there} of {count} samples are missing"
    with pytest.raises(ms.InputError, match=f"{missing}; .*incomplete=True exports the other"):
        export(copy, "card", tmp_path / "out")
    done = export(copy, "card", tmp_path / "out", incomplete=True)
    assert done == (there, [missing]) and 0 < there < count
    assert f"\n{missing}.\n" in (tmp_path / "out/README.md").read_text("utf-8")


def test_a_metered_exposure_is_a_number_of_seconds_in_parquet(tmp_path: Path) -> None:
    """`["auto"]` and `["auto", 0.05]` ended in tracebacks of Arrow and float."""
    pq = pytest.importorskip("pyarrow.parquet")
    (tmp_path / "d.toml").write_text(
        'name = "pq"\n[render]\nspp = 2\nwidth = 16\n[[scenes]]\nname = "flat"\nfile = "flat_field"\n'
        '[[cameras]]\ncamera = "konnik_table1"\n[grid]\nexposure_s = ["auto", 0.05]\n'
    )
    make_dataset(tmp_path / "d.toml", tmp_path / "out", workers=0)
    export(tmp_path / "out", "parquet", tmp_path / "hf")
    [file] = (tmp_path / "hf" / "data").iterdir()
    exposed = pq.read_table(file).column("exposure_s").to_pylist()
    samples = ms.Dataset(tmp_path / "out")
    assert exposed == [sample.facts["image"]["exposure_s"] for sample in samples]
    assert 0.05 in exposed and len({*exposed}) == 2
