"""Tables and progress bars of the terminal; :mod:`mitsuba_sensor.cli.app` prints them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console, Group, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from ..render.passes import MOST_IN_ALL
from ..render.render_noise import LITTLE_NOISE
from ..sensor.plan import IDLE, NEEDED, Plan
from ..study import page

if TYPE_CHECKING:
    from ..render.requirements import RenderRequirement
    from ..render.stop_criterion import RenderProgress

Report = Mapping[str, Any]  # ready for JSON: frame.json, or what a command prints
KEPT = {True: Text("yes"), False: Text("no", style="green")}  # of a plan
STYLES = {"good": "green", "bad": "bold red", "best": "bold green", "dim": "dim", "": ""}  # of a mark
LONGEST = 48  # rows of a table that a terminal still shows; of a longer one only those that are not as they must be
END = {"max_seconds": ", the time was up", "max_spp": ", the most samples were taken"}


@contextmanager
def render_progress(console: Console, options: Mapping[str, object]) -> Iterator[Callable[[RenderProgress], None]]:
    """A bar over the passes of a render, or over frames with a render each; nothing where nobody watches.

    Beside it the noise ratio as it falls, and a forecast. Yields what ``capture`` takes as its progress.
    """
    frames, first = options.get("frames", 1), options.get("first_frame", 0)
    assert isinstance(frames, int) and isinstance(first, int)
    count = 1 if options.get("render_noise", "shared") == "shared" else frames
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TextColumn("{task.fields[ratio]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("rendering", total=None, ratio="", left="")

        def show(step: RenderProgress) -> None:
            number = 0 if count == 1 else step.frame - first
            name = "rendering" if count == 1 else f"frame {step.frame}"
            completed, total = number * step.expected + step.done, count * step.expected
            ratio = "" if math.isnan(step.noise_ratio) else f"render noise {_number(step.noise_ratio)} × the sensor's"
            left = "" if math.isnan(step.seconds_left) else f"about {step.seconds_left:.0f} s left"
            progress.update(task, description=name, completed=completed, total=total, ratio=ratio, left=left)

        yield show


@contextmanager
def seconds_bar(console: Console) -> Iterator[Callable[[float, float, str], None]]:
    """A bar over the seconds that a study expects to take, and what it does now. Yields what a kit reports to."""
    texts = TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn(), TextColumn("{task.description}")
    with Progress(BarColumn(), *texts, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=None)

        def tell(done_s: float, expected_s: float, now: str) -> None:
            left_s = max(expected_s - done_s, 0.0)
            left = f"about {left_s / 60:.0f} min" if left_s > 90 else f"about {left_s:.0f} s"
            if progress.tasks[task].total is None:
                console.print(f"this takes {left}", highlight=False)
            progress.update(task, completed=done_s, total=expected_s, description=f"{left} left [dim]{now}")

        yield tell


def summary(report: Report, folder: str) -> RenderableType:
    """A frame in short: photons, the signal after each stage in theory and in the frame, noise by source."""
    image, exposure = report["image"], report["exposure"]
    size = f"{image['columns']} × {image['rows']}, {image['frames']} frame{'s' if image['frames'] > 1 else ''}"
    metered = " (metered)" if report["origin"].get("metering") else ""
    conditions = f", {exposure['time_s']:g} s{metered} at {exposure['temperature_k']:g} K, {size} → "
    head = Text.assemble((report["camera"]["name"], "bold"), conditions, (folder, "bold"))
    said = *report["render"]["notes"], *report["camera"].get("notes", ()), *report["notes"]
    notes = (Text.assemble(("note: ", "bold yellow"), note) for note in said)
    return Group(head, _stages(report), *_facts(report), *notes)


def plan_sheet(plan: Plan, needs: Sequence[RenderRequirement]) -> RenderableType:
    """What a plan keeps and leaves out, sensor and render, with the effect in DN and the time that is saved."""
    held, whole_s, planned_s = plan.range, *plan.seconds
    head = f"{plan.camera}: what is left out moves no light level by more than {plan.tolerance_dn:g} DN in all"
    light = f"{_number(held.darkest_e)} … {_number(held.brightest_e)} mean photoelectrons per pixel"
    conditions = f"{held.exposure.time_s:g} s at {held.exposure.temperature_k:g} K, {held.columns} × {held.rows} pixels"
    below = [e.stage for e in plan.effects if not e.kept and e.reason != IDLE]
    stages = {reason: [e.stage for e in plan.effects if e.reason == reason] for reason in (NEEDED, IDLE)}
    names = {"always needed": stages[NEEDED], "changes nothing": stages[IDLE], "left out beside that": below}
    saved = f"{whole_s:.3g} s a frame with the whole chain, {planned_s:.3g} s with this plan"
    lists = {name: ", ".join(found) or "–" for name, found in names.items()}
    facts = {"holds for": f"{light}, {conditions}", **lists, "time": saved}
    lines = (_fact(name, text) for name, text in facts.items())
    return Group(Text(head, style="bold"), _effects(plan), _needs(needs), *lines, Text(plan.float32.explain()))


def _effects(plan: Plan) -> Table:
    """One row per stage that does something and can be left out."""
    table = columns_table("stage", "kept", "mean", "temporal", "spatial", "lines", "pixels")
    table.caption = (
        "what each changes by itself at most on this scene [DN]; lines: what a row or column shares, times √length; "
        "pixels that it moves beyond the tolerance"
    )
    for column in table.columns[1:]:
        column.no_wrap, column.justify = True, "right"
    for e in plan.effects:
        if e.reason not in (IDLE, NEEDED):
            numbers = (e.mean_dn, e.temporal_dn, e.spatial_dn, e.structure_dn, e.pixels_beyond)
            table.add_row(e.stage, KEPT[e.kept], *map(_rough, numbers))
    return table


def _needs(needs: Sequence[RenderRequirement]) -> Table:
    """One row per option of the render."""
    table = columns_table("render", "kept", "DN", "why")
    for column in table.columns[:3]:
        column.no_wrap = True
    for need in needs:
        table.add_row(need.what, KEPT[need.kept], _number(need.effect_dn), need.reason)
    return table


def map_list(spread: Report, path: str) -> RenderableType:
    """The FPN maps of a camera: name, shape, mean and spread of each."""
    table = columns_table("map", "shape", "mean", "σ")
    for name, x in spread.items():
        table.add_row(name, " × ".join(map(str, x["shape"])), _number(x["mean"]), _number(x["sigma"]))
    table.caption = "gains and dark factors are 1 on average; offsets are in electrons"
    return Group(Text(f"wrote {path}", style="bold"), table)


def diagnosis(findings: Report) -> RenderableType:
    """What works on this machine, as tables, and the commands that repair what does not."""
    variants = columns_table("variant", "renders?", "why")
    yes = {True: Text("yes", style="green"), False: Text("no", style="red")}
    for one in findings["variants"]:
        variants.add_row(one["name"], yes[one["works"]], Text(one["reason"]))
    llvm = columns_table("LLVM", "usable?", "library", "why")
    for one in findings["llvm"]:
        llvm.add_row(str(one["version"] or "?"), yes[one["usable"]], Text(one["path"]), Text(one["reason"]))
    versions = ", ".join(f"{name} {version or 'missing'}" for name, version in findings["versions"].items())
    remedies = [Text.assemble(("do: ", "bold yellow"), command) for command in findings["remedies"]]
    verdict = Text(f"renders with {findings['variant']}" if findings["works"] else "cannot render", style="bold")
    verdict.stylize("green" if findings["works"] else "red")
    return Group(variants, llvm, Text(versions, style="dim"), verdict, *remedies)


def study_sheet(found: page.Study, path: str, width: int) -> RenderableType:
    """The whole study in the terminal, its findings and as much of its tables as fits into so many characters."""
    verdict = ("everything that must hold does", "bold green") if found.passed else ("not all holds", "bold red")
    lines: list[RenderableType] = [Text.assemble((found.title, "bold"), " – ", verdict, " → ", (path, "bold"))]
    lines += (Text(f"• {finding}") for finding in found.findings)
    for part in found.parts:
        if isinstance(part, page.Grid):
            drawn = columns_table("", *part.columns)
            drawn.title, drawn.title_justify, drawn.title_style = part.title, "left", "bold"
            for name, marks, texts in zip(part.rows, part.marks, part.texts, strict=True):
                drawn.add_row(name, *(Text(cell, STYLES[mark]) for cell, mark in zip(texts, marks, strict=True)))
            lines.append(drawn)
        elif isinstance(part, page.Table) and part.rows:
            held = Text(f"{part.title}: all {len(part.rows)} rows as they must be")
            lines += [held] if set(part.marks) == {"good"} else _study_table(part, width)
    return Group(*lines)


def _study_table(table: page.Table, width: int) -> Iterator[RenderableType]:
    """As many of its columns, from the left, as fit, and what of it stands only in the page."""
    rows = list(zip(table.marks or ("",) * len(table.rows), table.rows, strict=True))
    shown = rows if len(rows) <= LONGEST else [row for row in rows if row[0] in ("bad", "best")][:LONGEST]
    cells = [[f"{v:.3g}" if isinstance(v, float) else page.text(v) for v in row] for _, row in shown]
    columns = zip(table.columns, zip(*cells, strict=True) if cells else [()] * len(table.columns), strict=True)
    longest = (max(map(len, (*heading.split(), "", *column))) for heading, column in columns)  # they break at spaces
    count = max(sum(used <= width for used in accumulate(min(one, 30) + 2 for one in longest)), 1)
    drawn = columns_table(*table.columns[:count])
    for index, column in enumerate(drawn.columns):
        if shown and all(isinstance(row[index], int | float | None) for _, row in shown):
            column.justify = "right"
    for (mark, _), texts in zip(shown, cells, strict=True):
        drawn.add_row(*map(Text, texts[:count]), style=STYLES[mark])
    yield from (Text(f"\n{table.title}", style="bold"), drawn)
    hidden = {"rows": len(rows) - len(shown), "columns": len(table.columns) - count}
    if more := " and ".join(f"{number} more {name}" for name, number in hidden.items() if number):
        yield Text(f"{more} stand in the page", style="dim")


def _stages(report: Report) -> Table:
    """One row per stage: its signal in this frame and in theory, and how far it changes the noise of the raw frame."""
    table = columns_table("after", "", "mean", "theory", "σ", "theory", "temporal", "spatial")
    table.caption = "temporal, spatial: how far this stage changes the noise of the raw frame [DN]"
    for column in table.columns:
        column.no_wrap = True
    for column in table.columns[2:]:
        column.justify = "right"
    effects = {effect["stage"]: effect for effect in report["effects"]}  # the published chain has none
    for stage in report["stages"]:
        effect = effects.get(stage["name"], {})
        if effect.get("reason") == IDLE:
            continue
        scale, unit = (1e3, "mV") if stage["unit"] == "V" else (1.0, stage["unit"])
        signal = [stage[key] for key in ("mean_frame", "mean_expected", "sigma_frame", "sigma_expected")]
        noise = [effect.get(key) for key in ("temporal_dn", "spatial_dn")]
        cells = [_number(value * scale) for value in signal] + [f"{value:.2g}" if value else "" for value in noise]
        table.add_row(stage["name"], Text(unit, style="dim"), *cells)
    return table


def _facts(report: Report) -> Iterator[Text]:
    photons, counts, noise, render = (report[key] for key in ("photons", "counts", "render_noise", "render"))
    ended = _ended(render["noise_ratio_asked"], render["ended_by"])
    yield _fact(
        "photoelectrons per pixel" if photons["detected"] else "photons per pixel",
        f"{_number(photons['min'])} … {_number(photons['median'])} … {_number(photons['max'])} (min, median, max)",
    )
    yield _fact(
        "render noise / sensor noise",
        f"variance × {_number(noise['over_sensor_median'])} median, {_number(noise['over_sensor_p95'])} at the 95th "
        f"percentile: {100 * noise['share_of_variance_median']:.0f} % of the variance of a pixel is the render's "
        f"(median), more than half in {100 * noise['above_sensor']:.0f} % of the pixels; "
        f"{render['samples_per_pixel']} samples per pixel{ended}{_for_less(noise, report)}",
    )
    if "uncompensated" in report["origin"]:
        left, above = (f"{100 * report['origin'][name]:.2g} %" for name in ("uncompensated", "above_shot_noise"))
        left = f"{left} of the shot noise's variance is left on top of it; {above} of the pixels have more render noise"
        yield _fact("a render for every frame", left)
    if done := render["denoised"]:
        before = f"× {_number(done['raw_noise_ratio_median'])} median, {_number(done['raw_noise_ratio_p95'])}"
        yield _fact("denoised", f"by {done['by']}; without it {before} at the 95th percentile (--no-denoise)")
    seen = {name.replace("_", " "): number for name, number in counts.items() if number}
    yield _fact("pixels", ", ".join(f"{name} {number}" for name, number in seen.items()) or "none clipped, none bad")
    outside = report["outside_qe"]
    if outside["share_of_photons"]:
        share = f"{100 * outside['share_of_photons']:.3g} % of the photons"
        yield _fact("not detected", f"{share}, in {len(outside['wavelengths_nm'])} bands beyond the QE curve")
    idle = [effect["stage"] for effect in report["effects"] if effect["reason"] == IDLE]
    if report["left_out"]:
        yield _fact("left out", f"{', '.join(report['left_out'])} (tolerance {report['options']['tolerance_dn']:g} DN)")
    if idle:
        yield _fact("changes nothing", ", ".join(idle))
    single = report["float32"]
    if single and report["precision"] == "float32" and single["share_of_pixels"]:
        share, most = f"{100 * single['share_of_pixels']:.2g} %", f"{single['largest_dn']:g} DN"
        advice = "" if single["precision"] == "float32" else "; --precision float64 is better"
        yield _fact("float32", f"about {share} of the pixels differ from float64, by at most {most}{advice}")
    yield _fact("seconds", ", ".join(f"{name} {seconds:.2f}" for name, seconds in report["times_s"].items()))


def _for_less(noise: Mapping[str, float | None], report: Report) -> str:
    """What a render would take whose noise is a tenth of the sensor's variance."""
    samples, seconds = noise["samples_for_a_tenth"], noise["seconds_for_a_tenth"]
    if samples is None or seconds is None or samples > MOST_IN_ALL or "render" not in report["times_s"]:
        return ""
    takes = f"about {_rough(samples)} samples, {_rough(seconds)} s"
    return f"; × {LITTLE_NOISE:g} takes {takes} (--noise-ratio {LITTLE_NOISE:g})"


def _ended(asked: float | None, end: str) -> str:
    """Whether the noise ratio that was asked for was reached, and what ended the render."""
    reached = "reached" if end == "noise_ratio" else "not reached"
    return ("" if asked is None else f"; {_number(asked)} was asked for and {reached}") + END.get(end, "")


def _fact(name: str, text: str) -> Text:
    return Text.assemble((f"{name}: ", "bold"), text)


def columns_table(*headings: str) -> Table:
    """An empty table under these headings, as every table of the command line looks."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), caption_justify="left")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table


def _number(value: float | None) -> str:
    """Four significant digits, without an exponent where it can be avoided."""
    return "–" if value is None else f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.4g}"


def _rough(value: float) -> str:
    """Two significant digits, no more than six characters for most numbers."""
    return "<0.001" if 0 < value < 1e-3 else f"{value:.0f}" if 10 <= value < 1e6 else f"{value:.2g}"


def short(value: object) -> str:
    """A value on one line; a long list by its ends."""
    if isinstance(value, list | tuple) and len(value) > 6:
        return f"{value[0]} … {value[-1]} ({len(value)} numbers)"
    return str(value)
