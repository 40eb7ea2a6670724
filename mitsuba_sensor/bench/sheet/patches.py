"""Charts of even patches in rows and columns: their light in a small render, and their places in the frames.

The mean of a patch in the render is the light of a larger one in the frames: render noise is in the levels of patches,
and none in the noise of their pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...camera.figures import saturation_e
from ...core import InputError
from ...core.types import Float64Array
from ...files.texts import Facts
from ...lab.frames.bench import Bench
from ...lab.frames.manifest import is_number
from ...lab.measure.image_quality.patches import Region
from .light import ChartLight
from .setting import Bands, Setting, chart_shape, levels_of_filters, take


class PatchGrid(NamedTuple):
    """Patches of equal size.

    rows, columns : of patches.
    rendered_px : side of one in the render.  margin_px : what of it on each side may be frame, or blurred by the lens.
    patch_px : side of one in the frames, behind each place of the mosaic.
    """

    rows: int
    columns: int
    rendered_px: int
    margin_px: int
    patch_px: int

    def irradiance(self, light: ChartLight) -> Float64Array:
        """Of every patch without its margin, row by row, (P, B) [W m⁻² nm⁻¹]."""
        side, bands = self.rendered_px, light.data.shape[-1]
        patches = light.data.reshape(self.rows, side, self.columns, side, bands)
        inside = slice(self.margin_px, -self.margin_px)
        return np.asarray(patches[:, inside, :, inside].mean(axis=(1, 3)).reshape(-1, bands))

    def side(self, camera: Camera) -> tuple[int, int]:
        """Rows and columns of a patch in the frames, whole tiles of the mosaic."""
        shape = chart_shape(camera, self.rows * self.patch_px, self.columns * self.patch_px)
        rows, columns = len(camera.tile), len(camera.tile[0])
        return (
            shape[0] // self.rows // rows * rows,
            shape[1] // self.columns // columns * columns,
        )

    def regions(self, camera: Camera) -> list[list[int]]:
        """First row, first column, rows and columns of every patch in the frames, for ``chart.toml``."""
        rows, columns = self.side(camera)
        places = np.ndindex(self.rows, self.columns)
        return [[row * rows, column * columns, rows, columns] for row, column in places]

    def take(
        self,
        setting: Setting,
        patches: Float64Array,
        bands: Bands,
        name: str,
        counts: tuple[int, int],
    ) -> Bench:
        """Frames of the chart and dark ones.

        patches : mean photons per pixel of each, (P, B).  counts : of frames, and of dark ones.
        """
        rows, columns = self.side(setting.camera)
        grid = patches.reshape(self.rows, self.columns, -1)
        photons = grid.repeat(rows, axis=0).repeat(columns, axis=1)
        scene = take(setting, photons, bands, counts[0], name)
        dark = take(setting, 0 * photons, bands, counts[1], f"{name} dark")
        return Bench((), (dark,), (), (scene,))


def scaled_to_saturation(
    camera: Camera, photons: Float64Array, bands: Bands, share: float
) -> Float64Array:
    """Photons (P, B), scaled: the brightest patch has this share of saturation behind the filter that sees most."""
    most_e = levels_of_filters(camera, photons, bands).max()
    return np.asarray(photons * (share * saturation_e(camera) / most_e))


class Patches(NamedTuple):
    """Where the patches are (first row, first column, rows, columns), and the exposure of each [lx s]."""

    regions: Sequence[Region]
    exposures_lxs: Sequence[float]

    def behind_one_filter(self, step: tuple[int, int]) -> list[Region]:
        """The regions in the plane of one place of the mosaic.  step : distance of its pixels, down and across."""
        return [
            (top // step[0], left // step[1], rows // step[0], columns // step[1])
            for top, left, rows, columns in self.regions
        ]


def patches_of(facts: Facts) -> Patches:
    """The patches that ``chart.toml`` names. Raises InputError where it does not, and for wrong values."""
    regions, exposures = (facts.get(name) for name in ("patches", "exposure_lxs"))
    are_regions = isinstance(regions, list) and all(map(_is_region, regions))
    are_exposures = isinstance(exposures, list) and all(map(is_number, exposures))
    if not (are_regions and are_exposures and len(regions or ()) == len(exposures or ())):
        raise InputError(
            "chart.toml of a chart of patches has patches = [[first row, first column, rows, columns], …] and "
            "exposure_lxs = […], the illuminance at the focal plane times the exposure time of each patch; "
            "docs/image-quality.md shows one."
        )
    return Patches([tuple(region) for region in regions or ()], exposures or ())


def _is_region(value: object) -> bool:
    """Whether a value is four whole numbers of at least 0."""
    if not isinstance(value, list) or len(value) != 4:
        return False
    return all(type(number) is int and number >= 0 for number in value)
