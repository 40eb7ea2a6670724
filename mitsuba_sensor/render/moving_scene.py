"""A scene that moves while the shutter is open: sub-frames of it, weighted into the rows of one frame.

Mitsuba 3.9.1 has no animated transforms and nothing reads the time of its rays, so the scene is put where it stands at
each instant of shutter.py, and rendered. One kernel serves all poses. A sub-frame renders all rows of its block, open
or not, because every other crop compiles another kernel (1.1 s for a Cornell box, 4 s for a scene of eight materials);
a rolling shutter that is open for a shorter time than its read-out takes is cut into up to eight blocks (512² pixels,
read-out of eight exposures: 20 s a pass, and 57 s in one block).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, nearest, require
from ..optics.f_number_law import View
from ..optics.shutter import shutter_of, subframes
from .motion import Body, Motion
from .passes import MOST_SPP, hashed_seed
from .rays import Floats, Hits, intersect, matrix_of, pixel_rays, pose_of, project
from .scene import Scene
from .variants import mitsuba

if TYPE_CHECKING:
    from ..core.exposure import Exposure
    from ..sensor.camera import Camera

MOST_BLOCKS = 8  # of rows with kernels of their own, against rendering rows that are closed
PROBES = 32  # rays along each side of the picture that look for the fastest thing
INSTANTS = (0.0, 0.25, 0.5, 0.75, 1.0)  # when they look, shares of the time from first row open to last row closed
INSTANT = 1 / 256  # of that time: speeds are differences over it, 0.03 px of rounding in all
STILL = Body()


class Poses:
    """Puts camera and objects of a scene where a motion has them; leaving the block puts them back.

    unit_m : metres per scene unit. All poses and points here are in scene units.
    """

    def __init__(self, scene: Scene, motion: Motion, unit_m: float = 1.0) -> None:
        mi = mitsuba()
        self.motion, self._camera = motion, mi.traverse(scene.sensor)
        self._unit_m = unit_m
        self.base = pose_of(scene.sensor)
        self.names = [shape.id() for shape in scene.native.shapes()]
        for name in motion.objects:
            if name not in self.names:
                known = sorted(name for name in self.names if name)
                has = f"the ids of its shapes are {', '.join(known)}" if known else "no shape of it has an id"
                raise InputError(
                    f"the motion names {name!r}, which is no shape of the scene; {has}.{nearest(name, known)}"
                )
        self._shapes = mi.traverse(scene.native)
        self._rest = {name: _movable(self._shapes, name) for name in motion.objects}
        self._shapes.keep([key for rest in self._rest.values() for key in rest])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._place(self.base, {name: np.eye(4) for name in self._rest})

    def put(self, time_s: float) -> None:
        """Everything where it is at this time."""
        moved = {name: self._moved(body, time_s) for name, body in self.motion.objects.items()}
        self._place(self.camera_at(time_s), moved)

    def camera_at(self, time_s: float) -> Floats:
        """Pose of the camera, 4×4."""
        return self._moved(self.motion.camera or STILL, time_s) @ self.base

    def _moved(self, body: Body, time_s: float) -> Floats:
        """Displacement in scene units; of an object too, whose pivot is its own."""
        metres = self.base.copy()
        metres[:3, 3] *= self._unit_m
        moved = body.displacement(time_s, metres)
        moved[:3, 3] /= self._unit_m
        return moved

    def carried(self, points: Floats, shapes: NDArray[np.intp], from_s: float, to_s: float) -> Floats:
        """Homogeneous world points (N, 4) on the shapes of these numbers, at another time."""
        moved = points.copy()
        for name, body in self.motion.objects.items():
            mine = shapes == self.names.index(name)
            there = self._moved(body, to_s) @ np.linalg.inv(self._moved(body, from_s))
            moved[mine] = points[mine] @ there.T
        return moved

    def _place(self, camera: Floats, objects: Mapping[str, Floats]) -> None:
        if self.motion.camera is not None:
            self._camera["to_world"] = type(self._camera["to_world"])(camera)
            self._camera.update()
        for name, moved in objects.items():
            for key, value in self._rest[name].items():
                self._shapes[key] = _transformed(type(self._shapes[key]), key, value, moved)
        if objects:
            self._shapes.update()


def _movable(parameters: Any, name: str) -> dict[str, Floats]:
    """What has to change when a shape moves, as the scene file has it: its transform, or the vertices of a mesh."""
    place = f"{name}.to_world"
    if place in parameters:
        return {place: matrix_of(parameters[place])}
    keys = [f"{name}.vertex_positions", f"{name}.vertex_normals"]
    if keys[0] not in parameters:
        raise InputError(f"the shape {name!r} cannot be moved: it has neither a transform nor vertices; use a mesh.")
    return {key: np.array(parameters[key], dtype=np.float64).reshape(-1, 3) for key in keys if len(parameters[key])}


def _transformed(kind: Any, key: str, rest: Floats, moved: Floats) -> Any:
    """The value of one parameter after a displacement.

    Made from an array it is data to the kernel; from a list it would be numbers in it, and every pose another kernel.
    """
    if key.endswith(".to_world"):
        return kind(moved @ rest)
    shift = moved[:3, 3] if key.endswith("positions") else 0.0
    return kind((rest @ moved[:3, :3].T + shift).ravel().astype(np.float32))


class MovingScene:
    """A scene with a motion and a shutter, rendered like a :class:`Scene`: one pass is all of an exposure.

    scene : at rest.
    subframes : how many make one exposure; by default so many that the fastest thing in the picture moves by half a
        pixel from one to the next. At most one for each sample of a pass; they share the samples evenly.
    unit_m : metres per scene unit.  Raises InputError for a motion that does not fit the scene.
    """

    def __init__(
        self,
        scene: Scene,
        motion: Motion,
        camera: Camera,
        exposure: Exposure,
        subframes: int | None = None,
        unit_m: float = 1.0,
    ) -> None:
        if subframes is not None and require("subframes", subframes, 1, MOST_SPP, "e.g. 16") != int(subframes):
            raise InputError(f"subframes is {subframes!r}; it must be a whole number (e.g. 16).")
        self.scene, self._shutter, self._given = scene, shutter_of(camera, exposure), subframes
        self.poses = Poses(scene, motion, unit_m)
        self._taken: set[int] = set()
        with self.poses:
            span_s = self._shutter.span_s(self._rows_of((0, scene.view.crop_size[1])))
            self.speed_px_per_s = fastest(scene, self.poses, span_s)

    @property
    def view(self) -> View:
        """What the sensor sees; where it stands makes no difference."""
        return self.scene.view

    def focus(self, low_nm: float, high_nm: float) -> None:
        """See :meth:`Scene.focus`."""
        self.scene.focus(low_nm, high_nm)

    @property
    def sha256(self) -> str:
        """Of the scene file."""
        return self.scene.sha256

    @property
    def notes(self) -> tuple[str, ...]:
        """Those of the scene, and how the exposure was cut."""
        blur = self.speed_px_per_s * self._shutter.open_s
        return (*self.scene.notes, *(self._note(count, blur) for count in sorted(self._taken)))

    def render(self, seed: int, samples: int, rows: tuple[int, int]) -> NDArray[np.float32]:
        """One pass over rows [first, last) of the crop: ∫response·L dλ [W m⁻² sr⁻¹], (rows, columns, channels)."""
        wanted = self._shutter.wanted(self.speed_px_per_s) if self._given is None else self._given
        count = deal(wanted, samples)
        self._taken.add(count)
        with self.poses:
            blocks = [self._render(seed, samples // count, count, block) for block in self._blocks(rows)]
        return np.concatenate(blocks).astype(np.float32)

    def _render(self, seed: int, samples: int, count: int, rows: tuple[int, int]) -> Floats:
        """Rows whose sub-frames are rendered together."""
        film = self._rows_of(rows)
        step = self._shutter.step_s(count, math.inf if self._given else self.speed_px_per_s, film)
        cut = subframes(self._shutter, film, count, step, hashed_seed(seed, 0, 0) / 2**32)
        frame: Floats | None = None
        for k, (time_s, weights) in enumerate(zip(cut.times_s, cut.weights().T, strict=True)):
            self.poses.put(time_s)
            picture = self.scene.render(hashed_seed(seed, 1 + rows[0], k), samples, rows)
            frame = np.zeros(picture.shape) if frame is None else frame
            mine = weights > 0  # what other rows see at this time, infinite or not, is not theirs
            frame[mine] += weights[mine, None, None] * picture[mine]
        assert frame is not None
        return frame

    def _blocks(self, rows: tuple[int, int]) -> list[tuple[int, int]]:
        """Rows that are open at about the same time: as many blocks as read-outs of them last exposures."""
        readout_s = (rows[1] - rows[0] - 1) * self._shutter.row_time_s
        lasting_s = max(self._shutter.open_s, readout_s / MOST_BLOCKS, sys.float_info.min)
        count = max(min(math.ceil(readout_s / lasting_s), MOST_BLOCKS, rows[1] - rows[0]), 1)
        edges = [rows[0] + (rows[1] - rows[0]) * k // count for k in range(count + 1)]
        return list(zip(edges[:-1], edges[1:], strict=True))

    def _rows_of(self, rows: tuple[int, int]) -> tuple[int, int]:
        """Rows of the crop as rows of the film."""
        top = self.view.crop_offset[1]
        return rows[0] + top, rows[1] + top

    def _note(self, count: int, blur_px: float) -> str:
        text = f"{count} sub-frames per exposure and pass; the picture moves up to {blur_px:.3g} px while a row is open"
        wanted = self._shutter.wanted(self.speed_px_per_s)
        if count < wanted:
            return f"{text} ({wanted} would be smooth in each pass; that takes more samples)"
        return text


def deal(wanted: int, samples: int) -> int:
    """The fewest sub-frames, at least ``wanted``, that share the samples of a pass evenly; at most one for each.

    What each gets is a count that multijitter keeps (see ``pass_plan``): r², r(r+1) or r(r+2).
    """
    for count in range(min(wanted, samples), samples):
        share, rest = divmod(samples, count)
        root = math.isqrt(share)
        if not rest and share in (root * root, root * (root + 1), root * (root + 2)):
            return count
    return samples


def fastest(scene: Scene, poses: Poses, span_s: tuple[float, float]) -> float:
    """How fast the picture moves at its fastest place [px/s], at five instants from end to end of ``span_s``.

    Of all that a grid of rays meets, and of the corners of the boxes around the moved shapes, where they are in view.
    """
    length = span_s[1] - span_s[0]
    if length == 0:
        return 0.0
    return max(_speed(scene, poses, span_s[0] + share * length, length * INSTANT) for share in INSTANTS)


def _speed(scene: Scene, poses: Poses, at_s: float, instant_s: float) -> float:
    poses.put(at_s)
    (width, height), (left, top) = scene.view.crop_size, scene.view.crop_offset
    x, y = (np.unique(np.linspace(0, n - 1, PROBES).round()) + 0.5 for n in (width, height))
    grid = np.stack(np.meshgrid(left + x, top + y), axis=-1).reshape(-1, 2)
    origins, directions = pixel_rays(scene, grid)
    points, shapes = seen(scene, poses.camera_at(at_s), origins, directions)[:2]
    for name in poses.motion.objects:
        number = poses.names.index(name)
        corners = np.array(list(product(*_box(scene.native.shapes()[number]).T, [1.0])))
        points, grid = np.concatenate([points, corners]), np.concatenate([grid, np.tile(np.mean(grid, axis=0), (8, 1))])
        shapes = np.concatenate([shapes, np.full(8, number)])
    before = found_at(scene, poses, points, shapes, grid, (at_s, at_s))
    after = found_at(scene, poses, points, shapes, before, (at_s, at_s + instant_s))
    inside = (np.abs(before - (left + width / 2, top + height / 2)) <= (width / 2, height / 2)).all(axis=1)
    moved = np.hypot(*(after - before)[inside].T)
    return float(np.nanmax(moved, initial=0.0)) / instant_s


def _box(shape: Any) -> Floats:
    """(2, 3) corners of the box around a shape."""
    return np.array([shape.bbox().min, shape.bbox().max], dtype=np.float64).reshape(2, 3)


def seen(
    scene: Scene, camera: Floats, origins: Floats, directions: Floats, albedo: bool = False
) -> tuple[Floats, NDArray[np.intp], Hits]:
    """What rays of the camera's frame meet, as homogeneous world points (N, 4), directions where there is nothing."""
    world = directions @ camera[:3, :3].T
    unit = world / np.linalg.norm(world, axis=1, keepdims=True)
    hits = intersect(scene, origins @ camera[:3, :3].T + camera[:3, 3], unit, albedo)
    points = np.where(hits.found[:, None], hits.position, world)
    return np.column_stack([points, hits.found]), hits.shape, hits


def found_at(
    scene: Scene, poses: Poses, points: Floats, shapes: NDArray[np.intp], guess: Floats, times_s: tuple[float, float]
) -> Floats:
    """Pixel places (N, 2) at the second time of points that are on these shapes, and known, at the first."""
    moved = poses.carried(points, shapes, *times_s)
    return project(scene, moved @ np.linalg.inv(poses.camera_at(times_s[1])).T, guess)
