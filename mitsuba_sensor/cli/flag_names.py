"""Names of arguments as the caller typed them: errors and notes name Python arguments, and the terminal their flags.

Messages are written for Python: ``spp=256``, ``camera.replace(**{"adc.bits": 14})``, ``spp is 0``. Before the command
line prints a message, :func:`with_flags` turns them into ``--spp 256``, ``--set adc.bits=14`` and ``--spp is 0``.
"""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..core.options import Declared

FLAGS: dict[str, str] = {"time_s": "--exposure-s", "exposure": "--exposure-s", "out": "-o"}
"""Python argument → flag; every command adds its options."""
PHRASES = {
    "None unsets a field": "--set FIELD=none unsets a field",
    "ms.list_cameras()": "`cameras list`",
    "ms.check_camera": "`cameras check`",
    "camera.at_gain": "--gain",
    "camera.at_readout": "--readout",
    "camera.replace": "--set",
}
"""Python name without argument → command or flag."""
VALUE = r"""(?:\{[^{}]*\}|'[^']*'|"[^"]*"|[\w.+*:/-]*[\w*])"""
FIELD = re.compile(rf"""["'](?P<field>[a-z_.0-9]+)["']: (?P<value>{VALUE})""")
REPLACE = re.compile(r"(?:camera|Camera)\.replace\(\*\*\{([^{}]*)\}\)")
SETTING = re.compile(rf"camera\.at_(gain|readout)\(({VALUE})\)")
EXPOSURE = re.compile(
    rf"(?:exposure=)?Exposure\(time_s=({VALUE})(?:, temperature_k=({VALUE}))?\)"
)
ARGUMENT = re.compile(
    rf"(?<!-D )(?<!--set )(?<![\w./'\"*-])(?P<name>[a-z_]+)=(?P<value>{VALUE})?"
)
SUBJECT = re.compile(
    rf"^(?P<first>(?:--[\w-]+ is {VALUE} and )?)(?P<name>[a-z_]+) (?P<verb>is|has)"
    r"(?: '?(?P<number>-?\d+)(?:'|\.0(?!\d)))?(?= |;|,|$)"
)


def flag_of(option: Declared) -> str:
    """Return the flag of an option, or its flags separated by blanks."""
    flag = option.option.flag or f"--{option.name.replace('_', '-')}"
    FLAGS[option.name] = flag
    return flag


def with_flags(message: str) -> str:
    """Return a message for Python callers with flags instead of Python arguments."""
    message = REPLACE.sub(lambda found: _settings(found[1]), message)
    message = SETTING.sub(lambda found: f"--{found[1]} {_quoted(_plain(found[2]))}", message)
    message = EXPOSURE.sub(_exposure, message)
    message = ARGUMENT.sub(_argument, message)
    for _ in range(2):  # "spp is 16 and noise_ratio is 0.1"
        message = SUBJECT.sub(_subject, message)
    for phrase, typed in PHRASES.items():
        message = message.replace(phrase, typed)
    return message


def _subject(found: re.Match[str]) -> str:
    """Return the beginning of a sentence with the flag of its argument, and a number as it was typed."""
    if found["name"] not in FLAGS:
        return found[0]
    number = f" {found['number']}" if found["number"] else ""
    return f"{found['first']}{_on(FLAGS[found['name']])} {found['verb']}{number}"


def _on(flag: str) -> str:
    """Return the first name of a flag that switches on: ``--gain`` of ``--gain --iso``."""
    return flag.partition("/")[0].split()[0]


def _settings(fields: str) -> str:
    """Return ``--set adc.bits=14`` for each of the fields of ``camera.replace``."""
    values = {found["field"]: _plain(found["value"]) for found in FIELD.finditer(fields)}
    return " ".join(
        f"--set {field}={'none' if value is None else _quoted(value)}"
        for field, value in values.items()
    )


def _exposure(found: re.Match[str]) -> str:
    temperature = f" --temperature-k {found[2]}" if found[2] else ""
    return f"--exposure-s {found[1]}{temperature}"


def _argument(found: re.Match[str]) -> str:
    """Return the flag of an argument with its value."""
    flag = FLAGS.get(found["name"])
    if flag is None:
        return found[0]
    on, off = _on(flag), flag.partition("/")[2]
    if found["value"] is None:
        return on
    value = _plain(found["value"])
    if isinstance(value, bool):
        return on if value else off or f"no {on}"
    pairs = [f"{k}={v}" for k, v in value.items()] if isinstance(value, Mapping) else [value]
    return " ".join(f"{on} {_quoted(pair)}" for pair in pairs)


def _plain(text: str) -> Any:
    """Return the value of a Python literal; another text unchanged."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def _quoted(value: object) -> str:
    return shlex.quote(f"{value:g}" if isinstance(value, float) else str(value))
