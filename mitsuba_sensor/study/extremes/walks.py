"""Whole chains, stage by stage, from no light to 1e150 photons, from no time to 30 000 years, from 0 K to 10 000 K."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from ...core.backend import BRIGHTEST
from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow
from ...core.signals import Electrons, Photons
from ...sensor.camera import Camera, list_cameras, load_camera
from ...sensor.chain import chain
from ...sensor.noise_budget import stage_name
from .case import RARE, SIGMAS, Case, Engine, Got

SHAPE, TILE = (64, 64), (2, 2)
"""4096 pixels: 5 standard errors of a mean are 8 % of a pixel's σ, and 60 % of that of columns or rows. The light is
the same everywhere, so the theory of one tile of colour filters is that of all."""

ROUNDINGS = 16
"""A number that went through a chain is some unit roundoffs off: one for each operation."""

COMPARED = 1e-2 * BRIGHTEST
"""Above BRIGHTEST engines count no further; no pixel's share of a pattern is a hundredth."""

FIRST_S = 0.7
"""How long the walks of a theme take on one engine [s]."""

EVERY_OPTION = "every option"
OPTIONS: dict[str, Any] = {
    "readout.reset": "hard", "readout.dsnu_row": 5e-4, "readout.prnu_col": 2e-3, "pixel.dsnu_e": 20.0,
    "pixel.prnu_distribution": "lognormal", "dark_current.distribution": "gamma", "dark_current.cv": 0.1,
    "dark_current.rts_fraction": 0.2, "dark_current.rts_amplitude_e_per_s": 900.0, "dark_current.rts_switching": 0.5,
    "quantum_efficiency.quantum_yield": [2.3, 1.1], "source_follower.rtn_uv": 100.0,
    "readout.ve_nonlinearity": 0.5, "source_follower.gain": 0.9, "source_follower.vv_nonlinearity": 1.05,
    "readout.cds_gain": 2.0, "adc.gamma": 1.04, "adc.dnl_lsb": {"100": 0.7, "511": -1.0, "900": 0.3},
}  # fmt: skip
"""Every stage that a camera may have, all of them at once, on Table 1."""


@cache
def camera_of(name: str) -> Camera:
    """A shipped camera, or the one with every option."""
    return load_camera("konnik_table1").replace(**OPTIONS) if name == EVERY_OPTION else load_camera(name)


@cache
def cameras() -> tuple[str, ...]:
    """Whose chains are walked."""
    return (*list_cameras(), EVERY_OPTION)


TENTH = Exposure(0.1)


@dataclass(frozen=True)
class Condition:
    """Light as photons per pixel, or as a share of the full well of the most sensitive filter; and an exposure."""

    words: str
    photons: float = 0.0
    well: float = 0.0
    exposure: Exposure = TENTH

    def light(self, camera: Camera) -> float:
        """Mean photons per pixel."""
        sensitivity = camera.qe([camera.quantum_efficiency.reference_nm]).max()
        return self.photons + self.well * camera.pixel.full_well_e / float(sensitivity)


LIGHT = (
    *(Condition(n, photons=float(n)) for n in ("0", "1e-320", "1e-12", "1e-6", "1")),
    Condition("¼ well", well=0.25),
    *(Condition(n, photons=float(n)) for n in ("1e12", "1e30", "1e150")),
)
"""Between a quarter of a well and far more than one, a clip of what is not normal has no closed form to compare with
(test_stages looks there, to 5 %)."""
TIME = tuple(Condition(f"{t} s", exposure=Exposure(float(t))) for t in ("0", "1e-12", "1e-3", "1", "1e6", "1e12"))
WARMTH = tuple(
    Condition(f"{k} K", photons=1000.0, exposure=Exposure(0.1, float(k)))
    for k in ("0", "5e-324", "4", "77", "300", "400", "600", "1e4")
)
NOTHING = tuple(replace(condition, exposure=Exposure(0.0)) for condition in LIGHT[:3])


@dataclass(frozen=True)
class Step:
    """One stage on one walk: smallest and largest value of the pixels that see light at all, and how many standard
    errors the mean is off (NaN where anything is not finite)."""

    low: float
    high: float
    off: float


@cache
def walk(name: str, condition: Condition, engine: Engine) -> dict[str, Step]:
    """Every stage of a camera by its name, in one frame."""
    camera = camera_of(name)
    frame, stages = engine.frame(SHAPE, condition.exposure), chain(camera)
    signal: Any = Photons(np.full(SHAPE, condition.light(camera)))
    signals = []
    for stage in stages:
        signal = stage(signal, frame)
        signals.append(signal.total if isinstance(signal, Electrons) else signal)
    seen = camera.qe([camera.quantum_efficiency.reference_nm])[camera.filter_index(SHAPE), 0] > 0
    tile = Frame(condition.exposure, SensorWindow(7, TILE))
    theory = Moments(Photons(np.full(TILE, condition.light(camera))), 0.0, 0.0, tile)
    lines, unit, steps = False, 1.0, {}
    for stage, values in zip(stages, engine.give(signals, frame), strict=True):
        theory = stage.moments(theory)
        unit *= getattr(stage, "nominal_gain", 1.0)
        lines = lines or stage_name(stage).startswith(("column", "row"))
        off = _off(values, theory, lines, RARE * unit, engine)
        steps[stage_name(stage)] = Step(float(values[seen].min()), float(values[seen].max()), off)
    return steps


def _off(values: Any, theory: Moments, lines: bool, rare: float, engine: Engine) -> float:
    """Distance of the mean from its theory in standard errors, less what rounding and single counts explain.

    lines : whether a fixed part may be shared by whole columns or rows.  rare : a few counts, in this stage's unit.
    """
    if not all(np.isfinite(x).all() for x in (values, theory.mean, theory.temporal, theory.spatial)):
        return math.nan
    mean = np.tile(np.broadcast_to(np.minimum(theory.mean, COMPARED), TILE), np.floor_divide(SHAPE, TILE))
    temporal, fixed = float(np.mean(theory.temporal)), float(np.mean(theory.spatial))
    error = math.sqrt(temporal / values.size + fixed / (min(SHAPE) if lines else values.size))
    explained = rare / values.size + ROUNDINGS * engine.unit * float(np.abs(mean).max())
    beyond = max(abs(float(np.mean(np.minimum(values, COMPARED) - mean))) - explained, 0.0)
    return beyond / error if error else (math.inf if beyond else 0.0)


def _stages() -> list[str]:
    """Names of all stages of all cameras, in the order of the chain."""
    return list(dict.fromkeys(stage_name(stage) for name in reversed(cameras()) for stage in chain(camera_of(name))))


def _walked(engine: Engine, stage: str, conditions: tuple[Condition, ...]) -> Got:
    """The worst of one stage."""
    worst, where, low, high = 0.0, "", math.inf, -math.inf
    for name in cameras():
        for condition in conditions:
            if (step := walk(name, condition, engine).get(stage)) is None:
                continue
            low, high = min(low, step.low), max(high, step.high)
            if not step.off <= worst:
                worst, where = step.off, f" ({name}, {condition.words})"
            if math.isnan(worst):
                return Got(f"not finite{where}", False)
    good = worst <= SIGMAS and (low >= 0 or stage not in COUNTS)
    return Got(f"{low + 0.0:.4g} … {high:.4g}, mean off by {worst:.1f} standard errors at most{where}", good)


COUNTS = ("detection", "prnu", "dark current", "blinking pixels", "shot noise", "quantum yield", "full well")
"""Stages that hand on electrons, of which there cannot be fewer than none."""


def _exact(engine: Engine, stage: str, conditions: tuple[Condition, ...], value: Callable[[Camera], float]) -> Got:
    """Every pixel that sees light at all has exactly ``value(camera)`` after a stage."""
    frames = [(name, condition) for name in cameras() for condition in conditions]
    for name, condition in frames:
        step = walk(name, condition, engine)[stage]
        if {step.low, step.high} != {value(camera_of(name))}:
            return Got(f"{step.low:g} … {step.high:g} ({name}, {condition.words})", False)
    return Got(f"so in {len(frames)} frames", True)


def _theme(theme: str, given: str, conditions: tuple[Condition, ...]) -> list[Case]:
    """One case per stage; the first one walks, and the others look at what it saw."""
    expected = "finite; mean within 5 standard errors of the stage's own theory"
    return [
        Case(
            theme,
            stage,
            f"{given}; {len(list_cameras())} shipped cameras and one with every option",
            f"{expected}, never below 0" if stage in COUNTS else expected,
            partial(_walked, stage=stage, conditions=conditions),
            seconds=0.001 if number else FIRST_S,
        )
        for number, stage in enumerate(_stages())
    ]


def _exactly(theme: str, given: str, stage: str, conditions: tuple[Condition, ...]) -> Case:
    """No electron, or a full well of them."""
    full = stage == "full well"
    expected = f"exactly {'the full well' if full else '0 electrons'} in every pixel that sees light"
    value = lambda camera: camera.pixel.full_well_e if full else 0.0  # noqa: E731
    return Case(theme, stage, given, expected, partial(_exact, stage=stage, conditions=conditions, value=value))


def cases() -> list[Case]:
    """Light, time, warmth."""
    light, times, kelvins = (", ".join(c.words for c in conditions) for conditions in (LIGHT, TIME, WARMTH))
    return [
        *_theme("light", f"{light} photons", LIGHT),
        _exactly("light", "0, 1e-320 and 1e-12 photons, 0 s", "shot noise", NOTHING),
        _exactly("light", "1e12, 1e30 and 1e150 photons", "full well", LIGHT[-3:]),
        *_theme("exposure time", f"dark, {times}", TIME),
        _exactly("exposure time", "dark, 1e6 and 1e12 s", "full well", TIME[-2:]),
        *_theme("temperature", f"1000 photons, {kelvins}", WARMTH),
        _exactly("temperature", "600 and 1e4 K", "full well", WARMTH[-2:]),
    ]
