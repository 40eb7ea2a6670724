"""Versions of everything that a number depends on, and the machine that times were measured on."""

from __future__ import annotations

import os
import platform
from pathlib import Path

PACKAGES = (
    "mitsuba-sensor",
    "mitsuba",
    "drjit",
    "numpy",
    "scipy",
    "colour-science",
    "OpenEXR",
    "pydantic",
    "typer",
    "rich",
    "tifffile",
    "pillow",
    "matplotlib",
)


def versions() -> dict[str, str | None]:
    """Version of Python, of this package and of everything it stands on; None for what is not installed."""
    return {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}


def machine() -> dict[str, int | str | None]:
    """Processor and number of cores, for times that were measured here."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {"cpus": os.cpu_count(), "processor": models[0] if models else platform.machine()}


def _version(name: str) -> str | None:
    from importlib import metadata  # takes 20 ms to import

    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
