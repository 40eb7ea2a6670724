"""Geometric calibrations → size and lens distortion of a camera.

OpenCV (YAML, XML), ROS camera_info, EuRoC's sensor.yaml and Kalibr's camchain put the centre of the upper left pixel
at (0, 0); COLMAP's cameras.txt and nerfstudio's transforms.json put it at (0.5, 0.5). Focal length and principal point
belong to the sensor of a scene, so the description of the camera gives the values for a scene file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import Float64Array, InputError
from ...core.small_files import DEPTH_MAX
from ...files.texts import xml_tree
from ...optics.calibration import FIT_POINTS, HALF_PIXEL, Calibration, radial_fit
from .draft import Draft

OPENCV_ROOT, OPENCV_TAG = "<opencv_storage", "!!opencv-matrix"
YAML_CHARACTERS_MAX = 500_000
"""Read in five seconds; the corners of a hundred pictures have less than half."""
TABLE_POINTS = 65
"""Image heights of a fisheye lens."""
FIELD_ANGLE_MAX_RAD = math.radians(85)
"""Field angle of a fisheye's corner, whose tangent is the ideal image height."""
FOCAL_RATIO_TOLERANCE = 1e-3
"""Relative difference of fx and fy that needs no note."""
LARGEST = 1e6
"""Limit of sizes [pixels] and of coefficients."""
FISHEYE = ("k1", "k2", "k3", "k4")
THIN_PRISM = ("s1", "s2", "s3", "s4", "tau_x", "tau_y")
BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", *THIN_PRISM)
OTHER_LENSES = (
    *("lens.prescription", "lens.focal_length_mm", "lens.focus_m", "lens.distortion"),
    *("lens.distortion_percent", "lens.distortion_heights_mm"),
)
MODELS = {
    "plumb_bob": BROWN,
    "rational_polynomial": BROWN,
    "equidistant": FISHEYE,
    "fisheye": FISHEYE,
}
"""Distortion model of ROS → its coefficients."""
KALIBR_MODELS = dict.fromkeys(("radial-tangential", "radtan", "none"), "plumb_bob")
"""Distortion model of EuRoC and Kalibr → distortion model of ROS."""
COLMAP_MODELS: dict[str, tuple[int, tuple[str, ...]]] = {
    "SIMPLE_PINHOLE": (1, ()),
    "PINHOLE": (2, ()),
    "SIMPLE_RADIAL": (1, BROWN[:1]),
    "RADIAL": (1, BROWN[:2]),
    "OPENCV": (2, BROWN[:4]),
    "FULL_OPENCV": (2, BROWN[:8]),
    "OPENCV_FISHEYE": (2, FISHEYE),
}
"""Model of COLMAP → number of focal lengths, and coefficients."""
TRANSFORMS_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV_FISHEYE")


class ForeignLens(NamedTuple):
    """A calibrated lens.

    numerator, denominator : radial coefficients in powers of r², or in powers of θ² for a fisheye lens.
    tangential : p1, p2.
    """

    format: str
    pinhole: Calibration
    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    tangential: tuple[float, float]
    fisheye: bool
    notes: list[str]


def is_storage(text: str) -> bool:
    """Return True if an XML file is one of OpenCV's."""
    return OPENCV_ROOT in text[:1000]


def is_transforms(data: object) -> bool:
    """Return True if a JSON file is a transforms.json with intrinsics of all frames or of the first."""
    if not isinstance(data, dict):
        return False
    frames = data.get("frames")
    tables = [data, *(frames[:1] if isinstance(frames, list) else [])]
    return any(
        isinstance(one, dict) and ("fl_x" in one or "camera_angle_x" in one) for one in tables
    )


def read_transforms(data: dict[str, Any], file: str, like: Camera) -> Draft:
    """Return the draft of a camera of nerfstudio's transforms.json. Raises InputError unless it is a pinhole."""
    draft = Draft(file, like)
    frames = draft.tables("frames", data.get("frames") or [])
    entries = {**frames[0], **data} if frames else data
    model = draft.choice(
        "camera_model", entries.get("camera_model", "OPENCV"), TRANSFORMS_MODELS
    )
    width, height = (draft.count(name, entries.get(name), LARGEST) for name in "wh")

    def number(name: str, default: float, low: float = -LARGEST) -> float:
        return draft.number(name, entries.get(name, default), low, LARGEST)

    if "fl_x" in entries:
        focal_x = number("fl_x", 0.0, 0.0)
    else:
        angle = draft.number("camera_angle_x", entries.get("camera_angle_x"), 1e-6, 3.1)
        focal_x = width / 2 / math.tan(angle / 2)
    focal = focal_x, number("fl_y", focal_x, 0.0)
    centre = number("cx", width / 2) - HALF_PIXEL, number("cy", height / 2) - HALF_PIXEL
    others = sum(
        any(
            one.get(name, entries.get(name)) != entries.get(name)
            for name in ("fl_x", "fl_y", "w")
        )
        for one in frames
    )
    note = f"{others} of {len(frames)} frames have other intrinsics, which are ignored"
    lens = ForeignLens(
        format="transforms.json",
        pinhole=Calibration(width, height, focal, centre),
        numerator=tuple(number(name, 0.0) for name in FISHEYE),
        denominator=(),
        tangential=(number("p1", 0.0), number("p2", 0.0)),
        fisheye=model == "OPENCV_FISHEYE",
        notes=[note] if others else [],
    )
    return _fill_draft(draft, lens)


def read_colmap(text: str, file: str, like: Camera) -> Draft:
    """Return the draft of the first camera of COLMAP's cameras.txt. Raises InputError for an unsupported model."""
    draft = Draft(file, like)
    lines = [line.split() for line in text.splitlines() if line.strip() and line[0] != "#"]
    if not lines or len(lines[0]) < 5:
        raise InputError(
            f"{file} has no line CAMERA_ID MODEL WIDTH HEIGHT PARAMS; give the cameras.txt of COLMAP."
        )
    _, model, width, height, *parameters = lines[0]
    focal_lengths, names = COLMAP_MODELS[draft.choice("MODEL", model, list(COLMAP_MODELS))]
    if len(parameters) != focal_lengths + 2 + len(names):
        raise InputError(
            f"{file} has {len(parameters)} PARAMS; {model} needs {focal_lengths + 2 + len(names)}."
        )
    focal, centre = parameters[:focal_lengths], parameters[focal_lengths:][:2]
    cx, cy = (
        draft.number(name, value, -LARGEST, LARGEST) - HALF_PIXEL
        for name, value in zip(("cx", "cy"), centre, strict=True)
    )
    entries = {
        "resolution": [width, height],
        "intrinsics": [focal[0], focal[-1], cx, cy],
        "distortion_model": "equidistant" if names is FISHEYE else "radtan",
        "distortion_coeffs": parameters[focal_lengths + 2 :],
    }
    return _draft_of(_as_camera_info(entries, file), draft, "COLMAP calibration")


def _as_camera_info(entries: dict[str, Any], file: str) -> dict[str, Any]:
    """Rename the entries of EuRoC's sensor.yaml, or of the first camera of Kalibr's camchain, as ROS names them; return
    other entries as given. Raises InputError for a camera that is not a pinhole."""
    first = entries.get("cam0", entries)
    if not isinstance(first, dict):
        return entries
    size, intrinsics = first.get("resolution"), first.get("intrinsics")
    if not isinstance(size, list) or not isinstance(intrinsics, list):
        return entries
    camera_model = first.get("camera_model", "pinhole")
    if len(size) != 2 or len(intrinsics) != 4 or camera_model != "pinhole":
        raise InputError(
            f"{file} has camera_model {camera_model!r} with {len(intrinsics)} intrinsics; give a pinhole with fx, fy, "
            "cx and cy, and its resolution."
        )
    fx, fy, cx, cy = intrinsics
    model = first.get("distortion_model", "radtan")
    coefficients = first.get("distortion_coefficients", first.get("distortion_coeffs", []))
    return {
        "image_width": size[0],
        "image_height": size[1],
        "camera_matrix": {"data": [fx, 0, cx, 0, fy, cy, 0, 0, 1]},
        "distortion_model": KALIBR_MODELS.get(model, model),
        "distortion_coefficients": {"data": coefficients},
    }


def read_storage(text: str, file: str, like: Camera) -> Draft:
    """Return the draft of a camera of OpenCV's, ROS's, EuRoC's or Kalibr's file. Raises InputError for other files."""
    if is_storage(text):
        root = xml_tree(text, file, "Give the file that cv2.FileStorage writes")
        entries: dict[str, Any] = {
            one.tag: {child.tag: child.text for child in one} if len(one) else one.text
            for one in root
        }
    else:
        entries = _as_camera_info(yaml_tables(text, file), file)
    kind = "ROS calibration" if "distortion_model" in entries else "OpenCV calibration"
    return _draft_of(entries, Draft(file, like), kind)


def _draft_of(entries: dict[str, Any], draft: Draft, kind: str) -> Draft:
    """Return the draft of a camera from entries with the names of ROS and OpenCV."""
    entries = {str(name).lower(): value for name, value in entries.items()}
    matrix = _numbers(draft, entries, "camera_matrix")
    if len(matrix) != 9:
        raise InputError(
            f"{draft.file}: camera_matrix has {len(matrix)} numbers; it must have 9, row by row."
        )
    width, height = (
        draft.count(name, entries.get(name), LARGEST)
        for name in ("image_width", "image_height")
    )
    focal = (
        draft.number("fx", matrix[0], 0.0, LARGEST),
        draft.number("fy", matrix[4], 0.0, LARGEST),
    )
    flag = str(entries.get("fisheye_model")).strip().lower()  # OpenCV writes 0 or 1
    default = "fisheye" if flag in ("1", "true") else "plumb_bob"
    model = draft.choice(
        "distortion_model", entries.get("distortion_model") or default, list(MODELS)
    )
    names, values = MODELS[model], list[float]()
    if "distortion_coefficients" in entries:
        values = _numbers(draft, entries, "distortion_coefficients")
    if len(values) > len(names):
        raise InputError(
            f"{draft.file}: distortion_coefficients has {len(values)} numbers; {model} has {len(names)} at most."
        )
    k = dict.fromkeys((*FISHEYE, *BROWN), 0.0) | dict(zip(names, values, strict=False))
    fisheye, notes = names is FISHEYE, list[str]()
    if ignored := [name for name in THIN_PRISM if k[name]]:
        notes.append(f"{', '.join(ignored)} (thin prism, tilt) are ignored")
    if not values:
        notes.append("the file has no distortion_coefficients, so the lens has no distortion")
    lens = ForeignLens(
        format=kind,
        pinhole=Calibration(width, height, focal, (matrix[2], matrix[5])),
        numerator=tuple(k[name] for name in (FISHEYE if fisheye else FISHEYE[:3])),
        denominator=() if fisheye else (k["k4"], k["k5"], k["k6"]),
        tangential=(k["p1"], k["p2"]),
        fisheye=fisheye,
        notes=notes,
    )
    return _fill_draft(draft, lens)


def _fill_draft(draft: Draft, lens: ForeignLens) -> Draft:
    """Return the draft with size, distortion, and a description of what a scene file must contain."""
    pinhole, notes = lens.pinhole, list(lens.notes)
    (fx, fy), pitch_um = pinhole.focal, draft.like.pixel.pitch_x_um
    focal_mm = fx * pitch_um * 1e-3
    draft.says("sensor.columns", pinhole.columns, "width of its pictures")
    draft.says("sensor.rows", pinhole.rows, "height of its pictures")
    draft.changes |= dict.fromkeys(OTHER_LENSES) | {"lens.dispersion": False}
    if abs(fx / fy - 1) > FOCAL_RATIO_TOLERANCE:
        notes.append(
            f"fx / fy is {fx / fy:.5g}, but a scene has square pixels, so fx replaces fy"
        )
    notes += _set_fisheye(draft, lens, focal_mm) if lens.fisheye else _set_brown(draft, lens)
    view = ", ".join(f"{name} {value:.7g}" for name, value in pinhole.view.items())
    draft.description = "; ".join(
        [
            f"Camera of the {lens.format} {draft.file}",
            f"a perspective sensor of a scene has the same view with {view}",
            f"the focal length is {focal_mm:.5g} mm at {pitch_um:g} µm per pixel",
            *notes,
        ]
    )
    return draft


def _set_brown(draft: Draft, lens: ForeignLens) -> list[str]:
    """Set the five coefficients; more radial coefficients are replaced by the nearest k1, k2 and k3."""
    radial, how, notes = lens.numerator[:3], "k1, k2, p1, p2, k3", list[str]()
    if any(lens.denominator) or any(lens.numerator[3:]):
        radial, misfit = _fit_three_coefficients(draft, lens)
        misfit_px = f"{misfit * max(lens.pinhole.focal):.2g} px"
        how = f"its radial coefficients, by k1, k2 and k3 to {misfit_px}"
        notes = [f"k1, k2, k3 are fitted to more coefficients, to {misfit_px}"]
    if any((*radial, *lens.tangential)):
        k1, k2, k3 = radial
        draft.says("lens.distortion", [k1, k2, *lens.tangential, k3], how)
    return notes


def _fit_three_coefficients(
    draft: Draft, lens: ForeignLens
) -> tuple[tuple[float, float, float], float]:
    """Return the k1, k2 and k3 nearest to a rational polynomial, and the largest difference [focal lengths].

    Raises InputError if the polynomial folds the image before its corner.
    """
    corner = lens.pinhole.corner
    ideal = np.linspace(0.0, 2 * corner, FIT_POINTS)
    with np.errstate(all="ignore"):
        ratio = (1 + _series(lens.numerator, ideal)) / (1 + _series(lens.denominator, ideal))
        real = ideal * ratio
    folds = np.flatnonzero(~(np.diff(real) > 0))
    last = int(folds[0]) + 1 if len(folds) else FIT_POINTS
    if real[last - 1] < corner:
        raise InputError(
            f"{draft.file}: the radial distortion folds the image before its corner; check the coefficients, or "
            "calibrate with fewer of them."
        )
    return radial_fit(ideal[:last], real[:last], corner)


def _set_fisheye(draft: Draft, lens: ForeignLens, image_distance_mm: float) -> list[str]:
    """Set a table of ideal and real image heights beyond the corner: r = θ·(1 + k1·θ² + …) and tan θ."""
    angle = np.linspace(0.0, FIELD_ANGLE_MAX_RAD, 50 * TABLE_POINTS)
    real = angle * (1 + _series(lens.numerator, angle))
    beyond = np.flatnonzero(real > lens.pinhole.corner)
    if not len(beyond) or (np.diff(real[: beyond[0] + 1]) <= 0).any():
        raise InputError(
            f"{draft.file}: the corner of this fisheye lens sees more than {math.degrees(FIELD_ANGLE_MAX_RAD):.0f}° "
            "from the axis, but a scene is projected on a plane; crop the picture, or calibrate a smaller one."
        )
    angle = np.linspace(0.0, min(1.02 * angle[beyond[0]], FIELD_ANGLE_MAX_RAD), TABLE_POINTS)
    ideal, real = np.tan(angle), angle * (1 + _series(lens.numerator, angle))
    growth = np.divide(real, ideal, out=np.ones_like(real), where=ideal > 0) - 1
    how = "k1 … k4 of its fisheye model"
    draft.says("lens.distortion_percent", (100 * growth).tolist(), how)
    heights_mm = (ideal * image_distance_mm).tolist()
    draft.says("lens.distortion_heights_mm", heights_mm, f"{how}, at the pixel pitch")
    return ["the fisheye lens is a table of image heights"]


def _series(coefficients: tuple[float, ...], radius: Float64Array) -> Float64Array:
    """Return k1·r² + k2·r⁴ + …"""
    terms = (k * radius ** (2 * n) for n, k in enumerate(coefficients, start=1))
    return sum(terms, np.zeros_like(radius))


def yaml_tables(text: str, file: str) -> dict[str, Any]:
    """Return the tables of a YAML file with all values as texts, as in XML, so a file cannot create an object.

    OpenCV's directive and tag, which YAML 1.1 does not have, are removed. Aliases, which may expand to any size, and
    deep nesting raise InputError.
    """
    import yaml

    class PlainLoader(yaml.BaseLoader):  # type: ignore[misc]
        """Lists and tables of texts."""

        depth = 0

        def compose_node(self, parent: object, index: object) -> object:
            if self.check_event(yaml.AliasEvent):
                name = self.peek_event().anchor
                raise yaml.YAMLError(f"replace the alias *{name[:40]} by its value")
            self.depth += 1
            if self.depth > DEPTH_MAX:
                raise yaml.YAMLError(f"it is nested more than {DEPTH_MAX} deep")
            node = super().compose_node(parent, index)
            self.depth -= 1
            return node

    if len(text) > YAML_CHARACTERS_MAX:
        raise InputError(
            f"{file} has {len(text)} characters; a calibration has {YAML_CHARACTERS_MAX} at most."
        )
    lines = [line for line in text.splitlines() if not line.startswith("%")]
    plain = "\n".join(lines).replace(OPENCV_TAG, "")
    try:
        # The loader of libyaml would end the process where brackets are nested deeply.
        tables = yaml.load(plain, Loader=PlainLoader)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        why = " ".join(str(error).split()) or "it is nested too deeply"
        raise InputError(
            f"{file} is not valid YAML: {why}. Give a calibration of OpenCV or ROS."
        ) from None
    if not isinstance(tables, dict):
        raise InputError(
            f"{file} has no table of names and values; give a calibration of OpenCV or ROS."
        )
    return tables


def _numbers(draft: Draft, entries: Mapping[str, Any], name: str) -> list[float]:
    """Return the data of a matrix, which is one text in XML."""
    node = entries.get(name)
    values = node.get("data") if isinstance(node, dict) else None
    if isinstance(values, str):
        values = values.split()
    if not isinstance(values, list):
        names = ", ".join(entries)[:200]
        raise InputError(
            f"{draft.file} has no {name} with rows, cols and data, which a calibration needs; it has {names}."
        )
    return draft.numbers(name, values, -LARGEST, LARGEST)
