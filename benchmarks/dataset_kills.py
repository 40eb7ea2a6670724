"""Attack `mitsuba-sensor dataset run`: kill it and its workers, run it twice at once, fill its disk, corrupt its files.

    python benchmarks/dataset_kills.py [same kills calls poison full repair origin] [--tries N] [--seed S] [--json]

same    the files of 0, 1, 2 and 4 workers, of shards, and of two runs at once on one folder
kills   SIGKILL and Ctrl-C at random moments: the command, one of its workers, or all; then it is given again
calls   SIGKILL at the n-th rename, fsync, mkdir and unlink of the command or of a worker (strace, as root)
poison  a view whose process is killed each time it begins: put into quarantine after three, the rest is made
full    disks of every size until one is large enough: exit code 3, path and bytes named; resumed (as root)
repair  random corruptions: `verify` lists them all, and `repair` makes these again and touches nothing else
origin  damages of what says what a dataset is: seen by `verify`; nothing is rendered from them, and `run` restores them

The dataset is tiny: three scenes of 16 pixels, two exposures, two chips. A try is damaged if an entry is torn, lost or
wrong, if a file is left that belongs to nothing, or if the folder at the end is not that of an undisturbed run.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import dataset_calls as calls
from dataset_attacks import Attack, run_attacks
from dataset_damage import CORRUPTIONS
from dataset_disks import mounted
from dataset_entries import ALL_FILES_S, summary, tree

from mitsuba_sensor.dataset.record import sealed, unsealed
from mitsuba_sensor.dataset.repair import verify
from mitsuba_sensor.dataset.store import Store

ROOT = Path(__file__).resolve().parents[1]
COMMAND = [sys.executable, "-m", "mitsuba_sensor", "dataset"]
DATASET = """
name = "tiny"
seed = 1
outputs = ["raw", "clean", "electrons", "aovs"]
render = { width = 16, spp = 16 }
scenes = [
    { name = "first", file = "scenes/first_frame.xml" },
    { name = "flat", file = "scenes/flat_field.xml" },
    { name = "wedge", file = "scenes/step_wedge.xml" },
]
cameras = [{ camera = "bayer_2mp" }]
grid = { exposure_s = [0.01], exposure_ev = [0, -2], serial = [1, 2] }
"""
SAMPLES = 12
MOST_SHOWN = 20  # problems
ENDS_S = 20.0
"""After the command was killed alone, its workers end within so many seconds."""


class Runs:
    """A dataset file, what an undisturbed run makes of it, and commands on a folder that is attacked."""

    def __init__(self, top: Path) -> None:
        self.top, self.out, self.problems = top, top / "out", list[str]()
        (top / "tiny.toml").write_text(DATASET, "utf-8")
        began = time.monotonic()
        self.finish("undisturbed", "--workers", "0")
        self.seconds = time.monotonic() - began
        self.right = tree(self.out)
        shutil.move(self.out, top / "right")

    def start(self, *options: str, out: Path | None = None, below: tuple[str, ...] = ()) -> subprocess.Popen[str]:
        """Begin the command, in a process group of its own."""
        command = [*below, *COMMAND, "run", str(self.top / "tiny.toml"), "-o", str(out or self.out), *options]
        pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        return subprocess.Popen([*command, "--root", str(ROOT)], start_new_session=True, **pipes)

    def finish(self, where: str, *options: str) -> None:
        """Give the command and wait for it; it must end well."""
        process = self.start(*options)
        said, _ = process.communicate()
        if process.returncode:
            self.problems.append(f"{where}: ended with {process.returncode}: {said[-300:]}")

    def check(self, where: str) -> None:
        """After an attack: what is there is right."""
        store = Store(self.out)
        found = [str(fault) for fault in store.verify_all()]
        for path, content in tree(self.out).items():
            inside = path.startswith(("samples", "views")) and ".unfinished" not in path
            found += [f"wrong: {path}"] if inside and self.right.get(path) != content else []
        self.problems += [f"{where}: {found[0]}"] if found else []

    def complete(self, where: str, *options: str) -> None:
        """Give the command again; then all is as if nothing had happened."""
        with suppress(FileNotFoundError):
            Store(self.out).clean(ALL_FILES_S)
        self.finish(where, *options)
        left = tree(self.out)
        wrong = sorted(path for path in left.keys() | self.right.keys() if left.get(path) != self.right.get(path))
        wrong += [str(path) for path in self.out.rglob(".*")]
        self.problems += [f"{where}, resumed: {wrong}"] if wrong else []
        shutil.rmtree(self.out)


def below(pid: int) -> Iterator[tuple[int, bool]]:
    """Processes of a process group but its first, and whether each is a worker."""
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, ValueError):
            if os.getpgid(int(place.name)) == pid and int(place.name) != pid:
                yield int(place.name), b"spawn_main" in (place / "cmdline").read_bytes()


def ended(pid: int) -> bool:
    """Wait for the end of all that a killed command has started; whether it came."""
    end = time.monotonic() + ENDS_S
    while time.monotonic() < end:
        if not list(below(pid)):
            return True
        time.sleep(0.02)
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
    return False


def same(runs: Runs, tries: int, chance: random.Random) -> dict[str, Any]:
    """Who makes it does not matter."""
    ways = {f"{n} workers": [["--workers", str(n)]] for n in (0, 1, 2, 4)}
    ways |= {"shards": [["--shard", f"{n}/3"] for n in (1, 2, 3)], "two runs at once": [["--workers", "0"]] * 2}
    ways |= {"two runs with workers at once": [["--workers", "2"]] * 2}
    for name, commands in ways.items():
        processes = [runs.start(*options) for options in commands]
        for process in processes:
            said, _ = process.communicate()
            if process.returncode:
                runs.problems.append(f"{name}: ended with {process.returncode}: {said[-300:]}")
        left = tree(runs.out)
        wrong = sorted(path for path in left.keys() | runs.right.keys() if left.get(path) != runs.right.get(path))
        if name == "shards":  # the index is of what was there when the last one ended
            wrong = [path for path in wrong if path != "index.jsonl"]
        runs.problems += [f"{name}: {wrong}"] if wrong else []
        runs.problems += [f"{name}: {path}" for path in runs.out.rglob(".*")]
        shutil.rmtree(runs.out)
    return summary(len(ways), runs.problems)


def kills(runs: Runs, tries: int, chance: random.Random) -> dict[str, Any]:
    """Random moments and victims."""
    done, completed, kinds = 0, 0, dict.fromkeys(("command", "worker", "all", "Ctrl-C"), 0)
    while done < tries:
        workers, before = chance.choice("002"), set(runs.out.rglob(".unf*"))  # of those that were killed
        process = runs.start("--workers", workers)
        time.sleep(chance.uniform(0.2, 1.2) * runs.seconds * (1.0 if workers == "0" else 1.7))
        kind = chance.choice(list(kinds) if workers == "2" else ["command", "Ctrl-C"])
        victims = [pid for pid, worker in below(process.pid) if worker] if kind == "worker" else []
        if process.poll() is None and (kind != "worker" or victims):
            with suppress(ProcessLookupError):
                if kind in ("all", "Ctrl-C"):
                    os.killpg(process.pid, signal.SIGKILL if kind == "all" else signal.SIGINT)
                else:
                    os.kill(chance.choice(victims) if victims else process.pid, signal.SIGKILL)
            done, kinds[kind] = done + 1, kinds[kind] + 1
        said, _ = process.communicate()
        if not ended(process.pid):
            runs.problems.append(f"kill {done}, {kind}: its workers go on")
        begun = kind != "worker" or "could not begin" not in said
        if (process.returncode not in (0, -9, -2, 130) and begun) or "Traceback" in said:
            runs.problems.append(f"kill {done}, {kind}: ended with {process.returncode}: {said[-500:]}")
        if runs.out.exists():
            runs.check(f"kill {done}, {kind}")
            stopped = process.returncode == 128 + signal.SIGINT
            left = set(runs.out.rglob(".unf*")) - before if stopped else ()
            runs.problems += [f"kill {done}, {kind}: left {path}" for path in left]
        if process.returncode == 0 and runs.out.exists():
            runs.complete(f"run {completed}", "--workers", "0", "--retry")
            completed += 1
    runs.complete("the last one", "--workers", "0", "--retry")
    return summary(done, runs.problems, runs_completed=completed, **kinds)


def each_call(runs: Runs, tries: int, chance: random.Random) -> dict[str, Any]:
    """SIGKILL at system calls.  tries : that are drawn."""
    if not calls.possible():
        return {"skipped": "needs strace, as root"}
    killed = 0
    for _ in range(tries):
        name, workers = chance.choice(["rename", "fsync", "mkdir", "unlink", "openat"]), chance.choice("0002")
        call = chance.randint(1, 3000 if name == "openat" else 60)
        inject = "-e", f"trace={name}", "-e", f"inject={name}:signal=KILL:when={call}"
        process = runs.start("--workers", workers, below=("strace", "-f", "-qqq", "-o", "/dev/null", *inject))
        process.communicate()
        killed += process.returncode != 0
        ended(process.pid)
        if runs.out.exists():
            runs.check(f"{name} {call}")
        runs.complete(f"{name} {call}", "--workers", "0", "--retry")
    return summary(tries, runs.problems, killed=killed)


def poison(runs: Runs, tries: int, chance: random.Random) -> dict[str, Any]:
    """Kill each process that begins a certain view."""
    for _ in range(tries):
        key = chance.choice(sorted(path.parent.name for path in (runs.top / "right").glob("views/*/*/record.json")))
        process, log, seen = runs.start("--workers", "2"), runs.out / "quarantine" / f"{key}.log", set[int]()
        while process.poll() is None:
            with suppress(OSError):
                for pid in map(int, re.findall(r"begun by \S+ (\d+)", log.read_text("utf-8", "replace"))):
                    if pid not in seen:
                        os.kill(pid, signal.SIGKILL)
                    seen.add(pid)
            time.sleep(0.0005)
        said, _ = process.communicate()
        found = Store(runs.out).quarantined()
        made = len(list(runs.out.glob("samples/*/*/record.json")))
        right = process.returncode == 1 and list(found) == [key] and len(seen) == 3 and made == SAMPLES * 2 // 3
        if not right and len(seen) >= 3:
            runs.problems.append(f"{key}: code {process.returncode}, {len(seen)} died, {made} made: {said[-300:]}")
        runs.check(key)
        runs.complete(key, "--workers", "2", "--retry")
    return summary(tries, runs.problems)


def full(runs: Runs, tries: int, chance: random.Random) -> dict[str, Any]:
    """Small disks in memory.  tries : sizes."""
    if not calls.possible():
        return {"skipped": "needs mount, as root"}
    blocks = sum(1 + -(-len(content) // 4096) for content in runs.right.values()) + 40
    sizes = sorted({1 + blocks * number // tries for number in range(tries)})
    runs.out, stopped = runs.top / "disk" / "out", 0
    for size in sizes:
        with mounted(runs.top / "disk", "-t", "tmpfs", "-o", f"size={size * 4096}", "none"):
            process = runs.start("--workers", chance.choice("02"))
            said, _ = process.communicate()
            stopped += process.returncode == 3
            named = re.search(r"cannot write \S+: .*; \d+ bytes were to be written; make space", said)
            if process.returncode not in (0, 3) or (process.returncode == 3 and not named):
                runs.problems.append(f"{size} blocks: ended with {process.returncode}: {said[-300:]}")
            if runs.out.exists():
                runs.problems += [f"{size} blocks: left {path}" for path in runs.out.rglob(".*")]
                runs.check(f"{size} blocks")
            subprocess.run(["mount", "-o", "remount,size=1G", str(runs.top / "disk")], check=True)
            runs.complete(f"{size} blocks", "--workers", "0")
    return summary(len(sizes), runs.problems, stopped=stopped)


def repair(runs: Runs, tries: int, chance: random.Random) -> dict[str, Any]:
    """Several corruptions at once, a folder of strays among them now and then."""
    spoilt = 0
    for number in range(tries):
        shutil.copytree(runs.top / "right", runs.out)
        store = Store(runs.out)
        wanted = [(kind, key) for kind in ("samples", "views") for key in store.keys(kind)]
        before = {entry: store.folder_of(*entry).stat().st_ino for entry in wanted}
        must = set()
        for corrupt in chance.sample([one for one in CORRUPTIONS if one.__name__ != "moved"], chance.randint(1, 4)):
            left = [entry for entry in wanted if entry not in must]
            must |= corrupt(store, left, chance)
        done = subprocess.run([*COMMAND, "verify", str(runs.out), "--json"], capture_output=True, text=True)
        found = {(one["kind"], one["key"]) for one in json.loads(done.stdout)}
        if (found, done.returncode) != (must, 1):
            runs.problems.append(f"{number}: verify found {found} instead of {must}")
        now = {entry: store.folder_of(*entry).stat().st_ino for entry in wanted}
        subprocess.run([*COMMAND, "repair", str(runs.out), "--workers", "0"], capture_output=True, text=True)
        after = {entry: store.folder_of(*entry).stat().st_ino for entry in wanted}
        touched = {entry for entry in wanted if now[entry] != after[entry] and before[entry] == now[entry]} - must
        runs.problems += [f"{number}: made again without need {touched}"] if touched else []
        spoilt += len(must)
        runs.complete(f"{number}", "--workers", "0")
    return summary(tries, runs.problems, entries_spoilt=spoilt)


def origin(runs: Runs, tries: int, chance: random.Random) -> dict[str, Any]:
    """Bits, tails and other valid values of every file beside the entries."""
    shutil.copytree(runs.top / "right", runs.out)
    right, unseen = tree(runs.out), 0
    names = [name for name in right if not name.startswith(("samples/", "views/"))]
    for number in range(tries):
        path = runs.out / names[number % len(names)]
        path.write_bytes(damaged(path.read_bytes(), chance))
        unseen += not any(fault.kind == "dataset" for fault in verify(runs.out))
        if number < len(names):
            subprocess.run([*COMMAND, "repair", str(runs.out), "--workers", "0"], cwd=ROOT, capture_output=True)
            entries = {name for name in tree(runs.out) if name.startswith(("samples/", "views/"))}
            runs.problems += [f"{path.name}: repair made others"] if entries != right.keys() - set(names) else []
        path.write_bytes(right[path.relative_to(runs.out).as_posix()])
    runs.problems += [f"{unseen} damages were not seen"] if unseen else []
    runs.complete("the last one", "--workers", "0")
    return summary(tries, runs.problems, files=names, unseen=unseen)


def damaged(content: bytes, chance: random.Random) -> bytes:
    """One bit is flipped, a tail is lost, a digit is another one, or a seal is right for other content."""
    place, what = chance.randrange(len(content)), chance.randrange(4)
    if what == 0:
        return content[:place] + bytes([content[place] ^ 1 << chance.randrange(8)]) + content[place + 1 :]
    if what == 1:
        return content[:place]
    digits = [found.start() for found in re.finditer(rb"[0-9]", content)]
    place = chance.choice(digits)
    other = content[:place] + b"%d" % ((int(content[place : place + 1]) + 1) % 10) + content[place + 1 :]
    text = unsealed(content)
    if what == 2 or text is None:
        return other
    place = chance.choice([found for found in digits if found < len(text) - 1])
    return sealed(f"{text[:place]}{(int(text[place]) + 1) % 10}{text[place + 1 :]}")


def on_runs(attack: Callable[[Runs, int, random.Random], dict[str, Any]]) -> Attack:
    """The same attack, of a seed and a folder; what it found wrong is told on stderr."""

    def with_runs(tries: int, seed: int, top: Path) -> dict[str, Any]:
        runs = Runs(top)
        found = attack(runs, tries, random.Random(seed))
        for one in runs.problems[1:MOST_SHOWN]:
            print(one, file=sys.stderr)
        return found

    return with_runs


ATTACKS: dict[str, tuple[Attack, int]] = {
    "same": (on_runs(same), 1),
    "kills": (on_runs(kills), 300),
    "calls": (on_runs(each_call), 60),
    "poison": (on_runs(poison), 5),
    "origin": (on_runs(origin), 600),
    "full": (on_runs(full), 30),
    "repair": (on_runs(repair), 30),
}
"""Name → attack, and how often it is tried if nothing is said."""


if __name__ == "__main__":
    # A job in the background ignores Ctrl-C, and so would the commands that it begins.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    run_attacks(__doc__, ATTACKS)
