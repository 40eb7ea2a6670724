"""Tables and formulas of colour are those of colour-science."""

from __future__ import annotations

import colour
import mitsuba as mi
import numpy as np
import pytest
from colour.adaptation import matrix_chromatic_adaptation_VonKries
from colour.characterisation import read_training_data_rawtoaces_v1

from mitsuba_sensor.optics import spectra
from mitsuba_sensor.render.light.foreign_light import D65_OF_WHITE

NM = np.arange(250.0, 1150.0, 0.25)
OBSERVER = "CIE 1931 2 Degree Standard Observer"
WHITES = colour.CCS_ILLUMINANTS[OBSERVER]


@pytest.mark.parametrize("name", ["A", "D65"])
def test_illuminants_are_those_of_colour_science(name: str) -> None:
    """Its tables end at 780 nm."""
    table, nm = colour.SDS_ILLUMINANTS[name], NM[NM <= 780]
    expected = np.interp(nm, table.wavelengths, table.values, left=0.0)
    np.testing.assert_array_equal(spectra.standard_illuminant(name, nm), expected)


def test_daylight_goes_on_to_830_nm_as_in_mitsuba() -> None:
    """CIE 15:2004, table T.1; within float32."""
    mi.set_variant("scalar_spectral")
    d65, si = mi.load_dict({"type": "d65"}), mi.SurfaceInteraction3f()
    for nm in (400.0, 779.0, 795.0, 812.5, 829.9):
        si.wavelengths = [nm] * 4
        assert d65.eval(si)[0] * D65_OF_WHITE == pytest.approx(float(spectra.d65(nm)), rel=1e-6)
    assert spectra.d65(831.0) == 0


def test_the_observer_is_that_of_colour_science() -> None:
    table = colour.MSDS_CMFS[OBSERVER]
    for own, values in zip(spectra.observer(NM), table.values.T, strict=True):
        np.testing.assert_array_equal(
            own, np.interp(NM, table.wavelengths, values, left=0.0, right=0.0)
        )


def test_the_training_set_is_that_of_colour_science() -> None:
    """Its values of -1e-16 are 0 here."""
    table = read_training_data_rawtoaces_v1()
    np.testing.assert_allclose(
        spectra.surfaces(table.wavelengths), table.values.T, rtol=0, atol=1e-15
    )


def test_whites_and_matrices_are_those_of_colour_science() -> None:
    d50, d65 = (colour.xy_to_XYZ(WHITES[name]) for name in ("D50", "D65"))
    np.testing.assert_allclose(spectra.D50_XYZ, d50, rtol=1e-15)
    np.testing.assert_allclose(spectra.D65_XYZ, d65, rtol=1e-15)
    np.testing.assert_array_equal(
        spectra.XYZ_TO_SRGB, colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB
    )
    bradford = matrix_chromatic_adaptation_VonKries(d65, d50, transform="Bradford")
    np.testing.assert_allclose(spectra.bradford(d65, d50), bradford, atol=1e-14)


def test_colours_are_adapted_and_placed_in_cielab_as_by_colour_science() -> None:
    """Dark colours, where CIELAB is a straight line, included."""
    xyz = np.random.default_rng(1).random((1000, 3)) ** 4
    white = colour.xy_to_XYZ(WHITES["A"])
    expected = colour.chromatic_adaptation(
        xyz, white, colour.xy_to_XYZ(WHITES["D65"]), transform="CAT02"
    )
    np.testing.assert_allclose(spectra.adapted_to_daylight(xyz, white), expected, atol=1e-14)
    np.testing.assert_allclose(
        spectra.lab(xyz), colour.XYZ_to_Lab(xyz, WHITES["D65"]), atol=1e-12
    )
