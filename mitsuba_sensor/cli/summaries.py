"""Printed summaries: a dozen lines about frames (`render`, `expose`) or one sample of a dataset (`dataset show`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ..camera.camera import SET_BY_SCENE
from ..core import by_weight
from ..stages.usual_range import temperature_note
from .flag_names import with_flags
from .tables import counted, number

if TYPE_CHECKING:
    from ..dataset.read import Dataset, Sample

NOTES_MAX = 4
"""Printed notes."""
FIELDS_MAX = 3
"""Printed names of camera fields that the scene sets."""
EVERYTHING = "frame.json has all notes and facts, and each stage's signal next to its theory"
COUNTED = {
    "clipped_full_well": "at the full well",
    "clipped_adc_high": "at the full-scale code",
    "clipped_adc_low": "at code 0",
    "cut_to_zero_prnu": "with a negative PRNU gain, set to 0",
    "cut_to_zero_prnu_col": "in columns with a negative PRNU gain, set to 0",
    "cut_to_zero_dark_fpn": "with a negative dark current, set to 0",
    "negative": "with negative light, set to 0",
    "non_finite": "with light that is not a number",
}
"""Count in frame.json → what is true of these pixels."""
END = {"max_seconds": ", stopped by --max-seconds", "max_spp": ", stopped by --max-spp"}
Report = Mapping[str, Any]


def summary(report: Report, folder: str) -> RenderableType:
    """Return camera and exposure, signal and noise, the render's noise, and the most important notes.

    report : contents of frame.json.
    """
    told = temperature_note(report["exposure"]["temperature_k"])  # before the work began
    if report["sensor"] is None and report["render"]["samples_per_pixel"]:
        told += tuple(report["render"]["notes"])  # by the command that rendered this light
    notes = by_weight(note for note in report["notes"] if note not in told)
    lines = [
        Text.assemble(("note: ", "bold yellow"), with_flags(note)) for note in notes[:NOTES_MAX]
    ]
    if len(notes) > NOTES_MAX:
        lines.append(Text(f"{counted(len(notes) - NOTES_MAX, 'more note')}: frame.json"))
    facts = (Text.assemble((f"{name}: ", "bold"), text) for name, text in _facts(report))
    return Group(_head(report, folder), *facts, *lines, Text(EVERYTHING, style="dim"))


def _head(report: Report, folder: str) -> Text:
    camera, image, exposure = report["camera"], report["image"], report["exposure"]
    setting = ""
    if camera["gain"] is not None:
        setting = f" at gain {camera['gain']}"
    elif camera["gains"]:
        setting = " at no gain setting"
    fields = [name for name, source in camera["sources"].items() if source == SET_BY_SCENE]
    names = ", ".join(fields) if len(fields) <= FIELDS_MAX else f"{len(fields)} fields"
    changed = f" with {names} of the scene" if fields else ""
    size = f"{image['columns']} × {image['rows']}, {counted(image['frames'], 'frame')}"
    metered = " (metered)" if report["origin"].get("metering") else ""
    return Text.assemble(
        (f"{camera['name']}{changed}{setting}, K = {report['K_dn_per_e']:.4g} DN/e-", "bold"),
        f", {exposure['time_s']:g} s{metered} at {exposure['temperature_k']:g} K, {size} → ",
        (folder, "bold"),
    )


def _facts(report: Report) -> Iterator[tuple[str, str]]:
    from ..render.light.brightness import brightness_sentence

    last, photons, render = report["stages"][-1], report["photons"], report["render"]
    image, counts = report["image"], report["counts"]
    keys = "mean_frame", "sigma_frame", "sigma_expected"
    mean, sigma, expected = (f"{number(last[key])} {last['unit']}" for key in keys)
    yield "signal", f"mean {mean}, sensor noise σ = {sigma} (theory {expected})"
    low, median, high = (number(photons[name]) for name in ("min", "median", "max"))
    unit = "photoelectrons" if photons["detected"] else "photons"
    yield f"{unit} per pixel", f"{low} … {median} … {high} (min, median, max)"
    noise = "none, because there is no light"
    pixels = image["rows"] * image["columns"]
    saturated = max(counts["clipped_full_well"], counts["clipped_adc_high"])
    if photons["max"] and saturated > pixels / 2:
        noise = "not measurable in the median pixel, which is saturated"
    elif photons["max"]:
        ratio = number(report["render_noise"]["over_sensor_median"])
        denoised = ", denoised" if render["denoised"] else ""
        target, end = render["noise_ratio_asked"], render["ended_by"]
        reached = "reached" if end == "noise_ratio" else "not reached"
        target = "" if target is None else f"; target {target:g} {reached}"
        noise = (
            f"variance {ratio} × the sensor's in the median pixel; {render['samples_per_pixel']} samples per "
            f"pixel{denoised}{target}{END.get(end, '')}"
        )
    yield "render noise", noise
    if brightness := render["brightness"] and brightness_sentence(render["brightness"]):
        yield "brightness", brightness
    named = [
        f"{n} {COUNTED.get(name) or name.replace('_', ' ')}" for name, n in counts.items() if n
    ]
    yield "pixels", ", ".join(named) or "none clipped, none invalid"
    if (factor := report["summary"]["brightened"]) > 1:
        yield "images", f"frame.png as exposed, frame_brightened.png {factor} × brighter"
    if report["left_out"]:
        tolerance_dn = report["options"]["tolerance_dn"]
        yield "left out", f"{', '.join(report['left_out'])} (tolerance {tolerance_dn:g} DN)"


def sample_facts(dataset: Dataset, place: int, sample: Sample) -> dict[str, Any]:
    """Return the facts of a sample, ready for JSON. Raises InputError for a sample whose files changed.

    noise : of the camera, and of the median pixel if the sample has its variance.
    """
    from ..camera.figures import figures_if_any

    facts, figures = sample.facts, figures_if_any(sample.camera)
    noise = {"system_gain_dn_per_e": facts["system_gain_dn_per_e"]}
    if figures is not None:
        noise["temporal_dark_noise_e"] = figures.temporal_dark_noise_e
        noise["saturation_e"] = figures.saturation_e
    if sample.has("temporal_variance.tiff") and sample.has("frame.tiff"):
        noise_dn = float(np.median(np.sqrt(sample.read("variance"))))
        signal_dn = float(np.median(sample.read("raw"))) - facts["image"]["black_level_dn"]
        snr = signal_dn / noise_dn if noise_dn else None
        noise |= {"temporal_noise_dn": noise_dn, "snr": snr}
    noise["render_noise_ratio"] = facts["light"]["noise_ratio_median"]
    files = {**sample.view_files, **sample.files}
    same = ("image", "digital_quantiles_dn", "electrons_quantiles_e")
    return {
        "number": place,
        "samples": len(dataset),
        "key": sample.key,
        "split": sample.split,
        "shard": str(sample.store.shards / sample.line.shard),
        "settings": dict(sample.values),
        **{name: facts[name] for name in same},
        "noise": noise,
        "files": {name: len(content) for name, content in sorted(files.items())},
    }
