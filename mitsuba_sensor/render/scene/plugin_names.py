"""Which plugins there are: files of Mitsuba, those that Python registers, and our own."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from ...core import InputError, nearest
from ..variants import MitsubaObject, mitsuba

OWN_PLUGINS = ("camera", "photosensor", "raw_frame")
SHARED = ("__init__", "common")  # modules of the folder of gradient integrators that are none
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")

PRIMAL = {
    "direct_projective": "direct",
    "prb": "path",
    "prb_basic": "path",
    "prb_projective": "path",
    "prbvolpath": "volpath",
}
"""Integrators for gradients, and the one that renders the same image."""


def plugin_names() -> list[str]:
    """Names of the plugins of Mitsuba and of our own."""
    native = (file.stem for file in (_own_folder() / "plugins").iterdir())
    return sorted({*OWN_PLUGINS, *native, *gradient_integrators()})


def gradient_integrators() -> list[str]:
    """Names of the integrators that compute gradients, each a module of Mitsuba's in Python. Scalar variants do not
    register them."""
    folder = _own_folder() / "python" / "ad" / "integrators"
    return sorted(file.stem for file in folder.glob("*.py") if file.stem not in SHARED)


def remedy_for(kind: str) -> str:
    """What to write instead of a type that no plugin of this variant has, from the full stop or semicolon on."""
    if kind in gradient_integrators():
        same = f": {PRIMAL[kind]!r} gives the same image" if kind in PRIMAL else ""
        return f"; it computes gradients and needs an llvm or cuda variant{same}."
    return f".{nearest(kind, plugin_names())}"


def refuse_foreign_plugins(name: str, state: MitsubaObject, resolver: MitsubaObject) -> None:
    """Raise InputError for a type that is no name, and for one whose code is not Mitsuba's own.

    Types that Python has registered have no file.  name : of the scene.  state : parsed, of which nothing is built.
    resolver : looks into Mitsuba's folder first.
    """
    own = _own_folder().resolve() / "plugins"
    for kind in sorted({node.props.plugin_name() for node in state.nodes}):
        if not re.fullmatch(r"[\w-]{0,64}", kind):
            raise InputError(
                f"scene {name!r} has an element of type {kind[:80]!r}, which is no name of a plugin."
            )
        code = Path(str(resolver.resolve(f"plugins/{kind}{SUFFIX}")))
        if code.exists() and code.resolve().parent != own:
            way_out = "move it away, or render with plain Mitsuba what you trust"
            raise InputError(
                f"scene {name!r} has type {kind!r}, and {code} is native code that would be run; {way_out}."
            )


def _own_folder() -> Path:
    return Path(str(mitsuba().__file__)).parent
