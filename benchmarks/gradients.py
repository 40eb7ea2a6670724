"""Measure the time of a frame with gradients, compared with the next frame of an open stream.

    python benchmarks/gradients.py [--mpx 1 4] [--electrons 1000] [--turns 9] [--json]

plain           a frame of the full chain from the compiled backend, uint16 in NumPy
ten_parameters  a frame, and the gradient of a squared error with respect to ten camera parameters
all_photons     a frame, and the gradient of a squared error with respect to the photons of every pixel
both            all of these together

Times are medians of turns; ``times_plain`` is the median of the ratios to the plain frame of the same turn.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Callable
from typing import Any

from cases import EXPOSURE, full_chain, photon_map, shape_of
from frame_sources import next_frame
from numpy.typing import NDArray
from timing import alternate, ratio

from mitsuba_sensor.io.metadata import machine
from mitsuba_sensor.sensor.gradient import differentiable

TEN = (
    "readout.sense_gain_uv_per_e",
    "pixel.prnu",
    "pixel.full_well_e",
    "dark_current.fom_na_per_cm2",
    "dark_current.cv",
    "source_follower.white_nv_per_rthz",
    "source_follower.vv_nonlinearity",
    "readout.dsnu_col",
    "adc.gamma",
    "exposure.temperature_k",
)
TASKS = {"ten_parameters": TEN, "all_photons": ("photons",), "both": ("photons", *TEN)}


def main() -> None:
    """Parse the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mpx", type=float, nargs="+", default=[1, 4], help="million pixels")
    parser.add_argument("--electrons", type=float, default=1000, help="mean photoelectrons")
    parser.add_argument("--turns", type=int, default=9, help="measured turns (default 9)")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    rows = [row(mpx, options.electrons, options.turns) for mpx in options.mpx]
    if options.json:
        print(json.dumps({**machine(), "turns": options.turns, "rows": rows}))
        return
    for found in rows:
        print(f"{found['mpx']:g} Mpx, {found['electrons']:g} e-, {options.turns} turns")
        for name, task in found["tasks"].items():
            print(f"  {name:15} {task['seconds'] * 1e3:8.1f} ms   {task['times_plain']:5.2f} × plain")


def row(mpx: float, electrons: float, turns: int) -> dict[str, Any]:
    """Times of all tasks for one size."""
    camera = full_chain()
    photons = photon_map(camera, electrons, "ramp", shape_of(mpx))
    tasks: dict[str, Callable[[], object]] = {"plain": next_frame("drjit", photons, camera)}
    tasks |= {name: gradient(photons, parameters) for name, parameters in TASKS.items()}
    seconds = alternate(tasks, turns)
    found = {
        name: {"seconds": statistics.median(those), "times_plain": ratio(those, seconds["plain"])}
        for name, those in seconds.items()
    }
    return {"mpx": mpx, "electrons": electrons, "tasks": found}


def gradient(photons: NDArray[Any], parameters: tuple[str, ...]) -> Callable[[], object]:
    """A task: the next frame, and the gradient of its squared distance from 100 DN."""
    frames = differentiable(photons, full_chain(), EXPOSURE, parameters)
    numbers = iter(range(2**31))

    def task() -> object:
        frame = frames.frame(next(numbers))
        error = frame.digital - 100.0
        return frame.backward(error * error)

    return task


if __name__ == "__main__":
    main()
