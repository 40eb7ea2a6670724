"""What is refused in one sentence, and whole frames at the edge of what is not: values, window, report and plan."""

from __future__ import annotations

import json
import math
import time
from functools import cache, partial
from typing import Any

import numpy as np

from ...core.backend import BRIGHTEST
from ...core.exposure import Exposure
from ...io.files import to_json
from ...render.passes import clean
from ...render.photons import collect
from ...sensor.camera import Camera, load_camera
from ...sensor.chain import adc_gain_dn_per_v, black_level_dn
from ...sensor.expose import Frames, expose
from ...sensor.plan import plan
from .case import SIGMAS, Case, Engine, Got, once, refusal, shown
from .walks import EVERY_OPTION, camera_of

EXPOSURE = Exposure(0.1)
NAME = "konnik_table1"


@cache
def table1() -> Camera:
    """The paper's camera."""
    return load_camera(NAME)


def light_with(*values: float) -> Any:
    """1000 photons, and these in the places (1, 2), (2, 0), …"""
    light = np.full((3, 4), 1000.0)
    for place, value in zip(((1, 2), (2, 0)), values, strict=False):
        light[place] = value
    return light


def photons_refused(value: float, kind: str) -> Got:
    """By expose and by plan."""
    words = f"photons is {kind} in 2 place(s), first at (1, 2)"
    light = light_with(value, value)
    planned = refusal(lambda: plan(table1(), EXPOSURE, light), words)
    exposed = refusal(lambda: expose(light, table1(), EXPOSURE), words)
    return Got(exposed.words, exposed.passed and planned.passed)


def irradiance_refused(value: float) -> Got:
    """By collect."""
    words = "light is negative or NaN in 2 place(s), first at (1, 2)"
    return refusal(lambda: collect(light_with(value, value), table1(), EXPOSURE), words)


def exposure_refused(name: str, value: Any) -> Got:
    """At the door."""
    exposure = {"time_s": 0.1, name: value}
    return refusal(lambda: Exposure(**exposure), f"{name} is {value!r}; it must be")


def renderers_values() -> Got:
    """What a renderer may give and light cannot be: three NaN, two −inf, one −1, one +inf among 12 values."""
    raw = np.full((3, 4), 2.0, dtype=np.float32)
    raw[0] = np.nan, np.nan, np.nan, 5.0
    raw[1] = -np.inf, -np.inf, -1.0, np.inf
    done = clean(raw)
    counted = (done.negative, done.non_finite)
    left = [[0, 0, 0, 5], [0, 0, 0, 0], [2, 2, 2, 2]]
    infinite = done.infinite is not None and done.infinite.sum() == 1 and bool(done.infinite[1, 3])
    return Got(f"{counted[0]} negative, {counted[1]} not finite, {int(infinite)} to saturate",
               counted == (1, 6) and infinite and done.values.tolist() == left)  # fmt: skip


def unchanged(engine: Engine) -> Got:
    """+inf in one pixel."""
    one, other = (expose(light, table1(), EXPOSURE, keep="electrons", **engine.how) for light in
                  (light_with(math.inf), light_with()))  # fmt: skip
    there, elsewhere = (1, 2), np.isfinite(light_with(math.inf))
    assert one.electrons is not None
    same = bool((one.digital[0][elsewhere] == other.digital[0][elsewhere]).all())
    full = one.electrons[0][there], int(one.digital[0][there])
    return Got(f"{full[0]:g} e-, {full[1]} DN there; the others {'' if same else 'not '}as without",
               same and full == (33_000, 4095))  # fmt: skip


def unseen(engine: Engine) -> Got:
    """∞·0 = 0: the visible band counts alone."""
    bands = np.stack([np.full((2, 2), np.inf), np.full((2, 2), 500.0)], axis=-1)
    how = {"keep": "electrons", **engine.how}
    both = expose(bands, table1(), EXPOSURE, wavelengths_nm=[1500.0, 550.0], **how).electrons
    alone = expose(np.full((2, 2), 500.0), table1(), EXPOSURE, **how).electrons
    assert both is not None and alone is not None
    return Got(f"{both.ravel().tolist()} e-, alone {alone.ravel().tolist()}", bool((both == alone).all()))


def accounted(frames: Frames, light: Any) -> Got:
    """Codes in range, and a report and a plan that strict JSON can hold."""
    camera, exposure = frames.camera, frames.first.exposure
    report = json.loads(to_json(frames.report))
    planned = json.loads(to_json(plan(camera, exposure, light).to_dict()))
    top = int(frames.digital.max())
    stages = [line["mean_frame"] is not None and line["mean_expected"] is not None for line in report["stages"]]
    words = f"{frames.digital.min()} … {top} DN, {len(stages)} stages reported, {len(planned['stages'])} planned"
    return Got(words, top < 2**camera.adc.bits and all(stages))


EDGES = {
    "0 photons, 0 s, 0 K": (0.0, Exposure(0.0, 0.0)),
    "1e-320 photons, 1e-12 s, 5e-324 K": (1e-320, Exposure(1e-12, 5e-324)),
    "1e150 photons, 1e12 s, 1e4 K": (1e150, Exposure(1e12, 1e4)),
    "+inf photons, 1e6 s, 600 K": (math.inf, Exposure(1e6, 600.0)),
}


def whole(engine: Engine, name: str, edge: str) -> Got:
    """expose, report and plan."""
    photons, exposure = EDGES[edge]
    light = np.full((4, 6), photons)
    return accounted(expose(light, camera_of(name), exposure, **engine.how), light)


def published(edge: str) -> Got:
    """The same of the published chain, which has no plan."""
    photons, exposure = EDGES[edge]
    frames = expose(np.full((4, 6), photons), table1(), exposure, chain="konnik2014")
    report = json.loads(to_json(frames.report))
    return Got(f"{frames.digital.min()} … {frames.digital.max()} DN, {len(report['stages'])} stages reported",
               int(frames.digital.max()) <= 2**12)  # fmt: skip


SMALLEST = dict.fromkeys(
    (
        "pixel.pitch_x_um", "source_follower.cds_sample_s", "source_follower.cds_dominant_s", "source_follower.rtn_s",
        "source_follower.gain", "readout.sense_gain_uv_per_e", "readout.cds_gain", "readout.v_ref_v",
        "adc.full_scale_v",
    ),
    1e-30,
) | {"pixel.full_well_e": 1.0}  # fmt: skip
"""Fields that something is divided by, and the smallest number that they may be."""
NEEDED = {
    "source_follower.rtn_s": {"source_follower.rtn_uv": 100.0},
    "readout.v_ref_v": {"readout.ve_nonlinearity": 1.0},
}
"""Without these, nothing is divided by them."""


def too_small(field: str) -> Got:
    """Refused before it overflows."""
    tiny = (5e-324, 1e-320, 1e-150, 0.99 * SMALLEST[field])
    answers = [
        refusal(lambda x=x: table1().replace(**{field: x}), f"{field} is {x!r}; it must be greater") for x in tiny
    ]
    return Got(answers[-1].words, all(answer.passed for answer in answers))


def smallest(engine: Engine, field: str) -> Got:
    """The frame of float64; or a sentence, where float32 cannot hold the converter's gain."""
    camera, light = table1().replace(**{field: SMALLEST[field]}, **NEEDED.get(field, {})), light_with()
    if engine.precision == "float32" and adc_gain_dn_per_v(camera) > BRIGHTEST:
        return refusal(lambda: expose(light, camera, EXPOSURE, **engine.how), "precision is 'float32', which holds")
    digital = expose(light, camera, EXPOSURE, **engine.how).digital
    reference = expose(light, camera, EXPOSURE, precision="float64").digital
    off = np.abs(digital.astype(int) - reference).max()
    return Got(f"{digital.min()} … {digital.max()} DN, off by {off}", bool(off <= 1))


SHAPES = ((1, 1), (1, 5000), (5000, 1), (2, 3))


def crop(engine: Engine, shape: tuple[int, int]) -> Got:
    """Any window is the corner of a larger one."""
    corner = min(shape[0], 2), min(shape[1], 2)
    one, other = (expose(np.full(s, 500.0), table1(), EXPOSURE, **engine.how).digital for s in (shape, corner))
    same = bool((other == one[:, : corner[0], : corner[1]]).all())
    return Got(f"{one.shape[1]} × {one.shape[2]}, {'' if same else 'not '}the same corner",
               same and one.shape == (1, *shape))  # fmt: skip


LARGE = (3000, 4000)


def twelve_megapixels(engine: Engine) -> Got:
    """Read noise, stripes and converter in the dark of 77 K: the mean is the pedestal, σ of stripes over √4000."""
    camera = table1().replace(**{"sensor.columns": LARGE[1], "sensor.rows": LARGE[0], "pixel.prnu": 0.0})
    started = time.perf_counter()
    digital = expose(0.0, camera, Exposure(0.1, 77.0), **engine.how).digital
    seconds, mean = time.perf_counter() - started, float(digital.mean())
    stripes = camera.readout.dsnu_col * 2**camera.adc.bits
    good = digital.shape == (1, *LARGE) and abs(mean - black_level_dn(camera)) <= SIGMAS * stripes / math.sqrt(LARGE[1])
    return Got(f"mean {mean:.3f} of {black_level_dn(camera):g} DN, {digital.dtype}, {seconds:.1f} s", bool(good))


def cases() -> list[Case]:
    """Refusals, whole frames, windows."""
    return [*_refusals(), *_values(), *_whole_frames(), *_sizes()]


def _refusals() -> list[Case]:
    bad = ((math.nan, "NaN"), (-1.0, "negative"), (-1e-300, "negative"), (-math.inf, "negative"))
    times = (math.nan, math.inf, -math.inf, -1e-300, -1.0, 1.1e12, "0.1", None, [0.1])
    kelvins = (math.nan, math.inf, -1e-9, -273.15, 1.001e4, 1e9, "cold")
    count, value = "one sentence: how many, and the first place", "one sentence with value and range"
    refused = partial(once, "refusals")
    return [
        *(refused("expose, plan", f"{x:g} photons in two pixels", count, partial(photons_refused, x, kind))
          for x, kind in bad),
        *(refused("collect", f"{x:g} W/m² in two pixels", count, partial(irradiance_refused, x)) for x, _ in bad),
        *(refused("exposure", f"time_s = {x!r}", value, partial(exposure_refused, "time_s", x)) for x in times),
        *(refused("exposure", f"temperature_k = {x!r}", value, partial(exposure_refused, "temperature_k", x))
          for x in kelvins),
        *(refused("datasheet", f"{field} below {shown(least)}", value, partial(too_small, field))
          for field, least in SMALLEST.items()),
    ]  # fmt: skip


def _values() -> list[Case]:
    clamped = "clamped to 0 and counted; +inf marked, to saturate"
    return [
        once("light", "irradiance", "NaN, ±inf and −1 from the renderer", clamped, renderers_values),
        Case("light", "expose", "+inf photons in one pixel", "it is full, and no other changes", unchanged),
        Case("light", "detection", "+inf photons where the sensor sees nothing", "no electron of them", unseen),
    ]


def _whole_frames() -> list[Case]:
    frame = "finite; codes in range; report and plan are strict JSON"
    codes, same = "codes 0 … 2^12; report is strict JSON", "float64's frame to 1 DN, or a sentence why float32 cannot"
    return [
        *(Case("whole frames", "expose, report, plan", f"{edge}; {name}", frame, partial(whole, name=name, edge=edge),
               seconds=0.2) for name in (NAME, EVERY_OPTION) for edge in EDGES),
        *(once("whole frames", "published chain", edge, codes, partial(published, edge)) for edge in EDGES),
        *(Case("whole frames", "expose", f"{field} = {shown(least)}", same, partial(smallest, field=field))
          for field, least in SMALLEST.items()),
    ]  # fmt: skip


def _sizes() -> list[Case]:
    size, stripes = partial(Case, "frame sizes", "expose"), "the pedestal, within 5 standard errors of its stripes"
    return [
        *(size(f"{y} × {x}", "the corner of any other window", partial(crop, shape=(y, x))) for y, x in SHAPES),
        size("3000 × 4000, dark, 77 K", stripes, twelve_megapixels, seconds=2.0),
    ]
