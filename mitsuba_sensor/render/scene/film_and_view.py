"""Size of the film of a scene, and the sensor of Mitsuba that has the view of a <sensor type="camera">."""

from __future__ import annotations

import math

from ...camera.camera import Camera
from ...core import InputError
from .scene_file import SceneFile
from .scene_settings import FILM, SIZE, SceneSettings

MOST_PIXELS = 2**28  # of one picture; its bands alone take 64 GB
WIDTH, HEIGHT = 768, 576  # default of Mitsuba's films


def film_size(scene: SceneFile, camera: Camera | None, width: int | None) -> dict[str, int]:
    """Width, height and crop of the first sensor's film, by the names of Mitsuba's parameters; scaled so that the crop
    window, or the film without one, has ``width`` columns."""
    film, size = scene.film(), {}
    if film is not None:
        if film.props.plugin_name() == FILM and camera is not None:
            size = {"width": camera.sensor.columns, "height": camera.sensor.rows}
        size |= {k: v for k, v in film.props.items() if k in SIZE}
    if width is None:
        return _fitting(scene, size)
    whole = {"width": WIDTH, "height": HEIGHT, **size}
    columns = whole.get("crop_width", whole["width"])
    if not 1 <= width <= columns:
        what, way_out = "crop window" if "crop_width" in whole else "film", ""
        if width > columns:
            larger = (round(whole[name] * width / columns) for name in ("width", "height"))
            way_out = f"; {_larger_film(scene, *larger)}"
        raise InputError(
            f"width is {width!r}; it must be a whole number from 1 to the {what}'s own {columns}{way_out}."
        )
    scaled = {
        name: max(round(pixels * width / columns), 0 if "offset" in name else 1)
        for name, pixels in whole.items()
    }
    for side, offset in (("width", "crop_offset_x"), ("height", "crop_offset_y")):
        end = scaled.get(offset, 0) + scaled.get(f"crop_{side}", 0)  # both were rounded
        scaled[side] = max(scaled[side], end)
    return _fitting(scene, scaled)


def film_area(
    scene: SceneFile, camera: Camera, width: int | None
) -> tuple[tuple[int, int], tuple[int, int]]:
    """(rows, columns) of what is rendered of the film, and (row, column) of its first pixel. Raises InputError."""
    size = film_size(scene, camera, width)
    columns = size.get("crop_width", size.get("width", WIDTH))
    rows = size.get("crop_height", size.get("height", HEIGHT))
    return (rows, columns), (size.get("crop_offset_y", 0), size.get("crop_offset_x", 0))


def _larger_film(scene: SceneFile, width: int, height: int) -> str:
    """How the film of the scene becomes as large as that: the end of a sentence."""
    if {"width", "height"} <= {*scene.parameters}:
        return (
            f"a larger film is -D width={width} -D height={height} "
            f"(parameters={{'width': {width}, 'height': {height}}})"
        )
    return f"give the film in the scene a width of {width} and a height of {height}"


def _fitting(scene: SceneFile, size: dict[str, int]) -> dict[str, int]:
    """The same, if it is no more than can be rendered."""
    columns, rows = (
        size.get(f"crop_{x}", size.get(x, usual))
        for x, usual in (("width", WIDTH), ("height", HEIGHT))
    )
    if isinstance(columns, int) and isinstance(rows, int) and columns * rows > MOST_PIXELS:
        many = f"{columns} × {rows} pixels; it may have {MOST_PIXELS} at most, a crop of it or --width fewer"
        raise InputError(f"scene {scene.name!r} has a film of {many}.")
    return size


def built_in_sensor(
    settings: SceneSettings, camera: Camera, columns: int
) -> tuple[str, dict[str, float | str]]:
    """The sensor of Mitsuba that replaces a <sensor type="camera">: its type and its parameters.

    A thin lens of focal length f focused at d has its image at s = f·d/(d − f). Without a focus distance s = f, and a
    pinhole images everything sharply. Field of view 2·atan(columns·pitch/(2·s)), aperture radius f/(2·N).
    columns : width of the film in pixels.  Raises InputError.
    """
    if settings.focal_length_mm is None:
        raise InputError(
            'a camera needs its focal length, e.g. <float name="focal_length_mm" value="25"/>.'
        )
    focal_m, focus_m, unit_m = (
        settings.focal_length_mm * 1e-3,
        settings.focus_distance_m,
        settings.unit_m or 1.0,
    )
    if focus_m is not None and focus_m <= focal_m:
        far = f"more than the focal length, {focal_m:g} m (the distance of objects in focus, e.g. 2)"
        raise InputError(f"focus_distance_m is {focus_m:g}; it must be {far}.")
    image_m = focal_m if focus_m is None else focal_m * focus_m / (focus_m - focal_m)
    half_width = columns * camera.pixel.pitch_x_um * 1e-6 / (2 * image_m)
    view: dict[str, float | str] = {
        "fov": 2 * math.degrees(math.atan(half_width)),
        "fov_axis": "x",
    }
    if focus_m is None:
        return "perspective", view
    radius_m = focal_m / (2 * camera.lens.f_number)
    return "thinlens", {
        **view,
        "aperture_radius": radius_m / unit_m,
        "focus_distance": focus_m / unit_m,
    }
