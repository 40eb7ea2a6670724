"""Raw frames as files: metadata, previews, and the fragment that a notebook shows."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..camera.camera import Camera
from ..camera.colour_matrix import ColourMatrix, colour_matrix
from ..camera.dual_pixels import has_several_readouts
from ..core import Float64Array, require
from ..core.checks import require_frame, require_path
from ..core.html import facts, fragment, picture
from ..core.versions import versions
from ..files import png, texts, tiff
from ..files.appearing import output_folder
from ..files.tiff import READOUTS
from ..stages.stage import converter_of
from .preview import brightening, developed, preview
from .readout_files import readout_facts, write_readouts

if TYPE_CHECKING:
    from ..sensor.frames import RawFrames
    from .frames import Frames

CLEAN = ("clean.tiff", "temporal_variance.tiff")
DNGS = ("frame.dng", "frame_[0-9]*.dng")  # of one frame, of several
BRIGHTENED = "frame_brightened.png"
VIDEO = "frames.webp"
PAGE = "frame.html"
FRAME_FILES = (
    "frame.tiff",
    READOUTS,
    "frame.png",
    BRIGHTENED,
    VIDEO,
    PAGE,
    *DNGS,
    *CLEAN,
    "frame.json",
)
"""Files of frames of rendered light."""
CAPTURE_FILES = (*FRAME_FILES, "irradiance.exr", "aovs.exr")
"""Files of frames of a scene."""
ABOUT = (
    "docs/frames.md of mitsuba_sensor explains each key; null means not requested, default, not applicable or "
    "unknown"
)
"""Text in frame.json."""
CROP_PX = 200
"""Rows and columns of a crop at 1:1 in a notebook."""
PICTURE_PIXELS_MAX = 60_000
"""Pixels of a picture in a notebook: even a noisy one is below 250 kB as PNG in base64."""


def preview_of(frames: RawFrames, number: int = 0, gain: float = 1.0) -> NDArray[np.uint8]:
    """Return the picture of frame.png: one of the frames, developed in the light of the scene."""
    illuminant = frames.light.illuminant
    gain = require("gain", gain, 0.0, np.inf, "a factor of brightness, e.g. 2")
    digital = frames.digital[require_frame(number, len(frames.digital))]
    return preview(digital, frames.camera, gain, frames.first.window.origin, illuminant)


def frames_metadata(frames: Frames) -> dict[str, Any]:
    """Return the content of frame.json."""
    first, colours = frames.first, colour_matrix(frames.camera, frames.light.illuminant)
    report = frames.report
    return {
        "summary": summary_of(frames, report),
        "notes": list(frames.notes),
        "about": ABOUT,
        "camera": frames.camera.to_dict(),
        "exposure": asdict(first.exposure),
        "seeds": {
            "seed": first.seed,
            "serial": first.window.serial,
            "first_frame": first.index,
        },
        "precision": first.window.backend.precision,
        "given_maps": sorted(first.window.given),
        "image": image_facts(frames),
        "colour": None if colours is None else colours._asdict(),
        "readouts": readout_facts(frames),
        "left_out": [] if frames.plan is None else frames.plan.left_out,
        **report,
        "versions": versions(),
    }


def summary_of(frames: Frames, report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the summary of frame.json."""
    facts, counts = image_facts(frames), report["counts"]
    pixels = frames.digital[0].size
    noise, _ = frames.render_noise
    return {
        "camera": frames.camera.name,
        "exposure_s": facts["exposure_s"],
        "temperature_k": facts["temperature_k"],
        "frames": len(frames.digital),
        "overall_system_gain_dn_per_e": report["K_dn_per_e"],
        "black_level_dn": facts["black_level_dn"],
        "white_level_dn": facts["white_level_dn"],
        "full_well_share": counts["clipped_full_well"] / pixels,
        "white_level_share": counts["clipped_adc_high"] / pixels,
        "render_noise_over_sensor_noise": noise.get("over_sensor_median"),
        "brightened": brightening(frames.digital[0], frames.camera),
    }


def save_frames(frames: Frames, folder: str | os.PathLike[str]) -> None:
    """Write frame.tiff, frame.png and frame.json, all or none; older FRAME_FILES are removed. Raises InputError."""
    with output_folder(require_path("folder", folder, "out/"), FRAME_FILES) as scratch:
        write_frames(scratch, frames, frames_metadata(frames))


def write_frames(
    folder: Path, frames: Frames, metadata: dict[str, Any], gain: float = 1.0
) -> None:
    """Write the files of frames with this metadata, and a brighter picture of dark frames.  gain : of the preview."""
    image, colours = metadata["image"], metadata["colour"]
    matrix = None if colours is None else ColourMatrix(**colours)
    first, camera, origin = frames.digital[0], frames.camera, frames.first.window.origin
    tiff.write_tiff(folder / "frame.tiff", frames.digital, image)
    if has_several_readouts(frames.camera) or frames.camera.companding.knees:
        write_readouts(folder / READOUTS, frames, image["cfa_pattern"])
    png.write_png(folder / "frame.png", developed(first, camera, matrix, gain, origin), image)
    factor = metadata["summary"]["brightened"]
    if factor > 1:
        shown = developed(first, camera, matrix, factor, origin)
        png.write_png(
            folder / BRIGHTENED, png.captioned(shown, brightened_caption(factor)), image
        )
    texts.write_json(folder / "frame.json", metadata)


def brightened_caption(factor: int) -> str:
    """Return the caption of a brightened picture.  factor : a power of two."""
    stops = round(math.log2(factor))
    unit = "stop" if stops == 1 else "stops"
    return f"{factor} x brighter than exposed ({stops} {unit})"


def frames_html(frames: Frames) -> str:
    """Return the first frame as a notebook shows it: a small picture, a crop of a large frame at 1:1, and facts."""
    first, window, camera = frames.digital[0], frames.first.window, frames.camera
    exposure, count = frames.first.exposure, len(frames.digital)
    highest = converter_of(camera.stages).highest
    illuminant = frames.light.illuminant
    origin = window.origin
    small, means = binned(first, camera)
    shown = preview(small, camera, 1.0, origin, illuminant)
    described = f"first of {count} raw frames of {camera.name}"
    pictures = [picture(png.png(shown), shown.shape[1], described)]
    clipped = f"{100 * np.mean(first == highest):.3g} % at the full-scale code"
    wells = f"{100 * frames.counts['clipped_full_well'] / first.size:.3g} % at the full well"
    rows = {
        "frames": f"{count} × {first.shape[1]} × {first.shape[0]} pixels, {first.dtype}",
        "exposure": f"{exposure.time_s:g} s at {exposure.temperature_k:g} K",
        "serial, seed": f"{window.serial}, {frames.first.seed}",
        "first frame": f"{first.min()} … {first.mean():.5g} … {first.max()} DN (min, mean, max)",
        "clipped pixels": f"{clipped}, {wells}",
    }
    if means != (1, 1):
        top, left = (max(side - CROP_PX, 0) // 4 * 2 for side in first.shape)
        part = first[top : top + CROP_PX, left : left + CROP_PX]
        crop = preview(part, camera, 1.0, (origin[0] + top, origin[1] + left), illuminant)
        pictures.append(picture(png.png(crop), crop.shape[1], "middle of the frame at 1:1"))
        rows["pictures"] = (
            f"means of {means[0]} × {means[1]} pixels of one filter, which have less noise; beside them "
            f"{part.shape[1]} × {part.shape[0]} pixels at 1:1"
        )
    if frames.notes:
        rows["notes"] = " · ".join(frames.notes)
    return fragment(f"Raw frames of {camera.name}", *pictures, facts(rows))


def binned(
    digital: NDArray[np.generic], camera: Camera
) -> tuple[Float64Array, tuple[int, int]]:
    """Return a raw frame averaged to at most PICTURE_PIXELS_MAX pixels, but at least one tile of the mosaic, and the
    rows and columns of one filter that are averaged."""
    tile_rows, tile_columns = np.array(camera.tile).shape
    rows, columns = digital.shape
    step = 1
    while (rows // step + 1) * (columns // step + 1) > PICTURE_PIXELS_MAX:
        step += 1
    if step == 1:
        return np.asarray(digital, dtype=np.float64), (1, 1)
    step_y = max(min(step, rows // tile_rows), 1)
    step_x = max(min(step, columns // tile_columns), 1)
    down, right = rows // (step_y * tile_rows), columns // (step_x * tile_columns)
    whole = digital[: down * step_y * tile_rows, : right * step_x * tile_columns]
    blocks = whole.reshape(down, step_y, tile_rows, right, step_x, tile_columns)
    means = blocks.mean(axis=(1, 4), dtype=np.float64)
    return np.asarray(means.reshape(down * tile_rows, right * tile_columns)), (step_y, step_x)


def image_facts(frames: RawFrames) -> dict[str, Any]:
    """Return the facts for reading raw frames: size, first pixel on the sensor, colour filters from the first pixel of
    the file, black and white level [DN], exposure time [s] and temperature [K]."""
    camera, first = frames.camera, frames.first
    converter = converter_of(camera.stages)
    pattern = None
    if len(camera.filter_names) > 1:
        tile_shape = (len(camera.tile), len(camera.tile[0]))
        filters = camera.filter_index(tile_shape, first.window.origin)
        pattern = [[camera.filter_names[number] for number in row] for row in filters]
    number, rows, columns = frames.digital.shape
    return {
        "frames": number,
        "rows": rows,
        "columns": columns,
        "origin": first.window.origin,
        "cfa_pattern": pattern,
        "black_level_dn": converter.black_level_dn,
        "white_level_dn": converter.highest,
        "exposure_s": first.exposure.time_s,
        "temperature_k": first.exposure.temperature_k,
    }
