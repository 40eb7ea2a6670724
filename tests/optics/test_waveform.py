"""Waveforms of lamps: means in closed form against sums over many instants; waveforms as text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.optics.waveform import Waveform, table, waveform_of

TABLE = "time_s,value\n0,0\n0.002,3\n0.004,1\n0.010,0\n"


@pytest.fixture(params=["pwm", "sine", "mains", "table", "constant"])
def waveform(request: pytest.FixtureRequest, tmp_path: Path) -> Waveform:
    file = tmp_path / "lamp.csv"
    file.write_text(TABLE, encoding="utf-8")
    found: dict[str, Waveform] = {
        "pwm": ms.pwm(90, 0.3, 0.2, level=2.0),
        "sine": ms.sine(100, 0.7, 0.1),
        "mains": ms.mains(50, level=0.5),
        "table": table(str(file)),
        "constant": Waveform(level=3.0),
    }
    return found[request.param]


@pytest.mark.parametrize("open_s", [1e-4, 0.0031, 0.01, 0.123])
def test_the_mean_over_an_exposure_is_the_sum_over_its_instants(
    waveform: Waveform, open_s: float
) -> None:
    starts = np.array([0.0, 0.00123, 0.5, 77.7771, -3.2])
    instants = starts[:, None] + (np.arange(100_000) + 0.5) * open_s / 100_000
    sums = waveform.mean_over(instants, 0.0).mean(axis=1)
    np.testing.assert_allclose(
        waveform.mean_over(starts, open_s), sums, rtol=1e-4, atol=1e-4 * waveform.level
    )


def test_the_mean_over_whole_periods_is_the_level(waveform: Waveform) -> None:
    starts = np.linspace(0, 0.05, 41)
    for periods in (1, 3, 1000):
        period_s = 1 / 90 if isinstance(waveform, ms.pwm) else 0.01
        mean = waveform.mean_over(starts, periods * period_s)
        np.testing.assert_allclose(mean, waveform.level, rtol=1e-10)


def test_a_sine_follows_the_closed_form_of_its_integral() -> None:
    """1 + m·[cos(2πf·t + φ) − cos(2πf·(t + T) + φ)]/(2πf·T)."""
    starts, open_s, turns = np.linspace(0, 0.02, 9), 0.0037, 2 * np.pi * 100
    phase = 2 * np.pi * 0.2
    change = np.cos(turns * starts + phase) - np.cos(turns * (starts + open_s) + phase)
    expected = 1 + 0.4 * change / (turns * open_s)
    np.testing.assert_allclose(ms.sine(100, 0.4, 0.2).mean_over(starts, open_s), expected)


def test_a_short_exposure_sees_all_of_a_pulse_or_none() -> None:
    mean = ms.pwm(100, 0.25).mean_over([0.0, 0.0024, 0.0025, 0.009, 0.01], 1e-9)
    np.testing.assert_allclose(mean, [4, 4, 0, 0, 4], rtol=1e-5)


def test_a_waveform_survives_its_text(waveform: Waveform) -> None:
    assert waveform_of("lamp", repr(waveform)) == waveform


def test_texts_contain_level_kind_and_numbers() -> None:
    assert waveform_of("lamp", "2 pwm(100, 0.5)") == ms.pwm(100, 0.5, level=2.0)
    assert waveform_of("lamp", "2*pwm(100,0.5,0.25)") == ms.pwm(100, 0.5, 0.25, level=2.0)
    assert waveform_of("lamp", " mains( 60 ) ") == ms.mains(60)
    assert waveform_of("lamp", "0.2") == Waveform(level=0.2)
    assert not waveform_of("lamp", 0.2).flickers


BAD = {
    "pwm(0, 0.5)": "frequency_hz is 0",
    "pwm(100, 0)": "duty is 0",
    "pwm(100, 1.5)": "duty is 1.5",
    "sine(100, 2)": "depth is 2",
    "sine(100, 0.5, nan)": "phase is nan",
    "-1 mains(50)": "the level of lamp is -1",
    "2 pvm(100, 0.5)": "Did you mean 'pwm'",
    "pwm(100)": "pwm takes the numbers frequency_hz, duty, phase",
    "pwm(1, 0.5, 0, 0)": "pwm takes the numbers frequency_hz",
    "mains()": "mains takes the numbers frequency_hz",
    "pwm(100, half)": "pwm takes the numbers",
    "pwm(100, 0.5": "must be a level or a waveform",
    "": "must be a level or a waveform",
    "table(nowhere.csv)": "nowhere.csv cannot be read",
}


@pytest.mark.parametrize("text", BAD)
def test_a_wrong_text_is_refused_with_a_remedy(text: str) -> None:
    with pytest.raises(ms.InputError, match=BAD[text].replace("(", r"\(")):
        waveform_of("lamp", text)


@pytest.mark.parametrize(
    ("header", "unit_s"),
    [
        ("", 1.0),
        ("time_s,value\n", 1.0),
        ("\ufeffTime [ms],CH1 (V)\n", 1e-3),
        ("# time_ms,value\n", 1e-3),  # as numpy.savetxt writes it
        ("# lamp 3, measured\nt (µs),value\n", 1e-6),
        ("time / ns,value\n", 1e-9),
    ],
)
def test_times_are_in_the_unit_of_the_header(
    header: str, unit_s: float, tmp_path: Path
) -> None:
    file = tmp_path / "lamp.csv"
    file.write_text(f"{header}0,1\n2,3\n5,0\n", encoding="utf-8")
    np.testing.assert_allclose(table(str(file)).times_s, np.array([0, 2, 5]) * unit_s)


@pytest.mark.parametrize(
    "rows",
    [
        *("0,1\n", "0,1\n0,2\n", "0,1\n1,-1\n", "0,0\n1,0\n", "a,b\nc,d\n"),
        *("0,1,2\n1,1,1\n", "time_s,v\n0,1\nx,1\n"),
    ],
)
def test_a_wrong_table_is_refused(rows: str, tmp_path: Path) -> None:
    file = tmp_path / "lamp.csv"
    file.write_text(rows, encoding="utf-8")
    with pytest.raises(ms.InputError, match=r"lamp\.csv"):
        table(str(file))
