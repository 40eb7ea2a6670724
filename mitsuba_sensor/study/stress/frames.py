"""Frames at the edge of what is allowed: light, time, temperature, noise that is hard to foresee, divisors, sizes."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

import mitsuba_sensor as ms

from .case import (
    CASES,
    SIGMAS,
    TENTH,
    Engine,
    Got,
    Row,
    Rows,
    refusal,
    table1,
    together,
    within,
)

SHAPE = 64, 64
PIXELS = SHAPE[0] * SHAPE[1]
COUNTED_PIXELS = 512, 512
RARE = 5.0
"""Counts more than a mean far below one explains: chance makes as many in one of a million cases."""

ROUNDINGS = 16.0
"""Rounding errors of float32 that a mean may be off: operations of the chain."""

LEFT_DN = 2e-3
"""What tables of quantiles leave of a mean and a variance [DN, DN²]."""

WELLS = 50.0
"""Full wells up to which the electrons of a pixel are compared: theory counts no further."""

EACH_KIND = ("konnik_table1", "bayer_2mp", "rgbir_2mp", "eev_44_82")
"""Shipped cameras: monochrome CMOS, two mosaics, CCD."""


def special_camera(**changes: Any) -> ms.Camera:
    """Table 1's camera with shot noise, full well, read noise and converter alone, and these changes."""
    camera = ms.load_camera("konnik_table1")
    return camera.replace(
        **{"source_follower.white_nv_per_rthz": None, **CASES["quiet"], **changes}
    )


def conditions(theme: str, camera_name: str, engine: Engine) -> Rows:
    """Every stage of a shipped camera in the light, times and temperatures of a theme, beside its theory."""
    camera = ms.load_camera(camera_name)
    for photons, time_s, temperature_k in CASES["conditions"][theme]:
        frames = engine.expose(
            np.full(SHAPE, photons),
            camera,
            ms.Exposure(time_s, temperature_k),
            keep=("electrons",),
        )
        given = f"{photons:g} photons, {time_s:g} s, {temperature_k:g} K; {camera_name}"
        expected = (
            "finite; every stage's mean within 5 standard errors of its theory; wells 0 … full"
        )
        yield Row(
            "every stage",
            given,
            expected,
            together(worst_stage(frames, engine), full_wells(frames)),
        )


def worst_stage(frames: ms.Frames, engine: Engine) -> Got:
    """The stage whose mean is farthest from theory, in standard errors."""
    worst, worst_label, is_patterned = 0.0, "none", False
    roundoff = ROUNDINGS * float(np.finfo(engine.precision).eps) / 2
    for told in frames.report["stages"]:
        is_patterned = is_patterned or not {"column", "row"}.isdisjoint(told["name"].split())
        independent = (
            min(SHAPE) if is_patterned else PIXELS
        )  # columns and rows share a spatial part
        temporal, spatial = told["sigma_temporal_expected"], told["sigma_spatial_expected"]
        mean, expected = told["mean_frame"], told["mean_expected"]
        if not np.isfinite([mean, expected, temporal, spatial]).all():
            return Got(f"{told['name']} has mean {mean:g}, expected {expected:g}", False)
        if told["domain"] == "electrons":
            mean, expected = (
                min(x, WELLS * frames.camera.pixel.full_well_e) for x in (mean, expected)
            )
        error = math.sqrt(temporal**2 / PIXELS + 2 * spatial**2 / independent)
        step = rare_step(frames, told["domain"])
        explained = (
            RARE * step / PIXELS + roundoff * abs(expected) + LEFT_DN * (told["domain"] == "DN")
        )
        beyond = max(abs(mean - expected) - explained, 0.0)
        off = beyond / max(error, step * 1e-9)
        if off > worst:
            worst, worst_label = off, told["name"]
    return Got(f"off by {worst:.1f} standard errors at most ({worst_label})", worst <= SIGMAS)


def rare_step(frames: ms.Frames, domain: str) -> float:
    """What one electron is in the unit of a stage."""
    gain_v = frames.camera.readout.sense_gain_uv_per_e * 1e-6
    steps = {"electrons": 1.0, "volts": gain_v, "DN": frames.camera.system_gain_dn_per_e}
    return float(steps.get(domain, 0.0))


def full_wells(frames: ms.Frames) -> Got:
    """Whether the electrons of all pixels are within the well."""
    electrons = np.asarray(frames.electrons)
    low, high = float(electrons.min()), float(electrons.max())
    return Got(f"{low:g} … {high:g} e-", low >= 0 and high <= frames.camera.pixel.full_well_e)


def counts(engine: Engine) -> Rows:
    """Mean, variance and third moment of the counts of a flat light, by their closed forms."""
    camera = special_camera(**{"pixel.full_well_e": 1e13, "adc.full_scale_v": None})
    per_photon = electrons_per_photon(camera)
    for mean_e in CASES["counts"]["means_e"]:
        light = np.full(COUNTED_PIXELS, mean_e / per_photon)
        frames = engine.expose(light, camera, ms.Exposure(0.0), keep=("photoelectrons",))
        counted = np.asarray(frames.photoelectrons)
        held = float(np.dtype(engine.precision).type(mean_e))
        off = counted - held
        # variances of off, off² and off³: μ₂ = λ, μ₄ − λ² = λ + 2λ², μ₆ − λ² = λ + 24λ² + 15λ³
        variances = np.array([held, held + 2 * held**2, held + 24 * held**2 + 15 * held**3])
        allowed = (
            SIGMAS * np.sqrt(variances / off.size) + RARE / off.size + ROUNDINGS * 6e-8 * held
        )
        moments = within(
            [np.mean(off**power) for power in (1, 2, 3)], [0.0, held, held], allowed
        )
        is_whole = bool((np.floor(counted) == counted).all()) and counted.min() >= 0
        got = together(moments, Got("whole numbers" if is_whole else "not whole", is_whole))
        expected = "mean, variance and third moment λ within 5 standard errors of 262 144 whole numbers"
        yield Row("shot noise", f"λ = {mean_e:g}", expected, got)


def electrons_per_photon(camera: ms.Camera) -> float:
    """Mean photoelectrons of one photon behind the most sensitive filter."""
    frames = ms.expose(np.ones(np.shape(camera.tile)), camera, ms.Exposure(0.0), engine="numpy")
    return float(np.max(frames.detected.mean_e))


def specials(engine: Engine) -> Rows:
    """Flat light on cameras whose noise is hard to foresee, beside the exact law of every pixel."""
    for given, (mean_e, changes) in CASES["special"].items():
        camera = special_camera(**changes)
        if engine.precision == "float32" and camera.adc.bits > 23:
            continue
        light = np.full(SHAPE, mean_e / electrons_per_photon(camera))
        frames = engine.expose(light, camera, ms.Exposure(0.0), frames=8)
        expected = "mean and temporal variance of 8 frames as in the law of every pixel, within 5 standard errors"
        yield Row("frames", f"{given}; {mean_e:g} e-", expected, beside_exact_law(frames))


def beside_exact_law(frames: ms.Frames) -> Got:
    """Mean and temporal variance of several frames, averaged over the pixels, beside their exact law."""
    digital = frames.digital.astype(np.float64)
    mean, variance = digital.mean(axis=0), digital.var(axis=0, ddof=1)
    mean_off, variance_off = mean - frames.clean, variance - frames.temporal_variance
    error = np.array([x.std(ddof=1) for x in (mean_off, variance_off)]) / math.sqrt(mean.size)
    text = f"mean {mean.mean():.5g} ({frames.clean.mean():.5g}) DN, variance {variance.mean():.5g} "
    text += f"({frames.temporal_variance.mean():.5g}) DN²"
    off = np.abs([mean_off.mean(), variance_off.mean()])
    return Got(text, bool((off <= SIGMAS * error + LEFT_DN).all()))


def corners(engine: Engine) -> Rows:
    """All inputs at their ends at once, for Table 1's camera and for one with every option."""
    cameras = {"table 1": table1(), "every option": table1().replace(**CASES["every_option"])}
    for photons, time_s, temperature_k in CASES["conditions"]["corners"]:
        given = f"{photons:g} photons, {time_s:g} s, {temperature_k:g} K"
        light, exposure = (
            ms.Photons(np.full((4, 6), photons)),
            ms.Exposure(time_s, temperature_k),
        )
        for name, camera in cameras.items():
            frames = engine.expose(light, camera, exposure)
            yield Row(
                "report",
                f"{given}; {name}",
                "codes in range, every number finite",
                finite_report(frames),
            )


def finite_report(frames: ms.Frames) -> Got:
    """Whether codes are in range and the report has no number that is none."""
    top = int(frames.digital.max())
    finite = all_finite(frames.report["stages"])
    numbers = "a number that is none"
    if finite:
        numbers = "every number finite"
    return Got(
        f"{frames.digital.min()} … {top} DN, {numbers}",
        finite and top < 2**frames.camera.adc.bits,
    )


def all_finite(tree: object) -> bool:
    """Whether every number of nested values is finite."""
    if isinstance(tree, dict):
        return all(map(all_finite, tree.values()))
    if isinstance(tree, list | tuple):
        return all(map(all_finite, tree))
    return not isinstance(tree, float) or math.isfinite(tree)


def divisors(engine: Engine) -> Rows:
    """The smallest values of what is divided by, beside the frame of float64."""
    light = np.full((3, 4), 1000.0)
    for field, (smallest, needed) in CASES["smallest"].items():
        camera = table1().replace(**{field: smallest, **needed})
        reference = ms.expose(light, camera, TENTH, engine="numpy", precision="float64")
        expected = "float64's frame to 1 DN, or a sentence why float32 cannot"
        exposed = partial(engine.expose, light, camera)
        try:
            got = within(exposed().digital, reference.digital, 1.0, " DN")
        except ms.InputError:
            got = refusal("precision is 'float32', which holds", exposed)
        yield Row("frames", f"{field} = {smallest:g}", expected, got)
        tiny = partial(table1().replace, **{field: 5e-324})
        got = refusal(f"{field} is 5e-324; it must be at least", tiny)
        yield Row("datasheet", f"{field} = 5e-324", "one sentence with value and range", got)


def sizes(engine: Engine) -> Rows:
    """Any window is the corner of a larger one."""
    larger = engine.expose(np.full((2, 5000), 500.0), table1()).digital
    for rows, columns in CASES["sizes"]["rows_columns"]:
        digital = engine.expose(np.full((rows, columns), 500.0), table1()).digital
        part = digital[:, :2, : larger.shape[2]]
        got = within(part, larger[:, : part.shape[1], : part.shape[2]], 0.0, " DN")
        yield Row("frames", f"{rows} × {columns}", "the corner of any other window", got)


def refusals(_: Engine) -> Rows:
    """Values that cannot be, of cameras and exposures."""
    for given, (part, changes) in CASES["refused"].items():
        yield Row(
            "datasheet",
            given,
            f"refused: {part} …",
            refusal(part, partial(table1().replace, **changes)),
        )
    for name, values in CASES["refused_exposures"].items():
        for value in values:
            part = f"{name} is {value!r}; it must be"
            got = refusal(part, partial(ms.Exposure, **{"time_s": 0.1, name: value}))
            yield Row(
                "exposure", f"{name} = {value!r}", "one sentence with value and range", got
            )
