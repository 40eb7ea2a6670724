"""Compare results and speed with Pyxel, GalSim and getframes, for the stages that both packages have.

    python benchmarks/peers.py [--peers pyxel galsim getframes] [--mpx 1 4] [--electrons 1000] [--turns 5]
        [--engines numpy drjit] [--json]

Each package computes frames of a ramp from 0 to twice the level, with the parameters of the same camera. First, means
and noise are compared; if they do not agree, the speed is not measured. A package that is not installed is skipped, and
the script prints how to install it.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
from collections.abc import Callable
from functools import partial
from typing import Any

from agreement import agreement, stack
from cases import EXPOSURE, photon_map, shape_of, shot_dark_read_quantise, shot_read_quantise
from frame_sources import ENGINES, next_frame, open_stream
from timing import alternate, lines, speeds

import mitsuba_sensor as ms
from mitsuba_sensor.core.versions import machine

CAMERAS: dict[str, Callable[[], ms.Camera]] = {
    "pyxel": shot_dark_read_quantise,
    "galsim": shot_read_quantise,
    "getframes": shot_dark_read_quantise,
}
"""A camera with the stages that the other package has too."""

INSTALL = {"pyxel": "pyxel-sim==3.0.2", "galsim": "galsim", "getframes": "getframes==2.6.*"}
"""Names of the packages for pip."""

COMPARED_MPX, COMPARED_FRAMES = 0.1, 16


def main() -> None:
    """Parse the options, compare with every installed package, print."""
    options = parsed()
    missing = {
        peer: f"{peer} is not installed; pip install '{INSTALL[peer]}' installs it."
        for peer in options.peers
        if importlib.util.find_spec(peer) is None
    }
    found = {
        peer: None if peer in missing else compared(peer, options) for peer in options.peers
    }
    results = {**machine(), "turns": options.turns, "missing": missing, "peers": found}
    if options.json:
        print(json.dumps(results))
        return
    for why in missing.values():
        print(why)
    for line in lines({peer: result for peer, result in found.items() if result}):
        print(line)


def parsed() -> argparse.Namespace:
    """The command-line options."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peers", nargs="+", default=list(CAMERAS), choices=CAMERAS)
    parser.add_argument(
        "--mpx", type=float, nargs="+", default=[1, 4], help="million pixels (default 1 and 4)"
    )
    parser.add_argument(
        "--electrons", type=float, default=1000, help="mean photoelectrons (default 1000)"
    )
    parser.add_argument("--turns", type=int, default=5, help="measured turns (default 5)")
    parser.add_argument("--engines", nargs="+", default=["numpy", "drjit"], choices=ENGINES)
    parser.add_argument("--json", action="store_true", help="print JSON only")
    return parser.parse_args()


def compared(peer: str, options: argparse.Namespace) -> dict[str, Any]:
    """Agreement with every backend, then Mpx/s for every size."""
    module, camera = importlib.import_module(f"peer_{peer}"), CAMERAS[peer]()
    light = photon_map(camera, options.electrons, "ramp", shape_of(COMPARED_MPX))
    theirs = stack(module.frames(light, camera, EXPOSURE), COMPARED_FRAMES)
    agreed = {}
    for engine in options.engines:
        found = agreement(stack(open_stream(engine, light, camera), COMPARED_FRAMES), theirs)
        agreed[engine] = found.as_json()
        if not found:
            raise SystemExit(
                f"{peer} and the backend {engine} disagree, so their speeds are not comparable: {found}"
            )
    rows = []
    for mpx in options.mpx:
        photons = photon_map(camera, options.electrons, "ramp", shape_of(mpx))
        tasks = {peer: partial(next, module.frames(photons, camera, EXPOSURE))}
        tasks |= {engine: next_frame(engine, photons, camera) for engine in options.engines}
        rows.append(
            {"mpx": mpx, "speeds": speeds(alternate(tasks, options.turns), photons.size, peer)}
        )
    return {"version": module.VERSION, "agreement": agreed, "rows": rows}


if __name__ == "__main__":
    main()
