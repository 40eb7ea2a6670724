"""COCO annotations of the instances in pictures: masks, boxes, areas and categories, from the AOV shape_index.

A shape of the scene file is one instance, its name (id) the category. Masks are exact, occlusions and holes included:
compressed run lengths (the encoding of pycocotools' maskApi.c), which loaders take for any annotation. Polygons would
have no holes, and lists of run lengths are for crowds only.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...files.texts import write_page
from ...files.whole_folder import inside
from ..store.entry_files import checked, require_file
from .job import Job, facts_of

HOW = """from pycocotools.coco import COCO

data = COCO("annotations/instances_{split}.json")
picture = data.loadImgs(data.getImgIds()[0])[0]  # its file is images/ + picture["file_name"]
masks = [data.annToMask(one) for one in data.loadAnns(data.getAnnIds(imgIds=picture["id"]))]
"""
LEVELS = ("black_level_dn", "white_level_dn", "cfa_pattern")
"""Of the raw frame, that pictures have beside their values."""
BITS, MORE, SIGN, FIRST = 5, 0x20, 0x10, 48  # of a character of compressed run lengths


class Instance(NamedTuple):
    """What one shape covers of a picture.  counts : compressed run lengths.  bbox : left, top, width, height."""

    name: str
    shape_index: int
    counts: str
    bbox: tuple[int, int, int, int]
    area: int


class CocoImage(NamedTuple):
    """A picture and its instances.  facts : further entries of it, plain values, which COCO's readers pass over."""

    file_name: str
    columns: int
    rows: int
    instances: Sequence[Instance]
    facts: dict[str, Any]


def coco(
    images: Iterable[CocoImage],
    description: str,
    licence: str = "",
    names: Sequence[str] | None = None,
) -> dict[str, Any]:
    """The contents of an annotation file, ready for JSON. Numbers start at 1.

    names : of the categories; by default those that the pictures have, sorted.
    """
    known = list(images)
    if names is None:
        names = sorted({one.name for image in known for one in image.instances})
    categories = {name: number for number, name in enumerate(names, start=1)}
    found: dict[str, Any] = {
        "info": {"description": description, "version": "1.0"},
        "licenses": [{"id": 1, "name": licence or "none given", "url": ""}],
        "images": [],
        "annotations": [],
        "categories": [
            {"id": number, "name": name, "supercategory": "shape"}
            for name, number in categories.items()
        ],
    }
    for number, image in enumerate(known, start=1):
        shape = {"width": image.columns, "height": image.rows}
        found["images"].append(
            {"id": number, "file_name": image.file_name, **shape, "license": 1, **image.facts}
        )
        for one in image.instances:
            entry = {
                "id": len(found["annotations"]) + 1,
                "image_id": number,
                "category_id": categories[one.name],
            }
            mask = {"size": [image.rows, image.columns], "counts": one.counts}
            box = {"segmentation": mask, "area": one.area, "bbox": list(one.bbox), "iscrowd": 0}
            found["annotations"].append({**entry, **box, "shape_index": one.shape_index})
    return found


def instances_of(shape_index: ArrayLike, shapes: Sequence[str]) -> list[Instance]:
    """The instances in a picture, by their index.

    shape_index : (H, W), −1 where nothing is.  shapes : names, in the order of the indices.
    """
    index = np.asarray(shape_index).astype(np.int64)
    flat = index.ravel(order="F")  # COCO's runs go down the columns
    starts = np.flatnonzero(np.concatenate([[True], flat[1:] != flat[:-1]]))
    ends, values = np.append(starts[1:], flat.size), flat[starts]
    order = np.argsort(values, kind="stable")
    edges = np.flatnonzero(np.diff(values[order])) + 1
    groups = (group for group in np.split(order, edges) if values[group[0]] >= 0)
    return [
        _instance(int(values[group[0]]), shapes, (starts[group], ends[group]), index.shape)
        for group in groups
    ]


def _instance(
    number: int,
    shapes: Sequence[str],
    runs: tuple[NDArray[np.int64], NDArray[np.int64]],
    shape: tuple[int, ...],
) -> Instance:
    (starts, ends), (rows, columns) = runs, shape
    left, right = int(starts[0]) // rows, int(ends[-1] - 1) // rows
    goes_on_in_next_column = starts // rows != (ends - 1) // rows
    if goes_on_in_next_column.any():
        top, bottom = 0, rows - 1
    else:
        top, bottom = int((starts % rows).min()), int(((ends - 1) % rows).max())
    lengths = np.diff(np.column_stack([starts, ends]).ravel(), prepend=0)
    after = rows * columns - int(ends[-1])
    counts = [*lengths.tolist(), *([after] if after else [])]
    box = left, top, right - left + 1, bottom - top + 1
    return Instance(shapes[number], number, compressed(counts), box, int((ends - starts).sum()))


def compressed(counts: Sequence[int]) -> str:
    """Run lengths of 0, 1, 0, … as COCO's text: from the fourth on the difference to the one before the last, in groups
    of five bits, the lowest first."""
    text = []
    for position, count in enumerate(counts):
        rest = count
        if position > 2:
            rest = count - counts[position - 2]
        more = True
        while more:
            bits, rest = rest & (2**BITS - 1), rest >> BITS
            more = rest != (-1 if bits & SIGN else 0)
            text.append(chr((bits | MORE if more else bits) + FIRST))
    return "".join(text)


def write_coco(job: Job) -> str:
    """Write images/KEY.png and annotations/instances_SPLIT.json. Returns how to read."""
    found: dict[str, list[CocoImage]] = {}
    view, instances = "", list[Instance]()
    for sample in job.samples:
        if sample.view_key != view:  # samples of one view follow one another
            require_file(sample.view_files, "aovs.exr", "shape_index")
            checked(sample.view_files, "aovs.exr")
            aovs = sample.aovs()
            view, instances = sample.view_key, instances_of(aovs.shape_index, aovs.shapes)
        name = job.place_picture(sample, f"images/{sample.key}")
        about = facts_of(sample)["image"]
        levels = {level: about[level] for level in LEVELS}
        facts = {"split": sample.split, "values": dict(sample.values), **levels}
        image = CocoImage(name, about["columns"], about["rows"], instances, facts)
        found.setdefault(sample.split or "all", []).append(image)
        job.step()
    names = sorted(
        {one.name for images in found.values() for image in images for one in image.instances}
    )
    for split, images in found.items():
        annotations = coco(images, job.title, job.licence, names)
        write_page(
            inside(job.folder, f"annotations/instances_{split}.json"), json.dumps(annotations)
        )
    return HOW.format(split=next(iter(found)))
