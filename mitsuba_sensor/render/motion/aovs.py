"""AOVs of a frame: depth, position, normal, albedo, shape index and optical flow of each pixel.

A separate pass traces one ray through the centre of each pixel and of the pupil, without averaging at edges, aligned
with the pixels of the frame (same film, crop, lens). With a rolling shutter each row shows the scene when it opens.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...camera.camera_file import AnyCamera, camera_of
from ...core import Exposure, Float64Array, InputError, check_types
from ...core.options import complete, documents
from ...optics.shutter import Shutter, shutter_of
from ..light.bands import choose_bands
from ..load.scene import Scene, load_scene
from ..options import SceneOptions
from ..samples import LONGEST_NM, SHORTEST_NM, row_strips
from ..scene.motion import Motion, read_motion
from ..scene.parse_scene import SceneInput, parse
from ..scene.parsed_scene import ParsedScene
from ..variants import restores_variant
from .moving_scene import AnimatedTransforms
from .rays import first_hits

RowProgress = Callable[[int, int], None]
SAMPLES_PER_RAY = 4  # samples of a render that need the memory of one ray of this pass


@dataclass(frozen=True, eq=False)
class Aovs:
    """The AOVs of a frame. All arrays are float32, lengths are metres.

    A pixel is empty if its ray meets no surface or if the lens passes no light to it.

    depth_m : distance from the camera along its optical axis, shape (H, W); +inf for empty pixels.
    position_m : in world space, shape (H, W, 3); NaN for empty pixels.
    normal : outward unit shading normal in world space, shape (H, W, 3); 0 for empty pixels.
    albedo : diffuse reflectance at equal energy, mean over 600–700, 500–600 and 400–500 nm, shape (H, W, 3); 0 for
        metals, clear glass and empty pixels.
    shape_index : index of the shape in the scene file, from 0, shape (H, W); −1 for empty pixels.
    flow_px : optical flow to the right and down [pixels], shape (H, W, 2): displacement of the point while its row is
        open, by the motion of the camera and of its shape; the background is infinitely far. NaN if the point ends
        behind the camera. Outside of the film, the distortion of its edge applies.
    shapes : name of each shape: its id, or its type and index.
    """

    depth_m: NDArray[np.float32]
    position_m: NDArray[np.float32]
    normal: NDArray[np.float32]
    albedo: NDArray[np.float32]
    shape_index: NDArray[np.float32]
    flow_px: NDArray[np.float32]
    shapes: tuple[str, ...]
    scene_sha256: str

    def __repr__(self) -> str:
        rows, columns = self.depth_m.shape
        return f"<Aovs: {rows} × {columns}, {len(self.shapes)} shapes>"


@documents(SceneOptions)
@restores_variant
def render_aovs(
    scene: SceneInput,
    camera: AnyCamera,
    *,
    exposure: Exposure | None = None,
    progress: RowProgress | None = None,
    **options: Unpack[SceneOptions],
) -> Aovs:
    """Return the AOVs of a scene, aligned with the frame of :func:`render.passes.prepared.render`.

    exposure : required with a motion.
    progress : called with (rows done, all rows), also before the first row.

    Scalar variants trace rays individually: 0.3 ms per pixel with a motion, compared with 0.01 ms in LLVM. Raises
    InputError.
    """
    camera = camera_of(camera)
    check_types(camera, Exposure(0.0) if exposure is None else exposure)
    chosen = complete(SceneOptions, options)
    if chosen["motion"] is not None and exposure is None:
        raise InputError(
            "a motion is given and no exposure; pass exposure=Exposure(time_s) for the optical flow."
        )
    moved = read_motion(chosen["motion"])
    parsed = parse(scene, chosen).in_variant_for(camera)
    unit_m = parsed.settings.metres(chosen["scene_unit"]) or 1.0
    shutter = shutter_of(camera, exposure or Exposure(0.0))
    loaded = load_for_rays(parsed, camera, chosen["scene_unit"], chosen["width"])
    return aovs_of(loaded, moved, unit_m, shutter, progress)


def load_for_rays(
    scene: ParsedScene, camera: Camera, scene_unit: str | float | None, width: int | None
) -> Scene:
    """Return the scene at rest with one band, which is sufficient for tracing rays without light."""
    bands = choose_bands(camera, None, LONGEST_NM - SHORTEST_NM, "auto")
    return load_scene(scene, bands, {}, camera, scene_unit, width=width)


def aovs_of(
    scene: Scene,
    motion: Motion,
    unit_m: float,
    shutter: Shutter,
    progress: RowProgress | None = None,
) -> Aovs:
    """Return the AOVs of a loaded scene.  unit_m : metres per scene unit."""
    with AnimatedTransforms(scene, motion, unit_m) as transforms:
        arrays = _trace(transforms, shutter, progress)
    arrays["depth_m"] *= np.float32(unit_m)
    arrays["position_m"] *= np.float32(unit_m)
    shapes = enumerate(scene.mitsuba_scene.shapes())
    names = tuple(shape.id() or f"{shape.class_name().lower()} {k}" for k, shape in shapes)
    return Aovs(**arrays, shapes=names, scene_sha256=scene.sha256)


def _trace(
    transforms: AnimatedTransforms, shutter: Shutter, progress: RowProgress | None = None
) -> dict[str, NDArray[np.float32]]:
    """Return all arrays, computed by strips, or by rows if the rows show the scene at different times."""
    view = transforms.scene.view
    (columns, rows), (left, top) = view.crop_size, view.crop_offset
    row_by_row = shutter.row_time_s > 0 and transforms.motion != Motion()
    strips = row_strips((columns, rows), SAMPLES_PER_RAY)
    if row_by_row:
        strips = [(row, row + 1) for row in range(rows)]
    parts, report = [], progress or (lambda done, total: None)
    report(0, rows)
    for first, last in strips:
        start_s = float(shutter.start_s(first + top)) if row_by_row else shutter.begin_s
        transforms.set_time(start_s)
        grid = np.meshgrid(left + np.arange(columns) + 0.5, top + np.arange(first, last) + 0.5)
        pixels = np.stack(grid, axis=-1).reshape(-1, 2)
        arrays = _trace_pixels(transforms, pixels, start_s, start_s + shutter.open_s)
        shape = (last - first, columns)
        parts.append(
            {k: v.astype(np.float32).reshape(*shape, *v.shape[1:]) for k, v in arrays.items()}
        )
        report(last, rows)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _trace_pixels(
    transforms: AnimatedTransforms, pixels: Float64Array, from_s: float, to_s: float
) -> dict[str, Float64Array | NDArray[np.intp]]:
    """Return the arrays of Aovs at pixels, shape (N, 2)."""
    camera, flow = transforms.camera_at(from_s), np.zeros_like(pixels)
    hits = first_hits(transforms.scene, camera, pixels, albedo=True)
    axis = camera[:3, 2] / np.linalg.norm(camera[:3, 2])
    if transforms.motion != Motion():
        flow = transforms.reproject(hits.points, hits.shape, pixels, from_s, to_s) - pixels
    depth = np.asarray(np.where(hits.found, (hits.position - camera[:3, 3]) @ axis, np.inf))
    return {
        "depth_m": depth,
        "position_m": hits.position,
        "normal": hits.normal,
        "albedo": hits.albedo,
        "shape_index": hits.shape,
        "flow_px": flow,
    }
