"""Read lens prescriptions: this package's JSON, ISET3d's JSON, PBRT's .dat tables, and lens designs.

* This package's JSON: ``{"name": …, "source": …, "surfaces": [{"radius_mm": …, "thickness_mm": …,
  "semi_diameter_mm": …}, …]}``, with the fields of a prescription in a camera file.
* ISET3d's ``.json`` with ``radius``, ``thickness``, ``ior`` and ``semi_aperture`` for each surface [mm].
* PBRT's ``.dat`` with four columns: radius, thickness, index after the surface, diameter [mm], and optionally the Abbe
  number. A single number in the first line (ISET's focal length) is ignored. The stop has radius 0 and air on both
  sides.
* ``.json`` with ``polynomials``, a ray-transfer function of ISET (``…-raytransfer.json``; Goossens et al. 2022, arXiv
  2202.08880; github ISET/isetrtf, doc/json): see optics/ray_transfer.py.
* ``.zmx`` of Zemax OpticStudio and ``.seq`` of CODE V: see lens_designs.py.
"""

import math
from importlib import resources
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..core import nearest
from ..core.small_files import json_value, require_small
from .lens_designs import DesignSurface, GlassNumbers, from_seq, from_zmx, surface_fields

Json: TypeAlias = dict[str, Any]
BUILT_IN = resources.files(__package__) / "lenses"
DESIGNS = {".zmx": from_zmx, ".seq": from_seq}
SUFFIXES = (".json", ".dat", *DESIGNS)
COLUMNS = "radius, thickness, index, diameter and optionally the Abbe number"
ELLIPSES = {
    "pass_heights_mm": "positions",
    "pass_centers_mm": "centersY",
    "pass_radii_x_mm": "radiiX",
    "pass_radii_y_mm": "radiiY",
}
CIRCLES = {"pass_circle_radii_mm": "radii", "pass_circle_sensitivities": "sensitivities"}
PASS_FUNCTIONS = {"minimalellipse": ELLIPSES, "circles": CIRCLES}
"""ISET's kind of pass function → fields of a camera file and ISET's names; centersX is 0 for a round lens."""


def list_lenses() -> list[str]:
    """Return the names of the included lenses."""
    return sorted(
        file.name.removesuffix(".json")
        for file in BUILT_IN.iterdir()
        if file.name.endswith(".json")
    )


def read_lens(name: str, folder: str) -> Json:
    """Return the prescription of an included lens, or of a file in the camera file's folder. Raises ValueError."""
    if name in list_lenses():
        return dict(json_value((BUILT_IN / f"{name}.json").read_text("utf-8")))
    path = Path(folder) / name
    kind = path.suffix.lower()
    if kind not in SUFFIXES:
        raise ValueError(
            f"{name!r} is not a lens; give an included lens ({', '.join(list_lenses())}) or a "
            f"{', '.join(SUFFIXES)} file.{nearest(name, list_lenses())}"
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
        return _from_dat(text, path.stem)
    return _from_json(text, path.stem)


def _from_json(text: str, name: str) -> Json:
    """Return the prescription in this package's JSON, ISET3d's JSON or an ISET ray transfer."""
    try:
        data = json_value(text)
    except ValueError as error:  # also of numbers with thousands of digits
        raise ValueError(f"the lens {name!r} is not valid JSON: {error}") from None
    if isinstance(data, dict) and "polynomials" in data:
        return _from_ray_transfer(data, name)
    surfaces = data.get("surfaces") if isinstance(data, dict) else None
    if not isinstance(surfaces, list) or not all(isinstance(x, dict) for x in surfaces):
        raise ValueError(
            f"the lens {name!r} has no list of surfaces; write {{'surfaces': [{{…}}, …]}}"
        )
    if not any("semi_aperture" in surface for surface in surfaces):
        return {"name": name, **data}
    rows = list[DesignSurface]()
    try:
        for surface in surfaces:
            names = ("radius", "semi_aperture", "conic_constant")
            radius, semi, conic = (_number(surface.get(key, 0.0)) for key in names)
            index = GlassNumbers(_number(surface["ior"]) or 1.0, None)
            gap = _number(surface["thickness"])
            rows.append(DesignSurface(len(rows), radius, gap, semi, index, conic))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ValueError(
            f"the lens {name!r} has a surface without numbers for radius, thickness, ior and semi_aperture; add them"
        ) from None
    return {
        "name": str(data.get("name") or name),
        "source": str(data.get("description") or ""),
        "surfaces": _fields(rows, name),
    }


def _from_dat(text: str, name: str) -> Json:
    """Return the prescription in PBRT's columns; comments become its source."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    comments = [line.lstrip("# \t") for line in lines if line.startswith("#")]
    rows = [line.replace(",", " ").split() for line in lines if not line.startswith("#")]
    if rows and len(rows[0]) == 1:
        rows = rows[1:]
    surfaces = list[DesignSurface]()
    for row in rows:
        try:
            radius, gap, index, diameter, abbe = map(float, [*row, "0"][: max(len(row), 5)])
        except ValueError:
            raise ValueError(
                f"the lens {name!r} has the line {' '.join(row)[:60]!r}; it must be {COLUMNS}"
            ) from None
        glass = GlassNumbers(index or 1.0, abbe if abbe and index > 1 else None)
        surfaces.append(DesignSurface(len(surfaces), radius, gap, diameter / 2, glass))
    return {"name": name, "source": "; ".join(comments), "surfaces": _fields(surfaces, name)}


def _number(value: object) -> float:
    """Return a number, or the value of equal numbers (ISET3d gives x and y of a round surface)."""
    (number,) = np.unique(np.asarray(value, dtype=float))
    return float(number)


def _fields(surfaces: list[DesignSurface], name: str) -> list[Json]:
    """Return the surfaces of a prescription; the first plane in air is the stop."""
    before = 1.0
    for surface in surfaces:
        if surface.radius == 0 and before == surface.glass.index == 1:
            surface.stop = True
            break
        before = surface.glass.index
    else:
        raise ValueError(
            f"the lens {name!r} has no aperture stop; add a line with radius 0 and air on both sides"
        )
    for surface in surfaces:
        surface.radius = surface.radius or math.inf
    return [surface_fields(surface, 1.0, name) for surface in surfaces]


def _from_ray_transfer(data: Json, name: str) -> Json:
    """Return a prescription with the ray transfer of ISET's JSON. Raises ValueError for another format."""
    where = f"the ray transfer {name!r}"
    wavelengths = _list(data["polynomials"])
    if len(wavelengths) != 1:
        raise ValueError(f"{where} has {len(wavelengths)} wavelengths; keep one")
    try:
        return {
            "name": str(data.get("name") or name),
            "source": str(data.get("description") or f"ISET ray transfer {name}"),
            "ray_transfer": _ray_transfer_fields(data, wavelengths[0]),
        }
    except (KeyError, TypeError, AttributeError):
        raise ValueError(
            f"{where} does not follow ISET's format; it needs thickness, planeoffsetinput, planeoffsetoutput, and per "
            "wavelength raypass and poly with outputname, coeff, termr, termdx, termdy"
        ) from None


def _ray_transfer_fields(data: Json, wavelength: Json) -> Json:
    """Return the fields of the camera file. Raises KeyError, TypeError or AttributeError for another format."""
    passes = wavelength.get("raypass") or wavelength["passnopass"]
    method = passes["method"]
    if method not in PASS_FUNCTIONS:
        names = " or ".join(map(repr, PASS_FUNCTIONS))
        raise ValueError(f"the pass function is {method!r}; it must be {names}")
    return {
        "wavelength_nm": wavelength["wavelength_nm"],
        "thickness_mm": data["thickness"],
        "input_plane_mm": data["planeoffsetinput"],
        "output_plane_mm": data["planeoffsetoutput"],
        "uses_outdz": data.get("useDZpolynomial", False),
        "pass_plane_mm": passes["intersectPlaneDistance"],
        **{ours: _list(passes[theirs]) for ours, theirs in PASS_FUNCTIONS[method].items()},
        "polynomials": [_polynomial(polynomial) for polynomial in wavelength["poly"]],
    }


def _polynomial(polynomial: Json) -> Json:
    """Return the terms with coefficients other than 0. Raises ValueError for lists of different lengths."""
    columns = [_list(polynomial[n]) for n in ("coeff", "termr", "termdx", "termdy")]
    if len({len(column) for column in columns}) != 1:
        raise ValueError(
            f"coeff, termr, termdx and termdy of {polynomial['outputname']!r} must have equal lengths"
        )
    terms = [term for term in zip(*columns, strict=True) if term[0] != 0]
    coefficients, *powers = zip(*(terms or [(0.0, 0, 0, 0)]), strict=True)
    names = ("powers_r", "powers_dx", "powers_dy")
    return {
        "output": str(polynomial["outputname"]).removeprefix("out"),
        "coefficients": list(coefficients),
        **{name: list(column) for name, column in zip(names, powers, strict=True)},
    }


def _list(value: Any) -> list[Any]:
    """Return a list, also for the single element that MATLAB writes instead."""
    return value if isinstance(value, list) else [value]
