"""Combined readouts in files: the pages of readouts.tiff, and their facts in frame.json."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..camera.exposure_times import later_exposures
from ..files.tiff import BOTH_HALVES, page_name, write_named_pages
from ..stages.combined_readouts import combined_of
from ..stages.gains import gain_dn_per_e
from ..stages.stage import converter_of

if TYPE_CHECKING:
    from .frames import Frames


def write_readouts(path: Path, frames: Frames, pattern: Sequence[Sequence[str]] | None) -> None:
    """Write named pages for every frame: each readout, the combined linear code and, if the camera has knees, the
    companded code.

    pattern : names of the colour filters from the first pixel of the file.
    """
    pages, companded = list[tuple[str, np.ndarray]](), frames.companded
    for number, code in enumerate(frames.digital):
        index = frames.first.index + number
        for name, readout in frames.readouts.items():
            pages.append((page_name(index, name), readout.digital[number]))
        both = BOTH_HALVES if frames.camera.sensor.dual_pixel else "combined"
        pages.append((page_name(index, both), code))
        if companded is not None:
            pages.append((page_name(index, "companded"), companded[number]))
    write_named_pages(path, pages, pattern)


def readout_facts(frames: Frames) -> list[dict[str, object]] | None:
    """Return the facts of each readout for frame.json, None for a camera with one readout: exposure and its delay after
    the first readout, gain, levels, codes at which the next readout takes over, and fraction of the pixels of the first
    frame that use only this readout."""
    combined = combined_of(frames.stages)
    if frames.camera.sensor.dual_pixel:
        return [_photodiode_facts(name, one) for name, one in frames.readouts.items()]
    if combined is None:
        return None
    later = later_exposures(frames.camera, frames.first.exposure)
    begins_s = {name: begin_s for name, (_, begin_s) in later.items()}
    remaining, facts = np.ones(frames.digital.shape[1:]), list[dict[str, object]]()
    for chain, linear in zip(combined.readouts, combined.combination.readouts, strict=True):
        one = frames.readouts[chain.name]
        converter, code = converter_of(one.stages), one.digital[0]
        is_last = chain is combined.readouts[-1]
        facts.append(
            {
                "name": chain.name,
                "exposure_s": one.first.exposure.time_s,
                "begins_after_s": begins_s.get(chain.charge, 0.0),
                "overall_system_gain_dn_per_e": gain_dn_per_e(one.camera),
                "black_level_dn": converter.black_level_dn,
                "white_level_dn": converter.highest,
                "electrons_per_dn": linear.electrons_per_dn,
                "hand_over_from_dn": None if is_last else linear.begin_dn,
                "hand_over_dn": None if is_last else linear.end_dn,
                "share_of_pixels": float(np.mean(remaining * (code < linear.begin_dn))),
            }
        )
        remaining = remaining * (code >= linear.end_dn)
    return facts


def _photodiode_facts(name: str, frames: Frames) -> dict[str, object]:
    """Return the facts of one photodiode of dual pixels, which is read separately."""
    converter = converter_of(frames.stages)
    return {
        "name": name,
        "exposure_s": frames.first.exposure.time_s,
        "overall_system_gain_dn_per_e": gain_dn_per_e(frames.camera),
        "black_level_dn": converter.black_level_dn,
        "white_level_dn": converter.highest,
        "full_well_e": frames.camera.pixel.full_well_e,
    }
