"""What attacks on the folder of a dataset share: a run that dies, or meets a full disk, at each of its system calls."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dataset_calls as calls
from dataset_entries import FULL, Told, summary

from mitsuba_sensor.dataset.store.record import Entry

IGNORED = {"exit", "exit_group", "rt_sigreturn", "futex"}
"""Calls that do not return, and those of which there is any number."""


class Ground:
    """A folder that is attacked, and what is checked after each attack."""

    def __init__(self, top: Path) -> None:
        self.out, self.template = top / "out", top / "template"
        self.problems: list[str] = []

    def start(self, seed: int = 0) -> Callable[[Told], object]:
        """Begin anew; returns the job of a run."""
        raise NotImplementedError

    def check(self, where: str, told: set[Entry]) -> None:
        """What a run leaves that was stopped.  told : samples that it has told of."""
        raise NotImplementedError

    def resume(self, where: str) -> None:
        """After another run all is as if nothing had happened."""
        raise NotImplementedError

    def check_full(self, where: str, ended: tuple[int, str], expects_full: bool = True) -> None:
        """A clean stop: path and bytes named, nothing unfinished left.

        expects_full : the disk says that it is full; one that is broken may end a run with another sentence.
        """
        code, said = ended
        places = (
            str(self.out),
            tempfile.gettempdir(),
        )  # where a sample's files are before they are in a shard
        named = said.startswith("full: ") and said.split()[-1].isdigit()
        named = named and any(place in said for place in places)
        if code == FULL and not named:
            self.problems.append(f"{where}: the sentence was {said}")
        if code not in (0, FULL) and (expects_full or "InputError" not in said):
            self.problems.append(f"{where}: ended with {code}, {said.splitlines()[-1]}")
        self.problems += [f"{where}: left {path}" for path in self.out.rglob(".*")]

    def kill_each_call(self, tries: int, seed: int, log: Path) -> dict[str, Any]:
        """SIGKILL at every system call of a run.  tries : of each name at most."""
        known, done = calls.calls_of(self.start(seed), log), 0
        chosen = {
            name: min(count, tries) for name, count in known.items() if name not in IGNORED
        }
        for where, (code, told, said) in calls.each_call(
            chosen, "signal=KILL", lambda: self.start(seed)
        ):
            if code not in (0, -9):
                raise SystemExit(said)
            done += code == -9
            self.check(where, told)
            self.resume(where)
        return summary(done, self.problems, kinds_of_calls=len(chosen))

    def fail_each_call(
        self, error: str, names: tuple[str, ...], tries: int, seed: int, log: Path
    ) -> dict[str, Any]:
        """Every call of these names fails once with the error.  tries : of each name at most."""
        known, done = calls.calls_of(self.start(seed), log), 0
        chosen = {name: min(known.get(name, 0), tries) for name in names}
        for where, (code, told, said) in calls.each_call(
            chosen, f"error={error}", lambda: self.start(seed)
        ):
            done += 1
            self.check(where, told)
            self.check_full(where, (code, said), error != "EIO")
            self.resume(where)
        return summary(done, self.problems)
