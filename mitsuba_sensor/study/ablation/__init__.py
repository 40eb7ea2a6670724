"""``study ablation``: each stage of the sensor and each feature of the render off in turn, beside the seconds saved."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache, partial

from ...core import InputError, require, require_seed
from ...render.requirements import render_requirements
from ...render.stop_criterion import stop_criterion_of
from ...sensor.gains import gain_dn_per_e
from ..frames import Replicas
from ..kit import Kit, Step
from ..page import Study, study_of
from ..statistics import Values
from ..subject import Subject
from .pages import render_section, sensor_section
from .render import AOVS, ERROR_BARS, WHOLE_RENDERS, measures
from .sensor import CALL_S, KERNEL_S, SENSORS, SensorAblation, SensorResults

FRAMES = 24  # of each of the sensors: 1536 frames of each chain
SPP = 32  # samples per pixel of each render. Most of their noise is in both pictures that are compared
FEWEST_PASSES = 4  # two in each half, so that both have a standard error
SAMPLE_NS = 4000.0  # per light path (30 bands) on two cores of an AMD EPYC: for the estimate before any measurement


def ablation(
    kit: Kit, subject: Subject, *, tolerance_dn: float = 0.02, frames: int = FRAMES, seed: int = 1, serial: int = 1
) -> Study:
    """What each stage and each feature does to the picture, in theory and in frames, and what it costs.

    kit : measures, and knows what is measured already.  tolerance_dn : of the plan [DN].
    frames : of each of the 64 sensors, at least 2.  seed, serial : of the first frame and the first sensor.
    Raises InputError.
    """
    require("tolerance_dn", tolerance_dn, 0.0, float("inf"), "digital numbers, e.g. 0.02")
    if require_seed("frames", frames) < 2:
        raise InputError(f"frames is {frames}; a sensor needs at least 2 frames to show its temporal noise (e.g. 16).")
    replicas = Replicas(SENSORS, frames, require_seed("seed", seed), require_seed("serial", serial))
    spp, camera, exposure = subject.options.get("spp", SPP), subject.camera, subject.exposure
    criterion = stop_criterion_of({"spp": spp})
    if criterion.passes < FEWEST_PASSES:
        raise InputError(f"spp is {spp}; the study compares halves of the passes: ask for at least {FEWEST_PASSES}.")

    light = cache(lambda: subject.job.render(seed, criterion))
    ways = cache(lambda: measures(subject, criterion, seed))

    def scene() -> Values:
        here, missing = ways()
        columns, rows = subject.job.scene.view.crop_size
        return {"features": list(here), "missing": missing, "columns": columns, "rows": rows}

    def requirements() -> list[Values]:
        found = render_requirements(light(), camera, exposure, gain_dn_per_e(camera), tolerance_dn)
        return [asdict(one) for one in found]

    def without(name: str) -> Values:
        return ways()[0][name]()

    found = kit.measure("loading the scene", 60.0, scene)
    pixels = found["columns"] * found["rows"]
    render_s = criterion.passes * (CALL_S + 1e-9 * SAMPLE_NS * pixels * criterion.samples)
    sensor = SensorAblation(kit, subject, light, tolerance_dn, replicas)
    steps = [Step("rendering the scene", KERNEL_S + render_s, requirements), *sensor.steps(pixels)]
    expected_s = dict.fromkeys(found["features"], KERNEL_S + 2 * render_s)
    expected_s |= {AOVS: 1.0, ERROR_BARS: KERNEL_S + 2 * (WHOLE_RENDERS + 1) * render_s}
    steps += (Step(f"render: {one}", expected_s[one], partial(without, one)) for one in found["features"])
    kit.take(steps)
    changes = {name: kit[f"render: {name}"] for name in found["features"]}
    sections = (
        sensor_section(SensorResults(sensor), replicas, tolerance_dn),
        render_section(changes, found["missing"], kit["rendering the scene"], tolerance_dn),
    )
    about = f"{found['columns']} × {found['rows']} pixels, {exposure.time_s:g} s, {exposure.temperature_k:g} K"
    return study_of("ablation", f"What {subject.name} and {camera.name} can do without ({about})", sections)
