"""Charts of patches: a step chart and a ColorChecker.

Every pixel of a patch has the mean light of a smaller patch in the render, so render noise changes the levels of the
patches and not the noise of their pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...camera.figures import saturation_e
from ...core import InputError
from ...core.types import Float64Array
from ...files.texts import Facts
from ...lab.frames.bench import Bench
from ...lab.frames.manifest import is_number
from ...lab.measure.colour_and_geometry.colour_chart import colour_chart
from ...lab.measure.image_quality.patches import Region
from ...lab.measure.image_quality.step_chart import step_chart
from ...lab.quantity import Quantity
from ...optics.spectra import luminous
from .chart import (
    Chart,
    Draw,
    Lights,
    Measured,
    Setting,
    Taken,
    bench_of,
    chart_shape,
    each_filter,
    frames_and_black,
    planes_of_filters,
    step_of,
)
from .light import DAYLIGHT, Bands, ChartLight, ChartScene, emitter_rectangle, telecentric_scene
from .optics import coupling_of, levels_of_filters

STEPS, STEPS_BRIGHTEST = np.concatenate([[0.0], np.geomspace(0.002, 1.0, 15)]), 0.9
"""Reflectances of the step chart, and light of its brightest patch over saturation."""
COLOURS_BRIGHTEST, PATCH_SPP = 0.8, 64
"""Light of the brightest ColorChecker patch over saturation, and samples of the renders."""


class PatchGrid(NamedTuple):
    """Patches of equal size.

    rows, columns : number of patches.  rendered_px : side of a patch in the render.
    margin_px : width of its border that may be frame or blurred by the lens.  patch_px : side in the frames.
    """

    rows: int
    columns: int
    rendered_px: int
    margin_px: int
    patch_px: int

    def irradiance(self, light: ChartLight) -> Float64Array:
        """Return the mean irradiance of every patch without its margin, row by row, (P, B) [W m⁻² nm⁻¹]."""
        side, bands = self.rendered_px, light.data.shape[-1]
        patches = light.data.reshape(self.rows, side, self.columns, side, bands)
        inside = slice(self.margin_px, -self.margin_px)
        return np.asarray(patches[:, inside, :, inside].mean(axis=(1, 3)).reshape(-1, bands))

    def side(self, camera: Camera) -> tuple[int, int]:
        """Return the rows and columns of a patch in the frames, whole tiles of the mosaic."""
        shape = chart_shape(camera, self.rows * self.patch_px, self.columns * self.patch_px)
        tile = len(camera.tile), len(camera.tile[0])
        return (
            shape[0] // self.rows // tile[0] * tile[0],
            shape[1] // self.columns // tile[1] * tile[1],
        )

    def regions(self, camera: Camera) -> list[list[int]]:
        """Return first row, first column, rows and columns of every patch in the frames, as in ``chart.toml``."""
        rows, columns = self.side(camera)
        places = np.ndindex(self.rows, self.columns)
        return [[row * rows, column * columns, rows, columns] for row, column in places]

    def spread(self, camera: Camera, patches: Float64Array) -> Float64Array:
        """Spread values of patches, (P, …), over the pixels of the frames, (H, W, …)."""
        rows, columns = self.side(camera)
        grid = patches.reshape(self.rows, self.columns, -1)
        return grid.repeat(rows, axis=0).repeat(columns, axis=1)


STEPS_GRID, COLOURS_GRID = PatchGrid(4, 4, 12, 3, 40), PatchGrid(4, 6, 16, 4, 24)


def scaled(camera: Camera, photons: Float64Array, bands: Bands, share: float) -> Float64Array:
    """Scale photons (P, B) so the brightest patch has this fraction of saturation under the most sensitive filter."""
    most_e = levels_of_filters(camera, photons, bands).max()
    return np.asarray(photons * (share * saturation_e(camera) / most_e))


def patches_of(facts: Facts) -> tuple[list[Region], list[float]]:
    """Return places and exposures [lx s] of the patches in ``chart.toml``. Raises InputError if they are missing."""
    regions: Any = facts.get("patches")
    exposures: Any = facts.get("exposure_lxs")
    are_regions = isinstance(regions, list) and all(map(_is_region, regions))
    are_exposures = isinstance(exposures, list) and all(map(is_number, exposures))
    if not (are_regions and are_exposures and len(regions) == len(exposures)):
        raise InputError(
            "chart.toml of a chart of patches needs patches = [[first row, first column, rows, columns], …] and "
            "exposure_lxs = […], the illuminance at the focal plane times the exposure time of each patch; "
            "see docs/image-quality.md."
        )
    return [tuple(region) for region in regions], exposures


def _is_region(value: object) -> bool:
    """Return True for four whole numbers of at least 0."""
    if not isinstance(value, list) or len(value) != 4:
        return False
    return all(type(number) is int and number >= 0 for number in value)


def in_plane(regions: Sequence[Region], step: tuple[int, int]) -> list[Region]:
    """Return the regions in one plane of the mosaic."""
    return [
        (top // step[0], left // step[1], rows // step[0], columns // step[1])
        for top, left, rows, columns in regions
    ]


def steps_scenes(camera: Camera) -> list[ChartScene]:
    """Return sixteen grey patches in daylight, in rows from the darkest to the brightest."""
    side, patches = STEPS_GRID.rendered_px, []
    half, reach = side / 2, STEPS_GRID.rows * side / 2
    for number, reflectance in enumerate(STEPS):
        row, column = divmod(number, STEPS_GRID.columns)
        middle = column * side + half - reach, reach - row * side - half
        if reflectance > 0:
            patches.append(emitter_rectangle(middle, (half, half), 0.0, reflectance, DAYLIGHT))
    shape = STEPS_GRID.rows * side, STEPS_GRID.columns * side
    return [ChartScene("steps", telecentric_scene(shape, patches), PATCH_SPP)]


def steps_light(setting: Setting, light: ChartLight) -> tuple[Float64Array, Float64Array]:
    """Return the mean photons per pixel of every patch, (P, B), and its exposure, (P,) [lx s].

    All patches get the lamp's spectrum, which is the mean over the patches.
    """
    means = STEPS_GRID.irradiance(light)
    levels = means @ light.bands.bandwidths_nm
    irradiance = levels[:, None] * means.sum(axis=0) / levels.sum()
    photons = light.photons(setting.camera, setting.exposure, irradiance)
    bright = scaled(setting.camera, photons, light.bands, STEPS_BRIGHTEST)
    lux = np.array([luminous(light.bands.wavelengths_nm, spectrum) for spectrum in irradiance])
    return bright, lux * bright[-1].sum() / photons[-1].sum() * setting.exposure.time_s


def steps_frames(setting: Setting, lights: Lights) -> Taken:
    """Take frames of the chart and dark frames."""
    photons, exposures = steps_light(setting, lights[0])
    light = STEPS_GRID.spread(setting.camera, photons)
    bench = bench_of(setting, light, lights[0].bands, "steps", (8, 8))
    regions = STEPS_GRID.regions(setting.camera)
    return Taken(bench, {"patches": regions, "exposure_lxs": exposures.tolist()})


def steps_instrument(taken: Taken) -> list[Measured]:
    """Measure response, speeds and dynamic range."""
    (regions, exposures), step = patches_of(taken.facts), step_of(taken.bench)

    def measure(bench: Bench, _: object) -> tuple[Sequence[Quantity], dict[str, Draw]]:
        frames, black = frames_and_black(bench.scenes, bench)
        chart = step_chart(frames, in_plane(regions, step), exposures, black_dn=black)
        drawings: dict[str, Draw] = {"Response (OECF)": chart.plot}
        return chart.quantities, drawings | {"Signal-to-noise ratio": chart.plot_snr}

    return each_filter(taken, measure)


def colours_scenes(camera: Camera) -> list[ChartScene]:
    """Return the included scene, small."""
    width = COLOURS_GRID.columns * COLOURS_GRID.rendered_px
    return [ChartScene("colours", "color_checker", PATCH_SPP, width=width)]


def colours_frames(setting: Setting, lights: Lights) -> Taken:
    """Take frames of the chart and dark frames."""
    camera, (light,) = setting.camera, lights
    photons = light.photons(camera, setting.exposure, COLOURS_GRID.irradiance(light))
    patches = scaled(camera, photons, light.bands, COLOURS_BRIGHTEST)
    spread = COLOURS_GRID.spread(camera, patches)
    bench = bench_of(setting, spread, light.bands, "colours", (4, 8))
    ideal = None
    if coupling_of(camera) == ():
        levels = COLOURS_GRID.spread(camera, levels_of_filters(camera, patches, light.bands))
        index = camera.filter_index(levels.shape[:2])
        ideal = np.take_along_axis(levels, index[..., None], axis=2)[None, ..., 0]
    regions = COLOURS_GRID.regions(camera)
    return Taken(bench, {"patches": regions, "exposure_lxs": [0.0] * len(regions)}, ideal)


def colours_instrument(taken: Taken) -> list[Measured]:
    """Measure colour differences after the best matrix, for all filters together."""
    regions = in_plane(patches_of(taken.facts)[0], step_of(taken.bench))
    try:
        planes = planes_of_filters(taken.bench)
        if len(planes) < 3:
            raise InputError(
                "the frames have fewer than 3 colour filters, which a colour matrix needs; give the tile in bench.toml."
            )
        chart = colour_chart(np.stack(list(planes.values()), axis=2), regions)
    except InputError as error:
        return [Measured("", (), refused=(str(error),))]
    return [Measured("", chart.quantities, {"Colours in CIELAB": chart.plot})]


PATCH_CHARTS = (
    Chart(
        "steps",
        "steps",
        "Step chart: response, speed, noise, dynamic range",
        steps_scenes,
        steps_frames,
        steps_instrument,
        closed_form=True,
    ),
    Chart(
        "colours",
        "colours",
        "ColorChecker: colour differences and white balance",
        colours_scenes,
        colours_frames,
        colours_instrument,
        filters=3,
        drawn=False,
    ),
)
