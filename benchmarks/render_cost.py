"""Measure the cost of a render relative to plain ``mi.render`` of the same scene, variant and samples.

    python benchmarks/render_cost.py [--variants V …] [--spp 16 128] [--size 96] [--turns 5] [--processes 3]
                                     [--default] [--json]

plain    : ``mi.load_file`` and ``mi.render`` with a specfilm of one band (or thirty) and its default sampler.
same     : plain, but with the sampler of ours, multijitter, which makes 132 samples of 128; all in one pass.
ours     : ``mitsuba_sensor.render`` without denoising, from the scene file to standard errors and statistics.
default  : ``mitsuba_sensor.render``, denoised, for a monochrome and a Bayer camera; with
           --default only these and plain, of one band.
Warm     : in one process, alternately, scene and kernels loaded; ours loads the scene again, which is counted.
Process  : a whole process, alternately: with no kernel on disk, and with those of the processes before; with imports.
``first_pass_s`` is the time from its start until the first samples are there. ``over_plain``, ``over_same`` and
``over_channels`` are ratios of processor seconds of all threads, which other load on the machine hardly changes, each
the median of the ratios of single turns; wall-clock seconds stand beside them.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from plain_mitsuba import sensor_like
from timing import in_child, lines, ratio

SCENE = str(Path(__file__).resolve().parent.parent / "scenes" / "cornell_box.xml")
BARE: dict[str, Any] = {"denoise": False}
OURS: dict[str, tuple[str, dict[str, Any]]] = {
    "ours 1 band": ("konnik_table1", {**BARE, "wavelength_nm": 550}),
    "ours channels": ("konnik_table1", {**BARE, "spectral": "channels"}),
    "ours 30 bands": ("konnik_table1", BARE),
    "default mono": ("konnik_table1", {"denoise": True}),
    "default Bayer": ("bayer_2mp", {"denoise": True}),
}
KINDS = ("plain 1 band", "plain 30 bands", "same 1 band", "same 30 bands", *OURS)
DEFAULT = ("plain 1 band", "default mono", "default Bayer")
LOW_NM, HIGH_NM = 400.0, 700.0
Seconds = dict[str, float]


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--variants", nargs="+", default=["llvm_ad_spectral", "scalar_spectral"]
    )
    parser.add_argument("--spp", type=int, nargs="+", default=[16, 128])
    parser.add_argument(
        "--size", type=int, default=96, help="width and height in pixels (default 96)"
    )
    parser.add_argument(
        "--turns", type=int, default=5, help="warm renders of each kind (default 5)"
    )
    parser.add_argument(
        "--processes",
        type=int,
        default=3,
        help="processes of each kind with kernels (default 3)",
    )
    parser.add_argument(
        "--default", action="store_true", help="only the default and plain, of one band"
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    found: dict[str, Any] = {}
    kinds = DEFAULT if options.default else KINDS
    for variant in options.variants:
        for spp in options.spp:
            case = (variant, options.size, spp)
            found[f"{variant} {spp} samples"] = {
                "warm": summary(in_child("render_cost", "warm", *case, options.turns, kinds)),
                **processes(case, options.processes, kinds),
            }
    print(json.dumps(found) if options.json else "\n".join(lines(found)))


def processes(case: tuple[str, int, int], count: int, of: Sequence[str]) -> dict[str, Any]:
    """Time processes of one plain band and of ours: the first with an empty kernel cache, and the others."""
    kinds = ("plain 1 band", *(kind for kind in of if kind in OURS))
    with tempfile.TemporaryDirectory() as home:
        turns = [
            {
                kind: in_child("render_cost", "whole", *case, kind, time.time(), home=home)
                for kind in kinds
            }
            for _ in range(count + 1)
        ]
    first, others = (
        {kind: [turn[kind] for turn in those] for kind in kinds}
        for those in (turns[:1], turns[1:] or turns[:1])
    )
    return {"first process": summary(first), "second process": summary(others)}


def summary(found: dict[str, list[Seconds]]) -> dict[str, Seconds]:
    """Return medians, and processor seconds relative to plain Mitsuba, the same sampler and colour filters."""
    medians = {
        kind: {name: statistics.median(one[name] for one in runs) for name in runs[0]}
        for kind, runs in found.items()
    }
    seconds = {kind: [one["cpu_s"] for one in runs] for kind, runs in found.items()}
    for kind, median in medians.items():
        film = "30 bands" if "30" in kind else "1 band"
        bases = {"plain": f"plain {film}", "same": f"same {film}", "channels": "ours channels"}
        median |= {
            f"over_{name}": ratio(seconds[kind], seconds[base])
            for name, base in bases.items()
            if base in seconds
        }
    return medians


def warm(
    variant: str, size: int, spp: int, turns: int, kinds: Sequence[str]
) -> dict[str, list[Seconds]]:
    """Return wall-clock and processor seconds of every kind, in turns, after one turn that is not counted."""
    renders = {kind: renderer(kind, variant, size, spp) for kind in kinds}
    found: dict[str, list[Seconds]] = {kind: [] for kind in kinds}
    for turn in range(turns + 1):
        for kind, render in renders.items():
            wall, processor = time.perf_counter(), time.process_time()
            render(turn)
            one = {
                "wall_s": time.perf_counter() - wall,
                "cpu_s": time.process_time() - processor,
            }
            found[kind] += [one] if turn else []
    return found


def whole(variant: str, size: int, spp: int, kind: str, started: float) -> Seconds:
    """Render once; return the seconds of this process since ``started``."""
    first: list[float] = []
    renderer(kind, variant, size, spp, lambda: first.append(time.time() - started))(1)
    found = {"wall_s": time.time() - started, "cpu_s": time.process_time()}
    return {"first_pass_s": (first or [found["wall_s"]])[0], **found}


def renderer(
    kind: str, variant: str, size: int, spp: int, first_pass: Callable[[], None] = lambda: None
) -> Callable[[int], np.ndarray]:
    """A render of one kind, from its seed. first_pass : called when its first samples are there, if not at its end."""
    if kind not in OURS:
        sampler = "multijitter" if kind.startswith("same") else "independent"
        return plain(30 if "30" in kind else 1, variant, size, spp, sampler)
    import mitsuba_sensor as ms

    (name, options), exposure = OURS[kind], ms.Exposure(0.02)
    camera = ms.load_camera(name)
    asked: dict[str, Any] = {
        "variant": variant,
        "spp": spp,
        "parameters": {"width": size, "height": size},
        **options,
    }
    asked["progress"] = lambda step: first_pass() if step.done else None
    return lambda seed: ms.render(SCENE, camera, exposure, seed=seed, **asked).data


def plain(
    bands: int, variant: str, size: int, spp: int, sampler: str
) -> Callable[[int], np.ndarray]:
    """Return the same with plain Mitsuba."""
    import mitsuba as mi

    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)  # it warns of 132 samples, on stdout
    scene = mi.load_file(SCENE, width=str(size), height=str(size))
    sensor = sensor_like(
        mi, scene.sensors()[0], size, np.linspace(LOW_NM, HIGH_NM, bands + 1).tolist(), sampler
    )
    return lambda seed: np.array(mi.render(scene, sensor=sensor, seed=seed, spp=spp))


if __name__ == "__main__":
    main()
