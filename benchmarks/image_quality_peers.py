"""Modulation transfer by our instruments beside packages of other people, on charts whose modulation is known.

    pip install quickMTF pylinac essimaging
    python benchmarks/image_quality_peers.py

Edges: quickMTF 2023.3.3 (slanted edge in bins of a quarter of a pixel), pylinac 3.49 (every row as an edge spread
function). Textures: essimaging 26.6 (ratio of the spectra of a picture and of its target, for neutron images). Each
value is the mean of 20 pictures; a package that is not installed is left out.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import charts
import numpy as np

from mitsuba_sensor.lab.measure.image_quality.dead_leaves import dead_leaves
from mitsuba_sensor.lab.measure.image_quality.slanted_edge import slanted_edge

FREQUENCIES = 0.1, 0.25, 0.4
PICTURES = 20
Array = np.ndarray
Instrument = Callable[[Array], Array]


def of_quick_mtf(package: Any) -> Instrument:
    """Its slanted edge, in bins of a quarter of a pixel."""

    def measure(picture: Array) -> Array:
        mtf = package.sfr_mtfcal().calc_sfr(picture, oversampling=4)[0]
        return np.interp(FREQUENCIES, mtf[:, 0], mtf[:, 1])

    return measure


def of_pylinac(package: Any) -> Instrument:
    """Its mean over the rows of an edge, each by itself."""

    def measure(picture: Array) -> Array:
        found = package.EdgeSpreadFunctionMTF(list(picture))
        return np.interp(FREQUENCIES, found.freq, found.mtf)

    return measure


def of_essimaging(package: Any, chart: Array) -> Instrument:
    """Its ratio of spectra."""
    scipp = importlib.import_module("scipp")

    def measure(picture: Array) -> Array:
        images = [
            scipp.DataArray(scipp.array(dims=["y", "x"], values=values))
            for values in (picture, np.ones_like(picture), chart)
        ]
        mtf = package.modulation_transfer_function(*images)
        return np.interp(FREQUENCIES, mtf.coords["frequency"].values, mtf.values)

    return measure


def our_edge(picture: Array) -> Array:
    """Ours."""
    modulation = slanted_edge(picture).modulation
    return np.array([modulation.at(frequency).value for frequency in FREQUENCIES])


def our_leaves(chart: Array) -> Instrument:
    """Ours, wave by wave."""

    def measure(picture: Array) -> Array:
        modulation = dead_leaves(picture, chart).modulation
        return np.array([modulation.at(frequency).value for frequency in FREQUENCIES])

    return measure


def peers(chart: Array) -> dict[str, dict[str, Instrument]]:
    """Instruments by chart and package."""
    found = {"edge": {"ours": our_edge}, "leaves": {"ours": our_leaves(chart)}}
    for kind, name, module, make in (
        ("edge", "quickMTF", "quickMTF.SFR_MTF", of_quick_mtf),
        ("edge", "pylinac", "pylinac.core.mtf", of_pylinac),
        ("leaves", "essimaging", "ess.imaging.tools.resolution", None),
    ):
        try:
            package = importlib.import_module(module)
        except ImportError:
            continue
        if make is None:
            found[kind][name] = of_essimaging(package, chart)
        else:
            found[kind][name] = make(package)
    return found


def main() -> None:
    """Print the modulation at three frequencies, without noise and with a signal-to-noise ratio of 30."""
    chart = charts.dead_leaves(256)
    frequency = np.array(FREQUENCIES)
    pictures = {
        "edge": charts.slanted_edge((100, 80), 5.0),
        "leaves": charts.blurred(chart, 0.5),
    }
    true = {
        "edge": charts.pixel_modulation(frequency, 5.0),
        "leaves": np.exp(-2 * np.square(np.pi * 0.5 * frequency)),
    }
    rng = np.random.default_rng(3)
    for kind, instruments in peers(chart).items():
        print(f"{kind:8}{'theory':12}", *np.round(true[kind], 3))
        for name, measure in instruments.items():
            clean = measure(pictures[kind])
            shape = pictures[kind].shape
            noisy = [
                measure(pictures[kind] + rng.normal(0, 1 / 30, shape)) for _ in range(PICTURES)
            ]
            off = np.sqrt(np.square(np.array(noisy) - true[kind]).mean(axis=0))
            print(
                f"{'':8}{name:12}", *np.round(clean, 3), "  error with noise", *np.round(off, 3)
            )


if __name__ == "__main__":
    main()
