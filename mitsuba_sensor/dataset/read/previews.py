"""The preview of a sample: its file, or developed from the raw frame where the dataset stores none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...camera.camera_file import camera_from
from ...files.png import read_png
from ...output.preview import preview
from ..store.entry_files import require_file

if TYPE_CHECKING:
    from .reader import Sample

PICTURE = "frame.png"


def preview_of_sample(sample: Sample) -> NDArray[np.uint8]:
    """(H, W) grey or (H, W, 3) sRGB, as bright as without the stops that ``exposure_ev`` takes away.

    Without a file white is that of daylight, as nothing stored says what the light of the scene is. Raises InputError
    where there is neither a picture nor a raw frame.
    """
    if sample.files.has(PICTURE):
        return read_png(sample.files.readable(PICTURE), sample.files.place(PICTURE))
    require_file(sample.files, "frame.tiff", "preview")
    config, image = sample.facts["config"], sample.facts["image"]
    camera = camera_from(config["camera"], "of the sample").at_gain(config["gain"])
    gain = stops_taken(config["exposure"]["ev"])
    return preview(sample.read("raw")[0], camera, gain, tuple(image["origin"]))


def stops_taken(stops: float) -> float:
    """By which factor a preview is brighter for the stops that an exposure takes away."""
    return float(2.0 ** max(-stops, 0.0))
