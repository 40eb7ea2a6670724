"""How fast are Pyxel and GalSim on the stages that they share with us, and do they agree with us?

    python benchmarks/peers.py [--peers pyxel galsim] [--mpx 1 4] [--electrons 1000] [--turns 5]
        [--engines numpy drjit] [--json]

Each peer makes frames of a ramp from 0 to twice the level with the numbers of our camera, and so do we. Means and noise
are compared first; what does not agree is not timed. A peer that is not installed is left out, and the script says how
to install it.
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
from engines import ENGINES, next_frame, open_stream
from turns import lines, speeds, take_turns

import mitsuba_sensor as ms
from mitsuba_sensor.io.metadata import machine

CAMERAS: dict[str, Callable[[], ms.Camera]] = {"pyxel": shot_dark_read_quantise, "galsim": shot_read_quantise}
"""The stages that a peer shares with us, as a camera."""

INSTALL = {"pyxel": "pyxel-sim==3.0.2", "galsim": "galsim"}
"""What pip calls a peer."""

COMPARED_MPX, COMPARED_FRAMES = 0.1, 16


def main() -> None:
    """Parse the options, run every peer that is there, print."""
    options = parsed()
    missing = {
        peer: f"{peer} is not installed; pip install '{INSTALL[peer]}' brings it."
        for peer in options.peers
        if importlib.util.find_spec(peer) is None
    }
    found = {peer: None if peer in missing else against(peer, options) for peer in options.peers}
    results = {**machine(), "turns": options.turns, "missing": missing, "peers": found}
    if options.json:
        print(json.dumps(results))
        return
    for why in missing.values():
        print(why)
    for line in lines({peer: result for peer, result in found.items() if result}):
        print(line)


def parsed() -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", nargs="+", default=list(CAMERAS), choices=CAMERAS)
    parser.add_argument("--mpx", type=float, nargs="+", default=[1, 4], help="million pixels (default 1 and 4)")
    parser.add_argument("--electrons", type=float, default=1000, help="mean electrons of light (default 1000)")
    parser.add_argument("--turns", type=int, default=5, help="turns that count (default 5)")
    parser.add_argument("--engines", nargs="+", default=["numpy", "drjit"], choices=ENGINES)
    parser.add_argument("--json", action="store_true", help="only JSON")
    return parser.parse_args()


def against(peer: str, options: argparse.Namespace) -> dict[str, Any]:
    """Agreement with every engine, then Mpx/s of every size."""
    module, camera = importlib.import_module(f"peer_{peer}"), CAMERAS[peer]()
    light = photon_map(camera, options.electrons, "ramp", shape_of(COMPARED_MPX))
    theirs = stack(module.frames(light, camera, EXPOSURE), COMPARED_FRAMES)
    agreed = {}
    for engine in options.engines:
        found = agreement(stack(open_stream(engine, light, camera), COMPARED_FRAMES), theirs)
        agreed[engine] = found.as_json()
        if not found:
            raise SystemExit(f"{peer} and the engine {engine} disagree, so their speeds mean nothing: {found}")
    rows = []
    for mpx in options.mpx:
        photons = photon_map(camera, options.electrons, "ramp", shape_of(mpx))
        tasks = {peer: partial(next, module.frames(photons, camera, EXPOSURE))}
        tasks |= {engine: next_frame(engine, photons, camera) for engine in options.engines}
        rows.append({"mpx": mpx, "speeds": speeds(take_turns(tasks, options.turns), photons.size, peer)})
    return {"version": module.VERSION, "agreement": agreed, "rows": rows}


if __name__ == "__main__":
    main()
