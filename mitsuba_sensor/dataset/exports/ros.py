"""ROS camera_info YAML, as camera_calibration_parsers and camera_info_manager read it.

As in OpenCV, the centre of the upper left pixel is (0, 0). The model is plumb_bob: k1, k2, p1, p2, k3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...files.texts import yaml_text
from ...optics.calibration import Calibration
from .export import Job
from .poses import worlds

HOW = """import yaml

with open("camera_1.yaml") as file:
    info = yaml.safe_load(file)  # as camera_info_manager does; samples.json lists its samples
"""


def write(job: Job) -> str:
    """Write camera_1.yaml, …, one for each calibration, and samples.json, which lists the samples of each.

    Returns code that reads them.
    """
    keys: dict[Calibration, list[str]] = {}
    for samples in worlds(job).values():
        job.done(len(samples))
        for posed in samples:
            keys.setdefault(posed.calibration, []).append(posed.sample.key)
    named = {f"camera_{number}": x for number, x in enumerate(keys, 1)}
    for name, calibration in named.items():
        job.text(f"{name}.yaml", camera_info(calibration, name))
    job.json("samples.json", {name: keys[x] for name, x in named.items()})
    return HOW


def camera_info(calibration: Calibration, name: str) -> str:
    """Return the text of the file. It has no pose: ROS keeps poses in the tree of frames."""
    entries: dict[str, object] = {
        "image_width": calibration.columns,
        "image_height": calibration.rows,
        "camera_name": name,
        "camera_matrix": _matrix(calibration.matrix),
        "distortion_model": "plumb_bob",
        "distortion_coefficients": _matrix([calibration.distortion]),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(np.hstack([calibration.matrix, np.zeros((3, 1))])),
    }
    return yaml_text(entries)


def _matrix(values: ArrayLike) -> dict[str, object]:
    rows, columns = np.shape(values)
    return {"rows": rows, "cols": columns, "data": np.ravel(values).tolist()}
