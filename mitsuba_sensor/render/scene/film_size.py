"""Size of the film of a scene: the scene's own, or the camera's, scaled to a width."""

from __future__ import annotations

from ...core import InputError
from ...sensor.camera import Camera
from .scene_file import SceneFile
from .scene_settings import FILM, SIZE

MOST_PIXELS = 2**28  # of one picture; its bands alone take 64 GB
WIDTH, HEIGHT = 768, 576  # default of Mitsuba's films


def film_size(scene: SceneFile, camera: Camera | None, width: int | None) -> dict[str, int]:
    """Width, height and crop of the first sensor's film, by the names of Mitsuba's parameters; scaled to ``width``."""
    film, size = scene.film(), {}
    if film is not None:
        if film.props.plugin_name() == FILM and camera is not None:
            size = {"width": camera.sensor.columns, "height": camera.sensor.rows}
        size |= {k: v for k, v in film.props.items() if k in SIZE}
    if width is None:
        return _fitting(scene, size)
    full = size.get("width", WIDTH)
    if not 1 <= width <= full:
        raise InputError(f"width is {width!r}; it must be a whole number from 1 to the film's own {full}.")
    whole = {"width": full, "height": size.get("height", HEIGHT), **size}
    return _fitting(scene, {k: max(round(v * width / full), 0 if "offset" in k else 1) for k, v in whole.items()})


def _fitting(scene: SceneFile, size: dict[str, int]) -> dict[str, int]:
    """The same, if it is no more than can be rendered."""
    columns, rows = (size.get(f"crop_{x}", size.get(x, usual)) for x, usual in (("width", WIDTH), ("height", HEIGHT)))
    if isinstance(columns, int) and isinstance(rows, int) and columns * rows > MOST_PIXELS:
        many = f"{columns} × {rows} pixels; it may have {MOST_PIXELS} at most, a crop of it or --width fewer"
        raise InputError(f"scene {scene.name!r} has a film of {many}.")
    return size
