"""Ground truth: what each pixel looks at, and where that goes while the shutter is open.

A pass of its own, beside the render: one ray through the centre of each pixel and the centre of the pupil, nothing
averaged at edges, pixel-aligned with the frame (same film, crop, lens). Under a rolling shutter every row is seen as
the scene stands when that row opens.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.checks import check_types
from ..core.errors import InputError
from ..core.exposure import Exposure
from ..optics.shutter import Shutter, shutter_of
from .bands import LONGEST_NM, SHORTEST_NM, choose_bands
from .motion import Motion, read_motion
from .moving_scene import Poses, found_at, seen
from .passes import row_strips
from .rays import Floats, pixel_rays
from .scene import Scene, load_scene
from .scene_settings import read_setup, unit_m
from .variants import choose_variant, use

if TYPE_CHECKING:
    from ..sensor.camera import Camera

Progress = Callable[[int, int], None]
RAYS_PER_PIXEL = 4  # that a strip is cut for: tracing a ray takes the memory of about so many samples


@dataclass(frozen=True, eq=False)
class Aovs:
    """What the pixels of a frame look at. All arrays are float32, lengths are metres.

    "Nothing" is where the ray meets no surface, or the lens lets no light through.

    depth_m : (H, W) distance from the camera along its optical axis; +inf where there is nothing.
    position_m : (H, W, 3) in world space; NaN where there is nothing.
    normal : (H, W, 3) unit shading normal in world space, as the surface has it (outwards); 0 where there is nothing.
    albedo : (H, W, 3) diffuse reflectance at equal energy, mean over 600–700, 500–600 and 400–500 nm; 0 for
        metals, clear glass and nothing.
    shape_index : (H, W) whole number, place of the shape in the scene file, from 0; −1 where there is nothing.
    flow_px : (H, W, 2) by how many pixels, to the right and down, the point moves while its row is open, from the
        motion of the camera and of its own shape; the background is infinitely far. NaN where it ends behind the
        camera. Beyond the film a measured distortion goes on as it is at the edge.
    shapes : name of each shape, its id or its kind and place.
    """

    depth_m: NDArray[np.float32]
    position_m: NDArray[np.float32]
    normal: NDArray[np.float32]
    albedo: NDArray[np.float32]
    shape_index: NDArray[np.float32]
    flow_px: NDArray[np.float32]
    shapes: tuple[str, ...]
    scene_sha256: str


def render_aovs(
    scene: str | os.PathLike[str],
    camera: Camera,
    *,
    parameters: Mapping[str, Any] | None = None,
    variant: str | None = None,
    motion: str | os.PathLike[str] | Mapping[str, Any] | Motion | None = None,
    exposure: Exposure | None = None,
    scene_unit: str | float | None = None,
    width: int | None = None,
    progress: Progress | None = None,
) -> Aovs:
    """The ground truth of a scene file, for the frame that :func:`render.irradiance.render` makes of it.

    motion : what moves, see render/motion.py; exposure : for how long the shutter is open, which a motion needs.
    scene_unit, width : as for :func:`render.irradiance.render`.
    progress : called with (rows done, rows in all), also once before the first.
    In scalar variants rays are traced one by one: 0.3 ms per pixel with a motion, and 0.01 ms in LLVM.
    Raises InputError.
    """
    check_types(camera, Exposure(0.0) if exposure is None else exposure)
    if motion is not None and exposure is None:
        raise InputError("a motion is given and no exposure; pass exposure=Exposure(time_s) for the optical flow.")
    if not isinstance(scene, str | os.PathLike):
        raise InputError(f"scene is {scene!r}; pass the path of a scene file, e.g. 'scenes/cornell_box.xml'.")
    moves = Motion() if motion is None else read_motion(motion)
    use(choose_variant(variant))
    bands = choose_bands(camera, None, LONGEST_NM - SHORTEST_NM, "auto")  # one is enough: only rays are traced
    loaded = load_scene(scene, bands, parameters or {}, camera, scene_unit, width=width)
    metres = unit_m(scene_unit if scene_unit is not None else read_setup(scene, parameters or {}).unit_m or 1.0)
    shutter = shutter_of(camera, exposure or Exposure(0.0))
    with Poses(loaded, moves, metres) as poses:
        arrays = _trace(loaded, poses, shutter, progress or (lambda done, total: None))
    arrays["depth_m"] *= np.float32(metres)
    arrays["position_m"] *= np.float32(metres)
    return Aovs(**arrays, shapes=shape_names(loaded), scene_sha256=loaded.sha256)


def guides_of(scene: Scene) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Albedo and normals of a loaded scene at rest, (H, W, 3) each, as a denoiser wants them."""
    with Poses(scene, Motion()) as poses:
        arrays = _trace(scene, poses, Shutter(open_s=0.0), lambda done, total: None)
    return arrays["albedo"], arrays["normal"]


def shape_names(scene: Scene) -> tuple[str, ...]:
    """Ids of the shapes in the order of the scene file; ``sphere 3`` for the fourth where it is one without an id."""
    shapes = scene.native.shapes()
    return tuple(shape.id() or f"{shape.class_name().lower()} {k}" for k, shape in enumerate(shapes))


def _trace(scene: Scene, poses: Poses, shutter: Shutter, progress: Progress) -> dict[str, NDArray[np.float32]]:
    """All arrays, strip by strip; row by row where the rows see the scene at different times."""
    (columns, rows), (left, top) = scene.view.crop_size, scene.view.crop_offset
    still = poses.motion == Motion()
    row_by_row = shutter.row_time_s > 0 and not still
    strips = [(r, r + 1) for r in range(rows)] if row_by_row else row_strips((columns, rows), 1, RAYS_PER_PIXEL)
    parts = []
    progress(0, rows)
    for first, last in strips:
        start_s = float(shutter.start_s(first + top)) if row_by_row else 0.0
        poses.put(start_s)
        places = np.meshgrid(left + np.arange(columns) + 0.5, top + np.arange(first, last) + 0.5)
        flat = _strip(
            scene, poses, np.stack(places, axis=-1).reshape(-1, 2), (start_s, start_s + shutter.open_s), still
        )
        shape = (last - first, columns)
        parts.append({name: value.astype(np.float32).reshape(*shape, *value.shape[1:]) for name, value in flat.items()})
        progress(last, rows)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _strip(
    scene: Scene, poses: Poses, pixels: Floats, times_s: tuple[float, float], still: bool
) -> dict[str, NDArray[Any]]:
    """The arrays of Aovs at these pixels, flat."""
    camera = poses.camera_at(times_s[0])
    origins, directions = pixel_rays(scene, pixels)
    points, shapes, hits = seen(scene, camera, origins, directions, albedo=True)
    axis = camera[:3, 2] / np.linalg.norm(camera[:3, 2])
    flow = np.zeros_like(pixels) if still else found_at(scene, poses, points, shapes, pixels, times_s) - pixels
    return {
        "depth_m": np.where(hits.found, (hits.position - camera[:3, 3]) @ axis, np.inf),
        "position_m": hits.position,
        "normal": hits.normal,
        "albedo": hits.albedo,
        "shape_index": shapes,
        "flow_px": flow,
    }
