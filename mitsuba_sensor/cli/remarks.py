"""The last lines of a command: which files it wrote, and what it took because nobody said otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from ..camera.camera import Camera
from ..files.appearing import replaced_in
from ..render.scene.scene_settings import SceneSettings
from .options import DEFAULT_TEMPERATURE_K, Flags


def written(folder: str | Path, names: Sequence[str]) -> str:
    """The files that are in a folder now, and those of an earlier result that they replace.

    names : of all that a command writes; a ``*`` stands for any text.
    """
    files = [file.name for file in Path(folder).iterdir()]
    known = [file for name in names for file in sorted(files) if fnmatch(file, name)]
    said = f"wrote in {folder}: {', '.join(dict.fromkeys(known))}"
    if older := replaced_in(folder):
        said += f"; an earlier result there was replaced ({', '.join(older)})"
    return said


def taken_by_default(flags: Flags, settings: SceneSettings, camera: Camera) -> list[str]:
    """The sentence about camera, exposure and temperature that neither the user nor the scene gave, or none.

    settings : what the scene, or the light, says of them.
    """
    taken = []
    if flags.get("camera") is None and settings.camera is None:
        taken.append(f"camera {camera.name} (--camera)")
    is_timed = "exposure_s" in flags and flags.get("exposure_s") is None
    if is_timed and flags.get("meter") is None and settings.exposure_s is None:
        taken.append("metered exposure time (--exposure-s)")
    is_tempered = "temperature_k" in flags and flags.get("temperature_k") is None
    if is_tempered and settings.temperature_k is None:
        taken.append(f"{DEFAULT_TEMPERATURE_K} K (--temperature-k)")
    if taken:
        return [f"taken by default: {', '.join(taken)}"]
    return []
