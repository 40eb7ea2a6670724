"""Frames of charts in front of a real camera: one folder for each chart, with bench.toml and chart.toml in it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

from ...camera.camera import Camera
from ...core import InputError, nearest
from ...files.texts import Facts, read_toml
from ...lab.frames.bench import read_bench
from .chart import Chart, Taken, Theory
from .charts import CHARTS
from .emva import theory_of_bench
from .sheet import ChartPart, Report, part_of_frames

FACTS = "chart.toml"


def chart_folders(path: Path) -> dict[Path, Chart]:
    """The folders of charts, with what measures each: the chart whose kind its name begins with.

    Raises InputError where there is none.
    """
    if not path.is_dir():
        raise InputError(
            f"--frames {path} is no folder; give one with a folder for each chart."
        )
    of_kind: dict[str, Chart] = {}
    for chart in CHARTS:
        of_kind.setdefault(chart.kind, chart)
    begin = f"their names begin with {', '.join(of_kind)}; see docs/image-quality.md."
    found = {}
    for folder in sorted(one for one in path.iterdir() if one.is_dir()):
        measures = _chart_of(folder, of_kind)
        if measures is not None:
            found[folder] = measures
        elif meant := nearest(folder.name, of_kind):
            raise InputError(f"{folder} is no folder of a chart; {begin}{meant}")
    if not found:
        raise InputError(f"{path} has no folder of a chart; {begin}")
    return found


def _chart_of(folder: Path, of_kind: Mapping[str, Chart]) -> Chart | None:
    """The chart whose kind the name of a folder begins with."""
    for kind, chart in of_kind.items():
        if folder.name.startswith(kind):
            return chart
    return None


def sheet_of_frames(path: Path, camera: Camera | None, report: Report) -> list[ChartPart]:
    """What the instruments find in frames from disk, each gain setting apart.

    camera : whose datasheet stands beside the figures of EMVA 1288, or None.
    Raises InputError for what cannot be read.
    """
    folders = chart_folders(path)
    parts = []
    for number, (folder, chart) in enumerate(folders.items()):
        report(number, len(folders), f"measuring {folder.name}")
        bench, facts = read_bench(folder), facts_of(folder)
        for gain in bench.gains:
            taken = Taken(bench.at_gain(gain), facts)
            theory: Theory = {}
            if camera is not None and chart.kind == "emva":
                theory = theory_of_bench(camera, taken.bench)
            parts.append(part_of_frames(chart, folder.name, taken, theory))
    return parts


def facts_of(folder: Path) -> Facts:
    """What ``chart.toml`` says; nothing without one. The path of a chart is from the folder.

    Raises InputError for a file that is no TOML.
    """
    file = folder / FACTS
    if not file.exists():
        return {}
    try:
        facts = read_toml(file)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{file} is no TOML: {error}.") from None
    if isinstance(facts.get("chart"), str):
        facts["chart"] = folder / facts["chart"]
    return facts
