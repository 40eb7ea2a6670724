"""Versions of the software that results depend on, and the machine that run times were measured on."""

from __future__ import annotations

import os
import platform
import re
from contextlib import suppress
from functools import cache
from pathlib import Path

PACKAGES: tuple[str, ...] = ("mitsuba-sensor", "mitsuba", "drjit", "numpy", "scipy", "OpenEXR")
PACKAGES += ("pyoidn", "pydantic", "typer", "rich", "tifffile", "pillow", "matplotlib")


@cache  # it takes 20 ms
def versions() -> dict[str, str | None]:
    """Return the versions of Python, this package and its dependencies; None if not installed."""
    from importlib import metadata  # takes 20 ms to import

    installed: dict[str, str | None] = {"python": platform.python_version()}
    for name in PACKAGES:
        installed[name] = None
        with suppress(metadata.PackageNotFoundError):
            installed[name] = metadata.version(name)
    return installed


def machine() -> dict[str, int | str | None]:
    """Return the processor and its number of cores."""
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        if model := re.search(r"^model name\s*:(.*)", text, re.M):
            return {"cpus": os.cpu_count(), "processor": model[1].strip()}
    return {"cpus": os.cpu_count(), "processor": platform.machine()}
