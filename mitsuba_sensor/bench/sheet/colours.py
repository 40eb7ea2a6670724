"""A ColorChecker on the sheet: colour differences through the best matrix and white balance, in daylight.

The scene ``color_checker`` is rendered small. Each patch is even, so that its mean is the light of a larger one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...camera.figures import saturation_e
from ...core import InputError
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.measure.colour_and_geometry.colour_chart import colour_chart
from ..datasheet import Said
from .chart import Lights, Measured, Taken, Theory
from .edge import without_black
from .edge_theory import coupling_of
from .light import ChartLight, ChartScene
from .setting import Setting, chart_shape, levels_of_filters, take
from .steps import Patches, patches_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROWS, COLUMNS = 4, 6
RENDERED_PX, MARGIN_PX = 16, 4
"""Distance of the patches in the render, and what of it on each side may be frame or blurred."""
PATCH_PX = 24
"""Side of a patch in the frames, behind each place of the mosaic."""
BRIGHTEST = 0.8
"""Of saturation, behind the filter that sees most."""
SAMPLES, FRAMES = 64, 4
CHANNELS = 3
"""Filters that a colour matrix needs."""


class ColoursChart(NamedTuple):
    """The 24 patches of a ColorChecker (ISO 17321-1) under CIE D65."""

    name: str = "colours"
    kind: str = "colours"
    title: str = "ColorChecker: colour differences and white balance"

    def suits(self, camera: Camera) -> bool:
        """Whether the camera sees colours."""
        return len(camera.filter_names) >= CHANNELS

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """The scene that ships with the package."""
        return [ChartScene(self.name, "color_checker", SAMPLES, width=COLUMNS * RENDERED_PX)]

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the chart and dark ones."""
        (light,) = lights
        side = _patch_side(setting.camera)
        patches = _patch_photons(setting, light).reshape(ROWS, COLUMNS, -1)
        photons = patches.repeat(side[0], axis=0).repeat(side[1], axis=1)
        scene = take(setting, photons, light.bands, FRAMES, self.name)
        dark = take(setting, 0 * photons, light.bands, 2 * FRAMES, f"{self.name} dark")
        regions = [
            [row * side[0], column * side[1], *side]
            for row, column in np.ndindex(ROWS, COLUMNS)
        ]
        facts = {"patches": regions, "exposure_lxs": [0.0] * len(regions)}
        return Taken(Bench((), (dark,), (), (scene,)), facts)

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """What the instrument finds in the mean photoelectrons of the patches; of pixels that are not coupled."""
        camera, (light,) = setting.camera, lights
        if coupling_of(camera) != ():
            return {}
        patches = levels_of_filters(camera, _patch_photons(setting, light), light.bands)
        planes = patches.repeat(PATCH_PX, axis=0)[None].repeat(PATCH_PX, axis=0)
        regions = [(0, PATCH_PX * n, PATCH_PX, PATCH_PX) for n in range(len(patches))]
        figures = colour_chart(planes, regions).quantities
        return {"": {one.symbol: Said(*3 * (one.value,)) for one in figures}}

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """Nothing: theory stands in the table."""

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """The patches behind all colour filters together."""
        return [_measure(taken.bench, patches_of(taken.facts))]


def _measure(bench: Bench, patches: Patches) -> Measured:
    """The instrument on one plane for each colour filter, the mean of its places in the mosaic."""
    tile = bench.stacks[0].tile or (("",),)
    regions = [
        (top // len(tile), left // len(tile[0]), rows // len(tile), columns // len(tile[0]))
        for top, left, rows, columns in patches.regions
    ]
    try:
        planes = planes_of_filters(bench)
        if len(planes) < CHANNELS:
            raise InputError(
                f"the frames have {len(planes)} colour filter(s); a colour matrix needs {CHANNELS}: give the tile in "
                "bench.toml."
            )
        chart = colour_chart(np.stack(list(planes.values()), axis=2), regions)
    except InputError as error:
        return Measured("", (), refused=(str(error),))
    return Measured("", chart.quantities, {"Colours in CIELAB": chart.plot})


def planes_of_filters(bench: Bench) -> dict[str, Float64Array]:
    """The picture behind each colour filter, the mean of its places in the mosaic. Raises InputError without dark
    frames or pictures."""
    planes: dict[str, list[Float64Array]] = {}
    for name, part in bench.of_filters().items():
        own = planes.setdefault(name.partition(" (")[0], [])
        own.append(without_black(part.scenes, part))
    return {name: np.asarray(np.mean(own, axis=0)) for name, own in planes.items()}


def _patch_side(camera: Camera) -> tuple[int, int]:
    """Rows and columns of a patch in the frames, whole tiles."""
    rows, columns = chart_shape(camera, ROWS * PATCH_PX, COLUMNS * PATCH_PX)
    tile = len(camera.tile), len(camera.tile[0])
    return rows // ROWS // tile[0] * tile[0], columns // COLUMNS // tile[1] * tile[1]


def _patch_photons(setting: Setting, light: ChartLight) -> Float64Array:
    """Mean photons per pixel of every patch (P, B), the brightest near saturation behind the filter that sees most."""
    camera, bands = setting.camera, light.data.shape[-1]
    patches = light.data.reshape(ROWS, RENDERED_PX, COLUMNS, RENDERED_PX, bands)
    inside = slice(MARGIN_PX, -MARGIN_PX)
    means = patches[:, inside, :, inside].mean(axis=(1, 3)).reshape(-1, bands)
    photons = light.photons(camera, setting.exposure, means)
    most_e = levels_of_filters(camera, photons, light.bands).max()
    return np.asarray(photons * (BRIGHTEST * saturation_e(camera) / most_e))
