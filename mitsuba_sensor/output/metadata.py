"""Versions of everything that a number depends on, and the machine that times were measured on."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..sensor.stage import converter_of

if TYPE_CHECKING:
    from ..sensor.frames import Frames

PACKAGES: tuple[str, ...] = ("mitsuba-sensor", "mitsuba", "drjit", "numpy", "scipy", "OpenEXR")
PACKAGES += ("pyoidn", "pydantic", "typer", "rich", "tifffile", "pillow", "matplotlib")


@cache  # it takes 20 ms
def versions() -> dict[str, str | None]:
    """Version of Python, of this package and of everything it stands on; None for what is not installed."""
    from importlib import metadata  # takes 20 ms to import

    found: dict[str, str | None] = {"python": platform.python_version(), **dict.fromkeys(PACKAGES)}
    for name in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def machine() -> dict[str, int | str | None]:
    """Processor and number of cores, for times that were measured here."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {"cpus": os.cpu_count(), "processor": models[0] if models else platform.machine()}


def image_facts(frames: Frames) -> dict[str, Any]:
    """What a reader of the raw frames must know: size, first pixel on the sensor, colour filters as they lie in this
    file from its first pixel on, black and white level [DN], exposure time [s] and temperature [K]."""
    camera, window, converter = frames.camera, frames.first.window, converter_of(frames.camera.stages)
    filters = camera.filter_index((len(camera.tile), len(camera.tile[0])), window.origin)
    names = [[camera.filter_names[number] for number in row] for row in filters]
    levels = {"black_level_dn": converter.black_level_dn, "white_level_dn": converter.highest}
    shape = dict(zip(("frames", "rows", "columns"), frames.digital.shape, strict=True))
    pattern = names if len(camera.filter_names) > 1 else None
    exposure = {"exposure_s": frames.first.exposure.time_s, "temperature_k": frames.first.exposure.temperature_k}
    return {**shape, "origin": window.origin, "cfa_pattern": pattern, **levels, **exposure}
