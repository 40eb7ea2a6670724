"""COCO annotations of the instances in pictures: masks, boxes, areas and categories, from the AOV shape_index.

A shape of the scene file is one instance, its name (id) the category. Masks are exact, occlusions and holes included:
compressed run lengths of pycocotools, which loaders take for any annotation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .export import Job

HOW = """from pycocotools.coco import COCO

data = COCO("annotations/instances_{split}.json")
picture = data.loadImgs(data.getImgIds()[0])[0]  # its file is images/ + picture["file_name"]
masks = [data.annToMask(one) for one in data.loadAnns(data.getAnnIds(imgIds=picture["id"]))]
"""


def write(job: Job) -> str:
    """Write images/KEY.png and annotations/instances_SPLIT.json. Returns how to read."""
    images: dict[str, list[dict[str, Any]]] = {}
    instances: dict[str, list[dict[str, Any]]] = {}
    task, of_task = "", list[dict[str, Any]]()
    for sample in job.samples:
        if sample.task != task:  # samples of one task follow one another
            aovs = sample.aovs("shape_index")
            task, of_task = sample.task, [*instances_of(aovs.shape_index, aovs.shapes)]
        split, image = sample.split or "all", sample.facts["image"]
        name = job.picture(sample, f"images/{sample.key}")
        known = images.setdefault(split, [])
        number = {"image_id": len(known) + 1}
        instances.setdefault(split, []).extend({**one, **number} for one in of_task)
        facts = {x: image[x] for x in ("black_level_dn", "white_level_dn", "cfa_pattern")}
        size = {"width": image["columns"], "height": image["rows"]}
        about = {"split": sample.split, "values": sample.values, **facts}
        known.append({"id": len(known) + 1, "file_name": name, **size, "license": 1, **about})
    names = sorted({one["name"] for found in instances.values() for one in found})
    for split, found in instances.items():
        text = annotations(images[split], found, names)
        text["info"] = {"description": job.title, "version": "1.0"}
        text["licenses"] = [{"id": 1, "name": job.licence or "none given", "url": ""}]
        job.json(f"annotations/instances_{split}.json", text)
    return HOW.format(split=next(iter(images)))


def annotations(
    images: Sequence[dict[str, Any]], instances: Sequence[dict[str, Any]], names: Sequence[str]
) -> dict[str, Any]:
    """The contents of an annotation file; numbers start at 1.  names : of the categories."""
    numbers = {name: number for number, name in enumerate(names, 1)}
    entries = []
    for number, instance in enumerate(instances, 1):
        entry = {x: value for x, value in instance.items() if x != "name"}
        category = numbers[instance["name"]]
        entries.append({"id": number, "category_id": category, "iscrowd": 0, **entry})
    categories = [
        {"id": number, "name": x, "supercategory": "shape"} for x, number in numbers.items()
    ]
    return {"images": [*images], "annotations": entries, "categories": categories}


def instances_of(shape_index: NDArray[Any], shapes: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Name, mask, area and box of each shape in a picture, in the order of their indices.

    shape_index : (H, W), −1 where nothing is.  shapes : names, by index.
    """
    from pycocotools import mask

    for number in np.unique(shape_index[shape_index >= 0]).astype(int).tolist():
        covered = np.asfortranarray(shape_index == number, np.uint8)
        runs = mask.encode(covered)
        yield {
            "name": shapes[number],
            "shape_index": number,
            "segmentation": {"size": [*covered.shape], "counts": runs["counts"].decode()},
            "area": int(mask.area(runs)),
            "bbox": mask.toBbox(runs).tolist(),
        }
