"""OpenCV FileStorage: camera_matrix, distortion_coefficients, and the pose of each picture.

The names are those of OpenCV's calibration sample. The middle of the upper left pixel is (0, 0), as in our
intrinsics.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...files.texts import yaml_text
from ...optics.calibration import Calibration
from .export import Job
from .poses import Posed, worlds

HOW = """import cv2

storage = cv2.FileStorage("{world}/camera_1.yml", cv2.FILE_STORAGE_READ)
matrix, poses = (storage.getNode(name).mat() for name in ("camera_matrix", "extrinsic_parameters"))
keys = [storage.getNode("images").at(number).string() for number in range(len(poses))]  # of the samples
"""


def write(job: Job) -> str:
    """Write SCENE/camera_1.yml, …: a calibration, and the poses of all samples that have it. Returns how to read."""
    for world, samples in worlds(job).items():
        for number, one in enumerate(dict.fromkeys(x.calibration for x in samples), 1):
            posed = [x for x in samples if x.calibration == one]
            job.text(f"{world}/camera_{number}.yml", calibration_text(one, posed))
        job.done(len(samples))
    return HOW.format(world=world)


def calibration_text(calibration: Calibration, posed: Sequence[Posed] = ()) -> str:
    """The text of a .yml that ``cv2.FileStorage`` reads.

    extrinsic_parameters : (N, 6), rotation vector [rad] and translation [m] of each picture, world to camera.
    """
    entries: dict[str, object] = {
        "image_width": calibration.columns,
        "image_height": calibration.rows,
        "camera_matrix": calibration.matrix,
        "distortion_coefficients": np.array(calibration.distortion)[:, None],
    }
    if posed:
        import scipy

        to_camera = np.linalg.inv([one.pose for one in posed])
        turns = scipy.spatial.transform.Rotation.from_matrix(to_camera[:, :3, :3])
        extrinsic = np.hstack([turns.as_rotvec(), to_camera[:, :3, 3]])
        entries |= {"extrinsic_parameters": extrinsic, "images": [x.sample.key for x in posed]}
    return f"%YAML:1.0\n---\n{yaml_text(entries)}"
