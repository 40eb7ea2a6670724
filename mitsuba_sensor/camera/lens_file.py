"""Reads lens prescriptions: the package's own JSON, ISET3d's JSON, PBRT's .dat tables, and lens designs.

* Own JSON: ``{"name": …, "source": …, "surfaces": [{"radius_mm": …, "thickness_mm": …, "semi_diameter_mm": …}, …]}``,
  the fields of a prescription in a camera file.
* ``.json`` with ``radius``, ``thickness``, ``ior`` and ``semi_aperture`` for each surface, as ISET3d writes them [mm].
* ``.dat`` with four columns, as PBRT reads them: radius, thickness, index behind, diameter [mm]; a fifth one, the Abbe
  number, may follow. A single number before them (ISET's focal length) is ignored. The stop has radius 0 and air on
  both sides.
* ``.json`` with ``polynomials``, an ISET ray transfer: see ray_transfer_file.py.
* ``.zmx`` of Zemax OpticStudio and ``.seq`` of CODE V: see lens_designs.py.
"""

from importlib import resources
from pathlib import Path

import numpy as np

from ..core.small_files import json_value, require_small
from .lens_designs import from_seq, from_zmx
from .ray_transfer_file import from_ray_transfer

BUILT_IN = resources.files(__package__) / "lenses"
Row = tuple[float, float, float, float, float, float]
DESIGNS = {".zmx": from_zmx, ".seq": from_seq}
SUFFIXES = (".json", ".dat", *DESIGNS)
COLUMNS = "radius, thickness, index, diameter and perhaps the Abbe number"


def list_lenses() -> list[str]:
    """Names of the lenses that the package contains."""
    return sorted(
        file.name.removesuffix(".json")
        for file in BUILT_IN.iterdir()
        if file.name.endswith(".json")
    )


def read_lens(name: str, folder: str) -> dict[str, object]:
    """The prescription of a built-in lens, or of a file from ``folder``, that of the camera file; else ValueError."""
    if name in list_lenses():
        return dict(json_value((BUILT_IN / f"{name}.json").read_text("utf-8")))
    path = Path(folder) / name
    kind = path.suffix.lower()
    if kind not in SUFFIXES:
        raise ValueError(
            f"{name!r} is not a built-in lens ({', '.join(list_lenses())}) and not a {', '.join(SUFFIXES)} file, "
            "e.g. 'singlet'"
        )
    try:
        require_small(path, "the lens")
        if kind in DESIGNS:
            return DESIGNS[kind](path.read_bytes(), path.stem)
        text = path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(
            f"the lens {name!r} cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None
    if kind == ".dat":
        return from_dat(text, path.stem)
    return from_json(text, path.stem)


def from_json(text: str, name: str) -> dict[str, object]:
    """A prescription from JSON, the package's own, ISET3d's or an ISET ray transfer."""
    try:
        data = json_value(text)
    except ValueError as error:  # also of numbers with thousands of digits
        raise ValueError(f"the lens {name!r} is not valid JSON: {error}") from None
    if isinstance(data, dict) and "polynomials" in data:
        return from_ray_transfer(data, name)
    if isinstance(data, dict):
        surfaces = data.get("surfaces")
    else:
        surfaces = None
    if not isinstance(surfaces, list) or not all(
        isinstance(surface, dict) for surface in surfaces
    ):
        raise ValueError(
            f"the lens {name!r} has no list of surfaces; it must be {{'surfaces': [{{…}}, …]}}"
        )
    if any("semi_aperture" in surface for surface in surfaces):
        rows = [_iset_row(surface, name) for surface in surfaces]
        names = {
            "name": str(data.get("name") or name),
            "source": str(data.get("description") or ""),
        }
        return {**names, "surfaces": _surfaces(rows, name)}
    return {"name": name, **data}


def from_dat(text: str, name: str) -> dict[str, object]:
    """A prescription from PBRT's columns; its comments become the source."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    comments = [line.lstrip("# \t") for line in lines if line.startswith("#")]
    rows = [line.replace(",", " ").split() for line in lines if not line.startswith("#")]
    if rows and len(rows[0]) == 1:
        rows = rows[1:]
    for row in rows:
        if len(row) not in (4, 5):
            raise ValueError(
                f"the lens {name!r} has a line of {len(row)} numbers; each must be {COLUMNS}"
            )
    try:
        numbers = [
            [float(number) for number in (*row, "0")[:5]] for row in rows
        ]  # an Abbe number of 0 is none
    except ValueError:
        raise ValueError(
            f"the lens {name!r} has a line that is not numbers; each must be {COLUMNS}"
        ) from None
    flat = [
        (radius, gap, index, diameter / 2, abbe, 0.0)
        for radius, gap, index, diameter, abbe in numbers
    ]
    return {"name": name, "source": "; ".join(comments), "surfaces": _surfaces(flat, name)}


def _iset_row(surface: dict[str, object], name: str) -> Row:
    """radius, thickness, index, semi-diameter, Abbe number (0 is none), conic constant."""
    try:
        radius, semi, conic = (
            _number(surface.get(key, 0.0))
            for key in ("radius", "semi_aperture", "conic_constant")
        )
        return radius, _number(surface["thickness"]), _number(surface["ior"]), semi, 0.0, conic
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ValueError(
            f"the lens {name!r} has a surface that is not numbers for radius, thickness, ior and semi_aperture"
        ) from None


def _number(value: object) -> float:
    """A number, or the value of a list of equal numbers (ISET3d gives x and y of a round surface)."""
    (number,) = np.unique(np.asarray(value, dtype=float))
    return float(number)


def _surfaces(rows: list[Row], name: str) -> list[dict[str, object]]:
    """Fields of a prescription; the first plane in air is the stop, and an index of 0 is air."""
    behind = [row[2] if row[2] > 0 else 1.0 for row in rows]
    before = [1.0, *behind[:-1]]
    planes = [i for i, row in enumerate(rows) if row[0] == 0 and before[i] == behind[i] == 1.0]
    if not planes:
        raise ValueError(
            f"the lens {name!r} has no aperture stop; add a line with radius 0 and air on both sides"
        )
    return [
        {
            "radius_mm": radius or None,
            "thickness_mm": thickness,
            "semi_diameter_mm": semi,
            "index": behind[i],
            "abbe": abbe if abbe and behind[i] != 1 else None,
            "conic": conic,
            "stop": i == planes[0],
        }
        for i, (radius, thickness, _, semi, abbe, conic) in enumerate(rows)
    ]
