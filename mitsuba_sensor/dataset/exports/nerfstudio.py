"""The transforms.json of nerfstudio: intrinsics, and poses camera to world in OpenGL's axes (right, up, back).

The centre of the upper left pixel is (0.5, 0.5) in nerfstudio (get_image_coords adds 0.5, and 0.5 is subtracted before
OpenCV undistorts an image), hence cx and cy are larger by 0.5 than OpenCV's. nerfstudio rotates, centres and scales the
poses unless its parser is told not to, as in HOW.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...files.png import png
from ...optics.calibration import HALF_PIXEL, Calibration
from ..read import Sample
from .export import Job
from .poses import worlds

MM_PER_M, DEPTH_MAX_MM = 1000.0, 65535
TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
HOW = """# in a terminal
ns-train splatfacto --data {world} nerfstudio-data --orientation-method none --center-method none \\
    --auto-scale-poses False
"""


def write(job: Job) -> str:
    """Write SCENE/transforms.json, SCENE/images/KEY.png, and depths [mm] if any. Returns code that reads them.

    There are no train_filenames: a scene belongs to one split, but nerfstudio needs all of its three splits or none.
    """
    for world, samples in worlds(job).items():
        frames = list[dict[str, Any]]()
        for sample, calibration, pose in samples:
            name = job.picture(sample, f"{world}/images/{sample.key}")
            matrix = (pose @ TO_OPENGL).tolist()
            frame = {"file_path": f"images/{name}", "transform_matrix": matrix}
            frames.append(frame | intrinsics(calibration) | _depth(job, world, sample))
        job.json(f"{world}/transforms.json", {"camera_model": "OPENCV", "frames": frames})
    return HOW.format(world=world)


def _depth(job: Job, world: str, sample: Sample) -> dict[str, str]:
    """Write the depth of a view [mm] once, 0 for no surface or too far; return its place, if there is any."""
    if not sample.has("aovs.exr"):
        return {}
    name = f"depth/{sample.task}.png"
    place = job.place(f"{world}/{name}")
    if not place.exists():
        depth_mm = np.rint(sample.read("depth_m") * MM_PER_M)
        depth_mm[~((depth_mm >= 0) & (depth_mm <= DEPTH_MAX_MM))] = 0
        job.bytes(f"{world}/{name}", png(depth_mm.astype(np.uint16)))
    return {"depth_file_path": name}


def intrinsics(calibration: Calibration) -> dict[str, float]:
    """Return the intrinsics of one frame; nerfstudio reads them from each frame if the file itself has none."""
    (fx, fy), (cx, cy) = calibration.focal, calibration.principal
    names = ("w", "h", "fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    size = calibration.columns, calibration.rows
    values = (*size, fx, fy, cx + HALF_PIXEL, cy + HALF_PIXEL, *calibration.distortion)
    return dict(zip(names, values, strict=True))
