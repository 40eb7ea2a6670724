"""KITTI's odometry benchmark: sequences/00/image_0/000000.png, times.txt, calib.txt, and poses/00.txt.

The centre of the upper left pixel is (0, 0). Poses are poses of the first camera, seen from its first frame. calib.txt
has P0, P1, …, which map points in front of the first camera [m] to pixels of a camera without distortion.
calib_cam_to_cam.txt is as in KITTI's raw data, with the distortion of the pictures.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...core import InputError
from .export import Job
from .poses import ImageSequence, sequences

HOW = """import pykitti

sequence = pykitti.odometry("DIR", "00")  # the folder of this file; sequences.json describes it
print(sequence.calib.P_rect_00, sequence.timestamps[0], sequence.poses[0], sequence.cam0_files[0])
"""
CAMERAS = 4
"""Cameras that readers expect; missing cameras get the parameters of the first one."""


def write(job: Job) -> str:
    """Write all sequences, and sequences.json, which describes them. Returns code that reads them."""
    about = {}
    for number, sequence in enumerate(sequences(job)):
        name = f"{number:02d}"
        for camera, frames in enumerate(sequence.cameras.values()):
            for place, (sample, *_) in enumerate(frames):
                picture = job.picture(sample, f"sequences/{name}/image_{camera}/{place:06d}")
                if not picture.endswith(".png"):
                    raise InputError(
                        f"raw frames of {sample.values.get('camera')} have more than 16 bits, but readers of KITTI "
                        "need PNGs; take images=preview, or euroc, which writes TIFFs."
                    )
        start = np.linalg.inv(sequence.poses[0])
        job.text(f"sequences/{name}/times.txt", *(_row("", [x]) for x in sequence.times_s))
        calib, cameras = calibrations(sequence)
        job.text(f"sequences/{name}/calib.txt", calib)
        job.text(f"sequences/{name}/calib_cam_to_cam.txt", cameras)
        poses = [_row("", (start @ pose)[:3]) for pose in sequence.poses]
        job.text(f"poses/{name}.txt", *poses)
        about[name] = sequence.facts()
    job.json("sequences.json", about)
    return HOW


def calibrations(sequence: ImageSequence) -> tuple[str, str]:
    """Return the texts of calib.txt, in which Tr is a laser scanner at the first camera, and of calib_cam_to_cam.txt:
    size, matrix, distortion k1 k2 p1 p2 k3 of each camera, and the pose from the first camera to it."""
    projections, cameras = list[str](), list[str]()
    for number, (name, frames) in enumerate(sequence.cameras.items()):
        calibration = frames[0].calibration
        from_first = np.linalg.inv(sequence.pose_in_first(name))
        projections.append(_row("", calibration.matrix @ from_first[:3]))
        facts: dict[str, ArrayLike] = {
            "S": (calibration.columns, calibration.rows),
            "K": calibration.matrix,
            "D": calibration.distortion,
            "R": from_first[:3, :3],
            "T": from_first[:3, 3],
        }
        cameras += [_row(f"{letter}_{number:02d}: ", value) for letter, value in facts.items()]
    projections += projections[:1] * (CAMERAS - len(projections))
    lines = [f"P{number}: {line}" for number, line in enumerate(projections)]
    return "".join([*lines, _row("Tr: ", np.eye(4)[:3])]), "".join(cameras)


def _row(name: str, values: ArrayLike) -> str:
    """Return numbers with all their digits, row by row."""
    return f"{name}{' '.join(repr(float(value)) for value in np.ravel(values))}\n"
