"""Whole chains, stage by stage, from no light to 1e150 photons, from no time to 30 000 years, from 0 K to 10 000 K."""

from __future__ import annotations

import itertools
import math
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from ... import Camera, Exposure, Photons, list_cameras, load_camera
from ...core.backend import FLOAT32_LIMIT
from ...core.frame import Frame
from ...core.moments import Moments
from ...core.sensor_window import SensorWindow
from ...core.types import Array
from .case import NAME, RARE, SIGMAS, TENTH, Engine, Rows, holds, to_numpy

SHAPE, TILE = (64, 64), (2, 2)
"""4096 pixels: 5 standard errors of a mean are 8 % of a pixel's σ, and 60 % of that of columns or rows. The light is
the same everywhere, so the theory of one tile of colour filters is that of all."""
ROUNDINGS = 16  # A number that went through a chain is some unit roundoffs off: one for each operation
COMPARED = 1e-2 * FLOAT32_LIMIT  # engines count no further than the limit; no pixel's share of an FPN is a hundredth
NODE_OPTIONS = {"readout.reset": "hard", "readout.dsnu_row": 5e-4, "readout.prnu_col": 2e-3, "pixel.dsnu_e": 20.0}
CURVES = {"readout.ve_nonlinearity": 0.5, "source_follower.vv_nonlinearity": 1.05, "adc.gamma": 1.04}
EVERY_OPTION = "every option"
OPTIONS: dict[str, object] = {
    **NODE_OPTIONS,
    **CURVES,
    **{"pixel.prnu_distribution": "lognormal", "dark_current.distribution": "gamma", "dark_current.cv": 0.1},
    **{"dark_current.rts_fraction": 0.2, "dark_current.rts_amplitude_e_per_s": 900.0},
    **{"dark_current.rts_switching": 0.5, "quantum_efficiency.quantum_yield": [2.3, 1.1]},
    **{"source_follower.rtn_uv": 100.0, "source_follower.gain": 0.9, "readout.cds_gain": 2.0},
    "adc.dnl_lsb": {"100": 0.7, "511": -1.0, "900": 0.3},
}
"""Every stage that a camera may have, all of them at once, on Table 1."""
CAMERAS = (*list_cameras(), EVERY_OPTION)


@cache
def camera_of(name: str) -> Camera:
    """A shipped camera, or the one with every option."""
    return load_camera(NAME).replace(**OPTIONS) if name == EVERY_OPTION else load_camera(name)


class Condition(NamedTuple):
    """Mean photons per pixel, and more as a share of the full well of the most sensitive filter; and an exposure."""

    name: str
    photons: float = 0.0
    well: float = 0.0
    exposure: Exposure = TENTH


Conditions = tuple[Condition, ...]


class Seen(NamedTuple):
    """Behind one stage: smallest and largest value of the pixels that see light at all, and how many standard errors
    the mean is off (NaN where anything is not finite)."""

    low: float
    high: float
    off: float


def seen_behind(name: str, condition: Condition, engine: Engine) -> dict[str, Seen]:
    """Every stage of a camera by its label, in one frame."""
    camera = camera_of(name)
    qe = camera.qe([camera.quantum_efficiency.reference_nm or 0.0])
    photons = condition.photons + condition.well * camera.pixel.full_well_e / float(qe.max())
    frame, signals = engine.frame(SHAPE, condition.exposure), [Photons(np.full(SHAPE, photons))]
    for stage in camera.stages:
        signals.append(stage.sample(signals[-1], frame))
    lit = qe[camera.filter_index(SHAPE), 0] > 0
    tile = Frame(condition.exposure, SensorWindow(7, TILE))
    theory = Moments(Photons(np.full(TILE, photons)), 0.0, 0.0, tile)
    lines, unit, found = False, 1.0, {}
    for stage, values in zip(camera.stages, to_numpy(signals[1:], frame), strict=True):
        theory = stage.moments(theory)
        unit *= stage.nominal_gain
        lines = lines or not {"column", "row"}.isdisjoint(stage.label.split())
        off = standard_errors(values, theory, lines, RARE * unit, engine)
        found[stage.label] = Seen(float(values[lit].min()), float(values[lit].max()), off)
    return found


def standard_errors(values: Array, theory: Moments, lines: bool, rare: float, engine: Engine) -> float:
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


def extremes(given: str, conditions: Conditions, exact: dict[str, tuple[str, Conditions]], engine: Engine) -> Rows:
    """Every stage of every camera under all conditions; and where a well must be full, or another stage empty.

    given : in words, with ``{}`` for the conditions.  exact : input → stage and conditions.
    """
    given = given.format(", ".join(condition.name for condition in conditions))
    given += f"; {len(list_cameras())} shipped cameras and one with every option"
    domains = {stage.label: stage.domain for name in reversed(CAMERAS) for stage in camera_of(name).stages}
    frames = {at: seen_behind(*at, engine) for at in itertools.product(CAMERAS, conditions)}
    for stage, domain in domains.items():
        found = {f"{name}, {at.name}": seen[stage] for (name, at), seen in frames.items() if stage in seen}
        low, high = min(seen.low for seen in found.values()), max(seen.high for seen in found.values())
        where = max(found, key=lambda where: math.inf if math.isnan(found[where].off) else found[where].off)
        off, counted = found[where].off, domain == "electrons"  # of which there cannot be fewer than none
        expected = "finite; mean within 5 standard errors of the stage's own theory" + ", never below 0" * counted
        text = f"{low + 0.0:.4g} … {high:.4g}, mean off by {off:.1f} standard errors at most ({where})"
        yield stage, given, expected, holds(text, off <= SIGMAS, low >= 0 or not counted)
    for given, (stage, some) in exact.items():
        full, wrong, at = stage == "full well", "", list(itertools.product(CAMERAS, some))
        for name, condition in at:
            seen = (frames.get((name, condition)) or seen_behind(name, condition, engine))[stage]
            if {seen.low, seen.high} != {camera_of(name).pixel.full_well_e if full else 0.0}:
                wrong = wrong or f"{seen.low:g} … {seen.high:g} ({name}, {condition.name})"
        expected = f"exactly {'the full well' if full else '0 electrons'} in every pixel that sees light"
        yield stage, given, expected, holds(wrong or f"so in {len(at)} frames", not wrong)


FEW, MANY = (
    tuple(Condition(x, float(x)) for x in some) for some in (("0", "1e-320", "1e-12"), ("1e12", "1e30", "1e150"))
)
NOTHING = tuple(condition._replace(exposure=Exposure(0.0)) for condition in FEW)
LIGHT = (*FEW, Condition("1e-6", 1e-6), Condition("1", 1.0), Condition("¼ well", well=0.25), *MANY)
"""Between a quarter of a well and far more than one, a clip of what is not normal has no closed form to compare with
(test_stages looks there, to 5 %)."""
TIME = tuple(Condition(f"{t} s", exposure=Exposure(float(t))) for t in ("0", "1e-12", "1e-3", "1", "1e6", "1e12"))
KELVINS = ("0", "5e-324", "4", "77", "300", "400", "600", "1e4")
WARMTH = tuple(Condition(f"{k} K", 1000.0, exposure=Exposure(0.1, float(k))) for k in KELVINS)
EMPTY = {"0, 1e-320 and 1e-12 photons, 0 s": ("shot noise", NOTHING)}
lights = partial(extremes, "{} photons", LIGHT, EMPTY | {"1e12, 1e30 and 1e150 photons": ("full well", MANY)})
times = partial(extremes, "dark, {}", TIME, {"dark, 1e6 and 1e12 s": ("full well", TIME[-2:])})
temperatures = partial(extremes, "1000 photons, {}", WARMTH, {"600 and 1e4 K": ("full well", WARMTH[-2:])})
