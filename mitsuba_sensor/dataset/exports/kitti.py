"""KITTI's odometry benchmark: sequences/00/image_0/000000.png, times.txt, calib.txt, and poses/00.txt.

The middle of the upper left pixel is (0, 0); cameras are right, down, forward. Poses are those of the first camera,
seen from its first frame. calib.txt has P0, P1, …, from points before the first camera [m] to pixels of a camera
without distortion; calib_cam_to_cam.txt is that of KITTI's raw data, with the distortion of the pictures as they are.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from ...core import Float64Array, InputError
from ...files.texts import write_json, write_page
from ...files.whole_folder import inside
from ...optics.calibration import Calibration
from ..read.reader import Sample
from .job import Job
from .sequences import ImageSequence, SequenceCamera, sequences

HOW = """import pykitti

sequence = pykitti.odometry("DIR", "00")  # the folder of this file; sequences.json says what it is of
print(sequence.calib.P_rect_00, sequence.timestamps[0], sequence.poses[0], sequence.cam0_files[0])
"""
CAMERAS = 4
"""That readers ask for: those that a sequence does not have are said to be its first one."""


def write_kitti(job: Job) -> str:
    """Write all sequences, and sequences.json, which says what each one is. Returns how to read."""
    about = {}
    for sequence in sequences(job):
        name = f"{sequence.number:02d}"
        for number, camera in enumerate(sequence.cameras):
            for frame, (sample, _) in enumerate(camera.frames):
                _place_png(job, sample, f"sequences/{name}/image_{number}/{frame:06d}")
                job.step()
        poses = sequence.poses
        start = np.linalg.inv(poses[0])
        texts = {
            f"sequences/{name}/times.txt": map(_row, sequence.times_s[:, None]),
            f"sequences/{name}/calib.txt": projections(sequence),
            f"sequences/{name}/calib_cam_to_cam.txt": _cameras(sequence),
            f"poses/{name}.txt": (_row((start @ pose)[:3]) for pose in poses),
        }
        for place, lines in texts.items():
            write_page(inside(job.folder, place), "".join(f"{line}\n" for line in lines))
        about[name] = sequence.facts()
    write_json(inside(job.folder, "sequences.json"), about)
    return HOW


def _place_png(job: Job, sample: Sample, stem: str) -> None:
    """Write the picture of a sample. Raises InputError for one that is no PNG, which readers do not find."""
    if not job.place_picture(sample, stem).endswith(".png"):
        raise InputError(
            f"raw frames of {sample.values.get('camera')} have more than 16 bits, and readers of KITTI look for PNGs; "
            "take --images preview, or euroc, which has TIFFs of them."
        )


def projections(sequence: ImageSequence) -> Iterable[str]:
    """calib.txt.  Tr : of the laser scanner, which is none and at the first camera."""
    cameras = [*sequence.cameras]
    cameras += [cameras[0]] * (CAMERAS - len(cameras))
    for number, camera in enumerate(cameras):
        from_first = np.linalg.inv(sequence.beside_first(camera))[:3]
        yield f"P{number}: {_row(_calibration(camera).matrix @ from_first)}"
    yield f"Tr: {_row(np.eye(4)[:3])}"


def _cameras(sequence: ImageSequence) -> Iterable[str]:
    """calib_cam_to_cam.txt: size, matrix, distortion k1 k2 p1 p2 k3, and pose of each camera, first one to it."""
    for number, camera in enumerate(sequence.cameras):
        calibration = _calibration(camera)
        from_first = np.linalg.inv(sequence.beside_first(camera))
        yield f"S_{number:02d}: {calibration.columns} {calibration.rows}"
        yield f"K_{number:02d}: {_row(calibration.matrix)}"
        yield f"D_{number:02d}: {_row(calibration.distortion)}"
        yield f"R_{number:02d}: {_row(from_first[:3, :3])}"
        yield f"T_{number:02d}: {_row(from_first[:3, 3])}"


def _calibration(camera: SequenceCamera) -> Calibration:
    return camera.frames[0].image.calibration


def _row(values: ArrayLike | Float64Array) -> str:
    """Numbers with all their digits, row by row."""
    return " ".join(repr(float(value)) for value in np.ravel(values))
