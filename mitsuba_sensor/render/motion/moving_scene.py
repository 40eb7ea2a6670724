"""Moving scenes: poses of camera and objects at any time, sub-frames of an open shutter, optical flow.

Mitsuba 3.9.1 has no animated transforms and does not read the time of its rays, so the transforms and vertices of the
scene are set for each instant, and restored afterwards. One compiled kernel serves all poses.

A sub-frame (see optics/shutter.py) renders all rows of its block, open or not, because each other crop compiles another
kernel (1.1 s for a Cornell box, 4 s for a scene of eight materials). With a rolling shutter whose exposure is shorter
than its readout, the rows are cut into up to eight blocks (512² pixels, readout of eight exposures: 20 s per pass
instead of 57 s in one block).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Exposure, Float64Array, InputError, nearest
from ...optics.shutter import displaced_share, phase_of_pass, shutter_of, subframes
from ...optics.waveform import Waveform
from ..light.statistics import TimeSampling
from ..load.scene import Scene
from ..samples import hashed_seed, whole_grid
from ..scene.motion import Motion, RigidMotion
from ..variants import MitsubaObject, mitsuba
from .rays import camera_to_world, first_hits, project

BLOCKS_MAX = 8  # of rows, each with a separate kernel; fewer blocks render more closed rows
PROBES = 32  # rays along each side of the image that measure the largest speed
INSTANTS = np.linspace(0, 1, 5)
"""Instants of the probes, as fractions of the time from the first row's opening to the last row's closing."""
GUIDE_SUBFRAMES_MAX = 16  # of one exposure
BOX_POINTS: Float64Array = np.stack(np.meshgrid(*3 * [[0.0, 0.5, 1.0]]), axis=-1).reshape(-1, 3)
FLASH_SUBFRAMES_MAX = (
    256  # of an exposure and pass under a flickering lamp, unless more are requested
)
POSITIONS = "vertex_positions"  # of a mesh
MIDDLE = 0.5  # phase of sub-frames in the middle of their intervals
DIFFERENCE = (
    1 / 256
)  # of the same time, over which speeds are measured, with 0.03 px of rounding

Make = Callable[[int, tuple[int, int]], NDArray[np.float32]]
Start = tuple[int, float]  # seed of a pass and phase of its sub-frames


class AnimatedTransforms:
    """Sets camera and objects of a scene to their poses at a time; leaving the ``with`` block restores them.

    unit_m : metres per scene unit. All poses and points are in scene units.
    Raises InputError for an object that the scene does not have or that cannot be moved.
    """

    def __init__(self, scene: Scene, motion: Motion, unit_m: float = 1.0) -> None:
        mi = mitsuba()
        self.scene, self.motion, self._unit_m = scene, motion, unit_m
        self._camera = mi.traverse(scene.sensor)
        self.rest_pose = camera_to_world(scene.sensor)
        shapes = [shape.id() for shape in scene.mitsuba_scene.shapes()]
        parameters = mi.traverse(scene.mitsuba_scene)
        _require_movable(motion, [*shapes, *_placed_emitters(scene, parameters)])
        self.indices = {name: shapes.index(name) for name in motion.objects if name in shapes}
        self._at_rest = {name: _movable_parameters(parameters, name) for name in motion.objects}
        # Traversed again: each update looks up all parameters that were read, so only these are kept.
        self._shapes = mi.traverse(scene.mitsuba_scene)
        self._shapes.keep([key for kept in self._at_rest.values() for key in kept])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._set(self.rest_pose, {name: np.eye(4) for name in self._at_rest})

    def set_time(self, time_s: float) -> None:
        """Set everything to its pose at this time."""
        moved = {
            name: self._displacement(motion, time_s)
            for name, motion in self.motion.objects.items()
        }
        self._set(self.camera_at(time_s), moved)

    def camera_at(self, time_s: float) -> Float64Array:
        """Return the pose of the camera to world space, shape (4, 4)."""
        if self.motion.camera is None:
            return self.rest_pose.copy()
        return self._displacement(self.motion.camera, time_s) @ self.rest_pose

    def reproject(
        self,
        points: Float64Array,
        shapes: NDArray[np.intp],
        guess: Float64Array,
        from_s: float,
        to_s: float,
    ) -> Float64Array:
        """Return the positions on the film [pixels], shape (N, 2), of world points, shape (N, 4), after moving with
        their shapes."""
        moved = points.copy()
        for name, index in self.indices.items():
            of_shape, motion = shapes == index, self.motion.objects[name]
            before, after = (self._displacement(motion, time_s) for time_s in (from_s, to_s))
            moved[of_shape] = points[of_shape] @ (after @ np.linalg.inv(before)).T
        return project(self.scene, moved @ np.linalg.inv(self.camera_at(to_s)).T, guess)

    def _displacement(self, motion: RigidMotion, time_s: float) -> Float64Array:
        """Return a displacement in scene units, shape (4, 4); the default pivot is the position of the camera."""
        metres = self.rest_pose.copy()
        metres[:3, 3] *= self._unit_m
        moved = motion.displacement(time_s, metres)
        moved[:3, 3] /= self._unit_m
        return moved

    def _set(self, camera: Float64Array, objects: Mapping[str, Float64Array]) -> None:
        """Set poses from arrays, which are data of the kernel; values from lists would compile a kernel for each
        pose."""
        if self.motion.camera is not None:
            self._camera["to_world"] = type(self._camera["to_world"])(camera)
            self._camera.update()
        for name, displacement in objects.items():
            for key, rest in self._at_rest[name].items():
                now = self._shapes[key]
                if key.endswith(".to_world"):
                    value = displacement @ rest
                else:
                    value = rest @ displacement[:3, :3].T  # normals only turn
                    if key.endswith(POSITIONS):
                        value = value + displacement[:3, 3]
                    value = value.astype(np.float32).reshape(now.shape)
                self._shapes[key] = type(now)(value)
        if objects:
            self._shapes.update()

    def image_speed(self, at_s: float, difference_s: float) -> float:
        """Return the largest speed in the image at an instant [px/s]: of the surfaces that a grid of rays meets, and of
        the visible bounding boxes of moving shapes (corners, centres of edges and sides, centre)."""
        self.set_time(at_s)
        (width, height), (left, top) = self.scene.view.crop_size, self.scene.view.crop_offset
        x, y = (np.unique(np.linspace(0, n - 1, PROBES).round()) + 0.5 for n in (width, height))
        grid: Float64Array = np.stack(np.meshgrid(left + x, top + y), axis=-1).reshape(-1, 2)
        hits = first_hits(self.scene, self.camera_at(at_s), grid)
        points, shapes = hits.points, hits.shape
        for index in self.indices.values():
            box = self.scene.mitsuba_scene.shapes()[index].bbox()
            low, high = np.ravel(box.min), np.ravel(box.max)
            count = len(BOX_POINTS)
            of_box = np.column_stack([low + BOX_POINTS * (high - low), np.ones(count)])
            points = np.concatenate([points, of_box])
            shapes = np.concatenate([shapes, np.full(count, index)])
            grid = np.concatenate([grid, np.tile(np.mean(grid, axis=0), (count, 1))])
        before = self.reproject(points, shapes, grid, at_s, at_s)
        after = self.reproject(points, shapes, before, at_s, at_s + difference_s)
        centre, half = (left + width / 2, top + height / 2), (width / 2, height / 2)
        inside = (np.abs(before - centre) <= half).all(axis=1)
        moved = np.hypot(*(after - before)[inside].T)
        return float(np.nanmax(moved, initial=0.0)) / difference_s


def pose_m(scene: Scene, motion: Motion, unit_m: float, begin_s: float) -> Float64Array:
    """Return the pose of the camera to world space [m] when the first row opens, shape (4, 4); the scene is at rest."""
    pose = AnimatedTransforms(scene, motion, unit_m).camera_at(begin_s)
    pose[:3, 3] *= unit_m
    return pose


def _placed_emitters(scene: Scene, parameters: MitsubaObject) -> list[str]:
    """Return the ids of the emitters with a separate transform: spot lights, but not emitters of shapes."""
    ids = [emitter.id() for emitter in scene.mitsuba_scene.emitters()]
    return [name for name in ids if f"{name}.to_world" in parameters]


def _require_movable(motion: Motion, names: Sequence[str]) -> None:
    """Raise InputError if the motion names anything other than these shapes and emitters."""
    for missing in (name for name in motion.objects if name not in names):
        known = sorted({name for name in names if name})
        ids = f"the ids are {', '.join(known)}" if known else "no shape or emitter has an id"
        raise InputError(
            f"the motion names {missing!r}, which is neither a shape of the scene nor an emitter with a transform; "
            f"{ids}.{nearest(missing, known)}"
        )


def _movable_parameters(parameters: MitsubaObject, name: str) -> dict[str, Float64Array]:
    """Return the parameters that move an object, at rest: its transform, or the vertices of a mesh."""
    transform = f"{name}.to_world"
    if transform in parameters:
        return {
            transform: np.array(parameters[transform].matrix, dtype=np.float64).reshape(4, 4)
        }
    positions, normals = f"{name}.{POSITIONS}", f"{name}.vertex_normals"
    if positions not in parameters:
        raise InputError(
            f"the shape {name!r} cannot be moved, because it has neither a transform nor vertices; use a mesh."
        )
    keys = [positions, normals] if len(parameters[normals]) else [positions]
    return {key: np.array(parameters[key], dtype=np.float64).reshape(-1, 3) for key in keys}


class MovingScene:
    """A scene with a motion and a shutter, rendered like a :class:`Scene`: one pass covers the whole exposure.

    scene : at rest.
    subframes : sub-frames of one exposure, at most one for each sample of a pass; they share the samples evenly.
        Default: enough for motion of at most half a pixel between two sub-frames.
    unit_m : metres per scene unit.  begin_s : start of the frame in the time of the motion.
    waveform : of the light, which weights the sub-frames; each row gets the same light as from a steady lamp.
    Raises InputError for a motion that does not fit the scene.
    """

    def __init__(
        self,
        scene: Scene,
        motion: Motion,
        camera: Camera,
        exposure: Exposure,
        subframes: int | None = None,
        unit_m: float = 1.0,
        begin_s: float = 0.0,
        waveform: Waveform | None = None,
    ) -> None:
        self.scene, self.view, self.sha256 = scene, scene.view, scene.sha256
        self.restrict_wavelengths, self._waveform = scene.restrict_wavelengths, waveform
        self._shutter, self.asked_subframes = shutter_of(camera, exposure, begin_s), subframes
        self.transforms, self._counts = AnimatedTransforms(scene, motion, unit_m), list[int]()
        self._phase = MIDDLE
        (_, rows), (_, top) = scene.view.crop_size, scene.view.crop_offset
        first_s, last_s = self._shutter.span_s((top, top + rows))
        with self.transforms:
            length, speed = last_s - first_s, self.transforms.image_speed
            speeds = (
                speed(first_s + fraction * length, length * DIFFERENCE) for fraction in INSTANTS
            )
            self.speed_px_per_s = max(speeds) if length else 0.0
        self._needed = self._shutter.subframes_needed(self.speed_px_per_s)

    @property
    def begin_s(self) -> float:
        """Start of the frame in the time of the motion [s]."""
        return self._shutter.begin_s

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the scene, and the number of sub-frames."""
        blur_px, needed = self.speed_px_per_s * self._shutter.open_s, self._needed
        moves = f"sub-frames per exposure and pass; the image moves up to {blur_px:.3g} px while a row is open"
        more = f" ({needed} would be smooth in each pass, and need more samples)"
        return (
            *self.scene.notes,
            *(f"{n} {moves}{more if n < needed else ''}" for n in self._counts),
        )

    def time_sampling(self) -> TimeSampling | None:
        """Return how finely the exposure was sampled; None before the first pass."""
        if not self._counts:
            return None
        (_, rows), (_, top) = self.view.crop_size, self.view.crop_offset
        count, film_rows, speed = self._counts[0], (top, top + rows), self.speed_px_per_s
        step_s, open_s = self._step_s(count, film_rows), self._shutter.open_s
        share = displaced_px = None
        if self._waveform is not None:
            share = displaced_share(self._shutter, film_rows, count, self._waveform)
            displaced_px = speed * open_s / (2 * count)
        return TimeSampling(
            subframes=count,
            speed_px_per_s=speed,
            step_px=speed * step_s,
            blur_too_long_px=speed * max(count * step_s - open_s, 0.0),
            waveform_displaced_share=share,
            waveform_displaced_px=displaced_px,
        )

    def begin_pass(self, seed: int, number: int) -> None:
        """Prepare the pass with this number of a render with this seed: its instants lie between those of earlier
        passes."""
        self._phase = phase_of_pass(hashed_seed(seed, 0, 0) / 2**32, number)

    def render(self, seed: int, samples: int, rows: tuple[int, int]) -> NDArray[np.float32]:
        """Return a pass over rows [first, last) of the crop: ∫response·L dλ [W m⁻² sr⁻¹], shape (rows, columns,
        channels)."""
        wanted = self.asked_subframes or self._needed
        count = subframes_of_pass(wanted, samples)
        if self._waveform is not None:  # fewer would miss flashes: at least one sample each
            count = max(count, min(wanted, FLASH_SUBFRAMES_MAX))
        self._counts[:] = [count]  # of the last render, not of a pilot before it

        def make(number: int, block: tuple[int, int]) -> NDArray[np.float32]:
            return self.scene.render(number, max(samples // count, 1), block)

        return self._exposed(make, (seed, self._phase), count, rows)

    def averaged(self, make: Make, seed: int, rows: tuple[int, int]) -> NDArray[np.float32]:
        """Return the images that ``make`` renders of rows [first, last) of the crop, averaged over the exposure."""
        count = min(self.asked_subframes or self._needed, GUIDE_SUBFRAMES_MAX)
        return self._exposed(make, (seed, MIDDLE), count, rows)

    def _exposed(
        self, make: Make, start: Start, count: int, rows: tuple[int, int]
    ) -> NDArray[np.float32]:
        """Return the images that ``make`` renders with a seed, averaged over ``count`` sub-frames of the exposure."""
        # Blocks are rows that are open at about the same time: as many as exposures fit into the readout of all rows.
        total, readout_s = rows[1] - rows[0], (rows[1] - rows[0] - 1) * self._shutter.row_time_s
        duration_s = max(self._shutter.open_s, readout_s / BLOCKS_MAX, sys.float_info.min)
        blocks = max(min(math.ceil(readout_s / duration_s), BLOCKS_MAX, total), 1)
        edges = pairwise(rows[0] + total * k // blocks for k in range(blocks + 1))
        with self.transforms:
            parts = [self._exposed_block(make, start, count, block) for block in edges]
        return np.concatenate(parts).astype(np.float32)

    def _exposed_block(
        self, make: Make, start: Start, count: int, rows: tuple[int, int]
    ) -> Float64Array:
        """Return the weighted sum of the sub-frames of a block of rows, shape (rows, columns, channels)."""
        film_rows = rows[0] + self.view.crop_offset[1], rows[1] + self.view.crop_offset[1]
        step_s = self._step_s(count, film_rows)
        seed, phase = start
        times_s, weights = subframes(
            self._shutter, film_rows, count, step_s, phase, self._waveform
        )
        frame: Float64Array | None = None
        for k, time_s in enumerate(times_s):
            if not weights[:, k].any():  # between two flashes
                continue
            self.transforms.set_time(time_s)
            image = make(hashed_seed(seed, 1 + rows[0], k), rows)
            frame = np.zeros(image.shape) if frame is None else frame
            # Closed rows are left out, because 0 times an infinite value would be NaN.
            open_ = weights[:, k] > 0
            frame[open_] += weights[open_, k, None, None] * image[open_]
        assert frame is not None
        return frame

    def _step_s(self, count: int, film_rows: tuple[int, int]) -> float:
        """Return the time between two of ``count`` sub-frames of an exposure."""
        speed = math.inf if self.asked_subframes else self.speed_px_per_s
        return self._shutter.step_s(count, speed, film_rows)


def subframes_of_pass(needed: int, samples: int) -> int:
    """Return the smallest number of sub-frames from ``needed`` that share the samples of a pass evenly, at most one per
    sample; each gets a number of samples that multijitter keeps (see ``pass_plan``)."""
    shares = range(min(needed, samples), samples)
    return next(
        (n for n in shares if samples % n == 0 and whole_grid(samples // n) == samples // n),
        samples,
    )
