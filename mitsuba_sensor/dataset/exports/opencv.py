"""OpenCV FileStorage: camera_matrix, distortion_coefficients, and the pose of each picture.

Names are as in OpenCV's calibration sample. The centre of the upper left pixel is (0, 0), as in our intrinsics.
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
    """Write SCENE/camera_1.yml, …: a calibration, and the poses of its samples. Returns code that reads them."""
    for world, samples in worlds(job).items():
        calibrations = dict.fromkeys(x.calibration for x in samples)
        for number, calibration in enumerate(calibrations, 1):
            posed = [x for x in samples if x.calibration == calibration]
            job.text(f"{world}/camera_{number}.yml", calibration_text(calibration, posed))
        job.done(len(samples))
    return HOW.format(world=world)


def calibration_text(calibration: Calibration, posed: Sequence[Posed] = ()) -> str:
    """Return the text of a .yml for ``cv2.FileStorage``.

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

        to_camera = np.linalg.inv([x.pose for x in posed])
        turns = scipy.spatial.transform.Rotation.from_matrix(to_camera[:, :3, :3])
        extrinsic = np.hstack([turns.as_rotvec(), to_camera[:, :3, 3]])
        entries |= {"extrinsic_parameters": extrinsic, "images": [x.sample.key for x in posed]}
    return f"%YAML:1.0\n---\n{yaml_text(entries)}"
