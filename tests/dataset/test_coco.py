"""COCO annotations from shape indices: masks come back by the published decoding, and by pycocotools."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mitsuba_sensor.dataset.exports.coco import CocoImage, coco, compressed, instances_of

RNG = np.random.default_rng(5)
NAMES = ["wall", "ball", "lamp", "mesh 3"]
BLOCKS = np.kron(RNG.integers(-1, 4, (6, 9)), np.ones((7, 5), int))
INDICES = {
    "noise": RNG.integers(-1, 4, (31, 23)),
    "blocks": BLOCKS,
    "one shape": np.full((4, 7), 2.0, np.float32),
    "one pixel": np.where(np.arange(12).reshape(3, 4) == 11, 3, -1),
    "one row": RNG.integers(-1, 4, (1, 50)),
    "rings": (np.hypot(*np.mgrid[-20:21, -30:31]) // 7).astype(int) % 4,
}


def decoded(counts: str, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """rleFrString and rleDecode of pycocotools' maskApi.c."""
    lengths: list[int] = []
    position = 0
    while position < len(counts):
        value, shift, more = 0, 0, True
        while more:
            bits = ord(counts[position]) - 48
            value |= (bits & 0x1F) << shift
            more = bool(bits & 0x20)
            position, shift = position + 1, shift + 5
            if not more and bits & 0x10:
                value |= -1 << shift
        lengths.append(value + lengths[-2] if len(lengths) > 2 else value)
    flags = np.arange(len(lengths)) % 2 == 1
    return np.repeat(flags, lengths).reshape(shape, order="F")


@pytest.mark.parametrize("index", INDICES.values(), ids=INDICES)
def test_instances_partition_a_picture_into_its_shapes(index: NDArray[Any]) -> None:
    found = instances_of(index, NAMES)
    assert [one.shape_index for one in found] == [k for k in range(4) if (index == k).any()]
    for one in found:
        mask = index == one.shape_index
        np.testing.assert_array_equal(decoded(one.counts, mask.shape), mask)
        rows, columns = np.nonzero(mask)
        box = columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1
        assert (one.name, one.area, one.bbox) == (NAMES[one.shape_index], mask.sum(), box)


@pytest.mark.parametrize("index", INDICES.values(), ids=INDICES)
def test_pycocotools_encodes_alike(index: NDArray[Any]) -> None:
    masks = pytest.importorskip("pycocotools.mask")
    for one in instances_of(index, NAMES):
        mask = np.asfortranarray(index == one.shape_index, dtype=np.uint8)
        assert masks.encode(mask)["counts"].decode() == one.counts
        counted = {"size": list(mask.shape), "counts": one.counts}
        assert masks.area(counted) == one.area and tuple(masks.toBbox(counted)) == one.bbox


def annotations() -> dict[str, Any]:
    pictures = [
        CocoImage(
            f"images/{name.replace(' ', '_')}.png",
            *index.shape[::-1],
            instances_of(index, NAMES),
            {"key": name},
        )
        for name, index in INDICES.items()
    ]
    return json.loads(json.dumps(coco(pictures, "a dataset", "CC0-1.0")))  # type: ignore[no-any-return]


def test_numbers_start_at_1_and_name_what_exists() -> None:
    found = annotations()
    assert [one["name"] for one in found["categories"]] == sorted(NAMES)
    assert {one["license"] for one in found["images"]} == {found["licenses"][0]["id"]} == {1}
    for part in ("images", "annotations", "categories"):
        assert [one["id"] for one in found[part]] == list(range(1, len(found[part]) + 1))
    assert {one["image_id"] for one in found["annotations"]} <= {
        one["id"] for one in found["images"]
    }
    assert all(one["iscrowd"] == 0 and one["area"] > 0 for one in found["annotations"])


def test_pycocotools_loads_the_file(tmp_path: Path) -> None:
    library = pytest.importorskip("pycocotools.coco")
    path = tmp_path / "annotations.json"
    path.write_text(json.dumps(annotations()), "utf-8")
    with contextlib.redirect_stdout(io.StringIO()):
        data = library.COCO(str(path))
        same = data.loadRes(str(results(tmp_path, annotations())))
    names = {one["id"]: one["name"] for one in data.loadCats(data.getCatIds())}
    for picture, index in zip(data.loadImgs(data.getImgIds()), INDICES.values(), strict=True):
        painted = np.full(index.shape, -1)
        for one in data.loadAnns(data.getAnnIds(imgIds=picture["id"], iscrowd=False)):
            painted[data.annToMask(one) == 1] = NAMES.index(names[one["category_id"]])
        np.testing.assert_array_equal(painted, index)
    assert len(same.getAnnIds()) == len(data.getAnnIds())


def results(folder: Path, found: dict[str, Any]) -> Path:
    """The annotations as the results of a perfect detector."""
    names = ("image_id", "category_id", "segmentation")
    path = folder / "results.json"
    path.write_text(
        json.dumps(
            [
                {name: one[name] for name in names} | {"score": 1.0}
                for one in found["annotations"]
            ]
        )
    )
    return path


def test_long_and_falling_runs_are_compressed_as_they_are_decoded() -> None:
    """Differences of every sign and length of bits."""
    counts = [0, 1, 100_000, 3, 2**30, 1, 15, 16, 17, 31, 32, 33, 1]
    small = np.array(counts) % 5000
    np.testing.assert_array_equal(
        decoded(compressed(small.tolist()), (1, int(small.sum()))).ravel(),
        np.repeat(np.arange(len(counts)) % 2 == 1, small),
    )
    assert compressed([0]) == "0" and compressed([5, 2**30]) == "5PPPPPP1"
