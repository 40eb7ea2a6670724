"""A ColorChecker on the sheet: colour differences through the best matrix and white balance, in daylight.

The chart is the scene ``color_checker``, rendered small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core import InputError
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.measure.colour_and_geometry.colour_chart import colour_chart
from ..datasheet import Said
from .black import without_black
from .chart import Lights, Measured, Taken, Theory
from .light import ChartLight, ChartScene
from .patches import Patches, PatchGrid, patches_of, scaled_to_saturation
from .setting import Setting, levels_of_filters
from .transfer import coupling_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GRID = PatchGrid(rows=4, columns=6, rendered_px=16, margin_px=4, patch_px=24)
BRIGHTEST = 0.8
"""Of saturation, behind the filter that sees most."""
SAMPLES = 64
COUNTS = 4, 8
"""Of frames, and of dark ones."""
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
        width = GRID.columns * GRID.rendered_px
        return [ChartScene(self.name, "color_checker", SAMPLES, width=width)]

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the chart and dark ones."""
        (light,) = lights
        patches = _patch_photons(setting, light)
        bench = GRID.take(setting, patches, light.bands, self.name, COUNTS)
        regions = GRID.regions(setting.camera)
        return Taken(bench, {"patches": regions, "exposure_lxs": [0.0] * len(regions)})

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """What the instrument finds in the mean photoelectrons of the patches; of pixels that are not coupled."""
        camera, (light,) = setting.camera, lights
        if coupling_of(camera) != ():
            return {}
        patches = levels_of_filters(camera, _patch_photons(setting, light), light.bands)
        side = GRID.patch_px
        planes = patches.repeat(side, axis=0)[None].repeat(side, axis=0)
        regions = [(0, side * number, side, side) for number in range(len(patches))]
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
    regions = patches.behind_one_filter((len(tile), len(tile[0])))
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


def _patch_photons(setting: Setting, light: ChartLight) -> Float64Array:
    """Mean photons per pixel of every patch, (P, B)."""
    photons = light.photons(setting.camera, setting.exposure, GRID.irradiance(light))
    return scaled_to_saturation(setting.camera, photons, light.bands, BRIGHTEST)
