"""ROS camera_info YAML, as camera_calibration_parsers and camera_info_manager read it.

ROS has OpenCV's convention: the middle of the upper left pixel is (0, 0); the model is plumb_bob, k1, k2, p1, p2, k3.
"""

from __future__ import annotations

import json

import numpy as np

from ...core import Float64Array
from ...files.texts import write_json, write_page
from ...files.whole_folder import inside
from ...optics.calibration import Calibration
from .job import Job
from .poses import yaml_number

HOW = """import yaml

with open("camera_1.yaml") as file:
    info = yaml.safe_load(file)  # as camera_info_manager does; samples.json says which samples it is of
"""


def camera_info(calibration: Calibration, name: str) -> str:
    """The text of the file.  name : of the camera.  The pose is no part of it; ROS has it in the tree of frames."""
    projection = np.hstack([calibration.matrix, np.zeros((3, 1))])
    return "\n".join(
        [
            f"image_width: {calibration.columns}",
            f"image_height: {calibration.rows}",
            f"camera_name: {json.dumps(name)}",
            *_matrix("camera_matrix", calibration.matrix),
            "distortion_model: plumb_bob",
            *_matrix("distortion_coefficients", np.array([calibration.distortion])),
            *_matrix("rectification_matrix", np.eye(3)),
            *_matrix("projection_matrix", projection),
            "",
        ]
    )


def _matrix(name: str, value: Float64Array) -> list[str]:
    rows, columns = value.shape
    return [
        f"{name}:",
        f"  rows: {rows}",
        f"  cols: {columns}",
        f"  data: [{', '.join(map(yaml_number, value.ravel()))}]",
    ]


def write_ros(job: Job) -> str:
    """Write camera_1.yaml, …, one for each calibration, and samples.json, which says which samples have it. Returns how
    to read."""
    found: dict[Calibration, list[str]] = {}
    for samples in job.worlds().values():
        for sample, image in samples:
            found.setdefault(image.calibration, []).append(sample.key)
            job.step()
    names = [f"camera_{number}" for number in range(1, len(found) + 1)]
    for name, calibration in zip(names, found, strict=True):
        write_page(inside(job.folder, f"{name}.yaml"), camera_info(calibration, name))
    write_json(
        inside(job.folder, "samples.json"), dict(zip(names, found.values(), strict=True))
    )
    return HOW
