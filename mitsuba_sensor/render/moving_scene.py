"""A scene that moves while the shutter is open: renders sub-frames and weights them into the rows of one frame.

A sub-frame (see optics/shutter.py) renders all rows of its block, open or not, because every other crop compiles
another kernel (1.1 s for a Cornell box, 4 s for a scene of eight materials). With a rolling shutter whose exposure is
shorter than its read-out the rows are cut into up to eight blocks (512² pixels, read-out of eight exposures: 20 s a
pass, and 57 s in one block).
"""

from __future__ import annotations

import math
import sys

import numpy as np
from numpy.typing import NDArray

from ..core import Exposure, Float64Array, InputError, require
from ..optics.shutter import shutter_of, subframes
from ..sensor.camera import Camera
from .animated_transforms import AnimatedTransforms, max_image_speed
from .motion import Motion
from .passes import MOST_SPP, hashed_seed
from .scene import Scene

MOST_BLOCKS = 8  # of rows, each with a kernel of its own; fewer blocks render more rows that are closed


class MovingScene:
    """A scene with a motion and a shutter, rendered like a :class:`Scene`: one pass covers the whole exposure.

    scene : at rest.
    subframes : sub-frames of one exposure; by default so many that nothing in the image moves by more than half a
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
        self.view, self.sha256, self.restrict_wavelengths = scene.view, scene.sha256, scene.restrict_wavelengths
        self.transforms = AnimatedTransforms(scene, motion, unit_m)
        self._counts: set[int] = set()
        with self.transforms:
            span_s = self._shutter.span_s(self._film_rows((0, scene.view.crop_size[1])))
            self.speed_px_per_s = max_image_speed(scene, self.transforms, span_s)

    @property
    def notes(self) -> tuple[str, ...]:
        """Those of the scene, and the number of sub-frames."""
        blur_px, needed = (
            self.speed_px_per_s * self._shutter.open_s,
            self._shutter.subframes_needed(self.speed_px_per_s),
        )
        moves = f"sub-frames per exposure and pass; the image moves up to {blur_px:.3g} px while a row is open"
        more = f" ({needed} would be smooth in each pass; that takes more samples)"
        return (*self.scene.notes, *(f"{n} {moves}{more if n < needed else ''}" for n in sorted(self._counts)))

    def render(self, seed: int, samples: int, rows: tuple[int, int]) -> NDArray[np.float32]:
        """One pass over rows [first, last) of the crop: ∫response·L dλ [W m⁻² sr⁻¹], (rows, columns, channels)."""
        needed = self._shutter.subframes_needed(self.speed_px_per_s) if self._given is None else self._given
        count = subframes_of_pass(needed, samples)
        self._counts.add(count)
        with self.transforms:
            blocks = [self._render_block(seed, samples // count, count, block) for block in self._blocks(rows)]
        return np.concatenate(blocks).astype(np.float32)

    def _render_block(self, seed: int, samples: int, count: int, rows: tuple[int, int]) -> Float64Array:
        """The weighted sum of the sub-frames of some rows, (rows, columns, channels)."""
        film_rows = self._film_rows(rows)
        step_s = self._shutter.step_s(count, math.inf if self._given else self.speed_px_per_s, film_rows)
        times_s, weights = subframes(self._shutter, film_rows, count, step_s, hashed_seed(seed, 0, 0) / 2**32)
        frame: Float64Array | None = None
        for k, time_s in enumerate(times_s):
            self.transforms.set_time(time_s)
            image = self.scene.render(hashed_seed(seed, 1 + rows[0], k), samples, rows)
            frame = np.zeros(image.shape) if frame is None else frame
            open_ = weights[:, k] > 0  # only these rows, because 0 times an infinite value of a closed row would be NaN
            frame[open_] += weights[open_, k, None, None] * image[open_]
        assert frame is not None
        return frame

    def _blocks(self, rows: tuple[int, int]) -> list[tuple[int, int]]:
        """Rows that are open at about the same time: as many blocks as exposures fit into their read-out."""
        readout_s = (rows[1] - rows[0] - 1) * self._shutter.row_time_s
        duration_s = max(self._shutter.open_s, readout_s / MOST_BLOCKS, sys.float_info.min)
        count = max(min(math.ceil(readout_s / duration_s), MOST_BLOCKS, rows[1] - rows[0]), 1)
        edges = [rows[0] + (rows[1] - rows[0]) * k // count for k in range(count + 1)]
        return list(zip(edges[:-1], edges[1:], strict=True))

    def _film_rows(self, rows: tuple[int, int]) -> tuple[int, int]:
        """Rows of the crop as rows of the film."""
        top = self.view.crop_offset[1]
        return rows[0] + top, rows[1] + top


def subframes_of_pass(needed: int, samples: int) -> int:
    """The fewest sub-frames, at least ``needed``, that share the samples of a pass evenly; at most one per sample.

    The samples of each are a count that multijitter keeps (see ``pass_plan``): r², r(r+1) or r(r+2).
    """
    for count in range(min(needed, samples), samples):
        share, rest = divmod(samples, count)
        root = math.isqrt(share)
        if not rest and share in (root * root, root * (root + 1), root * (root + 2)):
            return count
    return samples
