"""What commands say of their results, as tables and lines; :mod:`mitsuba_sensor.cli.app` prints them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from ..core.progress import duration
from ..theory.plan import Plan
from ..theory.plan_trial import IDLE, NEEDED
from .counted import counted
from .sentences import said_here
from .tables import FittedTable, number, rough

if TYPE_CHECKING:
    from ..render.passes.requirements import RenderRequirement

Report = Mapping[str, Any]  # ready for JSON: frame.json, or what a command prints
OF_STAGES = (
    "the signal behind each stage: mean of the pixels and standard deviation σ of their noise in this frame, and as "
    "theory expects them. At the sense node the charge becomes a voltage"
)
"""Below the table of a frame."""
UNCERTAIN = 0.03
"""Relative standard error of a σ of the theory from which on it is printed."""
KEPT = {True: Text("yes"), False: Text("no", style="green")}  # of a plan
SIGNAL = (
    "mean_frame",
    "mean_expected",
    "sigma_frame",
    "sigma_expected",
)  # of a stage in a report
END = {"max_seconds": ", the time was up", "max_spp": ", the most samples were taken"}


def summary(report: Report, folder: str) -> RenderableType:
    """A frame in whole: photons, the signal after each stage in theory and in the frame, noise by source, all notes."""
    notes = (
        Text.assemble(("note: ", "bold yellow"), said_here(note)) for note in report["notes"]
    )
    facts = (fact("fact", one) for one in report["render"]["facts"])
    return Group(head_of(report, folder), _stages(report), *_facts(report), *notes, *facts)


def head_of(report: Report, folder: str) -> Text:
    """Camera, exposure and size of the frames, and where they are."""
    image, exposure = report["image"], report["exposure"]
    size = f"{image['columns']} × {image['rows']}, {image['frames']} frame{'s' if image['frames'] > 1 else ''}"
    metered = ""
    if report["origin"].get("metering"):
        metered = " (metered)"
    conditions = (
        f", {exposure['time_s']:g} s{metered} at {exposure['temperature_k']:g} K, {size} → "
    )
    return Text.assemble((_camera_and_gain(report), "bold"), conditions, (folder, "bold"))


def _camera_and_gain(report: Report) -> str:
    """The camera, its gain setting if it has any, and its overall system gain."""
    camera, setting = report["camera"], ""
    if camera["gain"] is not None:
        setting = f" at gain {camera['gain']}"
    elif camera["gains"]:
        setting = " at no gain setting"
    return f"{camera['name']}{setting}, K = {report['K_dn_per_e']:.4g} DN/e-"


def plan_sheet(plan: Plan, needs: Sequence[RenderRequirement]) -> RenderableType:
    """What a plan keeps and leaves out, sensor and render, with the effect in DN."""
    head = (
        f"{plan.camera}: without the stages that are not needed, no sampled pixel changes by more than "
        f"{plan.tolerance_dn:g} DN"
    )
    below = [e.stage for e in plan.effects if not e.kept and e.reason != IDLE]
    stages = {
        reason: [e.stage for e in plan.effects if e.reason == reason]
        for reason in (NEEDED, IDLE)
    }
    names = {
        "always needed": stages[NEEDED],
        "without effect here": stages[IDLE],
        "left out, below the tolerance": below,
    }
    clipped = f"{100 * plan.clipped:.3g} % of {plan.pixels} sampled pixels"
    lists = {name: ", ".join(found) for name, found in names.items() if found}
    facts = {"holds for": plan.conditions, **lists, "clipped": clipped}
    lines = (fact(name, text) for name, text in facts.items())
    tables = [_effects(plan)]
    if needs:
        tables.append(_needs(needs))
    return Group(Text(head, style="bold"), *tables, *lines)


def _effects(plan: Plan) -> FittedTable:
    """One row per stage that does something and can be left out."""
    table = FittedTable(
        ("stage", "needed", "mean", "temporal", "spatial", "lines", "pixels"),
        keys=2,
        caption="what leaving out each changes [DN]; lines: what a row or column shares, times √length; pixels: how "
        "many of them change by more than the tolerance",
    )
    for e in plan.effects:
        if e.reason not in (IDLE, NEEDED):
            table.add_row(e.stage, KEPT[e.kept], *map(rough, e.columns))
    return table


def _needs(needs: Sequence[RenderRequirement]) -> FittedTable:
    """One row per option of the render."""
    table = FittedTable(
        ("of the render", "needed", "changes by", "why"),
        caption="what the render has, and by how much a pixel changes without it [DN]",
    )
    for need in needs:
        table.add_row(
            need.what, KEPT[need.kept], number(need.effect_dn), said_here(need.reason)
        )
    return table


def map_list(spread: Report, what: str) -> RenderableType:
    """The FPN maps of a camera: name, shape, mean and spread of each.  what : was written."""
    caption = "gains and dark factors are 1 on average; offsets are in electrons"
    table = FittedTable(("map", "shape", "mean", "σ"), caption=caption)
    for name, x in spread.items():
        table.add_row(
            name, " × ".join(map(str, x["shape"])), number(x["mean"]), number(x["sigma"])
        )
    return Group(Text(f"wrote {what}", style="bold"), table)


def diagnosis(findings: Report) -> RenderableType:
    """What works on this machine, as tables, and the commands that repair what does not."""
    variants = FittedTable(("variant", "renders?", "why"))
    yes = {True: Text("yes", style="green"), False: Text("no", style="red")}
    for one in findings["variants"]:
        variants.add_row(one["name"], yes[one["works"]], Text(one["reason"]))
    python = findings["python"]
    variants.add_row("mi.render in Python", yes[python["works"]], Text(python["reason"]))
    llvm = FittedTable(("LLVM", "used?", "library", "why"))
    for library in findings["llvm"]:
        version, path = str(library["version"] or "?"), Text(library["path"])
        llvm.add_row(version, yes[library["used"]], path, Text(library["reason"]))
    versions = ", ".join(
        f"{name} {version or 'missing'}" for name, version in findings["versions"].items()
    )
    remedies = [
        Text.assemble(("do: ", "bold yellow"), command) for command in findings["remedies"]
    ]
    verdict = Text(
        f"works: renders with {findings['variant']}"
        if findings["works"]
        else "does not work: no variant of Mitsuba renders",
        style="bold",
    )
    verdict.stylize("green" if findings["works"] else "red")
    return Group(verdict, *remedies, variants, llvm, Text(versions, style="dim"))


def _stages(report: Report) -> FittedTable:
    """One row per stage that does something: its signal in this frame and in theory, and, where a plan was made, how
    far it changes the noise of the raw frame."""
    effects = {effect["stage"]: effect for effect in report["effects"]}
    of_plan = ("temporal", "spatial") if effects else ()
    caption = OF_STAGES
    if effects:
        caption += (
            "; temporal, spatial: how far this stage changes the noise of the raw frame [DN]"
        )
    caption += f"; theory: four samples of {report['theory']['pixels']} pixels"
    if any(map(_is_uncertain, report["stages"])):
        caption += "; ±: standard error of a σ that few very bright pixels make, that of the frame depends on the same"
    table = FittedTable(
        ("after", "", "mean", "theory", "σ", "theory σ", *of_plan), keys=2, caption=caption
    )
    idle = _idle_stages(report)
    for stage in report["stages"]:
        if stage["name"] in idle:
            continue
        scale, unit = (1e3, "mV") if stage["unit"] == "V" else (1.0, stage["unit"])
        cells = [number(stage[key] * scale) for key in SIGNAL]
        if _is_uncertain(stage):
            cells[-1] = f"{cells[-1]}±{rough(_error_of_sigma(stage) * scale)}"
        effect = effects.get(stage["name"], {})
        noise = [effect.get(f"{name}_dn") for name in of_plan]
        cells += [rough(value) if value else "" for value in noise]
        table.add_row(stage["name"], Text(unit, style="dim"), *cells)
    return table


def _error_of_sigma(stage: Report) -> float:
    """Standard error of the σ that theory expects behind a stage, in its unit."""
    parts = [
        float(stage[f"sigma_{part}_expected"] * stage[f"sigma_{part}_error"])
        for part in ("temporal", "spatial")
    ]
    return math.hypot(*parts) / max(float(stage["sigma_expected"]), math.ulp(0.0))


def _is_uncertain(stage: Report) -> bool:
    """Whether the σ that theory expects is known to no better than a few percent."""
    return _error_of_sigma(stage) > UNCERTAIN * float(stage["sigma_expected"])


def _idle_stages(report: Report) -> list[str]:
    """Names of the stages behind which the signal is what it was before: unit, means and σ, in the frame too."""
    seen = [(stage["unit"], *(stage[key] for key in SIGNAL)) for stage in report["stages"]]
    pairs = zip(report["stages"][1:], itertools.pairwise(seen), strict=True)
    return [stage["name"] for stage, (before, behind) in pairs if before == behind]


def _facts(report: Report) -> Iterator[Text]:
    photons, noise, render = (report[key] for key in ("photons", "render_noise", "render"))
    ended = ended_by(render["noise_ratio_asked"], render["ended_by"])
    yield fact(
        "photoelectrons per pixel" if photons["detected"] else "photons per pixel",
        f"{number(photons['min'])} … {number(photons['median'])} … {number(photons['max'])} (min, median, max)",
    )
    said = (
        f"its variance is {number(noise['over_sensor_median'])} × the sensor's in the median pixel, "
        f"{number(noise['over_sensor_p95'])} × at the 95th percentile; it is larger than the sensor's in "
        f"{100 * noise['above_sensor']:.0f} % of the pixels; {render['samples_per_pixel']} samples per pixel{ended}"
    )
    if not photons["max"]:
        said = "none, because there is no light"
    yield fact("render noise", said)
    most = noise["most_samples"]
    if most and noise["over_sensor_median"]:
        ratios = f"{number(noise['most_samples_median'])} × and {number(noise['most_samples_p95'])} ×"
        more_s = duration(noise["most_samples_more_s"])
        yield fact(
            "with more samples",
            f"--spp {most:.0f} is expected to bring these two to {ratios}, in {more_s} more",
        )
    if "uncompensated" in report["origin"]:
        left, above = (report["origin"][name] for name in ("uncompensated", "above_shot_noise"))
        left = (
            f"render noise makes the variance {number(left)} × the shot noise's larger, on average over the pixels; "
            f"in {100 * above:.2g} % of the pixels it is more than the shot noise"
        )
        yield fact("a render for every frame", left)
    if done := render["denoised"]:
        before = (
            f"{number(done['raw_noise_ratio_median'])} × in the median pixel and "
            f"{number(done['raw_noise_ratio_p95'])} × at the 95th percentile"
        )
        before = f"; without it (--no-denoise) the render noise would be {before}"
        known = {"camera", "exposure"} <= set(
            report["origin"].get("as_rendered", ("camera", "exposure"))
        )
        yield fact(
            "denoised", f"by {done['by']}{before if known else ''}"
        )  # before: of the exposure of the render
    yield from brightness_of(report)
    yield pixels_of(report)
    yield from pictures_of(report)
    idle = _idle_stages(report)
    yield from left_out_of(report)
    if idle:
        yield fact("without effect here", ", ".join(idle))
    yield fact(
        "seconds",
        ", ".join(f"{name} {seconds:.2f}" for name, seconds in report["times_s"].items()),
    )


def brightness_of(report: Report) -> Iterator[Text]:
    """How bright lamps, picture and sensor are, where that is known."""
    from ..render.light.brightness import brightness_sentence

    found = report["render"]["brightness"]
    if found and (said := brightness_sentence(found)):
        yield fact("brightness", said)


def ended_by(asked: float | None, end: str) -> str:
    """Whether the noise ratio that was asked for was reached, and what ended the render."""
    reached = "not reached"
    if end == "noise_ratio":
        reached = "reached"
    return ("" if asked is None else f"; {asked:g} was asked for and {reached}") + END.get(
        end, ""
    )


def pixels_of(report: Report) -> Text:
    """How many pixels are clipped or bad."""
    seen = [f"{n} {counted(name)}" for name, n in report["counts"].items() if n]
    return fact("pixels", ", ".join(seen) or "none clipped, none bad")


def left_out_of(report: Report) -> Iterator[Text]:
    """The stages that a tolerance left out."""
    if report["left_out"]:
        tolerance_dn = report["options"]["tolerance_dn"]
        stages = ", ".join(report["left_out"])
        yield fact("left out", f"{stages} (tolerance {tolerance_dn:g} DN)")


def pictures_of(report: Report) -> Iterator[Text]:
    """Where a dark frame has a brighter picture beside it."""
    if (factor := report["summary"]["brightened"]) > 1:
        brighter = f"frame.png as exposed, frame_brightened.png {factor} × brighter"
        yield fact("pictures", brighter)


def fact(name: str, text: str) -> Text:
    """A line: what it is about, and what is said of it."""
    return Text.assemble((f"{name}: ", "bold"), said_here(text))


def path_fact(name: str, path: str) -> Text:
    """A line with a path, which is not broken, so that it can be copied and searched for."""
    line = fact(name, path)
    line.no_wrap, line.overflow = True, "ignore"
    return line
