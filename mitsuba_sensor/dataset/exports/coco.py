"""COCO annotations of the instances in pictures: masks, boxes, areas and categories, from the AOV shape_index.

A shape of the scene file is one instance, and its name (id) is the category. Masks are exact, including occlusions and
holes, as compressed run lengths of pycocotools, which every loader accepts.
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
    """Write images/KEY.png and annotations/instances_SPLIT.json. Returns code that reads them."""
    licence = {"id": 1, "name": job.licence or "none given", "url": ""}
    files: dict[str, dict[str, Any]] = {}
    categories: dict[str, int] = {}
    task, instances = "", list[dict[str, Any]]()
    for sample in job.samples:
        if sample.task != task:  # the samples of a task follow one another
            aovs = sample.aovs()
            instances = [*_instances(aovs.shape_index, aovs.shapes, categories)]
            task = sample.task
        about = {"info": {"description": job.title, "version": "1.0"}, "licenses": [licence]}
        empty = {**about, "images": [], "annotations": []}
        content = files.setdefault(sample.split or "all", empty)
        images, annotations = content["images"], content["annotations"]
        image, number = sample.facts["image"], len(images) + 1
        facts = {x: image.get(x) for x in ("black_level_dn", "white_level_dn", "cfa_pattern")}
        facts |= {"width": image["columns"], "height": image["rows"], "values": sample.values}
        name = job.picture(sample, f"images/{sample.key}")
        images.append({"id": number, "file_name": name, "license": 1, **facts})
        for instance in instances:
            annotations.append({"id": len(annotations) + 1, "image_id": number, **instance})
    for split, content in files.items():
        content["categories"] = [{"id": n, "name": x} for x, n in categories.items()]
        job.json(f"annotations/instances_{split}.json", content)
    return HOW.format(split=next(iter(files)))


def _instances(
    shape_index: NDArray[Any], shapes: Sequence[str], categories: dict[str, int]
) -> Iterator[dict[str, Any]]:
    """Yield category, mask, area and box of each shape in a picture, in the order of their indices.

    shape_index : shape (H, W), −1 without a surface.  shapes : names, by index.  categories : name → number; new names
    are added.
    """
    from pycocotools import mask

    for number, name in enumerate(shapes):
        covered = np.asfortranarray(shape_index == number, np.uint8)
        if covered.any():
            runs = mask.encode(covered)
            yield {
                "category_id": categories.setdefault(name, len(categories) + 1),
                "shape_index": number,
                "segmentation": {"size": [*covered.shape], "counts": runs["counts"].decode()},
                "area": int(mask.area(runs)),
                "bbox": mask.toBbox(runs).tolist(),
                "iscrowd": 0,
            }
