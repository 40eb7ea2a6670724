"""EMVA 1288 on the sheet: bias, dark and flat frames, all instruments of the laboratory, the datasheet beside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from ...camera.camera import Camera
from ...core import Exposure
from ...lab.frames.bench import Bench
from ...lab.measure.measurement import measure_bench
from ..datasheet import Said, expected
from ..rendered_field import field_at
from ..virtual_bench import Setup, bench_shape, best_wavelength_nm, virtual_bench
from .chart import Lights, Measured, Taken, Theory
from .light import ChartScene
from .setting import Setting

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TEMPERATURE_K = 298.15
"""Of frames that do not say theirs."""
SIDE = 384
"""Of the middle of the sensor that is measured: standard deviations are within 0.2 %, of each filter within 0.4 %."""
DRAWN = (
    "Photon transfer, logarithmic",
    "Signal-to-noise ratio, logarithmic",
    "Linearity",
    "Non-uniformity",
    "Spectrogram, horizontal, half saturation",
    "Dark current",
)
"""Plots on the sheet; `characterize` draws all."""


class EmvaChart(NamedTuple):
    """No chart, but even light that is exactly known, from darkness to above saturation."""

    name: str = "emva"
    kind: str = "emva"
    title: str = "EMVA 1288: noise, sensitivity, non-uniformity, dark current"

    def suits(self, camera: Camera) -> bool:
        """Every camera."""
        return True

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """None: even light needs no render."""
        return []

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """The frames of ``characterize``, of a smaller part of the sensor."""
        setup = Setup(
            setting.temperature_k,
            best_wavelength_nm(setting.camera),
            setting.serial,
            setting.seed,
            SIDE,
        )
        bench = virtual_bench(setting.camera, setup)
        named = bench.change(lambda stacks: [replace(one, gain=setting.gain) for one in stacks])
        return Taken(named)

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """Figures of the datasheet, by filter."""
        camera = setting.camera
        rows, columns = len(camera.tile), len(camera.tile[0])
        height, width = bench_shape(camera, SIDE)
        pixels = (height // rows) * (width // columns)
        return _of_datasheet(camera, setting.exposure, best_wavelength_nm(camera), pixels)

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """Nothing: theory stands in the table."""

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """All instruments of the laboratory."""
        measured = []
        for found in measure_bench(taken.bench):
            refused = [f"{title}: {sentence}" for title, sentence in found.refused.items()]
            figures = tuple(found.figures.values())
            drawings = {
                title: found.drawings[title] for title in DRAWN if title in found.drawings
            }
            measured.append(Measured(found.filter_name, figures, drawings, refused))
        return measured


def theory_of_bench(camera: Camera, bench: Bench) -> Theory:
    """Figures of a datasheet beside frames from disk, in the exposure of their flat fields."""
    first = next(iter((*bench.flats, *bench.stacks)))
    kelvin = TEMPERATURE_K if first.temperature_k is None else first.temperature_k
    exposure = Exposure(min(one.exposure_s for one in bench.flats or (first,)), kelvin)
    pixels = next(iter(first.of_filters().values())).mean.size
    return _of_datasheet(camera, exposure, bench.wavelength_nm, pixels)


def _of_datasheet(
    camera: Camera, exposure: Exposure, wavelength_nm: float | None, pixels: int
) -> Theory:
    """Figures by filter.  wavelength_nm : of the light, or None.  pixels : that are measured behind each filter."""
    names = camera.filter_names if len(camera.filter_names) > 1 else ("",)
    theory = {}
    for number, name in enumerate(names):
        efficiency = None
        if wavelength_nm is not None:
            efficiency = float(field_at(camera, wavelength_nm).efficiency[number])
        theory[name] = expected(camera, exposure, efficiency, pixels)
    return theory
