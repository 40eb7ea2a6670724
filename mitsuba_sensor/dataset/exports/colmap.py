"""COLMAP text model: cameras.txt, images.txt and an empty points3D.txt.

The middle of the upper left pixel is (0.5, 0.5) there, hence cx and cy are larger by 0.5 than OpenCV's. Poses are world
to camera (right, down, forward) [m] as a quaternion w, x, y, z and a translation. PINHOLE is without distortion, OPENCV
has k1, k2, p1, p2, and FULL_OPENCV k3 too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import scipy

from ...core import InputError
from ...files.texts import write_page
from ...files.whole_folder import inside
from ...optics.calibration import HALF_PIXEL, Calibration
from .job import Job
from .poses import PosedImage, world_to_camera

HOW = """import pycolmap

model = pycolmap.Reconstruction("{world}/sparse/0")  # its pictures are in {world}/images
"""
NO_POINTS = "# 3D point list: none; the poses are known\n"


def colmap_model(images: Sequence[PosedImage]) -> dict[str, str]:
    """Name → text of the three files. Raises InputError for a name with a space, which images.txt cannot hold."""
    numbers = {
        one: number
        for number, one in enumerate(dict.fromkeys(i.calibration for i in images), start=1)
    }
    cameras = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    cameras += [f"{number} {_camera(one)}" for one, number in numbers.items()]
    poses = [
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
        "# POINTS2D[] as (X, Y, POINT3D_ID)",
    ]
    for number, one in enumerate(images, start=1):
        if any(letter.isspace() for letter in one.name):
            raise InputError(
                f"the picture {one.name!r} has a space in its name, which COLMAP cannot read; rename it."
            )
        poses += [f"{number} {_pose(one)} {numbers[one.calibration]} {one.name}", ""]
    texts = {"cameras.txt": cameras, "images.txt": poses}
    return {name: "\n".join(lines) + "\n" for name, lines in texts.items()} | {
        "points3D.txt": NO_POINTS
    }


def write_colmap(job: Job) -> str:
    """Write SCENE/sparse/0/ with the model and SCENE/images/KEY.png. Returns how to read."""
    for world, samples in job.worlds().items():
        images = []
        for sample, image in samples:
            name = job.place_picture(sample, f"{world}/images/{sample.key}")
            images.append(replace(image, name=name))
            job.step()
        for name, text in colmap_model(images).items():
            write_page(inside(job.folder, f"{world}/sparse/0/{name}"), text)
    return HOW.format(world=world)


def _camera(calibration: Calibration) -> str:
    """Model, size and parameters."""
    k1, k2, p1, p2, k3 = calibration.distortion
    model, more = "PINHOLE", list[float]()
    if k3:
        model, more = "FULL_OPENCV", [k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]
    elif any(calibration.distortion):
        model, more = "OPENCV", [k1, k2, p1, p2]
    principal = [c + HALF_PIXEL for c in calibration.principal]
    numbers = " ".join(repr(float(x)) for x in (*calibration.focal, *principal, *more))
    return f"{model} {calibration.columns} {calibration.rows} {numbers}"


def _pose(image: PosedImage) -> str:
    turn, move = world_to_camera(image.pose)
    x, y, z, w = scipy.spatial.transform.Rotation.from_matrix(turn).as_quat(canonical=True)
    return " ".join(repr(float(number)) for number in (w, x, y, z, *move))
