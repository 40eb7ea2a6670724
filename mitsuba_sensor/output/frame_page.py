"""The page of one frame: a single HTML file without server or library.

A slider selects frames of the same light at other exposure times; the pointer shows the code of a pixel, its expected
value and its temporal σ.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..camera.dual_pixels import has_several_readouts
from ..camera.figures import saturation_dn
from ..core import Exposure
from ..core.html import render_template
from ..files import png
from ..stages.stage import converter_of

if TYPE_CHECKING:
    from .frames import Frames

STOPS = (-4, -3, -2, -1, 0, 1)
"""Exposure times on the page, in stops relative to the frame."""
CROP_PX, OVERVIEW_PX = 512, 512
"""Rows and columns of the crop on the page, and the largest side of its overview."""
STEP_DN = 0.01
"""Resolution of expected values and σ on the page for codes of 16 bits or fewer."""


def frame_page(frames: Frames) -> str:
    """Return the HTML page of the first frame, with frames of the same light at other exposure times."""
    camera, first = frames.camera, frames.first
    converter = converter_of(camera.stages)
    step_dn = STEP_DN * 2.0 ** max(camera.code_bits - 16, 0)
    crop = tuple(_middle(side) for side in first.window.shape)
    exposures = [first.exposure]
    if first.exposure.time_s > 0:
        exposures = [
            replace(first.exposure, time_s=first.exposure.time_s * 2.0**stops)
            for stops in STOPS
        ]
    filters = None
    if len(camera.filter_names) > 1:
        origin = [
            start + part.start for start, part in zip(first.window.origin, crop, strict=True)
        ]
        tile = camera.filter_index(np.array(camera.tile).shape, (origin[0], origin[1]))
        filters = [[camera.filter_names[number] for number in row] for row in tile]
    data = {
        "rows": crop[0].stop - crop[0].start,
        "columns": crop[1].stop - crop[1].start,
        "first": [crop[0].start, crop[1].start],
        "step": step_dn,
        "top": 2**camera.code_bits - 1,
        "saturation": saturation_dn(camera),
        "pixels": math.prod(first.window.shape),
        "black": converter.black_level_dn,
        "filters": filters,
        "chosen": exposures.index(first.exposure),
        "frames": [_exposure_data(frames, exposure, crop, step_dn) for exposure in exposures],
    }
    shown = frames.preview()
    overview = factor = None
    if max(first.window.shape) > CROP_PX:
        factor = math.ceil(max(first.window.shape) / OVERVIEW_PX)
        overview = _png(block_means(shown, factor))
    budget = None if has_several_readouts(camera) else frames.noise_budget()
    return render_template(
        Path(__file__).with_name("frame_page.html.j2"),
        title=f"Raw frame of {camera.name}",
        data=json.dumps(data).replace("<", "\\u003c"),  # no text ends the script
        still=_png(shown[crop]),
        overview=overview,
        factor=factor,
        size=first.window.shape,
        seeds=f"serial {first.window.serial}, seed {first.seed}, frame {first.index}",
        temperature_k=first.exposure.temperature_k,
        budget=budget,
        notes=frames.notes,
    )


def block_means(picture: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Return the means of blocks of factor × factor pixels of an 8-bit picture; the remainder is cut off."""
    rows, columns = (side // factor for side in picture.shape[:2])
    blocks = picture[: rows * factor, : columns * factor].reshape(
        rows, factor, columns, factor, *picture.shape[2:]
    )
    return np.asarray(np.rint(blocks.mean(axis=(1, 3))), dtype=np.uint8)


def _middle(side: int) -> slice:
    """Return the middle CROP_PX pixels of a side, from an even pixel."""
    start = max(side - CROP_PX, 0) // 4 * 2
    return slice(start, min(start + CROP_PX, side))


def _exposure_data(
    frames: Frames, exposure: Exposure, crop: tuple[slice, ...], step_dn: float
) -> dict[str, object]:
    """Return codes, expected values and σ of the crop at one exposure time."""
    is_own = exposure == frames.first.exposure
    shown = frames if is_own else frames.exposed_for(exposure)
    sigma_dn, counts = np.sqrt(shown.temporal_variance[crop]), shown.counts
    data: dict[str, object] = {
        "time": f"{exposure.time_s:.4g} s",
        "own": is_own,
        "full_well": counts["clipped_full_well"],
        "full_scale": counts["clipped_adc_high"],
        "codes": _packed(shown.digital[0][crop]),
        "expected": _packed(np.rint(shown.clean[crop] / step_dn)),
        "sigma": _packed(np.rint(sigma_dn / step_dn)),
    }
    if is_own and not has_several_readouts(frames.camera):
        electrons = frames.exposed_for(exposure, ("electrons",)).electrons
        assert electrons is not None
        data["electrons"] = _packed(np.rint(electrons[0][crop]))
    return data


def _packed(values: NDArray[np.generic]) -> str:
    """Encode whole numbers from 0 to 2³² − 1 as base64 of compressed planes of bytes, lowest bytes first."""
    whole = np.clip(values, 0, 2**32 - 1).astype("<u4")
    planes = np.ascontiguousarray(whole).view(np.uint8).reshape(whole.size, 4).T
    return base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode()


def _png(picture: NDArray[np.uint8]) -> str:
    return base64.b64encode(png.png(picture)).decode()
