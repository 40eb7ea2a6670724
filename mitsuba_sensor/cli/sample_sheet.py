"""One sample of a dataset on the terminal: what `dataset show` prints."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from ..dataset.store.keys import Facts
from .tables import number
from .terminal import fact, path_fact


def sample_sheet(facts: Facts, said_of_picture: str) -> RenderableType:
    """A line for each thing that is known.  facts : of :func:`dataset.read.shown.facts_shown`."""
    split = ""
    if facts["split"]:
        split = f", split {facts['split']}"
    head = f"sample {facts['number']} of {facts['samples']}{split}, key {facts['key']}"
    settings = [
        f"{name} {value}" for name, value in facts["settings"].items() if name != "pose"
    ]
    files = [f"{name} ({size / 1e3:.3g} kB)" for name, size in facts["files"].items()]
    lines = [
        Text(head, style="bold"),
        path_fact("folder", facts["folder"]),
        fact("settings", ", ".join(settings)),
        fact("image", _image(facts["image"])),
        fact("signal", _signal(facts)),
        fact("noise", _noise(facts["noise"])),
        fact("files", ", ".join(files)),
        path_fact("picture", said_of_picture),
    ]
    return Group(*lines)


def _image(image: Facts) -> str:
    frames = "1 frame"
    if image["frames"] > 1:
        frames = f"{image['frames']} frames"
    size = f"{image['columns']} × {image['rows']}"
    black, white = number(image["black_level_dn"]), number(image["white_level_dn"])
    return (
        f"{frames} of {size} pixels, {number(image['exposure_s'])} s at {number(image['temperature_k'])} K, "
        f"black level {black} DN, white {white} DN"
    )


def _signal(facts: Facts) -> str:
    """The median pixel, and all but the darkest and the brightest hundredth."""
    _, low_e, median_e, high_e, _ = facts["electrons_quantiles_e"]
    _, low_dn, median_dn, high_dn, _ = facts["digital_quantiles_dn"]
    return (
        f"median {number(median_e)} e- (98 % of the pixels from {number(low_e)} to {number(high_e)}), "
        f"{number(median_dn)} DN ({number(low_dn)} to {number(high_dn)})"
    )


def _noise(noise: Facts) -> str:
    parts = [f"K {number(noise['system_gain_dn_per_e'])} DN/e-"]
    if "temporal_dark_noise_e" in noise:
        parts.append(f"temporal dark noise {number(noise['temporal_dark_noise_e'])} e-")
        parts.append(f"saturation {number(noise['saturation_e'])} e-")
    if "snr" in noise:
        said = f"temporal noise {number(noise['temporal_noise_dn'])} DN in the median pixel"
        parts.append(f"{said}, SNR {number(noise['snr'])}")
    ratio = number(noise["render_noise_ratio"])
    parts.append(f"the render's variance is {ratio} × the sensor's in the exposure of the view")
    return "; ".join(parts)
