"""DNG files: NoiseProfile (S, O), black and white level, ISO.

DNG 1.4: the variance of a signal x from 0 (black) to 1 (white) is S·x + O. So K = S·(white − black) [DN/e-], and the
read noise is √O/S electrons.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...camera.camera import Camera
from ...core import InputError
from ...files.raw_files import dng_tags
from .draft import LARGEST, Draft

MODEL, ISO = "UniqueCameraModel", "ISOSpeedRatings"
BLACK, WHITE, PROFILE = "BlackLevel", "WhiteLevel", "NoiseProfile"
SIDE_MAX = 1e6  # pixels


def read_dngs(paths: Sequence[Path], like: Camera) -> Draft:
    """Return the draft of a camera at the lowest ISO, with one gain setting for each file. Raises InputError."""
    pairs = sorted((_setting(path, like) for path in paths), key=lambda pair: pair[1]["iso"])
    settings = [setting for _, setting in pairs]
    speeds = [setting["iso"] for setting in settings]
    for speed in speeds:
        if speeds.count(speed) > 1:
            raise InputError(
                f"{speeds.count(speed)} files have ISO {speed:g}; give one DNG for each ISO."
            )
    draft = pairs[0][0]
    draft.set_gains(settings, "NoiseProfile and BlackLevel of the file of each ISO")
    draft.description += f", at ISO {speeds[0]:g}"
    return draft


def _setting(path: Path, like: Camera) -> tuple[Draft, dict[str, float]]:
    """Return the draft of one file, and its gain setting."""
    tags, draft = dng_tags(path), Draft(path.name, like)
    profile = _numbers(tags, PROFILE, draft)
    if len(profile) % 2 or not profile:
        raise InputError(
            f"{path} has a NoiseProfile of {len(profile)} numbers; it must have two for each colour."
        )
    black = float(np.mean(_numbers(tags, BLACK, draft)))
    white = min(_numbers(tags, WHITE, draft))
    slopes = [draft.number("S of NoiseProfile", x, 0.0, 10.0) for x in profile[0::2]]
    offsets = [draft.number("O of NoiseProfile", x, -1e-30, 10.0) for x in profile[1::2]]
    span = draft.number("white less black level", white - black)
    slope, offset = np.mean(slopes), np.mean(offsets)
    dn_per_e, read_noise_e = float(slope * span), float(math.sqrt(offset) / slope)
    which = f"{'mean of the colours of ' if len(slopes) > 1 else ''}NoiseProfile"
    draft.says("adc.bits", math.ceil(math.log2(white + 1)), f"WhiteLevel {white:g}")
    draft.set_gain(dn_per_e, f"S of {which} times white less black level: K")
    draft.says("source_follower.read_noise_e", read_noise_e, f"root of O over S, {which}")
    draft.says("adc.black_level_dn", black, "BlackLevel")
    draft.set_clip(dn_per_e, black)
    for field, tag in (("sensor.columns", "ImageWidth"), ("sensor.rows", "ImageLength")):
        draft.says(field, draft.count(tag, tags.get(tag), SIDE_MAX), tag)
    draft.name = draft.description = str(tags.get(MODEL) or path.stem)
    iso = draft.number("ISO", _list(tags.get(ISO, 100))[0])
    numbers = {"gain_dn_per_e": dn_per_e, "read_noise_e": read_noise_e, "black_level_dn": black}
    return draft, {"iso": iso, **numbers}


def _numbers(tags: Mapping[str, Any], name: str, draft: Draft) -> list[float]:
    if name not in tags:
        raise InputError(
            f"{draft.file} has no {name}, so its noise is unknown; convert it with Adobe's DNG Converter."
        )
    return draft.numbers(name, _list(tags[name]), -LARGEST, LARGEST)


def _list(value: object) -> list[object]:
    """Return the values of a tag as a list."""
    if isinstance(value, list | tuple | np.ndarray) and len(value):
        return list(value)
    return [value]
