"""A slanted edge on the sheet: modulation transfer behind each colour filter, beside pixel × lens × coupling.

The edge is lit by a narrow lamp for each filter, at the wavelength where that sees most, and seen through a telecentric
lens: the middle of the picture. Light areas are even, so that all that the render adds lies along the edge.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...camera.figures import saturation_e
from ...core import InputError
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.frames.stack import Stack
from ...lab.measure.image_quality.modulation import Modulation
from ...lab.measure.image_quality.slanted_edge import slanted_edge
from ...lab.quantity import Quantity
from ..datasheet import Said
from .chart import Lights, Measured, Taken, Theory
from .edge_theory import Transfer, picture_of_edge, transfer_of
from .light import NARROW_NM, ChartScene
from .scene_text import emitter_rectangle, telecentric_scene
from .setting import Bands, Setting, chart_shape, levels_of_filters, take

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ANGLE_DEG = 5.0
"""Of the edge from the columns or the rows."""
LENGTH_PX, WIDTH_PX = 128, 64
"""Along and across the edge, behind each place of the mosaic."""
DARK_SIDE, BRIGHT_SIDE = 0.1, 0.5
"""Light of the dark side over the bright one, and of that over saturation."""
SAMPLES = 512
FRAMES, FLATS, DARKS = 4, 16, 16
FREQUENCIES = 0.125, 0.25, 0.5
"""At which the modulation is on the sheet [cycles per pixel]."""


class EdgeChart(NamedTuple):
    """An edge that is nearly along the columns, or along the rows."""

    name: str
    title: str
    along_rows: bool = False
    kind: str = "edge"

    def shape(self, camera: Camera) -> tuple[int, int]:
        """Rows and columns of its picture."""
        if self.along_rows:
            return chart_shape(camera, WIDTH_PX, LENGTH_PX)
        return chart_shape(camera, LENGTH_PX, WIDTH_PX)

    @property
    def normal_deg(self) -> float:
        """Direction in which the edge becomes bright, from the rows, anticlockwise."""
        if self.along_rows:
            return 90 + ANGLE_DEG
        return ANGLE_DEG

    def suits(self, camera: Camera) -> bool:
        """Every camera."""
        return True

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """One for the lamp of each colour filter; without diffraction the light of all lamps has one shape."""
        shape, far = self.shape(camera), 1e5
        sides = [
            emitter_rectangle((far, 0), (far, far), self.normal_deg, 1.0),
            emitter_rectangle((-far, 0), (far, far), self.normal_deg, DARK_SIDE),
        ]
        text = telecentric_scene(shape, sides)
        return [
            ChartScene(f"{self.name}-{lamp_nm:g}", text, SAMPLES, lamp_nm)
            for lamp_nm in rendered_nm(camera)
        ]

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Pictures of the edge, of the bright side alone, and dark frames."""
        bands = bands_of_lamps(setting.camera)
        photons = lamp_photons(setting, lights)
        bright = np.broadcast_to(_brightest(photons), photons.shape)
        scene = take(setting, photons, bands, FRAMES, self.name)
        flat = take(setting, bright, bands, FLATS, f"{self.name} flat")
        dark = take(setting, np.zeros(photons.shape), bands, DARKS, f"{self.name} dark")
        return Taken(Bench((), (dark,), (flat,), (scene,)))

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """Modulation of pixel, lens and coupled pixels, of an edge that the same instrument measures."""
        camera, bands = setting.camera, bands_of_lamps(setting.camera)
        brightest = _brightest(lamp_photons(setting, lights))
        electrons = levels_of_filters(camera, np.diag(brightest), bands)  # (lamp, filter)
        theory = {}
        for number, name in enumerate(camera.filter_names):
            transfer = transfer_of(camera, bands.wavelengths_nm, electrons[:, number])
            if transfer is not None:
                step = len(camera.tile), len(camera.tile[0])
                said = _figures_of_theory(transfer, self.shape(camera), self.normal_deg, step)
                theory[name if len(camera.filter_names) > 1 else ""] = said
        return theory

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """The modulation of theory at the frequencies of the sheet."""
        points = [(f, said[f"MTF({f:g})"].value) for f in FREQUENCIES if f"MTF({f:g})" in said]
        if points:
            ax.plot(*zip(*points, strict=True), "kx", markersize=6, label="theory")

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """The modulation transfer behind each place of the mosaic."""
        return [
            measure_plane(name, bench, len(taken.bench.stacks[0].tile) or 1)
            for name, bench in taken.bench.of_filters().items()
        ]


@lru_cache(maxsize=256)
def _figures_of_theory(
    transfer: Transfer, shape: tuple[int, int], normal_deg: float, step: tuple[int, int]
) -> dict[str, Said]:
    """What the instrument finds in an edge without noise.  step : distance of the pixels behind one filter."""
    picture = DARK_SIDE + (1 - DARK_SIDE) * picture_of_edge(transfer, shape, normal_deg)
    edge = slanted_edge(picture[:: step[0], :: step[1]], sample_px=step[0])
    known = [one for one in figures(edge.modulation) if math.isfinite(one.value)]
    return {one.symbol: Said(*3 * (one.value,)) for one in known}


def measure_plane(name: str, bench: Bench, sample_px: int) -> Measured:
    """The instrument on the pixels behind one filter.

    sample_px : distance of these.  Raises nothing: what the instrument refuses is said.
    """
    try:
        edge = slanted_edge(
            without_black(bench.scenes, bench), flat=flat_of(bench), sample_px=sample_px
        )
    except InputError as error:
        return Measured(name, (), refused=(str(error),))
    return Measured(name, figures(edge.modulation), {"Modulation transfer": edge.plot})


def without_black(stacks: Sequence[Stack], bench: Bench) -> Float64Array:
    """Mean of the first of these stacks less that of the dark frames. Raises InputError where either is missing."""
    if not stacks or not bench.darks:
        raise InputError(
            f"{len(stacks)} pictures of the chart and {len(bench.darks)} stacks of dark frames; take both, with names "
            "that begin with scene and dark."
        )
    return np.asarray(stacks[0].mean - bench.darks[0].mean)


def flat_of(bench: Bench) -> Float64Array | None:
    """The flat field of a chart, if it was taken, with every pixel above 0."""
    if not bench.flats:
        return None
    return without_black(bench.flats, bench)


def figures(modulation: Modulation) -> list[Quantity]:
    """MTF50 and the modulation at the frequencies of the sheet."""
    return [modulation.mtf50, *(modulation.at(frequency) for frequency in FREQUENCIES)]


def lamps_nm(camera: Camera) -> list[float]:
    """Where each colour filter sees most [nm], each wavelength once."""
    points = np.array(camera.quantum_efficiency.wavelengths_nm, np.float64)
    peaks = points[camera.qe(points).argmax(axis=1)]
    return sorted(set(peaks.tolist()))


def rendered_nm(camera: Camera) -> list[float]:
    """The lamps whose light is rendered."""
    if camera.lens.diffraction:
        return lamps_nm(camera)
    return lamps_nm(camera)[:1]


def bands_of_lamps(camera: Camera) -> Bands:
    """A narrow band about each lamp."""
    centres = np.array(lamps_nm(camera))
    return Bands(centres, np.full(centres.shape, NARROW_NM))


def lamp_photons(setting: Setting, lights: Lights) -> Float64Array:
    """Mean photons of all lamps (H, W, B), the bright side at its share of saturation."""
    shapes = [light.data / _brightest(light.data) for light in lights]
    return photons_of_shapes(setting.camera, shapes, BRIGHT_SIDE)


def photons_of_shapes(
    camera: Camera, shapes: Sequence[Float64Array], share: float
) -> Float64Array:
    """Mean photons of all lamps (H, W, B): equally many electrons of each where it is seen best.

    shapes : light (H, W, 1) of each lamp, or of one for all.  share : of the saturation of the filter that sees most,
    where shapes are 1.
    """
    bands = bands_of_lamps(camera)
    joined = np.concatenate(shapes, axis=-1)
    joined = np.broadcast_to(joined, (*joined.shape[:2], len(bands.wavelengths_nm)))
    most_e = camera.qe(*bands).max(axis=0)
    total = levels_of_filters(camera, 1 / most_e, bands).max()
    return np.asarray(joined / most_e * (share * saturation_e(camera) / total))


def _brightest(light: Float64Array) -> Float64Array:
    """Light of the bright side, (B,), without the few pixels that render noise makes brighter."""
    return np.asarray(np.quantile(light, 0.75, axis=(0, 1)))


EDGES = (
    EdgeChart("edge_columns", "Slanted edge along the columns: modulation transfer across"),
    EdgeChart("edge_rows", "Slanted edge along the rows: modulation transfer down", True),
)
