"""The sheet of a camera: every chart at every gain and temperature, as rows with theory beside."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from ...camera.camera import Camera
from ...camera.figures import refuse_readouts
from ...core import InputError
from ...core.types import Float64Array
from ...files.texts import Facts
from ...lab.quantity import Quantity, no_value
from ..datasheet import Said
from ..figures_page import beside_datasheet
from .chart import Chart, Lights, Measured, Taken, Theory
from .light import light_of
from .setting import Setting

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Report = Callable[[int, int, str], None]
RENDER_NOISE = no_value(
    "ε_render", "render noise of the light, over the brightest", "%", "mitsuba-sensor"
)


@dataclass(frozen=True)
class Row:
    """One figure of the sheet.

    chart : name of the chart.  filter_name : of the colour filter, or nothing.  gain, temperature_k : of the setting.
    quantity : as it was measured.  said : what theory says of it, and the range of single chips, or None.
    """

    chart: str
    filter_name: str
    gain: str
    temperature_k: float | None
    quantity: Quantity
    said: Said | None = None

    @property
    def beside(self) -> Mapping[str, float]:
        """Theory and distances from it, empty where there is none or nothing was measured."""
        if self.said is None or not math.isfinite(self.quantity.value):
            return {}
        return beside_datasheet(self.quantity, {self.quantity.symbol: self.said})

    def to_dict(self) -> Facts:
        """Plain values of one line of sheet.json and sheet.csv; None where there is no number."""
        quantity, beside = self.quantity, self.beside
        numbers = {
            "value": quantity.value,
            "low": quantity.low,
            "high": quantity.high,
            "theory": math.nan if self.said is None else self.said.value,
            "theory_low": math.nan if self.said is None else self.said.low,
            "theory_high": math.nan if self.said is None else self.said.high,
            "z": beside.get("z", math.nan),
            "z_of_chip": beside.get("z_of_chip", math.nan),
        }
        return {
            "chart": self.chart,
            "filter": self.filter_name,
            "symbol": quantity.symbol,
            "name": quantity.name,
            "unit": quantity.unit,
            "gain": self.gain,
            "temperature_k": self.temperature_k,
            **{name: x if math.isfinite(x) else None for name, x in numbers.items()},
            "section": quantity.section,
            "note": quantity.note,
        }


@dataclass(frozen=True, eq=False)
class ChartPart:
    """What one chart gave at one setting.

    name, title : of the chart.  setting : what it is called.  rows : its figures.  drawings : by title.
    picture : the first frame, or None.  tile : rows and columns of its colour mosaic.  refused : sentences.
    """

    name: str
    title: str
    setting: str
    rows: Sequence[Row]
    drawings: Mapping[str, Callable[[Axes], object]] = field(default_factory=dict)
    picture: Float64Array | None = None
    refused: Sequence[str] = ()
    tile: tuple[int, int] = (1, 1)


def simulated_sheet(
    camera: Camera, settings: Sequence[Setting], charts: Sequence[Chart], report: Report
) -> list[ChartPart]:
    """Every chart at every setting of a simulated camera.

    report : told how many steps are done, how many there are, and what is done now.
    Raises InputError for a camera with several read-outs, and for charts that show nothing of it.
    """
    refuse_readouts(camera, "a sheet has the figures of one of them")
    charts = [chart for chart in charts if chart.suits(camera)]
    if not charts:
        raise InputError(
            f"{camera.name} has one colour filter, and the chart colours needs three; take another of --charts."
        )
    scenes = [(chart, scene) for chart in charts for scene in chart.scenes(camera)]
    total = len(scenes) + len(settings) * len(charts)
    lights: dict[str, Lights] = {chart.name: [] for chart in charts}
    for number, (chart, scene) in enumerate(scenes):
        report(number, total, f"light of {scene.name}")
        lights[chart.name] = [*lights[chart.name], light_of(scene, camera)]
    parts: list[ChartPart] = []
    for setting in settings:
        for chart in charts:
            report(len(scenes) + len(parts), total, f"{chart.name} at {_named(setting)}")
            parts.append(_simulated_part(chart, setting, lights[chart.name]))
    return parts


def _simulated_part(chart: Chart, setting: Setting, lights: Lights) -> ChartPart:
    """One chart at one setting; what the camera cannot do is said."""
    try:
        taken = chart.take(setting, lights)
        theory = chart.theory(setting, lights)
    except InputError as error:
        return ChartPart(chart.name, chart.title, _named(setting), (), refused=(str(error),))
    noise = [light.render_noise_percent for light in lights]
    part = part_of_frames(chart, chart.name, taken, theory)
    if not noise:
        return part
    percent = max(noise)
    quantity = replace(RENDER_NOISE, value=percent, low=percent, high=percent)
    last = Row(chart.name, "", setting.gain, setting.temperature_k, quantity)
    return replace(part, rows=[*part.rows, last])


def part_of_frames(chart: Chart, name: str, taken: Taken, theory: Theory) -> ChartPart:
    """What the instrument of a chart finds in frames.  name : of the chart, on the sheet."""
    first = next(iter((*taken.bench.flats, *taken.bench.scenes, *taken.bench.stacks)))
    gain, temperature_k = first.gain, first.temperature_k
    rows: list[Row] = []
    drawings: dict[str, Callable[[Axes], object]] = {}
    refused: list[str] = []
    for found in chart.measure(taken):
        said = theory.get(found.filter_name.partition(" (")[0], {})
        for quantity in found.figures:
            theory_of = said.get(quantity.symbol)
            rows.append(Row(name, found.filter_name, gain, temperature_k, quantity, theory_of))
        where = _behind(found)
        for title, draw in found.drawings.items():
            drawings[f"{title}{where}"] = partial(_draw_both, draw, chart, said)
        refused += [f"{sentence}{where}" for sentence in found.refused]
    pictures = (stack.frames[0] for stack in taken.bench.scenes)
    tile = first.tile or (("",),)
    return ChartPart(
        name,
        chart.title,
        named(gain, temperature_k),
        rows,
        drawings,
        next(pictures, None),
        refused,
        (len(tile), len(tile[0])),
    )


def _draw_both(
    draw: Callable[[Axes], object], chart: Chart, said: Mapping[str, Said], ax: Axes
) -> None:
    """What was measured, and theory on top."""
    draw(ax)
    chart.draw_theory(said, ax)


def _behind(measured: Measured) -> str:
    """Which filter, for a title."""
    if measured.filter_name:
        return f" behind {measured.filter_name}"
    return ""


def _named(setting: Setting) -> str:
    return named(setting.gain, setting.temperature_k)


def named(gain: str, temperature_k: float | None) -> str:
    """``800, 298.15 K``: what a setting is called."""
    temperature = None if temperature_k is None else f"{temperature_k:g} K"
    return ", ".join(filter(None, (gain, temperature))) or "its only setting"


def rows_of(parts: Sequence[ChartPart]) -> Iterator[Row]:
    """All rows, in the order of charts and settings."""
    for part in parts:
        yield from part.rows
