"""EuRoC: SEQUENCE/mav0/cam0/data/TIME.png, data.csv and sensor.yaml, and the poses in state_groundtruth_estimate0.

The centre of the upper left pixel is (0, 0). The body is the first camera; times are nanoseconds. There is no inertial
sensor. camchain.yaml has the same cameras for Kalibr.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core import Float64Array, InputError
from ...files.texts import yaml_text
from ...optics.calibration import Calibration
from .export import Job
from .poses import ImageSequence, Posed, quaternion, sequences

HOW = """import csv
import yaml
from evo.tools.file_interface import read_euroc_csv_trajectory

folder = "{sequence}/mav0"  # sequences.json describes it
trajectory = read_euroc_csv_trajectory(f"{{folder}}/state_groundtruth_estimate0/data.csv")
with open(f"{{folder}}/cam0/sensor.yaml") as camera, open(f"{{folder}}/cam0/data.csv") as pictures:
    print(yaml.safe_load(camera)["intrinsics"], [*csv.reader(pictures)][1], trajectory.poses_se3[0])
"""
STATE_COLUMNS = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
    "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\n"
)
NO_BIAS = [0.0] * 6
NS_PER_S = 10**9
TIME_DIGITS = 19
"""Digits of a time in nanoseconds, so names sort by time."""


def write(job: Job) -> str:
    """Write all sequences, and sequences.json, which describes them. Returns code that reads them."""
    about = {}
    for number, sequence in enumerate(sequences(job)):
        name = f"{sequence.scene}_{number:02d}"
        times = _times(sequence)
        for place, (camera, frames) in enumerate(sequence.cameras.items()):
            _write_camera(job, f"{name}/mav0/cam{place}", times, frames)
            body = {
                "sensor_type": "camera",
                "comment": camera,
                "T_BS": _matrix(sequence.pose_in_first(camera)),
                "rate_hz": _rate_hz(sequence.times_s),
                **_sensor(frames[0].calibration),
            }
            job.text(f"{name}/mav0/cam{place}/sensor.yaml", yaml_text(body))
        states = f"{name}/mav0/state_groundtruth_estimate0"
        job.text(f"{states}/data.csv", STATE_COLUMNS, *_states(sequence, times))
        comment = "the body is the first camera; there is no inertial sensor"
        body = {"sensor_type": "pose", "comment": comment, "T_BS": _matrix(np.eye(4))}
        job.text(f"{states}/sensor.yaml", yaml_text(body))
        if any(frames[0].calibration.distortion[4] for frames in sequence.cameras.values()):
            job.remark(
                "sequences of lenses with k3 have no camchain.yaml: Kalibr has no such model"
            )
        else:
            job.text(f"{name}/camchain.yaml", yaml_text(_camchain(sequence)))
        about[name] = sequence.facts()
    job.json("sequences.json", about)
    return HOW.format(sequence=next(iter(about)))


def _write_camera(job: Job, place: str, times: Sequence[str], frames: Sequence[Posed]) -> None:
    """Write data/TIME.png and data.csv of a camera."""
    rows = ["#timestamp [ns],filename\n"]
    for time, (sample, *_) in zip(times, frames, strict=True):
        rows.append(f"{time},{job.picture(sample, f'{place}/data/{time}')}\n")
    job.text(f"{place}/data.csv", *rows)


def _sensor(calibration: Calibration) -> dict[str, object]:
    """Return the entries of sensor.yaml; the fifth coefficient is k3, if it is not 0."""
    *distortion, k3 = calibration.distortion
    return {
        "resolution": [calibration.columns, calibration.rows],
        "camera_model": "pinhole",
        "intrinsics": [*calibration.focal, *calibration.principal],
        "distortion_model": "radial-tangential",
        "distortion_coefficients": [*distortion, k3] if k3 else distortion,
    }


def _camchain(sequence: ImageSequence) -> dict[str, object]:
    """Return Kalibr's cameras; T_cn_cnm1 maps from each camera to the next one."""
    chain, before = dict[str, object](), np.eye(4)
    for number, (camera, frames) in enumerate(sequence.cameras.items()):
        entries = _sensor(frames[0].calibration)
        entries["distortion_model"] = "radtan"
        entries["distortion_coeffs"] = entries.pop("distortion_coefficients")
        entries["cam_overlaps"] = [x for x in range(len(sequence.cameras)) if x != number]
        entries["rostopic"] = f"/cam{number}/image_raw"
        pose = sequence.pose_in_first(camera)
        if number:
            entries["T_cn_cnm1"] = (np.linalg.inv(pose) @ before).tolist()
        chain[f"cam{number}"], before = entries, pose
    return chain


def _times(sequence: ImageSequence) -> list[str]:
    """Return the times of the frames [ns] as text. Raises InputError for equal times."""
    times_ns = np.rint(sequence.times_s * NS_PER_S).astype(np.int64)
    if (np.diff(times_ns) <= 0).any():
        raise InputError(
            f"frames of {sequence.scene} are less than 1 ns apart, but EuRoC has whole nanoseconds; give the keys of "
            "its path other time_s."
        )
    return [f"{time_ns:0{TIME_DIGITS}d}" for time_ns in times_ns.tolist()]


def _states(sequence: ImageSequence, times: Sequence[str]) -> list[str]:
    """Return time, position, quaternion w x y z, velocity, and zeros for the biases of each frame."""
    positions_m = np.array([pose[:3, 3] for pose in sequence.poses])
    velocities = np.zeros_like(positions_m)
    if len(times) > 1:
        velocities = np.gradient(positions_m, sequence.times_s, axis=0)
    rows = []
    for time, pose, velocity in zip(times, sequence.poses, velocities.tolist(), strict=True):
        place = [*pose[:3, 3].tolist(), *quaternion(pose[:3, :3])]
        rows.append(",".join([time, *map(repr, [*place, *velocity, *NO_BIAS])]) + "\n")
    return rows


def _rate_hz(times_s: Float64Array) -> float:
    """Return the frame rate [Hz]; 0 for one frame."""
    if len(times_s) == 1:
        return 0.0
    return (len(times_s) - 1) / float(times_s[-1] - times_s[0])


def _matrix(pose: Float64Array) -> dict[str, object]:
    """Return T_BS, from the sensor to the body."""
    return {"cols": 4, "rows": 4, "data": pose.ravel().tolist()}
