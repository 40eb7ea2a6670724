"""One sample of a dataset on the terminal, for `dataset show`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from .tables import fact, number

if TYPE_CHECKING:
    from ..dataset.read import Dataset, Sample


def sample_facts(dataset: Dataset, place: int, sample: Sample) -> dict[str, Any]:
    """Return facts on a sample, ready for JSON. Raises InputError for a changed sample.

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
    return {
        "number": place,
        "samples": len(dataset),
        "key": sample.key,
        "split": sample.split,
        "shard": str(sample.store.shards / sample.line.shard),
        "settings": dict(sample.values),
        "image": facts["image"],
        "noise": noise,
        "digital_quantiles_dn": facts["digital_quantiles_dn"],
        "electrons_quantiles_e": facts["electrons_quantiles_e"],
        "files": {name: len(content) for name, content in sorted(files.items())},
    }


def sample_sheet(facts: dict[str, Any], picture: str) -> RenderableType:
    """Return a line for each group of facts.  facts : of :func:`sample_facts`.  picture : its place."""
    split = f", split {facts['split']}" if facts["split"] else ""
    settings = [f"{name} {x}" for name, x in facts["settings"].items() if name != "pose"]
    files = [f"{name} ({size / 1e3:.3g} kB)" for name, size in facts["files"].items()]
    head = f"sample {facts['number']} of {facts['samples']}{split}, key {facts['key']}"
    return Group(
        Text(head, style="bold"),
        fact("shard", facts["shard"]),
        fact("settings", ", ".join(settings)),
        fact("image", _image(facts["image"])),
        fact("signal", _signal(facts)),
        fact("noise", _noise(facts["noise"])),
        fact("files", ", ".join(files)),
        fact("picture", picture),
    )


def _image(image: dict[str, Any]) -> str:
    from ..dataset.card import time_text

    frames = "1 frame" if image["frames"] == 1 else f"{image['frames']} frames"
    black, white = number(image["black_level_dn"]), number(image["white_level_dn"])
    return (
        f"{frames} of {image['columns']} × {image['rows']} pixels, {time_text(image['exposure_s'])} at "
        f"{image['temperature_k']:.6g} K, black level {black} DN, white level {white} DN"
    )


def _signal(facts: dict[str, Any]) -> str:
    """Return the signal of the median pixel and the range of 98 % of the pixels."""
    _, low_e, median_e, high_e, _ = map(number, facts["electrons_quantiles_e"])
    _, low_dn, median_dn, high_dn, _ = map(number, facts["digital_quantiles_dn"])
    return (
        f"median {median_e} e- (98 % of the pixels from {low_e} to {high_e}), "
        f"{median_dn} DN ({low_dn} to {high_dn})"
    )


def _noise(noise: dict[str, Any]) -> str:
    parts = [f"K {number(noise['system_gain_dn_per_e'])} DN/e-"]
    if "temporal_dark_noise_e" in noise:
        parts.append(f"temporal dark noise {number(noise['temporal_dark_noise_e'])} e-")
        parts.append(f"saturation {number(noise['saturation_e'])} e-")
    if "snr" in noise:
        median = f"temporal noise {number(noise['temporal_noise_dn'])} DN in the median pixel"
        parts.append(f"{median}, SNR {number(noise['snr'])}")
    ratio = number(noise["render_noise_ratio"])
    parts.append(
        f"render variance is {ratio} × the sensor's temporal variance in the exposure of the view"
    )
    return "; ".join(parts)
