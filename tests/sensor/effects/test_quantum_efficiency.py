"""How many electrons a photon frees: a number, a table, a file; one curve per filter; and more than one per photon."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import CAMERAS

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.stages.effects.quantum_efficiency import QuantumEfficiency
from mitsuba_sensor.stages.effects.quantum_yield import QuantumYield
from mitsuba_sensor.stages.effects.shot_noise import ShotNoise

TABLE1 = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)
TOML = (CAMERAS / "konnik_table1.toml").read_text(encoding="utf-8")


def camera_file(folder: Path, quantum_efficiency: str) -> Path:
    """Table 1 with another [quantum_efficiency] table."""
    head, rest = TOML.split("[quantum_efficiency]\n")
    tail = "[dark_current]" + rest.split("[dark_current]")[1]
    path = folder / "camera.toml"
    text = head + f"[quantum_efficiency]\n{quantum_efficiency}\n" + tail.split("[sources]")[0]
    path.write_text(text, encoding="utf-8")
    return path


def detected(
    camera: ms.Camera,
    photons: Any,
    wavelengths_nm: Any = None,
    origin: tuple[int, int] = (0, 0),
) -> Any:
    """Mean photoelectrons (H, W)."""
    mean = np.asarray(photons, dtype=float)
    lengths = None if wavelengths_nm is None else np.asarray(wavelengths_nm, dtype=float)
    frame = ms.stages.Frame(EXPOSURE, SensorWindow(1, mean.shape[:2], origin))
    return camera.stages[0].sample(ms.Photons(mean, lengths), frame).light


def test_one_value_holds_over_the_whole_band_and_nowhere_else() -> None:
    camera = TABLE1.replace(**{"quantum_efficiency.value": 0.45})
    np.testing.assert_array_equal(
        camera.qe([399.9, 400, 550, 700, 700.1]), [[0, 0.45, 0.45, 0.45, 0]]
    )
    assert camera.band_nm == (400.0, 700.0)


def test_the_three_ways_to_give_a_curve_are_one_camera(tmp_path: Path) -> None:
    """value, curves, file: the same chain. The file lies beside the camera, wherever the program runs."""
    (tmp_path / "qe.csv").write_text("wavelength_nm,mono_fraction\n400,0.6\n700,0.6\n")
    ways = [
        "wavelengths_nm = [400, 700]\ncurves.mono = [0.6, 0.6]\nreference_nm = 550",
        "wavelengths_nm = [400, 700]\nvalue = 0.6\nreference_nm = 550",
        'file = "qe.csv"\nreference_nm = 550',
    ]
    chains = {ms.load_camera(camera_file(tmp_path, way)).stages for way in ways}
    assert chains == {TABLE1.stages}


@pytest.mark.parametrize(
    ("header", "scale_nm", "scale_qe"),
    [
        ("wavelength_nm,R_fraction,G_fraction", 1, 1),
        ("wavelength_um,R_fraction,G_fraction", 1e-3, 1),
        ("wavelength_µm,R_percent,G_percent", 1e-3, 100),
        ("wavelength_nm, R_percent , G_fraction", 1, (100, 1)),
        ("# Wavelength [µm], R (%), G (fraction)", 1e-3, (100, 1)),
    ],
)
def test_files_in_nm_and_um_in_fractions_and_percents_say_the_same(
    header: str, scale_nm: float, scale_qe: Any, tmp_path: Path
) -> None:
    """A comment, an empty line, a byte order mark and spaces do no harm."""
    points = np.array([[420, 0.1, 0.3], [530, 0.4, 0.6], [680, 0.2, 0.1]]) * [
        scale_nm,
        *np.broadcast_to(scale_qe, 2),
    ]
    lines = [
        "# from the datasheet",
        header,
        "",
        *(", ".join(f"{x:.6g}" for x in row) for row in points),
    ]
    (tmp_path / "qe.csv").write_text("\n".join(lines), encoding="utf-8-sig")
    camera = ms.load_camera(
        camera_file(tmp_path, 'file = "qe.csv"\ntile = [["R", "G"]]\nreference_nm = 550')
    )
    assert camera.filter_names == ("R", "G")
    np.testing.assert_allclose(
        camera.qe([420, 475, 530, 680, 700]),
        [[0.1, 0.25, 0.4, 0.2, 0], [0.3, 0.45, 0.6, 0.1, 0]],
        rtol=1e-9,
    )


FILES = {  # the text of a table → what its one sentence says
    "wavelength,mono_percent\n400,60\n700,60\n": "column 1 is called 'wavelength'",
    "wavelength_m,mono_percent\n400,60\n700,60\n": "wavelength_nm or wavelength_um",
    "wavelength_nm,mono\n400,0.6\n700,0.6\n": "NAME_fraction or NAME_percent",
    "wavelength_nm,mono_fraction\n400,60\n700,60\n": "mono_percent",
    "wavelength_nm,R_fraction,G_percent\n400,0.3,0.2\n700,0.6,0.5\n": "0.5 percent",
    "wavelength_nm,mono_fraction\n0.4,0.3\n0.7,0.6\n": "wavelength_um",
    "wavelength_nm,mono_percent\n400,60\n300,60\n": "must increase",
    "wavelength_nm,mono_percent\n400,60\n": "two lines",
    "wavelength_nm\n400\n700\n": "at least one curve",
    "wavelength_nm mono_percent\n400 60\n700 60\n": "separated by commas",
    "wavelength_nm,mono_percent\n400,60\n700\n": "not 2 numbers",
    "wavelength_nm,mono_percent\n400,high\n700,60\n": "not 2 numbers",
    "wavelength_nm,mono_percent\n400,nan\n700,60\n": "finite number",
    "wavelength_nm,G_percent,G_percent\n400,60,10\n700,60,10\n": "a curve twice",
}


@pytest.mark.parametrize("text", FILES)
def test_a_file_that_leaves_doubt_is_refused_in_one_sentence(text: str, tmp_path: Path) -> None:
    """Camera file, field, what is wrong, what to write instead."""
    (tmp_path / "qe.csv").write_text(text)
    with pytest.raises(ms.InputError) as caught:
        ms.load_camera(camera_file(tmp_path, 'file = "qe.csv"'))
    sentence = str(caught.value)
    assert FILES[text] in sentence and "camera.toml: quantum_efficiency" in sentence


# Colour filters.

RGB_IR_4X4 = [
    ["B", "G", "R", "G"],
    ["G", "I", "G", "I"],
    ["R", "G", "B", "G"],
    ["G", "I", "G", "I"],
]
CURVES = {"R": [0.1, 0.0], "G": [0.2, 0.0], "B": [0.3, 0.0], "I": [0.4, 0.5]}


@pytest.mark.parametrize("origin", [(0, 0), (7, 9)], ids=str)
@pytest.mark.parametrize(
    "tile",
    [
        RGB_IR_4X4,
        [["R"], ["G"], ["I"]],
        [["G", "R", "I"], ["B", "B", "G"]],
    ],
    ids=str,
)
def test_every_pixel_takes_the_curve_of_its_own_filter(
    tile: list[list[str]], origin: tuple[int, int]
) -> None:
    """Any rectangle that repeats, seen through any window: by index arithmetic written out here."""
    camera = TABLE1.replace(
        **{
            "quantum_efficiency.curves": CURVES,
            "quantum_efficiency.tile": tile,
            "quantum_efficiency.wavelengths_nm": [500.0, 600.0],
        }
    )
    light = np.full((6, 7, 2), 1000.0)
    light[..., 1] = 100.0
    seen = detected(camera, light, [500, 600], origin)
    for y in range(6):
        for x in range(7):
            name = tile[(y + origin[0]) % len(tile)][(x + origin[1]) % len(tile[0])]
            assert seen[y, x] == pytest.approx(
                1000 * CURVES[name][0] + 100 * CURVES[name][1], rel=1e-12
            )


# Quantum yield: several electrons per photon in the ultraviolet.

LAM = 1000.0


def yielding(eta: float, fano: float = 0.1, qe: float = 0.5) -> ms.Camera:
    return TABLE1.replace(
        **{
            "quantum_efficiency.curves": {"mono": [qe, qe]},
            "quantum_efficiency.quantum_yield": [eta, eta],
            "quantum_efficiency.fano_factor": fano,
        }
    )


def counted(camera: ms.Camera, photons: ms.Photons, shape: tuple[int, int] = (400, 500)) -> Any:
    """Electrons of one frame; detection, shot noise and yield alone."""
    frame = ms.stages.Frame(EXPOSURE, SensorWindow(3, shape))
    signal: Any = photons
    for stage in camera.stages[:6]:
        if isinstance(stage, QuantumEfficiency | ShotNoise | QuantumYield):
            signal = stage.sample(signal, frame)
    return np.broadcast_to(signal.light, shape)


@pytest.mark.parametrize(("eta", "fano"), [(1.0, 0.1), (1.3, 0.0), (3.5, 1.0)])
def test_a_yield_multiplies_the_mean_and_has_the_variance_of_a_compound_law(
    eta: float, fano: float
) -> None:
    """λ interactions: mean η·λ, variance η²·λ + F·η·λ (+ 1/12 of rounding to whole electrons); λ alone at η = 1.

    200 000 pixels: 5 se are 0.04 % of the mean and 1.6 % of the variance (0.8 % of σ).
    """
    camera = yielding(eta, fano)
    electrons = counted(camera, ms.Photons(np.full((400, 500), LAM / 0.5)))
    variance = LAM if eta == 1 else LAM * (eta**2 + fano * eta) + 1 / 12
    assert electrons.mean() == pytest.approx(
        eta * LAM, abs=5 * math.sqrt(variance / electrons.size)
    )
    assert electrons.var() == pytest.approx(variance, rel=5 * math.sqrt(2 / electrons.size))
    np.testing.assert_array_equal(electrons, np.floor(electrons))
    assert electrons.min() >= 0


def test_two_bands_of_different_yield_add_their_spread() -> None:
    """600 interactions of η = 3 and 400 of η = 1: mean 2200, variance Σλ(η² + F·η̄) by the mean and spread of η.

    var = λ(η̄² + F·η̄ + var η) + 1/12 = 1000·(2.2² + 0.22 + 0.96) + 1/12; 5 se of 200 000 pixels: 1.6 %.
    """
    camera = yielding(1.0).replace(**{"quantum_efficiency.quantum_yield": [3.0, 1.0]})
    light = np.broadcast_to([1200.0, 800.0], (400, 500, 2))
    electrons = counted(camera, ms.Photons(light, np.array([400.0, 700.0])))
    variance = 1000 * (2.2**2 + 0.22 + 0.96) + 1 / 12
    assert electrons.mean() == pytest.approx(2200, abs=5 * math.sqrt(6020 / electrons.size))
    assert electrons.var() == pytest.approx(variance, rel=0.016)


def test_dark_electrons_do_not_multiply() -> None:
    """The yield belongs to photons: no light, and a hot dark current, is the same frame with and without it."""
    hot = {"dark_current.fom_na_per_cm2": 50.0}
    for camera in (TABLE1, yielding(3.0)):
        kept = ms.expose(
            np.zeros((20, 30)),
            camera.replace(**hot),
            EXPOSURE,
            keep=["electrons", "dark_electrons"],
        )
        np.testing.assert_array_equal(kept.electrons, kept.dark_electrons)
        assert kept.electrons.mean() == pytest.approx(50 * 174.158, rel=0.02)
