"""The command line of attacks on datasets: which, how often, which seed; a table or JSON; 1 if any did damage."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from dataset_entries import folder_for_all

Attack: TypeAlias = Callable[[int, int, Path], dict[str, Any]]
"""Of how often, the seed and an empty folder: what it found."""


def run_attacks(about: str | None, attacks: Mapping[str, tuple[Attack, int]]) -> None:
    """Parse the options, attack, print.

    about : what --help says.  attacks : name → attack, and how often it is tried if nothing is said.
    """
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "attacks", nargs="*", metavar="ATTACK", help=f"of {', '.join(attacks)} (default: all)"
    )
    parser.add_argument(
        "--tries", type=int, help="how often (default: as many as a full proof takes)"
    )
    parser.add_argument("--seed", type=int, default=1, help="of all that is random (default 1)")
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    if unknown := set(options.attacks) - set(attacks):
        parser.error(
            f"there is no attack {', '.join(unknown)}; choose of {', '.join(attacks)}."
        )
    results = {}
    for name in options.attacks or attacks:
        attack, usual = attacks[name]
        began = time.monotonic()
        with folder_for_all() as top:
            results[name] = attack(options.tries or usual, options.seed, top)
        results[name]["seconds"] = time.monotonic() - began
        if not options.json:
            print(json.dumps({name: results[name]}, indent=2), flush=True)
    if options.json:
        print(json.dumps(results))
    if any(_damaged(results)):
        raise SystemExit(1)


def _damaged(tree: dict[str, Any]) -> list[int]:
    """All numbers of damaged tries."""
    inner = [
        one for value in tree.values() if isinstance(value, dict) for one in _damaged(value)
    ]
    return [*inner, *([tree["damaged"]] if "damaged" in tree else [])]
