"""COLMAP text model: cameras.txt, images.txt and an empty points3D.txt.

The centre of the upper left pixel is (0.5, 0.5) in COLMAP, hence cx and cy are larger by 0.5 than OpenCV's. PINHOLE has
no distortion, OPENCV has k1, k2, p1, p2, and FULL_OPENCV also has k3.
"""

from __future__ import annotations

import numpy as np

from ...optics.calibration import HALF_PIXEL, Calibration
from .export import Job
from .poses import quaternion, worlds

HOW = """import pycolmap

model = pycolmap.Reconstruction("{world}/sparse/0")  # its pictures are in {world}/images
"""


def write(job: Job) -> str:
    """Write SCENE/sparse/0/ with the model and SCENE/images/KEY.png. Returns code that reads them."""
    for world, samples in worlds(job).items():
        calibrations = dict.fromkeys(x.calibration for x in samples)
        numbers = {calibration: number for number, calibration in enumerate(calibrations, 1)}
        cameras = [_line(number, *camera_line(x)) for x, number in numbers.items()]
        images = []
        for number, (sample, calibration, pose) in enumerate(samples, 1):
            name = job.picture(sample, f"{world}/images/{sample.key}")
            to_camera = np.linalg.inv(pose)
            place = (*quaternion(to_camera[:3, :3].astype(float)), *to_camera[:3, 3].tolist())
            images += [_line(number, *place, numbers[calibration], name), "\n"]
        folder = f"{world}/sparse/0"
        job.text(
            f"{folder}/cameras.txt", "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n", *cameras
        )
        head = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# no POINTS2D[]\n"
        job.text(f"{folder}/images.txt", head, *images)
        job.text(f"{folder}/points3D.txt", "# 3D point list: none; the poses are known\n")
    return HOW.format(world=world)


def camera_line(calibration: Calibration) -> tuple[str | float, ...]:
    """Return model, size and parameters of a camera."""
    k1, k2, p1, p2, k3 = calibration.distortion
    model, more = "PINHOLE", list[float]()
    if k3:
        model, more = "FULL_OPENCV", [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]
    elif any(calibration.distortion):
        model, more = "OPENCV", [k1, k2, p1, p2]
    principal = [c + HALF_PIXEL for c in calibration.principal]
    size = calibration.columns, calibration.rows
    return model, *size, *calibration.focal, *principal, *more


def _line(*values: str | float) -> str:
    return " ".join(map(str, values)) + "\n"
