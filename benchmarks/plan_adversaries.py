"""Plans of random cameras and scenes against the theory of the whole chain, and against frames of many serials.

    python benchmarks/plan_adversaries.py [--seeds 0 10000] [--frames-every 20] [--file F.jsonl] [--minutes M] [--json]

Every number of --seeds is one camera, exposure, scene (plan_cases.py) and tolerance T from 0.005 to 5 DN. With --file
each result is a line there, and numbers that are in the file are not computed again.

theory : of the whole chain and of what the plan kept, at some of the levels of light that occur: how far the mean, and
    the roots of the changes of temporal and spatial variance, move, less four standard errors, over T. At most 1.
frames : of every n-th case, SERIALS cameras × 2 frames with and without the plan, same seeds. The darkest and the
    brightest pixels apart: mean, temporal and spatial variance; line means (variance × length of the line); and, of
    CHIPS serials, the pixels whose own mean or σ differs by more than T. The excess over T (over one pixel) is given in
    standard errors of the mean of batches of serials; above 4 a plan has failed.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plan_cases import Case, case

import mitsuba_sensor as ms
from mitsuba_sensor.core import Electrons, Frame, SensorWindow
from mitsuba_sensor.core.backend import NUMPY_FLOAT64
from mitsuba_sensor.sensor.checks import as_photons
from mitsuba_sensor.sensor.detection import Detected, detect
from mitsuba_sensor.stages.stage import Stage, total, without
from mitsuba_sensor.theory.frame_theory import FrameTheory
from mitsuba_sensor.theory.light_levels import light_levels
from mitsuba_sensor.theory.pixel_moments import pixel_moments

Array = NDArray[np.float64]
Result = dict[str, Any]

SERIALS, BATCHES, CHIPS = 48, 16, 12
MOST = 6000
"""Pixels of a scene of which frames are made, at most."""

LEVELS = 7
"""Levels of light at which theories are compared, at most."""

LIMIT = 4.0
"""Standard errors."""


def main() -> int:
    """Parse the options, compute, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--seeds",
        type=int,
        nargs=2,
        default=(0, 10_000),
        help="first, and the one after the last",
    )
    parser.add_argument(
        "--frames-every", type=int, default=20, help="frames of every n-th case"
    )
    parser.add_argument(
        "--file",
        type=Path,
        help="results, one a line; numbers that are there are not computed again",
    )
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), help="begin no case later than this"
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    found = {} if options.file is None or not options.file.exists() else read(options.file)
    end = time.monotonic() + 60 * options.minutes
    for number in range(*options.seeds):
        if number not in found and time.monotonic() < end:
            found[number] = result(case(number), number % options.frames_every == 0)
            if options.file is not None:
                with options.file.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(found[number]) + "\n")
    summary = summed_up(
        [one for number, one in found.items() if number in range(*options.seeds)]
    )
    print(json.dumps(summary) if options.json else text_of(summary))
    return 1 if summary["failed"] else 0


def read(path: Path) -> dict[int, Result]:
    """Results of earlier runs."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return {one["number"]: one for one in map(json.loads, lines)}


def result(one: Case, with_frames: bool) -> Result:
    """What the plan of a case leaves out, what that moves, and the seconds of processor that the plan took."""
    started = time.process_time()
    plan = ms.plan(one.camera, one.exposure, one.photons, one.tolerance_dn)
    taken = time.process_time() - started
    said = {
        "number": one.number,
        "camera": one.camera.name,
        "scene": one.scene,
        "tolerance_dn": one.tolerance_dn,
    }
    moved = {
        "left_out": plan.left_out,
        "working": [e.stage for e in plan.effects if not e.kept and e.largest_dn],
    }
    found: Result = {**said, **moved, "plan_s": taken, "theory": by_theory(one, plan)}
    return {**found, **by_frames(one, plan)} if with_frames else found


def by_theory(one: Case, plan: ms.Plan) -> dict[str, float]:
    """Change of mean, and roots of the changes of the variances, at all levels that occur, over the tolerance.

    Stages that change nothing stay in both: frames without them are the same, and the sums of the theory are rounded.
    """
    idle = {
        effect.stage for effect in plan.effects if not effect.kept and not effect.largest_dn
    }
    out = [stage for stage in without(plan.whole, plan.stages) if stage.label not in idle]
    occupied = light_levels(plan.light).light_e
    some = occupied[np.unique(np.linspace(0, occupied.size - 1, LEVELS).astype(int))]
    over = (
        np.max([moved(plan, out, float(level_e)) for level_e in some], axis=0)
        / one.tolerance_dn
    )
    return dict(zip(("mean", "temporal", "spatial"), over.tolist(), strict=True))


def moved(plan: ms.Plan, out: list[Stage], level_e: float) -> list[float]:
    """Change of the mean, and roots of the changes of the variances, less four standard errors [DN]."""
    averages = []
    for stages in (plan.whole, without(plan.whole, out)):
        light = Detected(
            ms.Photons(np.full((1, 1), level_e)), Electrons(np.full((1, 1), level_e))
        )
        given = {name: values[:1, :1] for name, values in plan.frame.window.given.items()}
        frame = replace(plan.frame, window=SensorWindow(1, (1, 1), given=given))
        averages.append(FrameTheory(stages, light, frame).averages(stages[-1]))
    whole, kept = averages
    errors = 4 * np.hypot(whole.errors, kept.errors)
    change = np.maximum(np.abs(np.subtract(whole[:3], kept[:3])) - errors, 0.0)
    return [float(change[0]), *np.sqrt(change[1:]).tolist()]


def by_frames(one: Case, plan: ms.Plan) -> Result:
    """Excess over the tolerance in standard errors, by figure; seconds of processor of the frames of both chains."""
    photons = as_photons(one.photons, one.camera)
    columns = photons.mean.shape[1]
    photons = photons.crop_rows(slice(0, max(MOST // columns, 4)))
    frames, seconds = [], []
    for chosen in (None, plan):
        started = time.process_time()
        stacks = [
            ms.expose(
                photons,
                one.camera,
                one.exposure,
                serial=s,
                frames=2,
                plan=chosen,
                engine="numpy",
                precision="float64",
            ).digital.astype(np.float64)
            for s in range(SERIALS)
        ]
        seconds.append(time.process_time() - started)
        frames.append(np.stack(stacks))
    window = SensorWindow(0, photons.mean.shape[:2], photons.origin, backend=NUMPY_FLOAT64)
    light = np.asarray(
        total(plan.whole[0].sample(photons, Frame(one.exposure, window)))
    ) * np.ones(window.shape)
    excess = {
        f"{name} of the {where}": value
        for where, here in {
            "darkest": light <= light.min(),
            "brightest": light >= light.max() * 0.999,
        }.items()
        for name, value in of_pixels(*frames, here, one.tolerance_dn).items()
    }
    for axis, name in ((1, "columns"), (2, "rows")):
        excess |= {
            f"{kind} of {name}": x
            for kind, x in of_lines(*frames, axis, one.tolerance_dn).items()
        }
    excess["pixels moved"] = moved_pixels(one, plan, photons)
    return {"frames": excess, "frames_s": seconds}


def of_pixels(
    whole: Array, kept: Array, here: NDArray[np.bool_], tolerance: float
) -> dict[str, float]:
    """Mean, temporal and spatial variance of some pixels; of stacks (serials, 2, H, W)."""
    a, b = whole[..., here], kept[..., here]
    return {
        "mean": abs_excess(batches(lambda x: x.mean(), a, b), tolerance),
        "temporal": abs_excess(batches(temporal, a, b), tolerance**2),
        "spatial": abs_excess(batches(spatial, a, b), tolerance**2),
    }


def of_lines(whole: Array, kept: Array, axis: int, tolerance: float) -> dict[str, float]:
    """The variances of the means over lines, times their length."""
    length = whole.shape[1 + axis]
    a, b = (length**0.5 * stack.mean(axis=1 + axis) for stack in (whole, kept))
    return {
        "temporal structure": abs_excess(batches(temporal, a, b), tolerance**2),
        "spatial structure": abs_excess(batches(spatial, a, b), tolerance**2),
    }


def temporal(x: Array) -> float:
    """(serials, 2, …): half the mean square of the difference of two frames."""
    return float(np.mean((x[:, 0] - x[:, 1]) ** 2) / 2)


def spatial(x: Array) -> float:
    """What two frames of a serial share: their covariance over the serials."""
    off = x - x.mean(axis=0)
    return float(np.mean(off[:, 0] * off[:, 1]) * len(x) / (len(x) - 1))


def batches(of: Callable[[Array], float], whole: Array, kept: Array) -> Array:
    """The difference of a figure, one of every batch of serials."""
    size = len(whole) // BATCHES
    parts = (slice(k * size, (k + 1) * size) for k in range(BATCHES))
    return np.array([of(whole[part]) - of(kept[part]) for part in parts])


def abs_excess(values: Array, allowed: float) -> float:
    """By how many standard errors the mean lies beyond ±allowed; at most 1e6."""
    error = values.std(ddof=1) / len(values) ** 0.5
    excess = abs(float(values.mean())) - allowed * (1 + 1e-9)
    return float(min(excess / max(error, 1e-12), 1e6) if excess > 0 else excess / allowed)


def moved_pixels(one: Case, plan: ms.Plan, photons: ms.Photons) -> float:
    """Pixels of the window whose own mean or σ the plan moves by more than the tolerance: the excess over one."""
    shape, counts = photons.mean.shape[:2], []
    for serial in range(CHIPS):
        frame = Frame(one.exposure, SensorWindow(serial, shape, photons.origin))
        light = detect(photons, plan.whole[0], frame)
        whole, kept = (
            pixel_moments(chain, light, frame) for chain in (plan.whole, plan.stages)
        )
        means = np.abs(whole.mean - kept.mean)
        sigmas = np.sqrt(np.abs(whole.temporal - kept.temporal))
        counts.append(
            np.count_nonzero(np.maximum(means, sigmas) > 1.001 * one.tolerance_dn + 1e-4)
        )
    scale = plan.range.rows * plan.range.columns / (shape[0] * shape[1])
    mean, error = np.mean(counts), max(np.std(counts), 1 / CHIPS) / CHIPS**0.5
    return float((mean * scale - 1) / (error * scale))


def summed_up(found: Iterable[Result]) -> Result:
    """Counts, the worst cases, the cases that failed, and the time that is saved."""
    cases = list(found)
    worst = {}
    for kind in ("theory", "frames"):
        for one in cases:
            for name, value in one.get(kind, {}).items():
                if value > worst.get(f"{kind}: {name}", {"value": -np.inf})["value"]:
                    worst[f"{kind}: {name}"] = {"value": value, "number": one["number"]}
    failed = sorted(
        one["number"]
        for one in cases
        if max(one["theory"].values()) > 1 + 1e-6
        or max(one.get("frames", {"": 0.0}).values()) > LIMIT
    )
    timed = np.array([one["frames_s"] for one in cases if "frames_s" in one]).reshape(-1, 2)
    return {
        "cases": len(cases),
        "with_frames": len(timed),
        "stages_left_out": sum(len(one["left_out"]) for one in cases),
        "of_those_with_an_effect": sum(len(one["working"]) for one in cases),
        "plan_seconds_median": float(np.median([one["plan_s"] for one in cases])),
        "time_saved": float(1 - timed[:, 1].sum() / timed[:, 0].sum()) if len(timed) else 0.0,
        "worst": worst,
        "failed": failed,
    }


def text_of(summary: Result) -> str:
    """For people."""
    lines = [
        f"{summary['cases']} plans, {summary['with_frames']} of them with frames of {SERIALS} serials",
        f"{summary['stages_left_out']} stages left out, {summary['of_those_with_an_effect']} of them with an effect",
        f"{summary['plan_seconds_median']:.2f} s of one processor a plan",
        f"{summary['time_saved']:.0%} of the frames' time saved",
        "worst: theory in tolerances (at most 1); frames in standard errors beyond the tolerance (at most 4)",
    ]
    lines += [
        f"  {name:<40} {one['value']:8.3g}   case {one['number']}"
        for name, one in summary["worst"].items()
    ]
    return "\n".join([*lines, f"failed: {summary['failed'] or 'none'}"])


if __name__ == "__main__":
    raise SystemExit(main())
