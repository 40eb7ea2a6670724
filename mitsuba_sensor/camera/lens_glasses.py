"""Optical glasses by name or code, as lens-design programs write them: index at 587.56 nm and Abbe number.

Numbers are those of the data sheets of Schott, of Malitson 1965 (fused silica) and 1963 (calcium fluoride), and of the
plastics that Zemax and CODE V know by these names.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from ..core import nearest

CODE = re.compile(r"(\d{3,6})[.:]?(\d{3,6})")  # 517642, 517.642, 516800.641673
MAKERS = ("SCHOTT", "OHARA", "HOYA", "SUMITA", "HIKARI", "CDGM")
TABLE = """
BK7 1.51680 64.17   NBK7 1.51680 64.17   NBK10 1.49782 66.95   K5 1.52249 59.48     NK5 1.52249 59.48
BAK1 1.57250 57.55  NBAK1 1.57250 57.55  BAK4 1.56883 56.13    NBAK4 1.56883 55.98  NBAF10 1.67003 47.11
F2 1.62004 36.37    NF2 1.62005 36.43    F5 1.60342 38.03      LF5 1.58144 40.85    LLF1 1.54814 45.75
SK2 1.60738 56.65   NSK2 1.60738 56.65   NSK4 1.61272 58.63    NSK5 1.58913 61.27   NSK14 1.60311 60.60
SK16 1.62041 60.33  NSK16 1.62041 60.32  SSK8 1.61772 49.77    NSSK8 1.61773 49.83  NSSK2 1.62229 53.27
SF1 1.71736 29.51   NSF1 1.71736 29.62   SF2 1.64769 33.85     NSF2 1.64769 33.82   SF4 1.75520 27.58
NSF4 1.75513 27.38  SF5 1.67270 32.21    NSF5 1.67271 32.25    SF6 1.80518 25.43    NSF6 1.80518 25.36
NSF8 1.68894 31.31  SF10 1.72825 28.41   NSF10 1.72828 28.53   SF11 1.78472 25.76   NSF11 1.78472 25.68
NSF14 1.76182 26.53 NSF15 1.69892 30.20  SF57 1.84666 23.83    NSF57 1.84666 23.78  NSF66 1.92286 20.88
LAK9 1.69100 54.71  NLAK8 1.71300 53.83  NLAK9 1.69100 54.71   NLAK10 1.72003 50.62 NLAK14 1.69680 55.41
NLAK22 1.65113 55.89 NLAF2 1.74397 44.85 NLAF7 1.74950 34.82   NLASF9 1.85025 32.17 NLASF44 1.80420 46.50
NFK5 1.48749 70.41  NFK51A 1.48656 84.47 NPK51 1.52855 76.98   NKZFS4 1.61336 44.49 NLASF31A 1.88300 40.76
NSK10 1.62278 56.98 NSK11 1.56384 60.80  NBAF51 1.65224 44.96  NBAF52 1.60863 46.60 NLAK7 1.65160 58.52
NLAK12 1.67790 55.20 NLAK21 1.64049 60.10 NLAK34 1.72916 54.50 NLAF21 1.78800 47.49 NLAF33 1.78582 44.05
NLAF34 1.77250 49.62 NLAF35 1.74330 49.40 NLASF40 1.83404 37.30 NLASF41 1.83501 43.13 NLASF43 1.80610 40.61
NLASF45 1.80107 34.97 NSSK5 1.65844 50.88 NKF9 1.52346 51.54   NPSK3 1.55232 63.46  NPSK53A 1.61800 63.39
NZK7 1.50847 61.19  NKZFS2 1.55836 54.01 NKZFS5 1.65412 39.70  NKZFS8 1.72047 34.70 NKZFS11 1.63775 42.41
NBASF2 1.66446 36.00 NBASF64 1.70400 39.38 NBALF4 1.57956 53.87 NBALF5 1.54739 53.63 NBAF4 1.60568 43.72
NBAK2 1.53996 59.71
SILICA 1.45846 67.82 FSILICA 1.45846 67.82 CAF2 1.43385 95.23  PMMA 1.49176 57.44   ACRYLIC 1.49176 57.44
POLYCARB 1.58547 29.91 POLYSTYR 1.59048 30.87
"""


@dataclass(frozen=True)
class GlassNumbers:
    """Refractive index at 587.56 nm; Abbe number, or None where it is not known."""

    index: float
    abbe: float | None


def _glasses() -> dict[str, GlassNumbers]:
    cells = iter(TABLE.split())
    return {
        name: GlassNumbers(float(index), float(abbe))
        for name, index, abbe in zip(cells, cells, cells, strict=True)
    }


def glass_named(name: str) -> GlassNumbers:
    """A glass by its name, with or without hyphens and its maker, or by its code.  Raises ValueError for any other."""
    if code := CODE.fullmatch(name):
        digits, abbe = code.groups()
        return GlassNumbers(1 + float(f"0.{digits}"), float(f"{abbe[:2]}.{abbe[2:]}"))
    plain = name.upper()
    for maker in MAKERS:
        plain = plain.removesuffix(f"_{maker}")
    plain, known = re.sub(r"[-_ ]", "", plain), _glasses()
    if plain not in known:
        raise ValueError(
            f"the glass {name!r} is not known here; write its code, e.g. 517642 for an index of 1.517 and an Abbe "
            f"number of 64.2{nearest(plain, known)}"
        )
    return known[plain]
