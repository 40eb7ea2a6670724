"""Refuses native code beside a scene: Mitsuba looks for plugins in every folder in which it looks for files."""

from __future__ import annotations

import re
import sys
from pathlib import Path

from ...core import InputError
from ..variants import MitsubaObject, mitsuba

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def refuse_foreign_plugins(name: str, state: MitsubaObject, resolver: MitsubaObject) -> None:
    """Raise InputError for a type that is no name, and for one whose code is not Mitsuba's own.

    Types that Python has registered have no file.  name : of the scene.  state : parsed, of which nothing is built.
    resolver : looks into Mitsuba's folder first.
    """
    own = Path(str(mitsuba().__file__)).resolve().parent / "plugins"
    for kind in sorted({node.props.plugin_name() for node in state.nodes}):
        if not re.fullmatch(r"[\w-]{0,64}", kind):
            raise InputError(f"scene {name!r} has an element of type {kind[:80]!r}, which is no name of a plugin.")
        code = Path(str(resolver.resolve(f"plugins/{kind}{SUFFIX}")))
        if code.exists() and code.resolve().parent != own:
            way_out = "move it away, or render with plain Mitsuba what you trust"
            raise InputError(
                f"scene {name!r} has type {kind!r}, and {code} is native code that would be run; {way_out}."
            )
