"""Check of this machine: each variant renders a small scene in a separate process, which may crash."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from importlib import resources
from typing import Any, TypeAlias

from ..core.llvm import GIVEN_PATH, INSTALL, LLVM_PATH, find_llvm
from ..core.versions import versions
from ..stopping import undone_if_stopped
from .variants import VARIANTS

SLOW = "scalar_spectral"
NOTEBOOK = """
import sys, mitsuba_sensor
import mitsuba as mi
mi.set_variant(sys.argv[1])
print(mi.render(mi.load_dict(mi.cornell_box()), spp=1).shape)
"""
RENDERER = "mitsuba>=3.9.1,<3.10"  # as in pyproject.toml
LIMIT_S = 300
Finding: TypeAlias = dict[str, Any]  # ready for JSON


def examine(tell: Callable[[int, int, str], object] = lambda done, total, now: None) -> Finding:
    """Return the variants, the default variant, LLVM libraries, versions and remedies (commands), and if plain Mitsuba
    renders after this package is imported.

    tell : called with the number of finished renders, the number of all renders, and the next render.
    """
    tell(0, len(VARIANTS), "rendering a small scene")
    chosen = _try(None)
    variants = []
    for number, name in enumerate(VARIANTS):
        tell(number, len(VARIANTS), f"rendering a small scene with {name}")
        variants.append(chosen if chosen["name"] == name else _try(name))
    tell(len(VARIANTS), len(VARIANTS), "rendering in Python")
    code, _, complaint = _run([sys.executable, "-c", NOTEBOOK, chosen["name"] or SLOW])
    reason = _why(code, complaint) if code else "a test picture was rendered"
    findings = {
        "works": chosen["works"],
        "variant": chosen["name"],
        "seconds": chosen["seconds"],
        "variants": variants,
        "python": {"works": not code, "reason": reason},
    }
    libraries = find_llvm()
    used = next((library for library in libraries if library.usable), None)
    llvm = [asdict(library) | {"used": library is used} for library in libraries]
    findings |= {"llvm": llvm, "versions": versions()}
    return {**findings, "remedies": _remedies(findings, chosen["reason"])}


def _try(variant: str | None) -> Finding:
    """Render the small scene in a child process, by the command line as a user would."""
    failed: Finding = {"name": variant, "works": False, "reason": "", "seconds": None}
    small = resources.as_file(resources.files("mitsuba_sensor.render") / "doctor.xml")
    with (
        tempfile.TemporaryDirectory() as folder,
        undone_if_stopped(partial(shutil.rmtree, folder)),
        small as scene,
    ):
        command = [
            sys.executable,
            "-m",
            "mitsuba_sensor",
            "render",
            str(scene),
            "-o",
            folder,
            "--spp",
            "16",
            "--json",
        ]
        command += ["--variant", variant] if variant else []
        code, output, complaint = _run(command)
    if code:
        return {**failed, "reason": _why(code, complaint)}
    report = json.loads(output)
    name, seconds = report["render"]["variant"], report["times_s"]["render"]
    return {
        "name": name,
        "works": True,
        "reason": "a test picture was rendered",
        "seconds": seconds,
    }


def _run(command: list[str]) -> tuple[int, str, str]:
    """Return exit code, stdout and stderr of a child process, which ends with this one and chooses LLVM again."""
    pipe = subprocess.PIPE
    environment = {name: value for name, value in os.environ.items() if name != LLVM_PATH}
    if GIVEN_PATH is not None:
        environment[LLVM_PATH] = GIVEN_PATH
    with (
        subprocess.Popen(
            command, stdout=pipe, stderr=pipe, text=True, env=environment
        ) as child,
        undone_if_stopped(child.kill),
    ):
        try:
            output, complaint = child.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            return 1, "", f"no end after {LIMIT_S} s"
        finally:
            child.kill()  # no effect if it has ended
    return child.returncode, output, complaint


def _why(code: int, complaint: str) -> str:
    """Return the last line of the child's stderr, or the signal that ended it."""
    if code < 0:
        return f"the process was ended by {signal.Signals(-code).name}"
    lines = [line for line in complaint.splitlines() if line.strip()]
    last = lines[-1].removeprefix("error: ").split("; ")[0] if lines else f"exit code {code}"
    return last.rpartition(", but there is ")[2]  # without the option, which this module set


def _remedies(findings: Finding, reason: str) -> list[str]:
    """Return commands that fix problems, most urgent first."""
    remedies = []
    missing = [
        name
        for name, version in findings["versions"].items()
        if version is None and name != "mitsuba-sensor"
    ]
    if missing:
        remedies.append(f"{sys.executable} -m pip install {' '.join(missing)}")
    if not findings["works"]:
        remedies.append(
            f"{sys.executable} -m pip install --force-reinstall '{RENDERER}'   # {reason}"
        )
        working = [row["name"] for row in findings["variants"] if row["works"]]
        remedies += [
            f"mitsuba-sensor render SCENE -o DIR --variant {name}   # until then; in Python: variant={name!r}"
            for name in working[:1]
        ]
    elif not findings["python"]["works"]:
        why = findings["python"]["reason"]
        remedies.append(f"mi.set_variant({SLOW!r})   # in Python, until mi.render works: {why}")
    elif findings["variant"] == SLOW:
        remedies.append(f"{INSTALL}   # renders up to about three times faster")
    return remedies
