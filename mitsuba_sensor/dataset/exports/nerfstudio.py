"""Contents of nerfstudio's transforms.json: intrinsics, and poses camera to world in OpenGL's axes (right, up, back).

The camera_model is OPENCV, lengths are metres. The middle of the upper left pixel is (0.5, 0.5) there
(get_image_coords has an offset of 0.5, and before OpenCV undistorts an image 0.5 is subtracted), hence cx and cy are
larger by 0.5 than OpenCV's. nerfstudio turns, centres and scales the poses unless its parser is told not to:
``nerfstudio-data --orientation-method none --center-method none --auto-scale-poses False``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...files.png import write_png
from ...files.texts import write_json
from ...files.whole_folder import inside
from ...optics.calibration import HALF_PIXEL, Calibration
from ..read.reader import Sample
from .job import Job, checked_array
from .poses import TO_OPENGL, PosedImage, camera_to_world

MM_PER_M, MOST_MM = 1000.0, 65535
HOW = """# in a terminal
ns-train splatfacto --data {world} nerfstudio-data --orientation-method none --center-method none \\
    --auto-scale-poses False
"""


def transforms(images: Sequence[PosedImage]) -> dict[str, Any]:
    """The contents of transforms.json. What all pictures share is said once; else each frame has its own intrinsics."""
    shared = {one.calibration for one in images}
    frames: list[dict[str, Any]] = []
    for one in images:
        if len(shared) == 1:
            own = {}
        else:
            own = _intrinsics(one.calibration)
        frames.append(
            {
                "file_path": one.name,
                **own,
                "transform_matrix": camera_to_world(one.pose, TO_OPENGL).tolist(),
            }
        )
    if len(shared) == 1:
        common = _intrinsics(shared.pop())
    else:
        common = {}
    return {"camera_model": "OPENCV", **common, "frames": frames}


def write_nerfstudio(job: Job) -> str:
    """Write SCENE/transforms.json, SCENE/images/KEY.png, and depths in millimetres where there are any. Returns how to
    read.

    No train_filenames: a scene belongs to one split, and nerfstudio wants all of its own three or none.
    """
    for world, samples in job.worlds().items():
        images, depths = [], {}
        for sample, image in samples:
            name = f"images/{job.place_picture(sample, f'{world}/images/{sample.key}')}"
            images.append(replace(image, name=name))
            depths[name] = _depth(job, world, sample)
            job.step()
        found = transforms(images)
        for frame in found["frames"]:
            frame |= {"depth_file_path": path} if (path := depths[frame["file_path"]]) else {}
        write_json(inside(job.folder, f"{world}/transforms.json"), found)
    return HOW.format(world=world)


def _depth(job: Job, world: str, sample: Sample) -> str:
    """Write the depth of a view [mm] once, 0 where nothing is or it is too far; empty where there is none."""
    if not sample.view_files.has("aovs.exr"):
        return ""
    name = f"depth/{sample.view_key}.png"
    place = inside(job.folder, f"{world}/{name}")
    if not place.exists():
        depth_mm = np.rint(checked_array(sample, "depth_m") * MM_PER_M)
        depth_mm[~((depth_mm >= 0) & (depth_mm <= MOST_MM))] = 0
        write_png(place, depth_mm.astype(np.uint16))
    return name


def _intrinsics(calibration: Calibration) -> dict[str, float]:
    (fx, fy), (cx, cy) = calibration.focal, calibration.principal
    coefficients = dict(
        zip(("k1", "k2", "p1", "p2", "k3"), calibration.distortion, strict=True)
    )
    size = {"w": calibration.columns, "h": calibration.rows}
    return {
        **size,
        "fl_x": fx,
        "fl_y": fy,
        "cx": cx + HALF_PIXEL,
        "cy": cy + HALF_PIXEL,
        **coefficients,
    }
