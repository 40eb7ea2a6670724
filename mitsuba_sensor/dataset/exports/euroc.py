"""EuRoC: SEQUENCE/mav0/cam0/data/TIME.png, data.csv and sensor.yaml, and the poses in state_groundtruth_estimate0.

The middle of the upper left pixel is (0, 0); cameras are right, down, forward. The body, whose poses are given, is the
first camera; times are nanoseconds. There is no inertial sensor.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
import scipy

from ...core import Float64Array, InputError
from ...files.texts import write_json, write_page
from ...files.whole_folder import inside
from .job import Job
from .poses import yaml_number
from .sequences import ImageSequence, SequenceCamera, sequences

HOW = """import csv
import yaml
from evo.tools.file_interface import read_euroc_csv_trajectory

folder = "{sequence}/mav0"  # sequences.json says what it is of
trajectory = read_euroc_csv_trajectory(f"{{folder}}/state_groundtruth_estimate0/data.csv")
with open(f"{{folder}}/cam0/sensor.yaml") as camera, open(f"{{folder}}/cam0/data.csv") as pictures:
    print(yaml.safe_load(camera)["intrinsics"], [*csv.reader(pictures)][1], trajectory.poses_se3[0])
"""
STATE_COLUMNS = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
    "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]"
)
NO_BIAS = (0.0,) * 6
NS_PER_S = 10**9
DIGITS = 19
"""Of a time in nanoseconds."""
BODY = "the body is the first camera; there is no inertial sensor"


def write_euroc(job: Job) -> str:
    """Write all sequences, and sequences.json, which says what each one is. Returns how to read."""
    about = {}
    for sequence in sequences(job):
        name = f"{sequence.scene}_{sequence.number:02d}"
        times_ns = _times_ns(sequence)
        for number, camera in enumerate(sequence.cameras):
            _write_camera(job, sequence, camera, f"{name}/mav0/cam{number}")
        states = f"{name}/mav0/state_groundtruth_estimate0"
        _write_lines(job, f"{states}/data.csv", [STATE_COLUMNS, *_states(sequence, times_ns)])
        _write_lines(
            job,
            f"{states}/sensor.yaml",
            ["sensor_type: pose", f"comment: {BODY}", *_matrix(np.eye(4))],
        )
        about[name] = sequence.facts()
    write_json(inside(job.folder, "sequences.json"), about)
    return HOW.format(sequence=next(iter(about)))


def _write_camera(
    job: Job, sequence: ImageSequence, camera: SequenceCamera, place: str
) -> None:
    """data/TIME.png, data.csv and sensor.yaml of a camera."""
    rows = ["#timestamp [ns],filename"]
    for time_ns, (sample, _) in zip(
        map(_text_of, _times_ns(sequence)), camera.frames, strict=True
    ):
        picture = job.place_picture(sample, f"{place}/data/{time_ns}")
        rows.append(f"{time_ns},{picture}")
        job.step()
    _write_lines(job, f"{place}/data.csv", rows)
    calibration = camera.frames[0].image.calibration
    intrinsics = (*calibration.focal, *calibration.principal)
    *distortion, k3 = calibration.distortion
    if k3:
        distortion.append(k3)
    lines = [
        "sensor_type: camera",
        f"comment: {json.dumps(camera.name)}",
        *_matrix(sequence.beside_first(camera)),
        f"rate_hz: {yaml_number(_rate_hz(sequence.times_s))}",
        f"resolution: [{calibration.columns}, {calibration.rows}]",
        "camera_model: pinhole",
        f"intrinsics: [{_list(intrinsics)}]",
        "distortion_model: radial-tangential",
        f"distortion_coefficients: [{_list(distortion)}]",
    ]
    _write_lines(job, f"{place}/sensor.yaml", lines)


def _write_lines(job: Job, place: str, lines: Iterable[str]) -> None:
    write_page(inside(job.folder, place), "".join(f"{line}\n" for line in lines))


def _times_ns(sequence: ImageSequence) -> list[int]:
    """Times of the frames [ns]. Raises InputError for two that are the same."""
    times_ns = [round(time_s * NS_PER_S) for time_s in sequence.times_s.tolist()]
    if any(later <= earlier for earlier, later in pairwise(times_ns)):
        raise InputError(
            f"frames of {sequence.scene} are less than 1 ns apart, which EuRoC cannot say; give the keys of its path "
            "other time_s."
        )
    return times_ns


def _text_of(time_ns: int) -> str:
    """With so many digits that the order of names is that of times."""
    return f"{time_ns:0{DIGITS}d}"


def _states(sequence: ImageSequence, times_ns: Sequence[int]) -> Iterable[str]:
    """Time, position, quaternion w x y z, velocity and zeros for the biases of each frame."""
    positions_m = np.array([pose[:3, 3] for pose in sequence.poses])
    velocity_m_per_s = np.zeros_like(positions_m)
    if len(positions_m) > 1:
        velocity_m_per_s = np.gradient(positions_m, sequence.times_s, axis=0)
    for time_ns, pose, velocity in zip(times_ns, sequence.poses, velocity_m_per_s, strict=True):
        turn = scipy.spatial.transform.Rotation.from_matrix(pose[:3, :3])
        x, y, z, w = turn.as_quat(canonical=True)
        state = (*pose[:3, 3], w, x, y, z, *velocity, *NO_BIAS)
        yield ",".join([_text_of(time_ns), *(repr(float(number)) for number in state)])


def _rate_hz(times_s: Float64Array) -> float:
    """Frames per second; 0 for one frame."""
    if len(times_s) == 1:
        return 0.0
    return (len(times_s) - 1) / float(times_s[-1] - times_s[0])


def _matrix(value: Float64Array) -> list[str]:
    """T_BS, from the sensor to the body."""
    return ["T_BS:", "  cols: 4", "  rows: 4", f"  data: [{_list(value.ravel())}]"]


def _list(values: Iterable[float]) -> str:
    return ", ".join(map(yaml_number, values))
