"""Converts elements in the text of scene files of Mitsuba 0.3 to 2 that the parser of Mitsuba 3 refuses.

Line numbers stay. Plugins and parameters are converted after parsing, see :mod:`.old_formats`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import TypeAlias

from ...core.units import BOLTZMANN_J_PER_K, LIGHT_SPEED_M_PER_S, PLANCK_J_S

Attributes: TypeAlias = dict[str, str]
CURRENT = (3, 0, 0)
QUOTED = r"""(?:"[^"]*"|'[^']*')"""  # the value of an attribute
RENAMED_TAGS = {"lookAt": "lookat", "luminaire": "emitter", "camera": "sensor"}
BLACKBODY_NM = range(
    300, 1201, 2
)  # the table of a <blackbody>, linear in between: within 0.08 % at 2000 K and above


def version_of(text: str) -> tuple[int, ...]:
    """The format of a scene file, from its text; that of Mitsuba 3 where it names none."""
    found = re.search(r"""<scene\s[^>]*?version\s*=\s*["']([\d.]+)["']""", text)
    return tuple(int(part) for part in found[1].split(".") if part) if found else CURRENT


def version_name(text: str) -> str:
    """The same as it is written: 0.5.0."""
    return ".".join(map(str, version_of(text)))


def upgraded_text(text: str, values: Mapping[str, str]) -> tuple[str, list[str]]:
    """The text with the elements of Mitsuba 3, and the names of those that were changed; what cannot be read stays.

    values : of the <default> names.
    """
    text = re.sub(
        r"<!--.*?-->", lambda found: "\n" * found[0].count("\n"), text, flags=re.DOTALL
    )
    known = {**dict(re.findall(r'<default\s+name="(\w+)"\s+value="([^"]*)"', text)), **values}
    changed: list[str] = []

    def element(found: re.Match[str]) -> str:
        end, tag, inside, close = found.groups()
        attributes = {
            name: quoted[1:-1]
            for name, quoted in re.findall(rf"([\w:]+)\s*=\s*({QUOTED})", inside)
        }
        new = (
            (RENAMED_TAGS.get(tag, tag), attributes)
            if end
            else _element(tag, attributes, known)
        )
        if new == (tag, attributes) or new is None:
            return found[0]
        if not end and tag not in changed:
            changed.append(tag)
        written = "".join(f' {name}="{value}"' for name, value in new[1].items())
        return f"<{end}{new[0]}{written}{close}>" + "\n" * found[0].count("\n")

    return re.sub(rf"<(/?)(\w+)((?:\s+[\w:]+\s*=\s*{QUOTED})*)\s*(/?)>", element, text), changed


def _element(
    tag: str, given: Attributes, known: Mapping[str, str]
) -> tuple[str, Attributes] | None:
    """An element in the terms of Mitsuba 3; None where its numbers cannot be read. known : values of parameters."""
    if tag in RENAMED_TAGS or not (tag == "blackbody" or tag in COLOURS):
        return _renamed(tag, given)
    filled = {
        name: re.sub(r"\$(\w+)", lambda m: known.get(m[1], m[0]), value)
        for name, value in given.items()
    }
    try:
        tag_now, attributes = _spectral(tag, filled)
    except (ValueError, ArithmeticError):
        return None
    return (tag, given) if (tag_now, attributes) == (tag, filled) else (tag_now, attributes)


def _spectral(tag: str, given: Attributes) -> tuple[str, Attributes]:
    """A colour or spectrum. Raises ValueError or ArithmeticError for numbers that cannot be read."""
    attributes = {name: value for name, value in given.items() if name != "intent"}
    if tag == "blackbody":
        return "spectrum", {
            "name": attributes.get("name", "radiance"),
            "value": _planck(attributes),
        }
    if "value" in attributes:
        tag, attributes["value"] = COLOURS[tag](tag, attributes["value"])
    return tag, attributes


def _renamed(tag: str, attributes: Attributes) -> tuple[str, Attributes]:
    """An element under its new name; the single coordinates of an early lookAt as vectors."""
    if tag == "lookAt" and "ox" in attributes:
        points = {"origin": "o", "target": "t", "up": "u"}
        attributes = {
            name: ", ".join(attributes.get(p + axis, "0") for axis in "xyz")
            for name, p in points.items()
        }
    return RENAMED_TAGS.get(tag, tag), attributes


def _rgb(tag: str, value: str) -> tuple[str, str]:
    """#rrggbb as three linear numbers, as Mitsuba 0.6 read it in an <rgb>."""
    return tag, " ".join(f"{part:.6g}" for part in _hexadecimal(value)) if value.startswith(
        "#"
    ) else value


def _srgb(_: str, value: str) -> tuple[str, str]:
    """sRGB as linear rgb, by the curve of IEC 61966-2-1."""
    encoded = (
        _hexadecimal(value)
        if value.startswith("#")
        else [float(x) for x in re.split(r"[,\s]+", value.strip())]
    )
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in encoded]
    return "rgb", " ".join(f"{part:.6g}" for part in linear)


def _spectrum(tag: str, value: str) -> tuple[str, str]:
    """Three numbers without wavelengths are red, green and blue: Mitsuba 0.6 counted in three bins unless built
    otherwise."""
    numbers = re.split(r"[,\s]+", value.strip())
    return ("rgb", value) if len(numbers) == 3 and ":" not in value else (tag, value)


COLOURS: Mapping[str, Callable[[str, str], tuple[str, str]]] = {
    "rgb": _rgb,
    "srgb": _srgb,
    "spectrum": _spectrum,
}


def _hexadecimal(value: str) -> list[float]:
    """#rrggbb or #rgb, from 0 to 1."""
    if len(value) not in (4, 7):
        raise ValueError(value)
    digits = value[1:] if len(value) == 7 else "".join(digit * 2 for digit in value[1:])
    return [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]


def _planck(attributes: Attributes) -> str:
    """The table of a <blackbody temperature="5000k" scale="1">, W m⁻² sr⁻¹ nm⁻¹."""
    kelvin = float(attributes.get("temperature", "5000").strip().rstrip("kK"))
    scale = float(attributes.get("scale", attributes.get("multiplier", "1")))

    def radiance(nm: int) -> float:
        length_m = nm * 1e-9
        x = PLANCK_J_S * LIGHT_SPEED_M_PER_S / (length_m * BOLTZMANN_J_PER_K * kelvin)
        return scale * 2e-9 * PLANCK_J_S * LIGHT_SPEED_M_PER_S**2 / length_m**5 / math.expm1(x)

    return ", ".join(f"{nm}:{radiance(nm):.6g}" for nm in BLACKBODY_NM)
