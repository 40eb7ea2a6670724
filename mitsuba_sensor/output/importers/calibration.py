"""Geometric calibrations → size and lens distortion of a camera.

OpenCV (YAML, XML), ROS camera_info, EuRoC's sensor.yaml and Kalibr's camchain have the middle of the upper left pixel
at (0, 0), COLMAP's cameras.txt and nerfstudio's transforms.json at (0.5, 0.5). Focal length and principal point
belong to the sensor of a scene; the description of the camera says the values that it needs.
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
LONGEST_YAML = 500_000  # characters, read in five seconds; the corners of a hundred pictures have less than half
TABLE_POINTS = 65  # heights of a fisheye lens
WIDEST_RAD = math.radians(85)
"""Field angle of a fisheye's corner; an ideal image height is its tangent."""
SQUARE = 1e-3  # relative difference of fx and fy that is not worth a note
MOST = 1e6  # pixels, and any coefficient
FISHEYE = ("k1", "k2", "k3", "k4")
RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")
LEFT_OUT = ("s1", "s2", "s3", "s4", "tau_x", "tau_y")
BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", *LEFT_OUT)
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
TRANSFORMS_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "OPENCV_FISHEYE")


class ForeignLens(NamedTuple):
    """What a file says.  radial : coefficients in r² of the numerator, then of the denominator, or those of θ²."""

    format: str
    pinhole: Calibration
    coefficients: dict[str, float]
    radial: tuple[tuple[float, ...], tuple[float, ...]]
    fisheye: bool
    notes: tuple[str, ...] = ()


def is_storage(text: str) -> bool:
    """Whether an XML file is one of OpenCV's."""
    return OPENCV_ROOT in text[:1000]


def is_transforms(data: object) -> bool:
    """Whether a JSON file is a transforms.json with intrinsics, of all its frames or of the first."""
    if not isinstance(data, dict):
        return False
    tables, frames = [data], data.get("frames")
    if isinstance(frames, list):
        tables += [frame for frame in frames if isinstance(frame, dict)][:1]
    return any("fl_x" in table or "camera_angle_x" in table for table in tables)


def read_transforms(data: dict[str, Any], file: str, like: Camera) -> Draft:
    """The draft of a camera of nerfstudio's transforms.json. Raises InputError for a camera that is no pinhole."""
    draft = Draft(file, like)
    frames = draft.tables("frames", data.get("frames") or [])
    said = data
    if frames:
        said = {**frames[0], **data}
    model = draft.choice("camera_model", said.get("camera_model", "OPENCV"), TRANSFORMS_MODELS)
    width = draft.count("w", said.get("w"), MOST)
    height = draft.count("h", said.get("h"), MOST)
    if "fl_x" in said:
        focal_x = draft.number("fl_x", said["fl_x"], 0.0, MOST)
    else:
        angle = draft.number("camera_angle_x", said.get("camera_angle_x"), 1e-6, 3.1)
        focal_x = width / 2 / math.tan(angle / 2)
    focal_y = draft.number("fl_y", said.get("fl_y", focal_x), 0.0, MOST)
    cx = draft.number("cx", said.get("cx", width / 2), -MOST, MOST)
    cy = draft.number("cy", said.get("cy", height / 2), -MOST, MOST)
    centre = (cx - HALF_PIXEL, cy - HALF_PIXEL)
    coefficients: dict[str, float] = {}
    for name in (*FISHEYE, "p1", "p2"):
        coefficients[name] = draft.number(name, said.get(name, 0.0), -MOST, MOST)
    notes: tuple[str, ...] = ()
    differ = sum(_differs(frame, said) for frame in frames)
    if differ:
        notes = (
            f"{differ} of {len(frames)} frames have intrinsics of their own, which are left out",
        )
    lens = ForeignLens(
        format="transforms.json",
        pinhole=Calibration(width, height, (focal_x, focal_y), centre),
        coefficients=coefficients,
        radial=(tuple(coefficients[name] for name in FISHEYE), ()),
        fisheye=model == "OPENCV_FISHEYE",
        notes=notes,
    )
    return _fill_draft(draft, lens)


def _differs(frame: Mapping[str, object], said: Mapping[str, object]) -> bool:
    """Whether a frame has other intrinsics than those that are read."""
    return any(
        frame.get(name, said.get(name)) != said.get(name) for name in ("fl_x", "fl_y", "w")
    )


KALIBR_MODELS = {"radial-tangential": "plumb_bob", "radtan": "plumb_bob", "none": "plumb_bob"}
"""Distortion model of EuRoC and Kalibr → that of ROS."""
COLMAP_MODELS: dict[str, tuple[int, tuple[str, ...]]] = {
    "SIMPLE_PINHOLE": (1, ()),
    "PINHOLE": (2, ()),
    "SIMPLE_RADIAL": (1, ("k1",)),
    "RADIAL": (1, ("k1", "k2")),
    "OPENCV": (2, ("k1", "k2", "p1", "p2")),
    "FULL_OPENCV": (2, ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "OPENCV_FISHEYE": (2, FISHEYE),
}
"""Model of COLMAP → how many focal lengths it has, and its coefficients."""


def read_colmap(text: str, file: str, like: Camera) -> Draft:
    """The draft of the first camera of COLMAP's cameras.txt. Raises InputError for a model that no lens here has."""
    lines = [line.split() for line in text.splitlines() if line.strip() and line[0] != "#"]
    if not lines or len(lines[0]) < 5:
        raise InputError(
            f"{file} has no line CAMERA_ID MODEL WIDTH HEIGHT PARAMS; give the cameras.txt of COLMAP."
        )
    _, model, width, height, *parameters = lines[0]
    focal_lengths, names = COLMAP_MODELS[
        Draft(file, like).choice("MODEL", model, list(COLMAP_MODELS))
    ]
    if len(parameters) != focal_lengths + 2 + len(names):
        raise InputError(
            f"{file}: {model} has {focal_lengths + 2 + len(names)} numbers, and {len(parameters)} are given."
        )
    centre = [
        Draft(file, like).number(name, value, -MOST, MOST) - HALF_PIXEL
        for name, value in zip(("cx", "cy"), parameters[focal_lengths:], strict=False)
    ]
    focal = [*parameters[:focal_lengths], parameters[0]][:2]
    entries = {
        "resolution": [width, height],
        "intrinsics": [*focal, *centre],
        "distortion_model": "equidistant" if names is FISHEYE else "radtan",
        "distortion_coeffs": parameters[focal_lengths + 2 :],
    }
    return _draft_of(_as_camera_info(entries, file), file, like, "COLMAP calibration")


def _as_camera_info(entries: dict[str, Any], file: str) -> dict[str, Any]:
    """Entries of EuRoC's sensor.yaml, or of the first camera of Kalibr's camchain, by the names of ROS; others as they
    are. Raises InputError for a camera that is no pinhole."""
    first = entries.get("cam0", entries)
    size, intrinsics = (
        first.get(name) if isinstance(first, dict) else None
        for name in ("resolution", "intrinsics")
    )
    if not isinstance(size, list) or not isinstance(intrinsics, list):
        return entries
    if (
        len(size) != 2
        or len(intrinsics) != 4
        or first.get("camera_model", "pinhole") != "pinhole"
    ):
        raise InputError(
            f"{file}: camera_model is {first.get('camera_model')!r} with {len(intrinsics)} intrinsics; give a pinhole "
            "with fx, fy, cx and cy, and its resolution."
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
    """The draft of a camera of OpenCV's, ROS's, EuRoC's or Kalibr's file. Raises InputError for what is no
    calibration."""
    if is_storage(text):
        entries = _read_xml(text, file)
    else:
        entries = _as_camera_info(yaml_tables(text, file), file)
    kind = "ROS calibration" if "distortion_model" in entries else "OpenCV calibration"
    return _draft_of(entries, file, like, kind)


def _draft_of(entries: dict[str, Any], file: str, like: Camera, kind: str) -> Draft:
    draft = Draft(file, like)
    said = {str(name).lower(): value for name, value in entries.items()}
    matrix = _numbers(draft, said, "camera_matrix")
    if len(matrix) != 9:
        raise InputError(
            f"{file}: camera_matrix has {len(matrix)} numbers; it must have 9, row by row."
        )
    width = draft.count("image_width", said.get("image_width"), MOST)
    height = draft.count("image_height", said.get("image_height"), MOST)
    focal = draft.number("fx", matrix[0], 0.0, MOST), draft.number("fy", matrix[4], 0.0, MOST)
    usual = "plumb_bob"
    if _is_set(said.get("fisheye_model")):
        usual = "fisheye"
    model = draft.choice(
        "distortion_model", said.get("distortion_model") or usual, list(MODELS)
    )
    names, values = MODELS[model], list[float]()
    if "distortion_coefficients" in said:
        values = _numbers(draft, said, "distortion_coefficients")
    if len(values) > len(names):
        raise InputError(
            f"{file}: distortion_coefficients has {len(values)} numbers; {model} has {len(names)} at most."
        )
    coefficients = dict.fromkeys(names, 0.0) | dict(zip(names, values, strict=False))
    fisheye = names is FISHEYE
    radial = tuple(coefficients[name] for name in (FISHEYE if fisheye else RADIAL))
    notes = []
    left_out = [name for name in LEFT_OUT if coefficients.get(name)]
    if left_out:
        notes.append(f"{', '.join(left_out)} (thin prism, tilt) are left out")
    if not values:
        notes.append("it has no distortion_coefficients, and the lens no distortion")
    lens = ForeignLens(
        format=kind,
        pinhole=Calibration(width, height, focal, (matrix[2], matrix[5])),
        coefficients=coefficients,
        radial=(radial, ()) if fisheye else (radial[:3], radial[3:]),
        fisheye=fisheye,
        notes=tuple(notes),
    )
    return _fill_draft(draft, lens)


def _fill_draft(draft: Draft, lens: ForeignLens) -> Draft:
    """The camera with this size and distortion; a sentence about what no datasheet says."""
    pinhole, notes = lens.pinhole, list(lens.notes)
    (fx, fy), pitch_um = pinhole.focal, draft.like.pixel.pitch_x_um
    focal_mm = fx * pitch_um * 1e-3
    draft.says("sensor.columns", pinhole.columns, "width of its pictures")
    draft.says("sensor.rows", pinhole.rows, "height of its pictures")
    draft.changes |= dict.fromkeys(OTHER_LENSES) | {"lens.dispersion": False}
    if abs(fx / fy - 1) > SQUARE:
        notes.append(f"fx / fy is {fx / fy:.5g} and pixels are square in a scene; fx is taken")
    if lens.fisheye:
        notes += _set_fisheye(draft, lens, focal_mm)
    else:
        notes += _set_brown(draft, lens)
    where = ", ".join(f"{name} {value:.7g}" for name, value in pinhole.view.items())
    sentences = [
        f"Camera of the {lens.format} {draft.file}",
        f"a perspective sensor of a scene has its view with {where}",
        f"the focal length is {focal_mm:.5g} mm at {pitch_um:g} µm per pixel",
        *notes,
    ]
    draft.description = "; ".join(sentences)
    return draft


def _set_brown(draft: Draft, lens: ForeignLens) -> list[str]:
    """The five coefficients; a rational polynomial, or one with more terms, by those that are nearest to it."""
    numerator, denominator = lens.radial
    p1, p2 = lens.coefficients["p1"], lens.coefficients["p2"]
    radial, how, notes = (*numerator, 0.0, 0.0)[:3], "k1, k2, p1, p2, k3", []
    if any(denominator) or any(numerator[3:]):
        radial, misfit = _fit_three_coefficients(draft, lens)
        misfit_px = misfit * max(lens.pinhole.focal)
        how = f"its radial coefficients, by k1, k2 and k3 to {misfit_px:.2g} px"
        notes = [f"k1, k2, k3 are fitted to more coefficients, to {misfit_px:.2g} px"]
    if any((*radial, p1, p2)):
        k1, k2, k3 = radial
        draft.says("lens.distortion", [k1, k2, p1, p2, k3], how)
    return notes


def _fit_three_coefficients(
    draft: Draft, lens: ForeignLens
) -> tuple[tuple[float, float, float], float]:
    """k1, k2 and k3 nearest to a rational polynomial, and the largest difference [focal lengths].

    Raises InputError where the polynomial is no picture of a plane up to the corner.
    """
    (numerator, denominator), corner = lens.radial, lens.pinhole.corner
    ideal = np.linspace(0.0, 2 * corner, FIT_POINTS)
    with np.errstate(all="ignore"):
        real = ideal * (1 + _series(numerator, ideal)) / (1 + _series(denominator, ideal))
    folds = np.flatnonzero(~(np.diff(real) > 0))
    last = FIT_POINTS
    if len(folds):
        last = int(folds[0]) + 1
    if real[last - 1] < corner:
        raise InputError(
            f"{draft.file}: the radial distortion folds the image before its corner; check the coefficients, or "
            "calibrate with fewer of them."
        )
    return radial_fit(ideal[:last], real[:last], corner)


def _set_fisheye(draft: Draft, lens: ForeignLens, image_distance_mm: float) -> list[str]:
    """A table of ideal and real image heights: r = θ·(1 + k1·θ² + …) and tan θ, to beyond the corner."""
    coefficients, _ = lens.radial
    angle = np.linspace(0.0, WIDEST_RAD, 50 * TABLE_POINTS)
    real = angle * (1 + _series(coefficients, angle))
    beyond = np.flatnonzero(real > lens.pinhole.corner)
    if not len(beyond) or (np.diff(real[: beyond[0] + 1]) <= 0).any():
        raise InputError(
            f"{draft.file}: the corner of this fisheye lens sees more than {math.degrees(WIDEST_RAD):.0f}° from the "
            "axis; a scene is projected on a plane: crop the picture, or calibrate a smaller one."
        )
    widest = min(1.02 * angle[beyond[0]], WIDEST_RAD)
    angle = np.linspace(0.0, widest, TABLE_POINTS)
    ideal, real = np.tan(angle), angle * (1 + _series(coefficients, angle))
    growth = np.divide(real, ideal, out=np.ones_like(real), where=ideal > 0) - 1
    heights_mm = (ideal * image_distance_mm).tolist()
    how = "k1 … k4 of its fisheye model"
    draft.says("lens.distortion_percent", (100 * growth).tolist(), how)
    draft.says("lens.distortion_heights_mm", heights_mm, f"{how}, at the pixel pitch")
    return ["the fisheye lens is a table of image heights"]


def _series(coefficients: tuple[float, ...], radius: Float64Array) -> Float64Array:
    """k1·r² + k2·r⁴ + …"""
    total = np.zeros_like(radius)
    for n, k in enumerate(coefficients, start=1):
        total = total + k * radius ** (2 * n)
    return total


def _read_xml(text: str, file: str) -> dict[str, Any]:
    """Tables of an XML file: each element is a text, or a table of its children's texts."""
    root = xml_tree(text, file, "Give the file that cv2.FileStorage writes")
    entries: dict[str, object] = {}
    for element in root:
        entries[element.tag] = element.text
        if len(element):
            entries[element.tag] = {child.tag: child.text for child in element}
    return entries


def yaml_tables(text: str, file: str) -> dict[str, Any]:
    """Tables of a YAML file, whose values are texts, as those of XML are: no type that a file names is made.

    OpenCV's directive and tag, which YAML 1.1 does not have, are passed over. An alias, which stands for what may stand
    for more, is refused, and so is what is nested deeply.
    """
    import yaml

    class PlainLoader(yaml.BaseLoader):  # type: ignore[misc]
        """Lists and tables of texts."""

        depth = 0

        def compose_node(self, parent: object, index: object) -> object:
            if self.check_event(yaml.AliasEvent):
                name = self.peek_event().anchor
                raise yaml.YAMLError(
                    f"it has the alias *{name[:40]}, in whose place its value must stand"
                )
            self.depth += 1
            if self.depth > DEPTH_MAX:
                raise yaml.YAMLError(f"it is nested more than {DEPTH_MAX} deep")
            node = super().compose_node(parent, index)
            self.depth -= 1
            return node

    if len(text) > LONGEST_YAML:
        raise InputError(
            f"{file} has {len(text)} characters; a calibration has {LONGEST_YAML} at most."
        )
    lines = [line for line in text.splitlines() if not line.startswith("%")]
    plain = "\n".join(lines).replace(OPENCV_TAG, "")
    try:
        # The loader of libyaml would end the process where brackets are nested deeply.
        tables = yaml.load(plain, Loader=PlainLoader)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        why = " ".join(str(error).split()) or "it is nested too deeply"
        raise InputError(
            f"{file} is no YAML: {why}. Give a calibration of OpenCV or ROS."
        ) from None
    if not isinstance(tables, dict):
        raise InputError(
            f"{file} has no table of names and values; give a calibration of OpenCV or ROS."
        )
    return tables


def _numbers(draft: Draft, said: Mapping[str, Any], name: str) -> list[float]:
    """The data of a matrix, which is text in XML."""
    values, node = None, said.get(name)
    if isinstance(node, dict):
        values = node.get("data")
    if isinstance(values, str):
        values = values.split()
    if not isinstance(values, list):
        names = ", ".join(said)[:200]
        raise InputError(
            f"{draft.file} has no {name} with rows, cols and data, which a calibration needs; it has {names}."
        )
    return draft.numbers(name, values, -MOST, MOST)


def _is_set(value: object) -> bool:
    """Whether OpenCV's flag is set, 0 or 1 as a text."""
    return isinstance(value, str) and value.strip() in ("1", "True", "true")
