"""AOVs of a frame: depth, position, normal, albedo, shape index and optical flow of each pixel.

A pass separate from the render: one ray through the centre of each pixel and the centre of the pupil, without averaging
at edges, pixel-aligned with the frame (same film, crop, lens). With a rolling shutter every row shows the scene at the
time when that row opens.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from ..core import Exposure, Float64Array, InputError, check_types
from ..core.options import complete, documents
from ..optics.shutter import Shutter, shutter_of
from ..sensor.camera import Camera
from .animated_transforms import AnimatedTransforms, first_hits, reproject
from .bands import LONGEST_NM, SHORTEST_NM, choose_bands
from .motion import Motion, read_motion
from .options import SceneOptions
from .passes import row_strips
from .rays import pixel_rays
from .scene import Scene, load_scene
from .scene_file import parse_scene
from .scene_settings import settings_of, unit_m
from .variants import choose_variant, use

RowProgress = Callable[[int, int], None]
SAMPLES_PER_RAY = 4  # samples of a render that take the memory of one ray of this pass


@dataclass(frozen=True, eq=False)
class Aovs:
    """The AOVs of a frame. All arrays are float32, lengths are metres.

    "Empty" are pixels whose ray meets no surface, or to which the lens passes no light.

    depth_m : (H, W) distance from the camera along its optical axis; +inf where empty.
    position_m : (H, W, 3) in world space; NaN where empty.
    normal : (H, W, 3) unit shading normal in world space, as the surface has it (outwards); 0 where empty.
    albedo : (H, W, 3) diffuse reflectance at equal energy, mean over 600–700, 500–600 and 400–500 nm; 0 for
        metals, clear glass and where empty.
    shape_index : (H, W) whole number, index of the shape in the scene file, from 0; −1 where empty.
    flow_px : (H, W, 2) optical flow to the right and down [pixels]: how far the point moves while its row is open, by
        the motion of the camera and of its own shape; the background is infinitely far. NaN where it ends behind the
        camera. Beyond the film a measured distortion is that of the edge.
    shapes : name of each shape, its id or its type and index.
    """

    depth_m: NDArray[np.float32]
    position_m: NDArray[np.float32]
    normal: NDArray[np.float32]
    albedo: NDArray[np.float32]
    shape_index: NDArray[np.float32]
    flow_px: NDArray[np.float32]
    shapes: tuple[str, ...]
    scene_sha256: str


@documents(SceneOptions)
def render_aovs(
    scene: str | os.PathLike[str],
    camera: Camera,
    *,
    exposure: Exposure | None = None,
    progress: RowProgress | None = None,
    **options: Unpack[SceneOptions],
) -> Aovs:
    """The AOVs of a scene file, aligned with the frame that :func:`render.prepared.render` makes of it.

    exposure : for how long the shutter is open, which a motion needs.
    progress : called with (rows done, rows in all), also once before the first.
    In scalar variants rays are traced one by one: 0.3 ms per pixel with a motion, and 0.01 ms in LLVM.
    Raises InputError.
    """
    check_types(camera, Exposure(0.0) if exposure is None else exposure)
    chosen = complete(SceneOptions, options)
    motion, scene_unit, parameters = chosen["motion"], chosen["scene_unit"], chosen["parameters"] or {}
    if motion is not None and exposure is None:
        raise InputError("a motion is given and no exposure; pass exposure=Exposure(time_s) for the optical flow.")
    if not isinstance(scene, str | os.PathLike):
        raise InputError(f"scene is {scene!r}; pass the path of a scene file, e.g. 'scenes/cornell_box.xml'.")
    moved = Motion() if motion is None else read_motion(motion)
    use(choose_variant(chosen["variant"]))
    bands = choose_bands(camera, None, LONGEST_NM - SHORTEST_NM, "auto")  # one is enough: only rays are traced
    file = parse_scene(scene, parameters)
    metres = unit_m(scene_unit if scene_unit is not None else settings_of(file).unit_m or 1.0)
    loaded = load_scene(file, bands, parameters, camera, scene_unit, width=chosen["width"])
    return aovs_of(loaded, moved, metres, shutter_of(camera, exposure or Exposure(0.0)), progress)


def aovs_of(scene: Scene, motion: Motion, unit_m: float, shutter: Shutter, progress: RowProgress | None = None) -> Aovs:
    """The AOVs of a scene that is loaded. unit_m : metres per scene unit."""
    with AnimatedTransforms(scene, motion, unit_m) as transforms:
        arrays = _trace(scene, transforms, shutter, progress or (lambda done, total: None))
    arrays["depth_m"] *= np.float32(unit_m)
    arrays["position_m"] *= np.float32(unit_m)
    return Aovs(**arrays, shapes=shape_names(scene), scene_sha256=scene.sha256)


def denoising_guides(scene: Scene) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Albedo and normals of a loaded scene at rest, (H, W, 3) each, as auxiliary images of a denoiser."""
    with AnimatedTransforms(scene, Motion()) as transforms:
        arrays = _trace(scene, transforms, Shutter(open_s=0.0), lambda done, total: None)
    return arrays["albedo"], arrays["normal"]


def shape_names(scene: Scene) -> tuple[str, ...]:
    """Ids of the shapes in the order of the scene file; without an id type and index, e.g. ``sphere 3``."""
    shapes = scene.mitsuba_scene.shapes()
    return tuple(shape.id() or f"{shape.class_name().lower()} {k}" for k, shape in enumerate(shapes))


def _trace(
    scene: Scene, transforms: AnimatedTransforms, shutter: Shutter, progress: RowProgress
) -> dict[str, NDArray[np.float32]]:
    """All arrays, strip by strip; row by row where the rows show the scene at different times."""
    (columns, rows), (left, top) = scene.view.crop_size, scene.view.crop_offset
    row_by_row = shutter.row_time_s > 0 and transforms.motion != Motion()
    strips = [(r, r + 1) for r in range(rows)] if row_by_row else row_strips((columns, rows), 1, SAMPLES_PER_RAY)
    parts = []
    progress(0, rows)
    for first, last in strips:
        start_s = float(shutter.start_s(first + top)) if row_by_row else 0.0
        transforms.set_time(start_s)
        grid = np.meshgrid(left + np.arange(columns) + 0.5, top + np.arange(first, last) + 0.5)
        pixels = np.stack(grid, axis=-1).reshape(-1, 2)
        arrays = _trace_pixels(scene, transforms, pixels, (start_s, start_s + shutter.open_s))
        shape = (last - first, columns)
        parts.append({k: v.astype(np.float32).reshape(*shape, *v.shape[1:]) for k, v in arrays.items()})
        progress(last, rows)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _trace_pixels(
    scene: Scene, transforms: AnimatedTransforms, pixels: Float64Array, times_s: tuple[float, float]
) -> dict[str, Float64Array | NDArray[np.intp]]:
    """The arrays of Aovs at pixels (N, 2), flat."""
    camera = transforms.camera_at(times_s[0])
    points, hits = first_hits(scene, camera, *pixel_rays(scene, pixels), albedo=True)
    axis = camera[:3, 2] / np.linalg.norm(camera[:3, 2])
    flow = np.zeros_like(pixels)
    if transforms.motion != Motion():
        flow = reproject(scene, transforms, points, hits.shape, pixels, times_s) - pixels
    return {
        "depth_m": np.asarray(np.where(hits.found, (hits.position - camera[:3, 3]) @ axis, np.inf)),
        "position_m": hits.position,
        "normal": hits.normal,
        "albedo": hits.albedo,
        "shape_index": hits.shape,
        "flow_px": flow,
    }
