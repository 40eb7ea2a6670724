"""How many renders a dataset takes whose views have more samples than a task: one for each view, whoever makes it.

python benchmarks/dataset_renders.py   # about ten minutes; --samples 300 --shard-samples 100 takes two

The command itself is run: by one process, by two workers, by two parts at once, and by two parts of which the one that
renders first is killed in its render, before the whole is made. All must leave the same shards.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

FILE = """
name = "renders"
store = {{ shard_samples = {shard_samples} }}
outputs = ["raw"]
render = {{ width = 16, spp = 16 }}
scenes = [{{ name = "flat", file = "flat_field" }}]
cameras = [{{ camera = "konnik_table1" }}]
grid = {{ "parameters.radiance" = {radiances}, repetition = {repetitions} }}
"""
COUNTS = """
import os

from mitsuba_sensor.dataset.run.view_render import ViewRender

own = ViewRender.light


def light(self):
    with open(os.environ["RENDERS"], "a") as log:
        log.write(f"{os.getpid()}\\n")
    return own(self)


ViewRender.light = light
"""
"""What each process of the command runs first: it writes a line for each of its renders."""
ONE, TWO_WORKERS, PARTS = (
    [["--workers", "0"]],
    [["--workers", "2"]],
    [["--shard", "1/2"], ["--shard", "2/2"]],
)
LOOKS_EVERY_S = 0.01


def begun(top: Path, out: str, options: list[str]) -> subprocess.Popen[bytes]:
    """The command, begun."""
    command = [sys.executable, "-m", "mitsuba_sensor", "dataset", "run", str(top / "file.toml")]
    places = [str(top), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment: Mapping[str, str] = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(places),
        "RENDERS": str(top / f"{out}.renders"),
    }
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        [*command, "-o", str(top / out), *options], env=environment, stdout=quiet, stderr=quiet
    )


def made(top: Path, out: str, ways: list[list[str]], kills: bool = False) -> str:
    """A line on a dataset that is made in these ways at once; then the whole, which has nothing to do but to say so.

    kills : the process that renders first is killed, and the others end.
    """
    began, log = time.perf_counter(), top / f"{out}.renders"
    processes = [begun(top, out, options) for options in ways]
    while kills and not (log.exists() and log.read_text().endswith("\n")):
        time.sleep(LOOKS_EVERY_S)
    if kills:
        os.kill(int(log.read_text().split()[0]), signal.SIGKILL)
    codes = sorted(process.wait() for process in processes)
    assert codes == [-signal.SIGKILL, 0] if kills else not any(codes), codes
    assert begun(top, out, ["--workers", "0"]).wait() == 0
    took = time.perf_counter() - began
    assert not (top / out / "lights").exists()
    return f"{out:34}{len(log.read_text().split()):9}{took:10.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--views", type=int, default=3)
    parser.add_argument("--samples", type=int, default=3000, help="of each view")
    parser.add_argument("--shard-samples", type=int, default=1000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        top = Path(folder)
        (top / "sitecustomize.py").write_text(COUNTS, "utf-8")
        values = {
            "radiances": [1e-5 * (1 + k) for k in range(asked.views)],
            "repetitions": [*range(asked.samples)],
        }
        text = FILE.format(shard_samples=asked.shard_samples, **values)
        (top / "file.toml").write_text(text, "utf-8")
        print(f"{asked.views} views of {asked.samples} samples{'renders':>13}{'[s]':>10}")
        print(made(top, "one process", ONE), flush=True)
        print(made(top, "two workers", TWO_WORKERS), flush=True)
        print(made(top, "1 of 2 and 2 of 2 at once", PARTS), flush=True)
        print(made(top, "the same, one killed in a render", PARTS, kills=True), flush=True)
        shards = [
            sorted(path.name for path in place.iterdir()) for place in top.glob("*/shards")
        ]
        assert len(shards) == 4 and shards.count(shards[0]) == 4, shards
        print("all four have the same shards")


if __name__ == "__main__":
    main()
