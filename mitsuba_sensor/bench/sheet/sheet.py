"""The sheet of a camera: one loop over charts and settings; its rows are figures next to theory."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from ...camera.camera import Camera
from ...camera.figures import refuse_readouts
from ...core import InputError, nearest
from ...core.types import Float64Array
from ...files.texts import Facts, read_toml
from ...lab.frames.bench import Bench, read_bench
from ...lab.frames.stack import rounding_shift_dn
from ...lab.quantity import Quantity, no_value
from ..datasheet import SIGMAS, Datasheet, Said, of_filter
from ..figures_page import beside_datasheet, has_interval
from .chart import Chart, Draw, Lights, Measured, Setting, Taken
from .charts import CHARTS
from .closed_forms import ROUNDING_DN, closed_form, theory_of_bench
from .light import light_of

Report = Callable[[int, int, str], None]
RENDER_NOISE = no_value(
    "ε_render", "render noise of the light, over the brightest", "%", "mitsuba-sensor"
)
FACTS = "chart.toml"
SHIFT_MIN_DN = 1e-3
"""Smallest shift of a black level that widens theory [DN]."""


@dataclass(frozen=True)
class Row:
    """One figure of the sheet.

    filter_name : of the colour filter, or empty.  gain, temperature_k : of the setting.
    said : theory with the range of single sensor units, or None.
    """

    chart: str
    filter_name: str
    gain: str
    temperature_k: float | None
    quantity: Quantity
    said: Said | None = None

    @property
    def beside(self) -> Mapping[str, float]:
        """Theory and the distance from it; empty without theory and for figures without an interval."""
        if self.said is None or not has_interval(self.quantity):
            return {}
        return beside_datasheet(self.quantity, {self.quantity.symbol: self.said})

    def to_dict(self) -> Facts:
        """Return the values of one line of sheet.json and sheet.csv; None for no number."""
        quantity, said = self.quantity, self.said or Said(*3 * (math.nan,))
        numbers = {"value": quantity.value, "low": quantity.low, "high": quantity.high}
        numbers |= {"theory": said.value, "theory_low": said.low, "theory_high": said.high}
        numbers |= {name: self.beside.get(name, math.nan) for name in ("z", "z_of_chip")}
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
    """Results of one chart at one setting.

    drawings : by title, for each filter the drawing of the measurement and of theory, or None.
    picture : the first frame, or None.  tile : rows and columns of its mosaic.  refused : sentences.
    at_kelvin : returns theory at another temperature, or None.
    """

    name: str
    title: str
    setting: str
    rows: Sequence[Row]
    drawings: Mapping[str, Sequence[tuple[str, Draw, Draw | None]]] = field(
        default_factory=dict
    )
    picture: Float64Array | None = None
    refused: Sequence[str] = ()
    tile: tuple[int, int] = (1, 1)
    at_kelvin: Callable[[float], Datasheet] | None = None


def settings_of(
    camera: Camera, gains: Sequence[str], kelvins: Sequence[float], unit: tuple[int, int]
) -> list[Setting]:
    """Return every gain ("all" for all gains of the camera) at every temperature.

    unit : serial number, and seed of the temporal noise.  Raises InputError for gains that the camera does not have.
    """
    if list(gains) == ["all"]:
        gains = [one.label for one in camera.gains]
        if not gains:
            raise InputError(f"{camera.name} has no gain settings; omit gains=.")
    if len(set(gains)) < len(gains):
        raise InputError(f"gains= repeats a setting: {', '.join(gains)}; name each once.")
    return [
        Setting(camera.at_gain(gain or None), gain, kelvin, *unit)
        for gain in gains or [""]
        for kelvin in kelvins
    ]


def simulated_sheet(
    camera: Camera, settings: Sequence[Setting], charts: Sequence[Chart], report: Report
) -> list[ChartPart]:
    """Measure every chart at every setting of a simulated camera.

    report : gets the number of steps done, their total, and the current step.
    Raises InputError for a camera with several readouts, and if no chart suits the camera.
    """
    refuse_readouts(camera, "a sheet measures one of them")
    charts = [chart for chart in charts if len(camera.filter_names) >= chart.filters]
    if not charts:
        raise InputError(
            f"{camera.name} has one colour filter, and the chart colours needs three; choose other charts=."
        )
    scenes = [(chart, scene) for chart in charts for scene in chart.scenes(camera)]
    total = len(scenes) + len(settings) * len(charts)
    lights: dict[str, list[object]] = {chart.name: [] for chart in charts}
    for number, (chart, scene) in enumerate(scenes):
        report(number, total, f"light of {scene.name}")
        lights[chart.name].append(light_of(scene, camera))
    parts: list[ChartPart] = []
    for setting in settings:
        for chart in charts:
            where = named(setting.gain, setting.temperature_k)
            report(len(scenes) + len(parts), total, f"{chart.name} at {where}")
            parts.append(simulated_part(chart, setting, lights[chart.name]))  # type: ignore[arg-type]
    return parts


def simulated_part(chart: Chart, setting: Setting, lights: Lights) -> ChartPart:
    """Measure one chart at one setting; a chart that the camera cannot have is a sentence."""
    name, where = chart.name, named(setting.gain, setting.temperature_k)
    try:
        taken = chart.frames(setting, lights)
        ideal = theory_of(chart, taken)
        closed = closed_form(name, setting, lights) if chart.closed_form else {}
    except InputError as error:
        return ChartPart(name, chart.title, where, (), refused=(str(error),))
    said = closed or _said(chart, taken, ideal)
    part = part_of_frames(chart, name, replace(taken, is_alike=False), said, ideal)
    if chart.closed_form:
        part = replace(part, at_kelvin=partial(_at_kelvin, name, setting, lights))
    if not lights:
        return part
    percent = max(light.render_noise_percent for light in lights)
    quantity = replace(RENDER_NOISE, value=percent, low=percent, high=percent)
    last = Row(name, "", setting.gain, setting.temperature_k, quantity)
    return replace(part, rows=[*part.rows, last])


def _at_kelvin(name: str, setting: Setting, lights: Lights, kelvin: float) -> Datasheet:
    return closed_form(name, setting._replace(temperature_k=kelvin), lights)


def theory_of(
    chart: Chart, taken: Taken, pictures: Float64Array | None = None
) -> dict[str, Measured]:
    """Measure the noise-free images with the instrument, by filter; empty without such images."""
    pictures = taken.ideal if pictures is None else pictures
    if pictures is None:
        return {}
    scene, dark = taken.bench.scenes[0], taken.bench.darks[0]
    ideal = replace(scene, frames=pictures, bits=None)
    black = replace(dark, frames=np.zeros((1, *scene.shape)), bits=None)
    measured = chart.instrument(replace(taken, bench=Bench((), (black,), (), (ideal,))))
    return {one.filter_name: one for one in measured}


def _said(chart: Chart, taken: Taken, ideal: Mapping[str, Measured]) -> Datasheet:
    """Return theory with the range of single sensor units, and of units whose black level rounding shifts."""
    units = [theory_of(chart, taken, pictures) for pictures in taken.chips]
    shifted = [theory_of(chart, taken, pictures) for pictures in _shifted_by_rounding(taken)]
    said: dict[str, dict[str, Said]] = {}
    for name, measured in ideal.items():
        said[name] = {}
        for figure in measured.figures:
            symbol, value = figure.symbol, figure.value
            others, ends = (
                [x.value for one in several for x in one[name].figures if x.symbol == symbol]
                for several in (units, shifted)
            )
            spread = SIGMAS * float(np.std(others)) if others else 0.0
            if math.isfinite(value):
                low, high = min([value, *ends]), max([value, *ends])
                said[name][symbol] = Said(value, low - spread, high + spread)
    return said


def _shifted_by_rounding(taken: Taken) -> list[Float64Array]:
    """Return the noise-free images above the lowest and highest black level of rounding; none if noise hides it."""
    scene, dark = taken.bench.scenes[0], taken.bench.darks[0]
    black_dn = min(SIGMAS * rounding_shift_dn(float(dark.variance.mean())), ROUNDING_DN)
    if taken.ideal is None or black_dn < SHIFT_MIN_DN:
        return []
    step = black_dn * float(taken.ideal.mean()) / float((scene.mean - dark.mean).mean())
    return [taken.ideal - step, taken.ideal + step]


def part_of_frames(
    chart: Chart, name: str, taken: Taken, theory: Datasheet, ideal: Mapping[str, Measured]
) -> ChartPart:
    """Measure frames with the instrument of a chart.  name : of the chart on the sheet."""
    first = next(iter((*taken.bench.flats, *taken.bench.scenes, *taken.bench.stacks)))
    rows: list[Row] = []
    drawings: dict[str, list[tuple[str, Draw, Draw | None]]] = {}
    refused: list[str] = []
    for measured in chart.instrument(taken):
        filter_name = measured.filter_name
        said = of_filter(theory, filter_name)
        rows += [
            Row(name, filter_name, first.gain, first.temperature_k, one, said.get(one.symbol))
            for one in measured.figures
        ]
        drawn = ideal[filter_name].drawings if chart.drawn and filter_name in ideal else {}
        for title, draw in measured.drawings.items():
            drawings.setdefault(title, []).append((filter_name, draw, drawn.get(title)))
        where = f" (filter {filter_name})" if filter_name else ""
        refused += [f"{sentence}{where}" for sentence in measured.refused]
    tile = first.tile or (("",),)
    picture = next((stack.frames[0] for stack in taken.bench.scenes), None)
    where = named(first.gain, first.temperature_k)
    shape = len(tile), len(tile[0])
    return ChartPart(name, chart.title, where, rows, drawings, picture, refused, shape)


def named(gain: str, temperature_k: float | None) -> str:
    """Return the name of a setting: ``800, 298.15 K``."""
    temperature = None if temperature_k is None else f"{temperature_k:g} K"
    return ", ".join(filter(None, (gain, temperature))) or "its only setting"


def rows_of(parts: Sequence[ChartPart]) -> list[Row]:
    """Return all rows, in the order of charts and settings."""
    return [row for part in parts for row in part.rows]


def sheet_of_frames(path: Path, camera: Camera | None, report: Report) -> list[ChartPart]:
    """Measure frames of a real camera, each gain setting separately.

    path : of a folder with a folder for each chart, which contains bench.toml and chart.toml.
    camera : its datasheet is shown next to the EMVA 1288 figures, or None.
    """
    folders, parts = chart_folders(path), []
    for number, (folder, chart) in enumerate(folders.items()):
        report(number, len(folders), f"measuring {folder.name}")
        bench, facts = read_bench(folder), facts_of(folder)
        for gain in bench.gains:
            taken = Taken(bench.at_gain(gain), facts)
            theory: Datasheet = {}
            if camera is not None and chart.kind == "emva":
                theory = theory_of_bench(camera, taken.bench)
            parts.append(part_of_frames(chart, folder.name, taken, theory, {}))
    return parts


def chart_folders(path: Path) -> dict[Path, Chart]:
    """Return the folders of charts and the chart that begins each folder's name. Raises InputError without any."""
    if not path.is_dir():
        raise InputError(
            f"frames= {path} is not a folder; give a folder with a folder for each chart."
        )
    of_kind: dict[str, Chart] = {}
    for chart in CHARTS:
        of_kind.setdefault(chart.kind, chart)
    begin = f"their names begin with {', '.join(of_kind)}; see docs/image-quality.md."
    folders = {}
    for folder in sorted(one for one in path.iterdir() if one.is_dir()):
        kind = next((kind for kind in of_kind if folder.name.startswith(kind)), None)
        if kind is not None:
            folders[folder] = of_kind[kind]
        elif meant := nearest(folder.name, of_kind):
            raise InputError(f"{folder} is not a folder of a chart; {begin}{meant}")
    if not folders:
        raise InputError(f"{path} has no folder of a chart; {begin}")
    return folders


def facts_of(folder: Path) -> Facts:
    """Return the contents of ``chart.toml``, if the folder has it. Raises InputError for invalid TOML."""
    file = folder / FACTS
    if not file.exists():
        return {}
    try:
        facts = read_toml(file)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{file} is not valid TOML: {error}.") from None
    if isinstance(facts.get("chart"), str):
        facts["chart"] = folder / facts["chart"]
    return facts
