"""The 24 patches of the ColorChecker: reflectances, colours that an observer sees, and where they are in the scene."""

from __future__ import annotations

import colour
import numpy as np
from numpy.typing import NDArray

from mitsuba_sensor.core.signals import Illuminant

CHECKER = colour.SDS_COLOURCHECKERS["ISO 17321-1"]
REFLECTANCES = {name: (patch.wavelengths, patch.values) for name, patch in CHECKER.items()}
SHAPE = colour.SpectralShape(380, 780, 5)
PATCHES = np.stack([one.copy().align(SHAPE).values for one in CHECKER.values()])
OBSERVER = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(SHAPE).values
WHITE = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["D65"]
MIDDLES = np.arange(360.0, 1101.0, 5.0)


def lit_by(name: str) -> Illuminant:
    """A CIE illuminant, nothing outside of its table."""
    table = colour.SDS_ILLUMINANTS[name]
    return Illuminant(
        MIDDLES, np.interp(MIDDLES, table.wavelengths, table.values, left=0.0, right=0.0)
    )


def seen(name: str) -> NDArray[np.float64]:
    """XYZ of the 24 patches under an illuminant, adapted to D65 by colour-science; the Y of white is 1."""
    power = colour.SDS_ILLUMINANTS[name].copy().align(SHAPE).values
    white = power @ OBSERVER / (power @ OBSERVER)[1]
    found = (PATCHES * power) @ OBSERVER / (power @ OBSERVER)[1]
    return np.asarray(
        colour.chromatic_adaptation(found, white, colour.xy_to_XYZ(WHITE), transform="CAT02")
    )


def distances(srgb: NDArray[np.float64], xyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """ΔE2000 of linear sRGB colours, which are made as bright as these on average."""
    found = srgb @ colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ.T
    found = np.maximum(found * (xyz[:, 1].sum() / found[:, 1].sum()), 0.0)
    pair = (colour.XYZ_to_Lab(one, WHITE) for one in (found, xyz))
    return np.asarray(colour.delta_E(*pair, method="CIE 2000"))


def patch_means(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """(24, 3) means over the middles of the patches of scenes/color_checker.xml: 40 mm wide, 50 mm apart."""
    pixels = linear.shape[1] / 0.3  # per metre, of which 0.3 are seen
    middles = [
        (
            linear.shape[0] / 2 - (0.075 - 0.05 * row) * pixels,
            linear.shape[1] / 2 + (0.05 * column - 0.125) * pixels,
        )
        for row, column in np.ndindex(4, 6)
    ]
    half = round(0.012 * pixels)
    means = [
        linear[int(y) - half : int(y) + half, int(x) - half : int(x) + half].mean(axis=(0, 1))
        for y, x in middles
    ]
    return np.array(means)
