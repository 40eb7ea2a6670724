"""Mitsuba's errors about a scene in one sentence with file and line, and the plugins that may be loaded."""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from ...core import InputError, nearest
from ..variants import MitsubaObject, mitsuba

OWN_PLUGINS = ("camera", "photosensor", "raw_frame")
SHARED = ("__init__", "common")  # modules among the gradient integrators without an integrator
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
MESSAGE_LENGTH_MAX = 1000
"""Longest message of Mitsuba [characters]; messages repeat values of the scene."""


@contextlib.contextmanager
def searching(resolver: MitsubaObject) -> Iterator[None]:
    """Let Mitsuba find files with this resolver inside the ``with`` block."""
    mi = mitsuba()
    before = mi.file_resolver()
    mi.set_file_resolver(resolver)
    try:
        yield
    finally:
        mi.set_file_resolver(before)


@contextlib.contextmanager
def mitsuba_errors(
    file: Path, text: str = "", values: Mapping[str, str] | None = None, place: str = ""
) -> Iterator[None]:
    """Turn Mitsuba's RuntimeError about a scene into an InputError with its message, which names file and line.

    text : of the scene.  values : of its parameters.  place : in the file, if Mitsuba does not know it.
    """
    try:
        yield
    except RuntimeError as error:
        message = plain_message(error).replace(str(file.resolve()), str(file))
        scene = "" if str(file) in message else f"scene {str(file)!r}: "
        sentence = f"{scene}{place}{message}{_remedy(message, values or {})}"
        if old := old_version(text):
            sentence += (
                f" The scene has the format of Mitsuba {old}, which Mitsuba's upgrade reads only in part; write the "
                "rest in the terms of version 3."
            )
        raise InputError(sentence) from error


def plain_message(error: BaseException) -> str:
    """Return Mitsuba's message without its source lines and line breaks."""
    text = re.sub(r"\[\w+\.(?:cpp|h|py):\d+\]\s*", "", str(error))
    text = re.sub(r"[\s\x00-\x1f\x7f]+", " ", text).strip().rstrip(".!")
    return text if len(text) <= MESSAGE_LENGTH_MAX else f"{text[:MESSAGE_LENGTH_MAX]} …"


def _remedy(message: str, values: Mapping[str, str]) -> str:
    """Return a remedy that Mitsuba does not give, from the full stop or semicolon."""
    if "No document element found" in message:
        return "; give the path of a Mitsuba 3 scene, or light to `mitsuba-sensor expose`."
    unreadable = re.search(r'[Cc]ould not parse .* value "(.*)"', message)
    for name, value in values.items():
        if unreadable and value == unreadable[1]:
            return f"; it is the value of the parameter {name} (-D {name}=…)."
    if "undefined parameter" in message:
        return "; give it a value (-D name=value)."
    unknown = re.search(r'Plugin "(\w+)" not found', message)
    return remedy_for(unknown[1]) if unknown else "."


def remedy_for(kind: str) -> str:
    """Return what to write instead of an unknown plugin type, from the full stop or semicolon."""
    if kind in gradient_integrators():
        return "; it computes gradients and needs an llvm or cuda variant; integrator='path' renders without them."
    native = (file.stem for file in (_own_folder() / "plugins").iterdir())
    return f".{nearest(kind, sorted({*OWN_PLUGINS, *native, *gradient_integrators()}))}"


def gradient_integrators() -> list[str]:
    """Return Mitsuba's integrators that compute gradients, which are Python modules. Scalar variants do not register
    them."""
    folder = _own_folder() / "python" / "ad" / "integrators"
    return sorted(file.stem for file in folder.glob("*.py") if file.stem not in SHARED)


def refuse_foreign_plugins(name: str, state: MitsubaObject, resolver: MitsubaObject) -> None:
    """Raise InputError for a type that cannot be a name, and for a plugin outside of Mitsuba's folder.

    Types that Python has registered have no file.  name : of the scene.  state : parsed, before anything is built.
    resolver : searches Mitsuba's folder first.
    """
    own = _own_folder().resolve() / "plugins"
    for kind in sorted({node.props.plugin_name() for node in state.nodes}):
        if not re.fullmatch(r"[\w-]{0,64}", kind):
            raise InputError(
                f"scene {name!r} has an element of type {kind[:80]!r}, which is not a plugin name."
            )
        code = Path(str(resolver.resolve(f"plugins/{kind}{SUFFIX}")))
        if code.exists() and code.resolve().parent != own:
            raise InputError(
                f"scene {name!r} has type {kind!r}, and {code} is native code that would be run; move it away, or "
                "render trusted code with plain Mitsuba."
            )


def _own_folder() -> Path:
    return Path(str(mitsuba().__file__)).parent


def old_version(text: str) -> str:
    """Return the format of a scene file, if it is older than version 3; else an empty string."""
    match = re.search(r"""<scene\s[^>]*?version\s*=\s*["']([012]\.[\d.]+)["']""", text)
    return match[1] if match else ""
