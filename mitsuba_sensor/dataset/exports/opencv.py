"""OpenCV FileStorage, YAML and XML: camera_matrix, distortion_coefficients, and pose of each picture as its sample has.

The names are those of OpenCV's calibration sample. The middle of the upper left pixel is (0, 0), as in our intrinsics.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias
from xml.sax.saxutils import escape

import numpy as np
import scipy

from ...core import Float64Array
from ...files.texts import write_page
from ...files.whole_folder import inside
from ...optics.calibration import Calibration
from .job import Job
from .poses import PosedImage, world_to_camera, yaml_number

HOW = """import cv2

storage = cv2.FileStorage("{world}/camera_1.yml", cv2.FILE_STORAGE_READ)
matrix, poses = (storage.getNode(name).mat() for name in ("camera_matrix", "extrinsic_parameters"))
keys = [storage.getNode("images").at(number).string() for number in range(len(poses))]  # of the samples
"""
Entry: TypeAlias = int | Float64Array | list[str]
MATRIX = "!!opencv-matrix"


def opencv_entries(
    calibration: Calibration, images: Sequence[PosedImage] = ()
) -> dict[str, Entry]:
    """What the files hold.  extrinsic_parameters : (N, 6), rotation vector [rad] and translation [m] of each picture,
    world to camera, in the order of ``images``."""
    found: dict[str, Entry] = {
        "image_width": calibration.columns,
        "image_height": calibration.rows,
        "camera_matrix": calibration.matrix,
        "distortion_coefficients": np.array(calibration.distortion)[:, None],
    }
    if images:
        found["extrinsic_parameters"] = np.array([_extrinsic(one) for one in images])
        found["images"] = [one.name for one in images]
    return found


def _extrinsic(image: PosedImage) -> Float64Array:
    turn, move = world_to_camera(image.pose)
    return np.concatenate(
        [scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec(), move]
    )


def opencv_yaml(calibration: Calibration, images: Sequence[PosedImage] = ()) -> str:
    """The text of a .yml that ``cv2.FileStorage`` reads."""
    lines = ["%YAML:1.0", "---"]
    for name, value in opencv_entries(calibration, images).items():
        if isinstance(value, np.ndarray):
            rows, columns = value.shape
            data = ", ".join(map(yaml_number, value.ravel()))
            lines += [
                f"{name}: {MATRIX}",
                f"   rows: {rows}",
                f"   cols: {columns}",
                "   dt: d",
                f"   data: [ {data} ]",
            ]
        elif isinstance(value, list):
            lines += [f"{name}:", *(f"   - {_quoted(text)}" for text in value)]
        else:
            lines.append(f"{name}: {value}")
    return "\n".join(lines) + "\n"


def opencv_xml(calibration: Calibration, images: Sequence[PosedImage] = ()) -> str:
    """The text of an .xml that ``cv2.FileStorage`` reads."""
    lines = ['<?xml version="1.0"?>', "<opencv_storage>"]
    for name, value in opencv_entries(calibration, images).items():
        if isinstance(value, np.ndarray):
            rows, columns = value.shape
            data = " ".join(map(yaml_number, value.ravel()))
            inside = f"<rows>{rows}</rows><cols>{columns}</cols><dt>d</dt><data>{data}</data>"
            lines.append(f'<{name} type_id="opencv-matrix">{inside}</{name}>')
        else:
            text = escape(" ".join(map(_quoted, value))) if isinstance(value, list) else value
            lines.append(f"<{name}>{text}</{name}>")
    return "\n".join([*lines, "</opencv_storage>"]) + "\n"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def write_opencv(job: Job) -> str:
    """Write SCENE/camera_1.yml and .xml, …: a calibration, and the poses of all samples that have it. Returns how to
    read."""
    for world, samples in job.worlds().items():
        found: dict[Calibration, list[PosedImage]] = {}
        for _, image in samples:
            found.setdefault(image.calibration, []).append(image)
            job.step()
        for number, (calibration, images) in enumerate(found.items(), start=1):
            for end, text in (("yml", opencv_yaml), ("xml", opencv_xml)):
                write_page(
                    inside(job.folder, f"{world}/camera_{number}.{end}"),
                    text(calibration, images),
                )
    return HOW.format(world=world)
