"""What commands say of their results, as tables and lines; :mod:`mitsuba_sensor.cli.app` prints them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from ..core import by_weight
from ..theory.plan import Plan
from ..theory.plan_trial import IDLE, NEEDED
from .tables import ResultTable, number, rough

NOTES_MAX = 4
"""Notes that are printed."""
DIGITS = re.compile(r"\d[\d.,]*")
GROUP_NAMES = re.compile(r"^(?:[A-Za-z][\w-]*, )*[A-Za-z][\w-]*: ")
"""Names of light groups in front of a note."""
WHOLE = "the signal after each stage beside its theory, all facts and notes: frame.json"


COUNTED = {
    "clipped_full_well": "at the full well",
    "clipped_adc_high": "at the highest code",
    "clipped_adc_low": "at code 0",
    "cut_to_zero_prnu": "whose gain would be negative by its distribution, taken as 0",
    "cut_to_zero_prnu_col": "whose column's gain would be negative by its distribution, taken as 0",
    "cut_to_zero_dark_fpn": "whose dark current would be negative by its distribution, taken as 0",
    "negative": "with negative light, taken as none",
    "non_finite": "with light that is no number",
}
"""Count → what so many pixels are."""
Report = Mapping[str, Any]  # ready for JSON: frame.json, or what a command prints
KEPT = {True: Text("yes"), False: Text("no", style="green")}  # of a plan
END = {"max_seconds": ", the time was up", "max_spp": ", the most samples were taken"}


def summary(report: Report, folder: str) -> RenderableType:
    """Camera and exposure, signal and noise, the render's noise, and the notes that matter most."""
    notes, left_out = notes_shown(report["notes"])
    lines = [Text.assemble(("note: ", "bold yellow"), note) for note in notes]
    if left_out:
        lines.append(Text(f"{left_out} more notes: frame.json"))
    return Group(head_of(report, folder), *_facts(report), *lines, Text(WHOLE, style="dim"))


def _facts(report: Report) -> Iterator[Text]:
    last = report["stages"][-1]
    mean, sigma, expected = (
        number(last[key]) for key in ("mean_frame", "sigma_frame", "sigma_expected")
    )
    unit = last["unit"]
    yield fact(
        "signal",
        f"{mean} {unit} on average, with a noise of σ = {sigma} {unit} ({expected} by theory)",
    )
    photons = report["photons"]
    yield fact(
        "photoelectrons per pixel" if photons["detected"] else "photons per pixel",
        f"{number(photons['min'])} … {number(photons['median'])} … {number(photons['max'])} (min, median, max)",
    )
    noise, render = report["render_noise"], report["render"]
    said = "none, because there is no light"
    if report["photons"]["max"]:
        denoised = ", denoised" if render["denoised"] else ""
        ended = ended_by(render["noise_ratio_asked"], render["ended_by"])
        said = (
            f"its variance is {number(noise['over_sensor_median'])} × the sensor's in the median pixel; "
            f"{render['samples_per_pixel']} samples per pixel{denoised}{ended}"
        )
    yield fact("render noise", said)
    yield from brightness_of(report)
    yield pixels_of(report)
    yield from pictures_of(report)
    yield from left_out_of(report)


def notes_shown(notes: Iterable[str]) -> tuple[list[str], int]:
    """The notes that are printed, and how many are not: those that change most come first, and notes that differ in
    their numbers or light groups alone are one."""
    alike: dict[str, list[str]] = {}
    for note in by_weight(notes):
        alike.setdefault(DIGITS.sub("", GROUP_NAMES.sub("", note)), []).append(note)
    shown = [
        f"{first} ({len(others)} more notes are alike)" if others else first
        for first, *others in alike.values()
    ]
    return shown[:NOTES_MAX], max(len(shown) - NOTES_MAX, 0)


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


def plan_sheet(plan: Plan) -> RenderableType:
    """What a plan keeps and leaves out, with the effect in DN."""
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
    return Group(Text(head, style="bold"), _effects(plan), *lines)


def _effects(plan: Plan) -> ResultTable:
    """One row per stage that does something and can be left out."""
    table = ResultTable(
        ("stage", "needed", "mean", "temporal", "spatial", "lines", "pixels"),
        caption="what leaving out each changes [DN]; lines: what a row or column shares, times √length; pixels: how "
        "many of them change by more than the tolerance",
    )
    for e in plan.effects:
        if e.reason not in (IDLE, NEEDED):
            table.add_row(e.stage, KEPT[e.kept], *map(rough, e.columns))
    return table


def map_list(spread: Report, what: str) -> RenderableType:
    """The FPN maps of a camera: name, shape, mean and spread of each.  what : was written."""
    caption = "gains and dark factors are 1 on average; offsets are in electrons"
    table = ResultTable(("map", "shape", "mean", "σ"), caption=caption)
    for name, x in spread.items():
        table.add_row(
            name, " × ".join(map(str, x["shape"])), number(x["mean"]), number(x["sigma"])
        )
    return Group(Text(f"wrote {what}", style="bold"), table)


def diagnosis(findings: Report) -> RenderableType:
    """What works on this machine, as tables, and the commands that repair what does not."""
    variants = ResultTable(("variant", "renders?", "why"))
    yes = {True: Text("yes", style="green"), False: Text("no", style="red")}
    for one in findings["variants"]:
        variants.add_row(one["name"], yes[one["works"]], Text(one["reason"]))
    python = findings["python"]
    variants.add_row("mi.render in Python", yes[python["works"]], Text(python["reason"]))
    llvm = ResultTable(("LLVM", "used?", "library", "why"))
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
    seen = [
        f"{n} {COUNTED.get(name) or name.replace('_', ' ')}"
        for name, n in report["counts"].items()
        if n
    ]
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
    return Text.assemble((f"{name}: ", "bold"), text)


def path_fact(name: str, path: str) -> Text:
    """A line with a path, which is not broken, so that it can be copied and searched for."""
    line = fact(name, path)
    line.no_wrap, line.overflow = True, "ignore"
    return line
