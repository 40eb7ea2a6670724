"""What `render` and `expose` print of their frames: a dozen lines; frame.json has everything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from ..core import by_weight
from .flag_names import with_flags
from .tables import fact, number

NOTES_MAX = 4
"""Notes that are printed."""
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
END = {"max_seconds": ", the time was up", "max_spp": ", the most samples were taken"}
Report = Mapping[str, Any]  # frame.json


def summary(report: Report, folder: str) -> RenderableType:
    """Camera and exposure, signal and noise, the render's noise, and the notes that matter most."""
    notes = by_weight(report["notes"])
    lines = [
        Text.assemble(("note: ", "bold yellow"), with_flags(note)) for note in notes[:NOTES_MAX]
    ]
    if len(notes) > NOTES_MAX:
        more = len(notes) - NOTES_MAX
        lines.append(Text(f"{more} more note{'s' * (more > 1)}: frame.json"))
    facts = (fact(name, text) for name, text in _facts(report))
    return Group(_head(report, folder), *facts, *lines, Text(WHOLE, style="dim"))


def _head(report: Report, folder: str) -> Text:
    """Camera, exposure and size of the frames, and where they are."""
    camera, image, exposure = report["camera"], report["image"], report["exposure"]
    setting = ""
    if camera["gain"] is not None:
        setting = f" at gain {camera['gain']}"
    elif camera["gains"]:
        setting = " at no gain setting"
    size = f"{image['columns']} × {image['rows']}, {image['frames']} frame{'s' * (image['frames'] > 1)}"
    metered = " (metered)" if report["origin"].get("metering") else ""
    return Text.assemble(
        (f"{camera['name']}{setting}, K = {report['K_dn_per_e']:.4g} DN/e-", "bold"),
        f", {exposure['time_s']:g} s{metered} at {exposure['temperature_k']:g} K, {size} → ",
        (folder, "bold"),
    )


def _facts(report: Report) -> Iterator[tuple[str, str]]:
    from ..render.light.brightness import brightness_sentence

    last, photons, render = report["stages"][-1], report["photons"], report["render"]
    keys = "mean_frame", "sigma_frame", "sigma_expected"
    mean, sigma, expected = (f"{number(last[key])} {last['unit']}" for key in keys)
    yield "signal", f"{mean} on average, with a noise of σ = {sigma} ({expected} by theory)"
    low, median, high = (number(photons[name]) for name in ("min", "median", "max"))
    counted = "photoelectrons" if photons["detected"] else "photons"
    yield f"{counted} per pixel", f"{low} … {median} … {high} (min, median, max)"
    noise = "none, because there is no light"
    if photons["max"]:
        ratio = number(report["render_noise"]["over_sensor_median"])
        denoised = ", denoised" if render["denoised"] else ""
        asked, end = render["noise_ratio_asked"], render["ended_by"]
        reached = "reached" if end == "noise_ratio" else "not reached"
        noise = (
            f"its variance is {ratio} × the sensor's in the median pixel; {render['samples_per_pixel']} samples per "
            f"pixel{denoised}{'' if asked is None else f'; {asked:g} was asked for and {reached}'}{END.get(end, '')}"
        )
    yield "render noise", noise
    if brightness := render["brightness"] and brightness_sentence(render["brightness"]):
        yield "brightness", brightness
    counts = report["counts"].items()
    seen = [f"{n} {COUNTED.get(name) or name.replace('_', ' ')}" for name, n in counts if n]
    yield "pixels", ", ".join(seen) or "none clipped, none bad"
    if (factor := report["summary"]["brightened"]) > 1:
        yield "pictures", f"frame.png as exposed, frame_brightened.png {factor} × brighter"
    if report["left_out"]:
        tolerance_dn = report["options"]["tolerance_dn"]
        yield "left out", f"{', '.join(report['left_out'])} (tolerance {tolerance_dn:g} DN)"
