"""Mitsuba's errors about a scene as one sentence, with file and line."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from ...core import InputError
from ..variants import MitsubaObject, mitsuba
from .plugin_names import remedy_for

MESSAGE_LENGTH_MAX = 1000
"""Characters of a message of Mitsuba, which repeats the values of a scene."""


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
    """Turn Mitsuba's RuntimeError about a scene into an InputError with its message, which has file and line; that of a
    scene of an older Mitsuba says so.

    text, values : of the scene and its parameters.  place : in the file, where Mitsuba does not know it.
    """
    try:
        yield
    except (RuntimeError, InputError) as error:
        said = str(error)
        if isinstance(error, RuntimeError):
            begin = "At|While loading|Error while loading|Parsing of XML file"
            names = f"{re.escape(str(file))}|{re.escape(str(file.resolve()))}"
            where = rf'(?:{begin}) "?(?:{names}|string|dictionary node "root)"?(?: failed)?:? '
            message = re.sub(where, "", plain_message(error))
            remedy = _remedy(message, file, values or {})
            said = f"scene {str(file)!r} cannot be loaded: {place}{message}{remedy}"
        old = old_version(text)
        if old and "Mitsuba's own upgrade" not in said:
            said += (
                f" The scene has the format of Mitsuba {old}, of which Mitsuba's own upgrade reads what only has "
                "another name in version 3; write the rest in its terms."
            )
        raise InputError(said) from error


def plain_message(error: BaseException) -> str:
    """Mitsuba's message without its source lines and line breaks."""
    text = re.sub(r"\[\w+\.(?:cpp|h|py):\d+\]\s*", "", str(error))
    text = re.sub(r"[\s\x00-\x1f\x7f]+", " ", text).strip().rstrip(".!")
    return text if len(text) <= MESSAGE_LENGTH_MAX else f"{text[:MESSAGE_LENGTH_MAX]} …"


def _remedy(message: str, file: Path, values: Mapping[str, str]) -> str:
    """The way out, where more is known than Mitsuba says, from the full stop or semicolon on."""
    if "No document element found" in message:
        if file.suffix == ".exr":
            return (
                "; it is no XML: `mitsuba-sensor expose` takes light that is rendered already."
            )
        return "; it is no XML, or empty: give the path of a Mitsuba 3 scene."
    unreadable = re.search(r'[Cc]ould not parse (.*) value "(.*)"', message)
    for name, value in values.items():
        if unreadable and value == unreadable[2]:
            return (
                f"; it is the value of the parameter {name} (-D {name}=…), which takes a value of the kind "
                f"{unreadable[1]}."
            )
    if "undefined parameter" in message:
        return "; give it a value (-D name=value)."
    unknown = re.search(r'Plugin "(\w+)" not found', message)
    if unknown is None:
        return "."
    remedy = remedy_for(unknown[1])
    if "failed to instantiate integrator" in message and remedy.startswith("."):
        way_out = "`--integrator path` (integrator='path'), or volpath if the scene has media"
        return f"; take {way_out}{remedy}"
    return remedy


def old_version(text: str) -> str:
    """The format of a scene file, where it is older than version 3; else an empty string."""
    found = re.search(r"""<scene\s[^>]*?version\s*=\s*["']([012]\.[\d.]+)["']""", text)
    return found[1] if found else ""
