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
from ...core import InputError
from ...core.types import Float64Array
from ...lab.frames.bench import Bench
from ...lab.measure.image_quality.slanted_edge import slanted_edge
from ..datasheet import Said
from .black import without_black
from .chart import Lights, Measured, Taken, Theory
from .lamps import bands_of_lamps, photons_of_shapes, rendered_nm, transfers_of_filters
from .light import ChartScene
from .modulation import draw_modulation, figures, flat_of, said_of
from .scene_text import emitter_rectangle, telecentric_scene
from .setting import Setting, chart_shape, take
from .transfer import Transfer

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
FINE, PERIOD_PX = 128, 512
"""Points per pixel and length of the edge spread that is computed: frequencies up to 64 cycles per pixel."""


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
        """What the same instrument finds in an edge that the closed form makes."""
        camera = setting.camera
        shape, step = self.shape(camera), (len(camera.tile), len(camera.tile[0]))
        return {
            name: _figures_of_theory(transfer, shape, self.normal_deg, step)
            for name, transfer in transfers_of_filters(camera).items()
        }

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """The modulation of theory at the frequencies of the sheet."""
        draw_modulation(said, ax)

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """The modulation transfer behind each place of the mosaic."""
        return [
            measure_plane(name, bench, len(taken.bench.stacks[0].tile) or 1)
            for name, bench in taken.bench.of_filters().items()
        ]


def picture_of_edge(
    transfer: Transfer, shape: tuple[int, int], normal_deg: float
) -> Float64Array:
    """The picture (H, W) of an edge through the middle that rises from 0 to 1.

    normal_deg : direction in which it rises, from the rows, anticlockwise.
    """
    cosine, sine = math.cos(math.radians(normal_deg)), math.sin(math.radians(normal_deg))
    frequency = np.arange(FINE * PERIOD_PX // 2 + 1, dtype=np.float64) / PERIOD_PX
    line = np.fft.irfft(transfer.at(frequency * cosine, frequency * sine)) * FINE
    line = np.roll(line, FINE * PERIOD_PX // 2)
    distances = np.arange(FINE * PERIOD_PX) / FINE - PERIOD_PX / 2
    spread = (np.cumsum(line) - 0.5 * line) / FINE
    rows, columns = (np.arange(length) + 0.5 - length / 2 for length in shape)
    distance = cosine * columns[None, :] - sine * rows[:, None]
    return np.asarray(np.interp(distance, distances, spread))


@lru_cache(maxsize=256)
def _figures_of_theory(
    transfer: Transfer, shape: tuple[int, int], normal_deg: float, step: tuple[int, int]
) -> dict[str, Said]:
    """What the instrument finds in an edge without noise.  step : distance of the pixels behind one filter."""
    edge = DARK_SIDE + (1 - DARK_SIDE) * picture_of_edge(transfer, shape, normal_deg)
    picture = transfer.with_glare(edge)
    found = slanted_edge(picture[:: step[0], :: step[1]], sample_px=step[0])
    return said_of(found.modulation)


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


def lamp_photons(setting: Setting, lights: Lights) -> Float64Array:
    """Mean photons of all lamps (H, W, B), the bright side at its share of saturation."""
    shapes = [light.data / _brightest(light.data) for light in lights]
    return photons_of_shapes(setting.camera, shapes, BRIGHT_SIDE)


def _brightest(light: Float64Array) -> Float64Array:
    """Light of the bright side, (B,), without the few pixels that render noise makes brighter."""
    return np.asarray(np.quantile(light, 0.75, axis=(0, 1)))


EDGES = (
    EdgeChart("edge_columns", "Slanted edge along the columns: modulation transfer across"),
    EdgeChart("edge_rows", "Slanted edge along the rows: modulation transfer down", True),
)
