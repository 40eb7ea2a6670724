"""frame.json: everything that must be known to judge a frame, or to make it again."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.backend import NUMPY_FLOAT64
from ..render.statistics import summary_of
from ..sensor.input_noise import input_noise

if TYPE_CHECKING:
    from ..core.exposure import Exposure
    from ..render.irradiance import Irradiance
    from ..sensor.camera import Camera
    from ..sensor.expose import Frames

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


@dataclass
class Clock:
    """Seconds that each named step took."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time the block under ``name``."""
        start = time.perf_counter()
        yield
        self.seconds[name] = round(time.perf_counter() - start, 4)


@dataclass(frozen=True)
class Shot:
    """What was asked of the camera.

    seed : temporal noise; serial, or measured maps : fixed patterns; frames : how many; chain : as for expose().
    engine, precision : who computes it, as for expose().
    preview_gain : how much brighter than the raw numbers the picture for the eye is.
    """

    camera: Camera
    exposure: Exposure
    seed: int = 1
    serial: int = 1
    frames: int = 1
    maps: Mapping[str, np.ndarray] | None = None
    chain: Any = "physical"
    preview_gain: float = 1.0
    engine: Any = "auto"
    precision: Any = "auto"

    @property
    def exposing(self) -> dict[str, Any]:
        """The other words of :func:`expose`."""
        return {"maps": self.maps, "chain": self.chain, "engine": self.engine, "precision": self.precision}


def frame_report(shot: Shot, light: Irradiance, frames: Frames, origin: dict[str, Any]) -> dict[str, Any]:
    """The whole of frame.json but the times, as a dict.

    origin : where the light comes from ("scene" or "irradiance", parameters given on the command line).
    """
    statistics = light.statistics.to_dict()
    counts = dict(frames.report["counts"])
    counts["negative"] = statistics["negative"]
    counts["non_finite"] = statistics["non_finite"]
    return {
        "origin": {**origin, "scene_sha256": statistics["scene_sha256"]},
        "camera": {**shot.camera.model_dump(), "sources": dict(shot.camera.sources)},
        "exposure": asdict(shot.exposure),
        "seeds": {"seed": shot.seed, "serial": shot.serial},
        "chain": shot.chain,
        "precision": frames.first.window.backend.precision,
        "given_maps": sorted(shot.maps or ()),
        "image": {"frames": shot.frames, "rows": frames.digital.shape[1], "columns": frames.digital.shape[2]},
        "bands": {"wavelengths_nm": light.wavelengths_nm, "bandwidths_nm": light.bandwidths_nm},
        **frames.report,
        "counts": counts,
        "render": statistics,
        "render_noise": render_noise(light, frames),
        "versions": versions(),
    }


def render_noise(light: Irradiance, frames: Frames) -> dict[str, float]:
    """Variance of the render over the sensor's own temporal variance, both as electrons at the input, in this exposure.

    The certificate has the same for the exposure of the render; a longer exposure of the same light shows more of it.
    """
    electrons = frames.camera.stages[0].sample(frames.light, frames.first.on(NUMPY_FLOAT64)).total
    with np.errstate(invalid="ignore"):
        variance_e2 = (light.relative_error.astype(np.float64) * electrons) ** 2
    ratio = input_noise(frames.camera, frames.first.exposure).ratio(electrons, variance_e2)
    found = summary_of(np.where(np.isfinite(electrons), ratio, np.inf), electrons > 0, light.statistics.passes)
    return {name.replace("noise_ratio", "over_sensor"): value for name, value in found.items()}


def versions() -> dict[str, str | None]:
    """Version of Python, of this package and of everything it stands on; None for what is not installed."""
    return {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}


def machine() -> dict[str, Any]:
    """What numbers of seconds were measured on."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {"cpus": os.cpu_count(), "processor": models[0] if models else platform.machine()}


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
