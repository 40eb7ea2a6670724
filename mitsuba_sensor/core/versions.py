"""Versions of everything that a number depends on, and the machine that times were measured on."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from functools import cache
from pathlib import Path

PACKAGES: tuple[str, ...] = ("mitsuba-sensor", "mitsuba", "drjit", "numpy", "scipy", "OpenEXR")
PACKAGES += ("pyoidn", "pydantic", "typer", "rich", "tifffile", "pillow", "matplotlib")


@cache  # it takes 20 ms
def versions() -> dict[str, str | None]:
    """Version of Python, of this package and of everything it stands on; None for what is not installed."""
    from importlib import metadata  # takes 20 ms to import

    found: dict[str, str | None] = {
        "python": platform.python_version(),
        **dict.fromkeys(PACKAGES),
    }
    for name in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def machine() -> dict[str, int | str | None]:
    """Processor and number of cores, for times that were measured here."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
    else:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {"cpus": os.cpu_count(), "processor": models[0] if models else platform.machine()}
