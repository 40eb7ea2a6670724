"""What the commands have in common that measure a camera: a simulated one, or a real one in frames from disk."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
import shlex
import sys
from collections.abc import Iterable, Mapping
from typing import Annotated, TypedDict

from ..core import InputError, require_seed
from ..core.options import Option

PANEL = "Simulated frames"


class SimulatedFlags(TypedDict, total=False):
    """Which camera of its kind is simulated, and which of its frames."""

    serial: Annotated[
        int | None,
        Option(
            "Serial number of the simulated camera. Default: 1.",
            check=require_seed,
            panel=PANEL,
        ),
    ]
    seed: Annotated[
        int | None,
        Option("Seed of the simulated frames. Default: 1.", check=require_seed, panel=PANEL),
    ]


def refuse_beside_frames(given: Mapping[str, object], names: Iterable[str]) -> None:
    """Raises InputError where one of these options of a simulated camera is given."""
    for name in names:
        if given[name] is not None and given[name] is not False:
            raise InputError(
                f"--{name} is for simulated frames, and --frames names real ones; leave one of them out."
            )


def how_made() -> dict[str, object]:
    """Command, machine and versions, for the foot of a page."""
    from ..core.versions import machine, versions

    return {
        "command": shlex.join(["mitsuba-sensor", *sys.argv[1:]]),
        "machine": machine(),
        "versions": versions(),
    }
