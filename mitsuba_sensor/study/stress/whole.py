"""Chains, stage by stage, and frames: light to 1e150 photons, time to 1e12 s, 0 K to 1e4 K; and what is refused."""

from __future__ import annotations

import itertools
import json
import math
import operator
import time
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ... import Camera, Exposure, Photons, collect, expose, load_camera, plan
from ...core import Float64Array, Frame, Moments, SensorWindow
from ...core.backend import FLOAT32_LIMIT
from ...files.texts import to_json
from ...render.passes.passes import clean
from ...sensor.chain import black_level_dn
from ...sensor.gains import adc_gain_dn_per_v
from .case import CASES as TABLES
from .case import NAME, RARE, SIGMAS, TENTH, Engine, Rows, agree, holds, refusal, shown, table1, to_numpy, together

SHAPE, TILE = (64, 64), (2, 2)  # 5 standard errors are 8 % of a pixel's σ, 60 % of a column's; theory has one tile
COMPARED = 1e-2 * FLOAT32_LIMIT  # engines count no further than the limit; no pixel's share of an FPN is a hundredth
EVERY_OPTION = "every option"
EACH_KIND = ("konnik_table1", "bayer_2mp", "rgbir_2mp", "eev_44_82")
"""Shipped cameras: monochrome CMOS, two mosaics, CCD."""
CAMERAS = {name: load_camera(name) for name in EACH_KIND}
CAMERAS[EVERY_OPTION] = load_camera(NAME).replace(**TABLES["curved"], **TABLES["options"])


def reference_qe(camera: Camera) -> Float64Array:
    """Quantum efficiency of every filter at the wavelength of light that names none."""
    return camera.qe([camera.quantum_efficiency.reference_nm or 0.0])[:, 0]


class Condition(NamedTuple):
    """Mean photons per pixel, and more as a share of the full well of the most sensitive filter; and an exposure."""

    name: str
    photons: float = 0.0
    well: float = 0.0
    exposure: Exposure = TENTH


Conditions = tuple[Condition, ...]


def seen_behind(name: str, condition: Condition, engine: Engine) -> dict[str, tuple[float, float, float]]:
    """Behind every stage: least and largest value of lit pixels, and the standard errors of the mean off its theory."""
    camera, exposure = CAMERAS[name], condition.exposure
    qe, stages, frame = reference_qe(camera), camera.stages, engine.frame(SHAPE, exposure)
    photons, tile = condition.photons + condition.well * camera.pixel.full_well_e / float(qe.max()), np.ones(TILE)
    flat, small = Photons(np.full(SHAPE, photons)), Photons(photons * tile)
    start = Moments(small, 0.0, 0.0, Frame(exposure, SensorWindow(7, TILE)))
    _, *signals = itertools.accumulate(stages, lambda signal, stage: stage.sample(signal, frame), initial=flat)
    _, *theories = itertools.accumulate(stages, lambda m, stage: stage.moments(m), initial=start)
    units = itertools.accumulate((stage.nominal_gain for stage in stages), operator.mul)
    lit, averaged, found = qe[camera.filter_index(SHAPE)] > 0, SHAPE[0] * SHAPE[1], {}
    for stage, values, theory, unit in zip(stages, to_numpy(signals, frame), theories, units, strict=True):
        if not {"column", "row"}.isdisjoint(stage.label.split()):
            averaged = min(SHAPE)  # columns or rows may share a spatial part
        off, parts = math.nan, (theory.mean, theory.temporal, theory.spatial)
        if all(np.isfinite(x).all() for x in (values, *parts)):
            mean = np.tile(np.minimum(theory.mean, COMPARED) * tile, np.floor_divide(SHAPE, TILE))
            error = math.sqrt(float(np.mean(parts[1])) / values.size + float(np.mean(parts[2])) / averaged)
            explained = RARE * unit / values.size + 16 * engine.unit * float(np.abs(mean).max())  # operations
            beyond = max(abs(float(np.mean(np.minimum(values, COMPARED) - mean))) - explained, 0.0)
            off = beyond / error if error else (math.inf if beyond else 0.0)
        found[stage.label] = float(values[lit].min()), float(values[lit].max()), off
    return found


def extremes(given: str, conditions: Conditions, exact: dict[str, tuple[str, Conditions]], engine: Engine) -> Rows:
    """Every stage of every camera under all conditions; exact: where a well must be full, or another stage empty."""
    given = given.format(", ".join(condition.name for condition in conditions))  # the input, in a sentence
    given += f"; {len(CAMERAS)} shipped cameras and one with every option"
    domains = {stage.label: stage.domain for name in reversed(CAMERAS) for stage in CAMERAS[name].stages}
    frames = {at: seen_behind(*at, engine) for at in itertools.product(CAMERAS, conditions)}
    for stage, domain in domains.items():
        found = {f"{name}, {at.name}": seen[stage] for (name, at), seen in frames.items() if stage in seen}
        lows, highs, offs = zip(*found.values(), strict=True)
        worst = int(np.argmax(offs))  # of a NaN, if there is any
        off, where, counted = offs[worst], list(found)[worst], domain == "electrons"  # never fewer than none of them
        expected = "finite; mean within 5 standard errors of the stage's own theory" + ", never below 0" * counted
        text = f"{min(lows) + 0.0:.4g} … {max(highs):.4g}, mean off by {off:.1f} standard errors at most ({where})"
        yield stage, given, expected, holds(text, off <= SIGMAS, min(lows) >= 0 or not counted)
    for given, (stage, some) in exact.items():
        full, wrong, at = stage == "full well", "", list(itertools.product(CAMERAS, some))
        for name, condition in at:
            low, high, _ = (frames.get((name, condition)) or seen_behind(name, condition, engine))[stage]
            if {low, high} != {CAMERAS[name].pixel.full_well_e if full else 0.0}:
                wrong = wrong or f"{low:g} … {high:g} ({name}, {condition.name})"
        expected = f"exactly {'the full well' if full else '0 electrons'} in every pixel that sees light"
        yield stage, given, expected, holds(wrong or f"so in {len(at)} frames", not wrong)


FEW = tuple(Condition(x, float(x)) for x in ("0", "1e-320", "1e-12"))
MANY = tuple(Condition(x, float(x)) for x in ("1e12", "1e30", "1e150"))
# About one well, a clip of what is not normal has no closed form to compare with (test_stages: to 5 %)
LIGHT = (*FEW, Condition("1e-6", 1e-6), Condition("1", 1.0), Condition("¼ well", well=0.25), *MANY)
TIME = tuple(Condition(f"{t} s", exposure=Exposure(float(t))) for t in ("0", "1e-12", "1e-3", "1", "1e6", "1e12"))
KELVINS = ("0", "5e-324", "4", "77", "300", "400", "600", "1e4")
WARMTH = tuple(Condition(f"{k} K", 1000.0, exposure=Exposure(0.1, float(k))) for k in KELVINS)
EMPTY = {"0, 1e-320 and 1e-12 photons, 0 s": ("shot noise", tuple(x._replace(exposure=Exposure(0.0)) for x in FEW))}
lights = partial(extremes, "{} photons", LIGHT, EMPTY | {"1e12, 1e30 and 1e150 photons": ("full well", MANY)})
times = partial(extremes, "dark, {}", TIME, {"dark, 1e6 and 1e12 s": ("full well", TIME[-2:])})
temperatures = partial(extremes, "1000 photons, {}", WARMTH, {"600 and 1e4 K": ("full well", WARMTH[-2:])})

WRONG_S = (math.nan, math.inf, -math.inf, -1e-300, -1.0, 1.1e12, "0.1", None, [0.1])
WRONG_K = (math.nan, math.inf, -1e-9, -273.15, 1.001e4, 1e9, "cold")
SMALLEST, NEEDED = TABLES["smallest"], TABLES["needed"]
CORNERS = ("0", "0", "0"), ("1e-320", "1e-12", "5e-324"), ("1e150", "1e12", "1e4"), ("+inf", "1e6", "600")
EDGES = {f"{n} photons, {t} s, {k} K": (float(n), Exposure(float(t), float(k))) for n, t, k in CORNERS}


def light_with(one: float = 1000.0, other: float = 1000.0) -> Float64Array:
    """1000 photons, and these in the places (1, 2) and (2, 0)."""
    return np.array([[1000.0] * 4, [1000.0, 1000.0, one, 1000.0], [other, 1000.0, 1000.0, 1000.0]])


def refusals(_: Engine) -> Rows:
    """Values that cannot be."""
    first, count = "in 2 place(s), first at (1, 2)", "one sentence: how many, and the first place"
    for value, kind in ((math.nan, "NaN"), (-1.0, "negative"), (-1e-300, "negative"), (-math.inf, "negative")):
        light = light_with(value, value)
        actions = partial(expose, light, table1(), TENTH), partial(plan, table1(), TENTH, light)
        got = refusal(f"photons is {kind} {first}", *actions)
        yield "expose, plan", f"{shown(value)} photons in two pixels", count, got
        got = refusal(f"light is negative or NaN {first}", partial(collect, light, table1(), TENTH))
        yield "collect", f"{shown(value)} W/m² in two pixels", count, got
    expected = "one sentence with value and range"
    for name, wrong in [*(("time_s", x) for x in WRONG_S), *(("temperature_k", x) for x in WRONG_K)]:
        got = refusal(f"{name} is {wrong!r}; it must be", partial(replace, TENTH, **{name: wrong}))
        yield "exposure", f"{name} = {wrong!r}", expected, got
    for field, least in SMALLEST.items():
        tiny = {x: partial(table1().replace, **{field: x}) for x in (5e-324, 1e-320, 1e-150, 0.99 * least)}
        got = together(*(refusal(f"{field} is {x!r}; it must be greater", change) for x, change in tiny.items()))
        yield "datasheet", f"{field} below {shown(least)}", expected, got


def renderers_values(_: Engine) -> Rows:
    """What a renderer may give and light cannot be: three NaN, two −inf, one −1, one +inf among 12 values."""
    raw = [[np.nan, np.nan, np.nan, 5.0], [-np.inf, -np.inf, -1.0, np.inf], [2.0, 2.0, 2.0, 2.0]]
    done = clean(np.array(raw, dtype=np.float32))
    infinite = done.infinite is not None and np.argwhere(done.infinite).tolist() == [[1, 3]]
    text = f"{done.negative} negative, {done.non_finite} not finite, {int(infinite)} to saturate"
    left = done.values.tolist() == [[0, 0, 0, 5], [0, 0, 0, 0], [2, 2, 2, 2]]
    got = holds(text, (done.negative, done.non_finite) == (1, 6), infinite, left)
    yield "irradiance", "NaN, ±inf and −1 from the renderer", "clamped to 0 and counted; +inf marked, to saturate", got


def infinite_light(engine: Engine) -> Rows:
    """+inf in one pixel; and in a band that the sensor does not see: ∞·0 = 0, the visible band counts alone."""
    light, camera = light_with(math.inf), table1()
    one, other = (engine.expose(Photons(x), camera, keep="electrons") for x in (light, light_with()))
    same = (one.digital[0] == other.digital[0])[np.isfinite(light)].all()
    full_e, full_dn = np.asarray(one.electrons)[0, 1, 2], one.digital[0, 1, 2]
    text = f"{full_e:g} e-, {full_dn} DN there; others as without: {same}"
    got = holds(text, same, full_e == 33_000, full_dn == 4095)
    yield "expose", "+inf photons in one pixel", "it is full, and no other changes", got
    bands = np.tile([np.inf, 500.0], (2, 2, 1))
    both = engine.expose(Photons(bands, np.array([1500.0, 550.0])), camera, keep="electrons").electrons
    alone = engine.expose(bands[..., 1], camera, keep="electrons").electrons
    got = agree(both, alone, unit=" e-")
    yield "detection", "+inf photons where the sensor sees nothing", "no electron of them", got


def edge_light(photons: float) -> Photons:
    """So many photons in 4 × 6 pixels."""
    return Photons(np.full((4, 6), photons))


def plans(_: Engine) -> Rows:
    """Plans at the ends, which no engine changes; with every option, which takes seconds each, at two of them."""
    for name, edge in [*((NAME, edge) for edge in EDGES), *((EVERY_OPTION, list(EDGES)[k]) for k in (0, -1))]:
        photons, exposure = EDGES[edge]
        planned = json.loads(to_json(plan(CAMERAS[name], exposure, edge_light(photons)).to_dict()))["stages"]
        got = holds(f"{len(planned)} stages planned", len(planned) == len(CAMERAS[name].stages))
        yield "plan", f"{edge}; {name}", "every stage; strict JSON", got


def whole_frames(engine: Engine) -> Rows:
    """Light, time and temperature at their ends; and the smallest divisors, against the frame of float64."""
    for name, (edge, (photons, exposure)) in itertools.product((NAME, EVERY_OPTION), EDGES.items()):
        camera, light = CAMERAS[name], edge_light(photons)
        frames = engine.expose(light, camera, exposure)
        lines, top = json.loads(to_json(frames.report))["stages"], int(frames.digital.max())
        told = all(line["mean_frame"] is not None and line["mean_expected"] is not None for line in lines)
        text = f"{frames.digital.min()} … {top} DN, {len(lines)} stages reported"
        expected = "finite; codes in range; report is strict JSON"
        yield "expose, report", f"{edge}; {name}", expected, holds(text, top < 2**camera.adc.bits, told)
    for field, least in SMALLEST.items():
        camera = table1().replace(**{field: least}, **NEEDED.get(field.split(".")[1], {}))
        exposed = partial(engine.expose, light_with(), camera)
        if engine.precision == "float32" and adc_gain_dn_per_v(camera) > FLOAT32_LIMIT:
            got = refusal("precision is 'float32', which holds", exposed)
        else:
            reference = expose(light_with(), camera, TENTH, precision="float64")
            got = agree(exposed().digital, reference.digital, 1.0, " DN")
        yield "expose", f"{field} = {shown(least)}", "float64's frame to 1 DN, or a sentence why float32 cannot", got


def published_frames(_: Engine) -> Rows:
    """The same of the published chain, which has no plan."""
    for edge, (photons, exposure) in EDGES.items():
        frames = expose(edge_light(photons), table1(), exposure, chain="konnik2014")
        lines, top = json.loads(to_json(frames.report))["stages"], int(frames.digital.max())
        got = holds(f"{frames.digital.min()} … {top} DN, {len(lines)} stages reported", top <= 2**12)
        yield "published chain", edge, "codes 0 … 2^12; report is strict JSON", got


def no_exact_count(_: Engine) -> Rows:
    """Electrons beyond 2^24, and codes beyond 2^23: the precision that nobody chose."""
    cameras = {"23 bit": table1(adc__bits=23), "24 bit": table1(adc__bits=24), "5e7 e-": table1(pixel__full_well_e=5e7)}
    for given, camera in cameras.items():
        exposed = partial(expose, np.ones((2, 2)), camera, Exposure(0.0))
        found, exact = exposed(engine="numpy").first.window.backend.precision, given != "23 bit"
        refused = refusal("compiled engines are float32: take numpy" * exact, partial(exposed, engine="drjit"))
        got = holds(
            f"NumPy takes {found}; {refused.text}", found == ("float64" if exact else "float32"), refused.passed
        )
        expected = "float64 on NumPy; a compiled engine says that it has none"
        yield "expose", f"{given} without a precision", expected if exact else "float32", got


def frame_sizes(engine: Engine) -> Rows:
    """Any window is the corner of a larger one; a large one in the dark has the mean of the black level."""
    for rows, columns in ((1, 1), (1, 5000), (5000, 1), (2, 3)):
        shapes = (rows, columns), (min(rows, 2), min(columns, 2))
        one, other = (engine.expose(np.full(shape, 500.0), table1()).digital for shape in shapes)
        got = agree(other, one[:, :2, :2], 0.0, " DN", one.shape == (1, rows, columns))
        yield "expose", f"{rows} × {columns}", "the corner of any other window", got
    rows, columns = 3000, 4000
    camera = table1(sensor__columns=columns, sensor__rows=rows, pixel__prnu=0.0)
    started = time.perf_counter()
    digital = engine.expose(0.0, camera, Exposure(0.1, 77.0)).digital
    seconds, dsnu_dn = time.perf_counter() - started, camera.readout.dsnu_col * 2**camera.adc.bits
    mean = agree(digital.mean(), black_level_dn(camera), SIGMAS * dsnu_dn / math.sqrt(columns), " DN")
    text = f"mean {mean.text}, {digital.dtype}, {seconds:.1f} s"
    expected = "the black level, within 5 standard errors of the column DSNU"
    yield "expose", "3000 × 4000, dark, 77 K", expected, holds(text, mean.passed, digital.shape == (1, rows, columns))
