"""What is refused in one sentence, and whole frames at the edge of what is not: values, window, report and plan."""

from __future__ import annotations

import json
import math
import time
from functools import partial
from typing import Any

import numpy as np

from ...core.backend import FLOAT32_LIMIT
from ...core.exposure import Exposure
from ...io.files import to_json
from ...render.passes import clean
from ...render.photons import collect
from ...sensor.chain import black_level_dn
from ...sensor.expose import expose
from ...sensor.gains import adc_gain_dn_per_v
from ...sensor.plan import plan
from .case import NAME, ONLY_ONCE, SIGMAS, TENTH, Case, Engine, cases_of, table1
from .chains import EVERY_OPTION, camera_of
from .got import Got, agree, holds, refusal, together


def light_with(*values: float) -> Any:
    """1000 photons, and these in the places (1, 2), (2, 0), …"""
    light = np.full((3, 4), 1000.0)
    for place, value in zip(((1, 2), (2, 0)), values, strict=False):
        light[place] = value
    return light


def photons_refused(value: float, kind: str) -> Got:
    """By expose and by plan."""
    part, light = f"photons is {kind} in 2 place(s), first at (1, 2)", light_with(value, value)
    actions = (lambda: expose(light, table1(), TENTH)), (lambda: plan(table1(), TENTH, light))
    return together(*(refusal(action, part) for action in actions))


def irradiance_refused(value: float) -> Got:
    """By collect."""
    part = "light is negative or NaN in 2 place(s), first at (1, 2)"
    return refusal(lambda: collect(light_with(value, value), table1(), TENTH), part)


def exposure_refused(name: str, _shown: str, value: Any) -> Got:
    """By the exposure itself."""
    return refusal(lambda: Exposure(**{"time_s": 0.1, name: value}), f"{name} is {value!r}; it must be")


def too_small(field: str, least: float) -> Got:
    """Refused before it overflows."""
    tiny = (5e-324, 1e-320, 1e-150, 0.99 * least)
    changes = [(x, partial(table1().replace, **{field: x})) for x in tiny]
    return together(*(refusal(change, f"{field} is {x!r}; it must be greater") for x, change in changes))


DIVISORS = (
    *("pixel.pitch_x_um", "source_follower.cds_sample_s", "source_follower.cds_dominant_s", "source_follower.rtn_s"),
    *("source_follower.gain", "readout.sense_gain_uv_per_e", "readout.cds_gain", "readout.v_ref_v", "adc.full_scale_v"),
)
"""Fields that something is divided by."""
SMALLEST = [*((field, 1e-30) for field in DIVISORS), ("pixel.full_well_e", 1.0)]
"""And the smallest number that they may be."""
NEEDED = {
    "source_follower.rtn_s": {"source_follower.rtn_uv": 100.0},
    "readout.v_ref_v": {"readout.ve_nonlinearity": 1.0},
}
"""Without these, nothing is divided by them."""


def refusal_cases() -> list[Case]:
    """Values that cannot be."""
    bad = ((math.nan, "NaN"), (-1.0, "negative"), (-1e-300, "negative"), (-math.inf, "negative"))
    times = (math.nan, math.inf, -math.inf, -1e-300, -1.0, 1.1e12, "0.1", None, [0.1])
    kelvins = (math.nan, math.inf, -1e-9, -273.15, 1.001e4, 1e9, "cold")
    exposures = [("time_s", repr(x), x) for x in times] + [("temperature_k", repr(x), x) for x in kelvins]
    count, value = "one sentence: how many, and the first place", "one sentence with value and range"
    refused = partial(cases_of, "refusals", asked=ONLY_ONCE)
    return [
        *refused("expose, plan", "{} photons in two pixels", count, photons_refused, bad),
        *refused("collect", "{} W/m² in two pixels", count, irradiance_refused, [x for x, _ in bad]),
        *refused("exposure", "{} = {}", value, exposure_refused, exposures),
        *refused("datasheet", "{} below {}", value, too_small, SMALLEST),
    ]


def renderers_values() -> Got:
    """What a renderer may give and light cannot be: three NaN, two −inf, one −1, one +inf among 12 values."""
    raw = np.full((3, 4), 2.0, dtype=np.float32)
    raw[0] = np.nan, np.nan, np.nan, 5.0
    raw[1] = -np.inf, -np.inf, -1.0, np.inf
    done = clean(raw)
    infinite = done.infinite is not None and done.infinite.sum() == 1 and bool(done.infinite[1, 3])
    text = f"{done.negative} negative, {done.non_finite} not finite, {int(infinite)} to saturate"
    left = done.values.tolist() == [[0, 0, 0, 5], [0, 0, 0, 0], [2, 2, 2, 2]]
    return holds(text, (done.negative, done.non_finite) == (1, 6), infinite, left)


def unchanged(engine: Engine) -> Got:
    """+inf in one pixel."""
    light = light_with(math.inf)
    one, other = (expose(x, table1(), TENTH, keep="electrons", **engine.how) for x in (light, light_with()))
    assert one.electrons is not None
    same = (one.digital[0] == other.digital[0])[np.isfinite(light)].all()
    full = float(one.electrons[0, 1, 2]), int(one.digital[0, 1, 2])
    return holds(f"{full[0]:g} e-, {full[1]} DN there; others as without: {same}", same, full == (33_000, 4095))


def unseen(engine: Engine) -> Got:
    """∞·0 = 0: the visible band counts alone."""
    bands, nm = np.stack([np.full((2, 2), np.inf), np.full((2, 2), 500.0)], axis=-1), [1500.0, 550.0]
    both = expose(bands, table1(), TENTH, wavelengths_nm=nm, keep="electrons", **engine.how).electrons
    alone = expose(bands[..., 1], table1(), TENTH, keep="electrons", **engine.how).electrons
    return agree(both, alone, unit=" e-")


EDGES = {
    "0 photons, 0 s, 0 K": (0.0, Exposure(0.0, 0.0)),
    "1e-320 photons, 1e-12 s, 5e-324 K": (1e-320, Exposure(1e-12, 5e-324)),
    "1e150 photons, 1e12 s, 1e4 K": (1e150, Exposure(1e12, 1e4)),
    "+inf photons, 1e6 s, 600 K": (math.inf, Exposure(1e6, 600.0)),
}


def whole_frame(engine: Engine, edge: str, name: str) -> Got:
    """Codes in range, and a report and a plan that strict JSON can hold."""
    (photons, exposure), camera = EDGES[edge], camera_of(name)
    light = np.full((4, 6), photons)
    frames = expose(light, camera, exposure, **engine.how)
    report = json.loads(to_json(frames.report))
    planned = json.loads(to_json(plan(camera, exposure, light).to_dict()))
    top = int(frames.digital.max())
    stages = [line["mean_frame"] is not None and line["mean_expected"] is not None for line in report["stages"]]
    text = f"{frames.digital.min()} … {top} DN, {len(stages)} stages reported, {len(planned['stages'])} planned"
    return holds(text, top < 2**camera.adc.bits, all(stages))


def published(edge: str) -> Got:
    """The same of the published chain, which has no plan."""
    photons, exposure = EDGES[edge]
    frames = expose(np.full((4, 6), photons), table1(), exposure, chain="konnik2014")
    report = json.loads(to_json(frames.report))
    text = f"{frames.digital.min()} … {frames.digital.max()} DN, {len(report['stages'])} stages reported"
    return holds(text, int(frames.digital.max()) <= 2**12)


def smallest(engine: Engine, field: str, least: float) -> Got:
    """The frame of float64; or a sentence, where float32 cannot hold the converter's gain."""
    camera, light = table1().replace(**{field: least}, **NEEDED.get(field, {})), light_with()
    if engine.precision == "float32" and adc_gain_dn_per_v(camera) > FLOAT32_LIMIT:
        return refusal(lambda: expose(light, camera, TENTH, **engine.how), "precision is 'float32', which holds")
    digital = expose(light, camera, TENTH, **engine.how).digital
    return agree(digital, expose(light, camera, TENTH, precision="float64").digital, 1.0, " DN")


def crop(engine: Engine, rows: int, columns: int) -> Got:
    """Any window is the corner of a larger one."""
    corner = min(rows, 2), min(columns, 2)
    one, other = (expose(np.full(s, 500.0), table1(), TENTH, **engine.how).digital for s in ((rows, columns), corner))
    same = agree(other, one[:, : corner[0], : corner[1]], unit=" DN")
    return holds(same.text, same.passed, one.shape == (1, rows, columns))


LARGE = (3000, 4000)


def twelve_megapixels(engine: Engine) -> Got:
    """Read noise, stripes and converter in the dark of 77 K: the mean is the black level, σ of stripes over √4000."""
    camera = table1(sensor__columns=LARGE[1], sensor__rows=LARGE[0], pixel__prnu=0.0)
    started = time.perf_counter()
    digital = expose(0.0, camera, Exposure(0.1, 77.0), **engine.how).digital
    seconds, stripes = time.perf_counter() - started, camera.readout.dsnu_col * 2**camera.adc.bits
    mean = agree(digital.mean(), black_level_dn(camera), SIGMAS * stripes / math.sqrt(LARGE[1]), " DN")
    return holds(f"mean {mean.text}, {digital.dtype}, {seconds:.1f} s", mean.passed, digital.shape == (1, *LARGE))


def frame_cases() -> list[Case]:
    """Values, whole frames, windows."""
    light, frames, size = (
        partial(cases_of, "light"),
        partial(cases_of, "whole frames"),
        partial(cases_of, "frame sizes"),
    )
    clamped = "clamped to 0 and counted; +inf marked, to saturate"
    finite, codes = "finite; codes in range; report and plan are strict JSON", "codes 0 … 2^12; report is strict JSON"
    same = "float64's frame to 1 DN, or a sentence why float32 cannot"
    stripes = "the black level, within 5 standard errors of its stripes"
    edges, shapes = (
        [(edge, name) for name in (NAME, EVERY_OPTION) for edge in EDGES],
        ((1, 1), (1, 5000), (5000, 1), (2, 3)),
    )
    return [
        *light("irradiance", "NaN, ±inf and −1 from the renderer", clamped, renderers_values, asked=ONLY_ONCE),
        *light("expose", "+inf photons in one pixel", "it is full, and no other changes", unchanged),
        *light("detection", "+inf photons where the sensor sees nothing", "no electron of them", unseen),
        *frames("expose, report, plan", "{}; {}", finite, whole_frame, edges, seconds=0.2),
        *frames("published chain", "{}", codes, published, EDGES, ONLY_ONCE),
        *frames("expose", "{} = {}", same, smallest, SMALLEST),
        *size("expose", "{} × {}", "the corner of any other window", crop, shapes),
        *size("expose", "3000 × 4000, dark, 77 K", stripes, twelve_megapixels, seconds=2.0),
    ]
