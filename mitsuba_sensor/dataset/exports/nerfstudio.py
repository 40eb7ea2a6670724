"""Contents of nerfstudio's transforms.json: intrinsics, and poses camera to world in OpenGL's axes (right, up, back).

The camera_model is OPENCV, lengths are metres. The middle of the upper left pixel is (0.5, 0.5) there
(get_image_coords has an offset of 0.5, and before OpenCV undistorts an image 0.5 is subtracted), hence cx and cy are
larger by 0.5 than OpenCV's. nerfstudio turns, centres and scales the poses unless its parser is told not to:
``nerfstudio-data --orientation-method none --center-method none --auto-scale-poses False``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...optics.calibration import HALF_PIXEL, Calibration
from .poses import TO_OPENGL, PosedImage, camera_to_world


def transforms(images: Sequence[PosedImage]) -> dict[str, Any]:
    """The contents of transforms.json. What all pictures share is said once; else each frame has its own intrinsics."""
    shared = {one.calibration for one in images}
    frames: list[dict[str, Any]] = []
    for one in images:
        own = {} if len(shared) == 1 else _intrinsics(one.calibration)
        frames.append({"file_path": one.name, **own, "transform_matrix": camera_to_world(one.pose, TO_OPENGL).tolist()})
    common = _intrinsics(shared.pop()) if len(shared) == 1 else {}
    return {"camera_model": "OPENCV", **common, "frames": frames}


def _intrinsics(calibration: Calibration) -> dict[str, float]:
    (fx, fy), (cx, cy) = calibration.focal, calibration.principal
    coefficients = dict(zip(("k1", "k2", "p1", "p2", "k3"), calibration.distortion, strict=True))
    size = {"w": calibration.columns, "h": calibration.rows}
    return {**size, "fl_x": fx, "fl_y": fy, "cx": cx + HALF_PIXEL, "cy": cy + HALF_PIXEL, **coefficients}
