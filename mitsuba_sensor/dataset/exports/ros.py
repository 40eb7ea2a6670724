"""ROS camera_info YAML, as camera_calibration_parsers and camera_info_manager read it.

ROS has OpenCV's convention: the middle of the upper left pixel is (0, 0); the model is plumb_bob, k1, k2, p1, p2, k3.
"""

from __future__ import annotations

import json

import numpy as np

from ...core import Float64Array
from ...optics.calibration import Calibration
from .poses import yaml_number


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
