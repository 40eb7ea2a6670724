"""Reads lens designs of Zemax OpticStudio (.zmx) and CODE V (.seq) into the fields of a prescription.

Both list surfaces from the object to the image. Planes in air that are neither the stop nor an aperture are left out.
What cannot be traced here is refused: mirrors, tilted or decentred surfaces, surfaces that are neither conics nor even
aspheres, apertures that are not circles around the axis. Other commands that are not read are listed.

* ``.zmx``, in UTF-16 or UTF-8: UNIT, NAME, GCAT, and of each SURF: TYPE, CURV, CONI, DISZ, GLAS, DIAM, STOP, CLAP,
  FLAP, OBSC, and PARM of an even asphere.
* ``.seq`` of a lens that CODE V saved with radii (RDM): DIM, TITLE, and of each S: radius, thickness, glass; STO, K and
  A, B, C, … of an asphere, and CIR, the semi-diameter, or CIR OBS, a central obscuration.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from ..core.printable import printable
from .lens_glasses import GlassNumbers, glass_named

ZEMAX_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0, "M": 1000.0}
CODEV_MM = {"M": 1.0, "C": 10.0, "I": 25.4}
PLACEHOLDER = (1.5, 40.0)  # index and Abbe number that Zemax writes for glasses of a catalogue
AIR = GlassNumbers(1.0, None)
ASPHERES = "ABCDEFGHJ"  # of CODE V: A4, A6, … A20
ZEMAX_REFUSED = {
    **dict.fromkeys(("SQAP", "SQOB"), "rectangular apertures"),
    **dict.fromkeys(("ELAP", "ELOB"), "elliptical apertures"),
    **dict.fromkeys(("UDAD", "UDOB"), "apertures from files"),
    **{
        "SPID": "spiders",
        "OBDC": "decentred apertures",
        "SCBD": "tilted or decentred surfaces",
    },
}
"""Command that changes light or geometry → what it makes. OBDC and SCBD have no effect if all their numbers are 0."""
ZEMAX_HARMLESS = frozenset(
    (
        *("COMM", "HIDE", "MIRR", "SLAB", "POPS", "FIMP", "MEMA", "OEMA", "MAZH", "TCE"),
        *("PZUP", "PPAR", "VPAR", "VDSZ", "VCON", "VCUR"),
    )
)
"""Remarks, drawing, physical optics, pickups and variables, whose values are written out beside them."""
CODEV_REFUSED = {
    **dict.fromkeys(
        ("XDE", "YDE", "ZDE", "ADE", "BDE", "CDE", "DAR", "BEN"), "tilted surfaces"
    ),
    **dict.fromkeys(("GRT", "DIF", "SPS", "CYL", "XTO", "YTO"), "such surfaces"),
    **dict.fromkeys(("REX", "REY"), "rectangular apertures"),
    **dict.fromkeys(("ELX", "ELY"), "elliptical apertures"),
    **dict.fromkeys(("ADX", "ADY", "ARO"), "decentred apertures"),
    **dict.fromkeys(("RDY", "CUY", "THI", "GLA"), "numbers outside of the line of S"),
}
CODEV_HARMLESS = frozenset(("ASP", "CON", "SPH", "SLB", "CCY", "THC", "GLC", "CIR"))
MOST_LISTED = 10
LARGEST = 1e10  # longer radii and distances are infinite


@dataclass
class DesignSurface:
    """One surface as a design has it, in its own unit, numbered from 0, the object.

    aspheric : A4, A6, ….  clear : radius of a clear aperture instead of the semi-diameter, which may be that of the
    drawing.  refused : what of it cannot be traced.  left_out : commands that are not read.
    """

    number: int
    radius: float = math.inf
    thickness: float = 0.0
    semi_diameter: float = 0.0
    glass: GlassNumbers = AIR
    conic: float = 0.0
    aspheric: dict[int, float] = field(default_factory=dict)
    stop: bool = False
    clear: float = 0.0
    obscuration: float = 0.0
    refused: str = ""
    left_out: list[str] = field(default_factory=list)


def from_zmx(data: bytes, name: str) -> dict[str, object]:
    """A prescription from a design of Zemax OpticStudio.  Raises ValueError."""
    unit_mm, title, surfaces, makers = 1.0, name, list[DesignSurface](), list[str]()
    for line in _decoded(data).splitlines():
        key, *values = line.split() or [""]
        with _naming(name, line):
            if key == "UNIT":
                unit_mm = ZEMAX_MM[values[0].upper()]
            elif key == "NAME" and values:
                title = " ".join(values)
            elif key == "GCAT":
                makers = values
            elif key == "MODE" and values[0] != "SEQ":
                raise ValueError(f"designs in the mode {values[0]} are not traced, only SEQ")
            elif key == "SURF":
                surfaces.append(DesignSurface(int(values[0])))
            elif surfaces and key:
                _read_zemax(surfaces[-1], key, values, makers)
    return _prescription(surfaces, unit_mm, (name, title, "Zemax"))


def _decoded(data: bytes) -> str:
    for encoding in (
        "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig",
        "latin-1",
    ):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return ""


def _read_zemax(surface: DesignSurface, key: str, values: list[str], makers: list[str]) -> None:
    """One line below a SURF.  makers : catalogues of glass.  Raises ValueError."""
    if key == "STOP":
        surface.stop = True
    elif key == "TYPE":
        if values[0] not in ("STANDARD", "EVENASPH"):
            surface.refused = f"surfaces of type {values[0]} are not traced"
    elif key == "CURV":
        surface.radius = _inverse(float(values[0]))
    elif key == "CONI":
        surface.conic = float(values[0])
    elif key == "DISZ":
        surface.thickness = float(values[0])
    elif key == "DIAM":
        surface.semi_diameter = float(values[0])
    elif key == "PARM":
        if float(values[1]):
            surface.aspheric[2 * int(values[0])] = float(values[1])
    elif key == "GLAS":
        _read_zemax_glass(surface, values, makers)
    elif key in ("CLAP", "FLAP", "OBSC"):
        _read_zemax_aperture(surface, key, float(values[0]), float(values[1]))
    elif key in ZEMAX_REFUSED:
        if key not in ("OBDC", "SCBD") or any(value.strip("+-.0eE") for value in values):
            surface.refused = f"{ZEMAX_REFUSED[key]} ({key}) are not traced"
    elif key not in ZEMAX_HARMLESS:
        surface.left_out.append(key)


def _read_zemax_aperture(surface: DesignSurface, key: str, low: float, high: float) -> None:
    """CLAP and FLAP let rays pass between two radii, OBSC stops them there."""
    if high <= low or (key == "OBSC" and low):
        surface.refused = f"apertures from {low:g} to {high:g} ({key}) are not traced"
    elif key == "OBSC":
        surface.obscuration = high
    else:
        surface.clear, surface.obscuration = high, low


def _read_zemax_glass(surface: DesignSurface, values: list[str], makers: list[str]) -> None:
    """A line ``GLAS name kind pickup index abbe …``: numbers without a name are the glass, others are left over."""
    name = values[0].upper()
    if name == "MIRROR":
        surface.refused = "mirrors are not traced"
        return
    numbers, beside = tuple(float(value) for value in values[3:5]), None
    if len(numbers) == 2 and numbers[0] > 1:
        beside = GlassNumbers(numbers[0], numbers[1] or None)
    if name == "___BLANK" or values[1:2] == ["1"]:
        if beside is None:
            raise ValueError("a glass without name needs an index above 1")
        surface.glass = beside
        return
    if numbers == PLACEHOLDER:
        beside = None
    surface.glass = glass_named(values[0], makers, beside)
    if surface.glass is beside:
        surface.left_out.append(f"the unknown name {values[0]} beside its numbers")


def from_seq(data: bytes, name: str) -> dict[str, object]:
    """A prescription from a sequence file of CODE V.  Raises ValueError."""
    unit_mm, title, surfaces, radii = 1.0, name, list[DesignSurface](), False
    for command in _codev_commands(_decoded(data)):
        key, *values = command.replace("'", " ").replace('"', " ").split() or [""]
        key = key.upper()
        with _naming(name, command):
            if key == "RDM":
                radii = not values or values[0].upper() not in ("N", "NO")
            elif key == "DIM":
                unit_mm = CODEV_MM[values[0].upper()]
            elif key == "TITLE" or key == "TIT":
                title = " ".join(values) or name
            elif re.fullmatch(r"S|SO|SI|S\d+", key):
                surfaces.append(_codev_surface(len(surfaces), values))
            elif surfaces:
                _read_codev(surfaces[-1], key, values)
    if not radii:
        raise ValueError(
            f"the lens {name!r} does not say RDM, so that its numbers may be curvatures; save it with radii"
        )
    return _prescription(surfaces, unit_mm, (name, title, "CODE V"))


def _codev_commands(text: str) -> Iterator[str]:
    """Commands one by one: lines end with & where they go on, ! begins a comment, ; divides."""
    joined = re.sub(r"&[ \t]*\r?\n", " ", text)
    for line in joined.splitlines():
        yield from (part.strip() for part in line.partition("!")[0].split(";"))


def _codev_surface(number: int, values: list[str]) -> DesignSurface:
    """Of a line ``S radius thickness glass``; a radius of 0 is a plane."""
    radius, thickness = (float(value) for value in values[:2])
    glass = AIR
    if len(values) > 2 and values[2].upper() != "AIR":
        if values[2].upper() == "REFL":
            raise ValueError("mirrors are not traced")
        glass = glass_named(values[2])
    return DesignSurface(number, radius or math.inf, thickness, glass=glass)


def _read_codev(surface: DesignSurface, key: str, values: list[str]) -> None:
    """One command below an S.  Raises ValueError for what cannot be traced."""
    if key == "STO":
        surface.stop = True
    elif key in CODEV_REFUSED:
        surface.refused = f"{CODEV_REFUSED[key]} ({key}) are not traced"
    elif key == "CIR" and len(values) == 1:
        surface.clear = float(values[0])
    elif key == "CIR" and values[0].upper() == "OBS":
        surface.obscuration = float(values[1])
    elif key == "K" and values:
        surface.conic = float(values[0])
    elif len(key) == 1 and key in ASPHERES and values:
        surface.aspheric[4 + 2 * ASPHERES.index(key)] = float(values[0])
    elif key and key not in CODEV_HARMLESS:
        surface.left_out.append(key)


@contextmanager
def _naming(name: str, line: str) -> Iterator[None]:
    """The lens and the line, in the ValueError of what is wrong with it."""
    where = f"the lens {name!r}, line {line.strip()[:60]!r}"
    try:
        yield
    except (ValueError, IndexError, KeyError) as error:
        is_ours = isinstance(error, ValueError) and "could not convert" not in str(error)
        if is_ours and "invalid literal" not in str(error):
            raise ValueError(f"{where}: {error}") from None
        raise ValueError(f"{where} is not what the format has there") from None


def _inverse(curvature: float) -> float:
    return 1 / curvature if curvature else math.inf


def _prescription(
    surfaces: list[DesignSurface], unit_mm: float, names: tuple[str, str, str]
) -> dict[str, object]:
    """Fields of a prescription.  names : of the file, the lens and the program.  Raises ValueError."""
    file, title, program = names
    if len(surfaces) < 4:
        raise ValueError(
            f"the lens {file!r} has {len(surfaces)} surfaces; object, two of a lens and image are the least"
        )
    kept, left_out = list[DesignSurface](), dict[str, list[str]]()
    before = surfaces[0].glass
    for surface in surfaces[1:-1]:
        if surface.refused:
            raise ValueError(f"the lens {file!r}, surface {surface.number}: {surface.refused}")
        for what in surface.left_out:
            left_out.setdefault(what, []).append(str(surface.number))
        limits = surface.stop or surface.clear or surface.obscuration
        is_dummy = before.index == surface.glass.index == 1 and not limits
        if is_dummy and kept:
            kept[-1].thickness += surface.thickness
        elif not is_dummy:
            kept.append(surface)
        before = surface.glass
    kept[-1:] = [_without_thickness(surface) for surface in kept[-1:]]
    return {
        "name": title,
        "source": f"{program} design {file}",
        "surfaces": [_fields(surface, unit_mm, file) for surface in kept],
        "left_out": _shown(left_out),
    }


def _shown(left_out: dict[str, list[str]]) -> str:
    """Each command with its surfaces, the first of them where there are many."""
    texts = [f"{what} (surface {', '.join(where)})" for what, where in left_out.items()]
    if len(texts) > MOST_LISTED:
        texts[MOST_LISTED:] = [f"{len(texts) - MOST_LISTED} more commands"]
    return printable("; ".join(texts))


def _without_thickness(surface: DesignSurface) -> DesignSurface:
    """The last one, whose distance to the image follows from the focus."""
    surface.thickness = 0.0
    return surface


def _fields(surface: DesignSurface, unit_mm: float, file: str) -> dict[str, object]:
    """In mm.  Raises ValueError."""
    where = f"the lens {file!r}, surface {surface.number}"
    if not 0 <= surface.thickness < LARGEST:
        raise ValueError(
            f"{where}: its thickness is {surface.thickness:g}; it must be 0 or more"
        )
    semi_diameter, glass = surface.clear or surface.semi_diameter, surface.glass
    if not 0 < semi_diameter < LARGEST:
        raise ValueError(
            f"{where} has no semi-diameter (DIAM in a .zmx file, CIR in a .seq file); save the design with apertures"
        )
    if 2 in surface.aspheric:
        raise ValueError(f"{where} has a term r² of an asphere; put it into the radius")
    radius_mm = None
    if abs(surface.radius) < LARGEST:
        radius_mm = surface.radius * unit_mm
    powers = range(4, max(surface.aspheric, default=2) + 1, 2)
    return {
        "radius_mm": radius_mm,
        "thickness_mm": surface.thickness * unit_mm,
        "semi_diameter_mm": semi_diameter * unit_mm,
        "obscuration_mm": surface.obscuration * unit_mm,
        "index": 1.0 if glass.sellmeier else glass.index,
        "abbe": None if glass.sellmeier else glass.abbe,
        "sellmeier": glass.sellmeier,
        "conic": surface.conic,
        "aspheric": [surface.aspheric.get(p, 0.0) * unit_mm ** (1 - p) for p in powers],
        "stop": surface.stop,
    }
