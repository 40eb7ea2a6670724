"""Masked values and booleans: no array or number that users hand in is read as something else without a sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import backend_problem

TABLE1, BAYER = ms.load_camera("konnik_table1"), ms.load_camera("bayer_2mp")
EXPOSURE = ms.Exposure(0.01)
needs_llvm = pytest.mark.skipif(bool(backend_problem("llvm")), reason="no LLVM")
ONES = np.ones((4, 4))
HIDDEN = np.ma.masked_array(ONES, np.eye(4, dtype=bool))
NM = np.array([550.0])

MASKED: dict[str, Callable[[Path], Any]] = {
    "photons": lambda _: ms.expose(HIDDEN, TABLE1, EXPOSURE),
    "Photons": lambda _: ms.expose(ms.Photons(HIDDEN[..., None], NM), BAYER, EXPOSURE),
    "stream": lambda _: ms.stream(HIDDEN, TABLE1, EXPOSURE),
    "derivatives": lambda _: ms.differentiable(HIDDEN, TABLE1, EXPOSURE, "photons"),
    "wavelengths": lambda _: ms.expose(
        ONES, TABLE1, EXPOSURE, wavelengths_nm=np.ma.masked_array(NM, [True])
    ),
    "map": lambda _: ms.expose(ONES, TABLE1, EXPOSURE, maps={"prnu": HIDDEN}),
    "light": lambda _: ms.collect(HIDDEN, TABLE1, EXPOSURE),
    "measured frames": lambda _: ms.lab.Stack(HIDDEN[None], 0.01),
    "frames of a file": lambda folder: ms.write_tiff(
        folder / "x.tiff", HIDDEN.astype(np.uint16)
    ),
    "QE": lambda _: TABLE1.qe(np.ma.masked_array(NM, [True])),
}


@pytest.mark.parametrize("case", MASKED)
def test_masked_values_are_refused_with_their_number(case: str, tmp_path: Path) -> None:
    """NumPy drops the mask and goes on with what is under it."""
    with pytest.raises(
        ms.InputError,
        match=r"has \d masked value\(s\), of which nothing is known; pass numbers",
    ):
        MASKED[case](tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_masked_array_in_which_nothing_is_masked_is_an_array() -> None:
    frames = ms.expose(np.ma.masked_array(ONES), TABLE1, EXPOSURE)
    np.testing.assert_array_equal(frames.digital, ms.expose(ONES, TABLE1, EXPOSURE).digital)


NUMBERS: dict[str, Callable[[Any], Any]] = {
    "time": lambda yes: ms.Exposure(time_s=yes),
    "temperature": lambda yes: ms.Exposure(1.0, yes),
    "photons": lambda yes: ms.expose(yes, TABLE1, EXPOSURE),
    "map": lambda yes: ms.expose(ONES, TABLE1, EXPOSURE, maps={"prnu": np.full((4, 4), yes)}),
    "wavelength of light": lambda yes: ms.collect(ONES, TABLE1, EXPOSURE, wavelengths_nm=yes),
    "field of a camera": lambda yes: TABLE1.replace(**{"pixel.full_well_e": yes}),
    "QE": lambda yes: TABLE1.qe([yes]),
    "memory": lambda yes: ms.Sensor(TABLE1, most_bytes=yes),
    "measured time": lambda yes: ms.lab.Stack(ONES[None], yes),
}


@pytest.mark.parametrize("yes", [True, np.True_], ids=["Python", "NumPy"])
@pytest.mark.parametrize("case", NUMBERS)
def test_a_boolean_is_no_number(case: str, yes: Any) -> None:
    """True would be one second, one kelvin, one nanometre."""
    with pytest.raises(ms.InputError, match=r"True|bool"):
        NUMBERS[case](yes)


@pytest.mark.parametrize("name", ["konnik_table1", "bayer_2mp", "rgbir_2mp"])
@pytest.mark.parametrize("engine", ["numpy", pytest.param("drjit", marks=needs_llvm)])
def test_photoelectrons_are_exposed_of_each_filter_or_of_each_pixel(
    name: str, engine: Any
) -> None:
    """Without wavelengths: the QE is applied already. A pixel takes the layer of its own filter, at any origin."""
    camera, at = ms.load_camera(name), (3, 2)
    layers = np.random.default_rng(5).uniform(0, 5e3, (6, 8, len(camera.filter_names)))
    own = np.take_along_axis(layers, camera.filter_index((6, 8), at)[..., None], axis=2)[..., 0]
    by_filter, by_pixel = (
        ms.expose(ms.Photons(mean, detected=True), camera, EXPOSURE, origin=at, engine=engine)
        for mean in (layers, own)
    )
    np.testing.assert_allclose(by_filter.detected.mean_e, own, rtol=1e-6)
    np.testing.assert_array_equal(by_pixel.digital, by_filter.digital)


@pytest.mark.parametrize(
    ("layers", "options", "said"),
    [
        (
            2,
            {},
            r"shape \(4, 4, 2\) and is detected already; it must be \(H, W\), or \(H, W, 3\)",
        ),
        (
            3,
            {"keep": "photons"},
            "of this light only the photoelectrons are known; keep 'photoelectrons'",
        ),
    ],
)
def test_photoelectrons_that_mean_nothing_are_refused(
    layers: int, options: Any, said: str
) -> None:
    with pytest.raises(ms.InputError, match=said):
        ms.expose(
            ms.Photons(np.ones((4, 4, layers)), detected=True), BAYER, EXPOSURE, **options
        )
