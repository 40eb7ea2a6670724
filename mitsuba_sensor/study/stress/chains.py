"""Whole chains, stage by stage, from no light to 1e150 photons, from no time to 30 000 years, from 0 K to 10 000 K."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from ...core.backend import FLOAT32_LIMIT
from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow
from ...core.signals import Electrons, Photons
from ...sensor.camera import Camera, list_cameras, load_camera
from ...sensor.chain import chain
from .case import RARE, SIGMAS, TENTH, Case, Engine, cases_of
from .got import Got, holds

SHAPE, TILE = (64, 64), (2, 2)
"""4096 pixels: 5 standard errors of a mean are 8 % of a pixel's σ, and 60 % of that of columns or rows. The light is
the same everywhere, so the theory of one tile of colour filters is that of all."""
ROUNDINGS = 16  # A number that went through a chain is some unit roundoffs off: one for each operation
COMPARED = (
    1e-2 * FLOAT32_LIMIT
)  # above FLOAT32_LIMIT engines count no further; no pixel's share of a pattern is a hundredth
FIRST_S = 0.7  # how long the frames of a theme take on one engine [s]
NODE_OPTIONS = {"readout.reset": "hard", "readout.dsnu_row": 5e-4, "readout.prnu_col": 2e-3, "pixel.dsnu_e": 20.0}
CURVES = {"readout.ve_nonlinearity": 0.5, "source_follower.vv_nonlinearity": 1.05, "adc.gamma": 1.04}
EVERY_OPTION = "every option"
OPTIONS: dict[str, Any] = {
    **NODE_OPTIONS,
    **CURVES,
    **{"pixel.prnu_distribution": "lognormal", "dark_current.distribution": "gamma", "dark_current.cv": 0.1},
    **{"dark_current.rts_fraction": 0.2, "dark_current.rts_amplitude_e_per_s": 900.0},
    **{"dark_current.rts_switching": 0.5, "quantum_efficiency.quantum_yield": [2.3, 1.1]},
    **{"source_follower.rtn_uv": 100.0, "source_follower.gain": 0.9, "readout.cds_gain": 2.0},
    "adc.dnl_lsb": {"100": 0.7, "511": -1.0, "900": 0.3},
}
"""Every stage that a camera may have, all of them at once, on Table 1."""


@cache
def camera_of(name: str) -> Camera:
    """A shipped camera, or the one with every option."""
    return load_camera("konnik_table1").replace(**OPTIONS) if name == EVERY_OPTION else load_camera(name)


@cache
def cameras() -> tuple[str, ...]:
    """Whose chains are looked at."""
    return (*list_cameras(), EVERY_OPTION)


@dataclass(frozen=True)
class Condition:
    """Light as photons per pixel, or as a share of the full well of the most sensitive filter; and an exposure."""

    name: str
    photons: float = 0.0
    well: float = 0.0
    exposure: Exposure = TENTH

    def light(self, camera: Camera) -> float:
        """Mean photons per pixel."""
        sensitivity = float(camera.qe([camera.quantum_efficiency.reference_nm or 0.0]).max())
        return self.photons + self.well * float(camera.pixel.full_well_e) / sensitivity


LIGHT = (
    *(Condition(n, float(n)) for n in ("0", "1e-320", "1e-12", "1e-6", "1")),
    Condition("¼ well", well=0.25),
    *(Condition(n, float(n)) for n in ("1e12", "1e30", "1e150")),
)
"""Between a quarter of a well and far more than one, a clip of what is not normal has no closed form to compare with
(test_stages looks there, to 5 %)."""
TIME = tuple(Condition(f"{t} s", exposure=Exposure(float(t))) for t in ("0", "1e-12", "1e-3", "1", "1e6", "1e12"))
WARMTH = tuple(
    Condition(f"{k} K", 1000.0, exposure=Exposure(0.1, float(k)))
    for k in ("0", "5e-324", "4", "77", "300", "400", "600", "1e4")
)
NOTHING = tuple(replace(condition, exposure=Exposure(0.0)) for condition in LIGHT[:3])


@dataclass(frozen=True)
class Seen:
    """Behind one stage: smallest and largest value of the pixels that see light at all, and how many standard errors
    the mean is off (NaN where anything is not finite)."""

    low: float
    high: float
    off: float


@cache
def seen_behind(name: str, condition: Condition, engine: Engine) -> dict[str, Seen]:
    """Every stage of a camera by its name, in one frame."""
    camera = camera_of(name)
    frame, stages = engine.frame(SHAPE, condition.exposure), chain(camera)
    signal: Any = Photons(np.full(SHAPE, condition.light(camera)))
    signals = []
    for stage in stages:
        signal = stage.sample(signal, frame)
        signals.append(signal.total if isinstance(signal, Electrons) else signal)
    lit = camera.qe([camera.quantum_efficiency.reference_nm or 0.0])[camera.filter_index(SHAPE), 0] > 0
    tile = Frame(condition.exposure, SensorWindow(7, TILE))
    theory = Moments(Photons(np.full(TILE, condition.light(camera))), 0.0, 0.0, tile)
    lines, unit, found = False, 1.0, {}
    for stage, values in zip(stages, engine.give(signals, frame), strict=True):
        theory = stage.moments(theory)
        unit *= stage.nominal_gain
        lines = lines or not {"column", "row"}.isdisjoint(stage.label.split())
        off = standard_errors(values, theory, lines, RARE * unit, engine)
        found[stage.label] = Seen(float(values[lit].min()), float(values[lit].max()), off)
    return found


def standard_errors(values: Any, theory: Moments, lines: bool, rare: float, engine: Engine) -> float:
    """Distance of the mean from its theory in standard errors, less what rounding and single counts explain.

    lines : whether a spatial part may be shared by whole columns or rows.  rare : a few counts, in this stage's unit.
    """
    if not all(np.isfinite(x).all() for x in (values, theory.mean, theory.temporal, theory.spatial)):
        return math.nan
    mean = np.tile(np.broadcast_to(np.minimum(theory.mean, COMPARED), TILE), np.floor_divide(SHAPE, TILE))
    temporal, spatial = float(np.mean(theory.temporal)), float(np.mean(theory.spatial))
    error = math.sqrt(temporal / values.size + spatial / (min(SHAPE) if lines else values.size))
    explained = rare / values.size + ROUNDINGS * engine.unit * float(np.abs(mean).max())
    beyond = max(abs(float(np.mean(np.minimum(values, COMPARED) - mean))) - explained, 0.0)
    return beyond / error if error else (math.inf if beyond else 0.0)


def worst_of(conditions: tuple[Condition, ...], stage: str, least: float, engine: Engine) -> Got:
    """The farthest that any camera is off behind a stage; no pixel may be below ``least``."""
    frames = [(name, condition) for name in cameras() for condition in conditions]
    seen = [(at, seen_behind(*at, engine)) for at in frames]
    found = [(found[stage], at) for at, found in seen if stage in found]
    worst, (name, condition) = max(found, key=lambda one: math.inf if math.isnan(one[0].off) else one[0].off)
    low, high = min(one.low for one, _ in found), max(one.high for one, _ in found)
    where = f"{name}, {condition.name}"
    if math.isnan(worst.off):
        return Got(f"not finite ({where})", False)
    text = f"{low + 0.0:.4g} … {high:.4g}, mean off by {worst.off:.1f} standard errors at most ({where})"
    return holds(text, worst.off <= SIGMAS, low >= least)


def exactly(conditions: tuple[Condition, ...], stage: str, value: Callable[[Camera], float], engine: Engine) -> Got:
    """Every pixel that sees light at all has exactly ``value(camera)`` behind a stage."""
    frames = [(name, condition) for name in cameras() for condition in conditions]
    for name, condition in frames:
        seen = seen_behind(name, condition, engine)[stage]
        if {seen.low, seen.high} != {value(camera_of(name))}:
            return Got(f"{seen.low:g} … {seen.high:g} ({name}, {condition.name})", False)
    return Got(f"so in {len(frames)} frames", True)


def chain_cases() -> list[Case]:
    """Light, time, warmth: a case per stage, the first of which makes the frames that the others look at."""
    stages = {stage.label: stage.domain for name in reversed(cameras()) for stage in chain(camera_of(name))}
    shipped = f"{len(list_cameras())} shipped cameras and one with every option"
    found = []
    for theme, given, conditions in (
        ("light", "{} photons", LIGHT),
        ("exposure time", "dark, {}", TIME),
        ("temperature", "1000 photons, {}", WARMTH),
    ):
        given = f"{given.format(', '.join(condition.name for condition in conditions))}; {shipped}"
        for number, (stage, domain) in enumerate(stages.items()):
            counted = domain == "electrons"  # of which there cannot be fewer than none
            expected = "finite; mean within 5 standard errors of the stage's own theory"
            check = partial(worst_of, conditions, stage, 0.0 if counted else -math.inf)
            expected, seconds = expected + ", never below 0" * counted, 0.001 if number else FIRST_S
            found += cases_of(theme, stage, given, expected, check, seconds=seconds)
    for theme, given, conditions, stage in (
        ("light", "0, 1e-320 and 1e-12 photons, 0 s", NOTHING, "shot noise"),
        ("light", "1e12, 1e30 and 1e150 photons", LIGHT[-3:], "full well"),
        ("exposure time", "dark, 1e6 and 1e12 s", TIME[-2:], "full well"),
        ("temperature", "600 and 1e4 K", WARMTH[-2:], "full well"),
    ):
        full = stage == "full well"
        expected = f"exactly {'the full well' if full else '0 electrons'} in every pixel that sees light"
        value: Callable[[Camera], float] = (lambda camera: camera.pixel.full_well_e) if full else (lambda camera: 0.0)
        found += cases_of(theme, stage, given, expected, partial(exactly, conditions, stage, value))
    return found
