"""Notes and warnings: what may surprise is said in the same sentences in Python, in files and on the terminal."""

from __future__ import annotations

import html
import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import SKY, scene_text, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.cli.flag_names import with_flags
from mitsuba_sensor.output.exr import write_irradiance_exr

BAYER, WIDER = ms.load_camera("bayer_2mp"), ms.load_camera("sony_imx174")
TABLE1 = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.01)
BANDS = {"wavelengths_nm": [550.0]}
FIVE = np.full((4, 4, 1), 5.0)
SMALL: dict[str, Any] = {"spp": 16, "width": 8, "denoise": False, "variant": "scalar_spectral"}


def told(call: Callable[[], Any]) -> tuple[Any, list[warnings.WarningMessage]]:
    """What a call returns, and all warnings of ours that it gives."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = call()
    return found, [one for one in caught if issubclass(one.category, ms.SensorWarning)]


@pytest.fixture(scope="module")
def of_bayer(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Light that was rendered for a camera that sees 390 to 710 nm."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", ms.SensorWarning)
        folder = tmp_path_factory.mktemp("scene")
        return ms.render(write_scene(folder, scene_text(SKY)), BAYER, EXPOSURE, **SMALL)


def test_light_of_another_camera_is_told_in_python_once_at_the_line_of_the_call(
    of_bayer: Any,
) -> None:
    """sony_imx174 sees 350 to 1000 nm: 30.4 % of a flat spectrum were not rendered for it."""
    said = "nothing was rendered beyond 390 to 710 nm, where the mono pixels of this camera detect 30.4 %"
    sensor, photons = ms.Sensor(WIDER), ms.collect(of_bayer, WIDER, EXPOSURE)
    calls: tuple[Callable[[], Any], ...] = (
        lambda: ms.expose(of_bayer, WIDER, EXPOSURE),
        lambda: ms.expose(photons, WIDER, EXPOSURE),
        lambda: ms.stream(of_bayer, WIDER, EXPOSURE),
        lambda: sensor.expose(of_bayer, EXPOSURE),
        lambda: sensor.stream(photons, EXPOSURE),
        lambda: ms.capture(of_bayer, WIDER, EXPOSURE),
    )
    for call in calls:
        found, (warning,) = told(call)
        assert said in str(warning.message) and warning.filename == __file__
        frames = getattr(found, "frames", found)
        if isinstance(frames, ms.Frames):
            assert sum(said in note for note in frames.notes) == 1
    own, none = told(lambda: ms.expose(of_bayer))
    assert not none and not any("rendered" in note for note in own.notes)


def test_terminal_file_notebook_and_python_show_the_same_sentences(
    of_bayer: Any, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """Of noisy light, of another camera, at an unusual temperature; the terminal says whose an option is."""
    noisy = replace(of_bayer, relative_error=np.full_like(of_bayer.relative_error, 0.2))
    write_irradiance_exr(tmp_path / "light.exr", noisy)
    odd = ms.Exposure(1e-3, 25.0)
    frames = ms.capture(tmp_path / "light.exr", WIDER, odd).frames
    for part in (
        "if 25 is in °C, write 298.15",
        "is the render's, not the camera's",
        "30.4 % of a flat spectrum",
    ):
        assert sum(part in note for note in frames.notes) == 1
    flags = ("--camera", "sony_imx174", "--exposure-s", "0.001", "--temperature-k", "25")
    printed, caught = told(
        lambda: cli("expose", tmp_path / "light.exr", "-o", tmp_path / "out", *flags)
    )
    assert not caught and "SensorWarning" not in printed.stderr
    shown = " ".join(printed.stdout.split())
    assert sum(f"note: {with_flags(note)}" in shown for note in frames.notes) >= 3
    frames.save(tmp_path / "alone")
    for folder in ("out", "alone"):
        assert json.loads((tmp_path / folder / "frame.json").read_text("utf-8"))[
            "notes"
        ] == list(frames.notes)
    assert " · ".join(frames.notes) in html.unescape(frames._repr_html_())


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda: ms.expose(np.full((2, 1901), 9.0), TABLE1, EXPOSURE),
            "1901 × 2 pixels, but konnik_table1 has 1900",
        ),
        (
            lambda: ms.expose(FIVE, TABLE1, EXPOSURE, wavelengths_nm=[1200.0]),
            "100 % of the photons are in a band at 1200",
        ),
        (
            lambda: ms.expose(FIVE[..., 0], TABLE1, EXPOSURE, wavelengths_nm=[0.55]),
            "wavelengths are in nm: 0.55 µm are 550",
        ),
        (lambda: ms.expose(FIVE[..., 0], BAYER, EXPOSURE), "are assumed to have 530 nm"),
        (
            lambda: ms.expose(1e6 * FIVE, TABLE1, EXPOSURE, **BANDS),
            "100 % of the pixels are saturated at 0.01 s; ",
        ),
        (
            lambda: ms.expose(FIVE, TABLE1, ms.Exposure(0.01, 25.0), **BANDS),
            "if 25 is in °C, write 298.15",
        ),
        (
            lambda: ms.expose(
                FIVE, TABLE1.replace(**{"pixel.pitch_x_um": 5.7e-6}), EXPOSURE, **BANDS
            ),
            "pixel.pitch_x_um is 5.7e-06; 0.3 to 200 is usual: if 5.7e-06 is in metres, write 5.7",
        ),
        (
            lambda: ms.expose(
                FIVE, TABLE1.replace(**{"adc.full_scale_v": 0.165 / 200}), EXPOSURE, **BANDS
            ),
            "a full well fills 200 of it; if the highest code is a full well, omit it, or write 0.165",
        ),
    ],
    ids=[
        "size",
        "band",
        "micrometres",
        "no wavelength",
        "clipped",
        "celsius",
        "datasheet",
        "full scale",
    ],
)
def test_a_result_that_was_probably_not_meant_is_a_warning_and_a_note(
    call: Callable[[], Any], said: str
) -> None:
    frames, (warning,) = told(call)
    assert said in str(warning.message) and sum(said in note for note in frames.notes) == 1


def test_a_usual_exposure_is_silent_and_has_no_note() -> None:
    frames, none = told(lambda: ms.expose(FIVE, TABLE1, EXPOSURE, **BANDS))
    assert not none and frames.notes == ()


def test_photons_that_an_infrared_filter_absorbs_are_a_note_and_no_warning() -> None:
    """The curves of bayer_2mp end in zeros: nothing is missing."""
    both = np.concatenate([FIVE, 3 * FIVE], axis=2)
    frames, none = told(lambda: ms.expose(both, BAYER, EXPOSURE, wavelengths_nm=[550.0, 850.0]))
    (note,) = frames.notes
    assert not none and note.startswith(
        "75 % of the photons are in a band at 850 nm and not detected"
    )


@pytest.mark.parametrize(("share", "noted"), [(0.15, False), (0.3, True)])
def test_saturated_pixels_are_noted_from_a_fifth_of_them_on(share: float, noted: bool) -> None:
    """The share is that of the pixels; of a flat field at the full well half of them."""
    photons = np.where(np.arange(400).reshape(20, 20) < 400 * share, 1e6, 10.0)
    frames, caught = told(lambda: ms.expose(photons[..., None], TABLE1, EXPOSURE, **BANDS))
    assert (
        len(caught) == noted
        and any(f"{100 * share:.0f} % of the pixels" in note for note in frames.notes) == noted
    )
    well = TABLE1.pixel.full_well_e / float(TABLE1.qe([550.0])[0, 0])
    low_scale = TABLE1.replace(**{"adc.full_scale_v": 0.33})
    (note,) = told(
        lambda: ms.expose(np.full((8, 8, 1), well), low_scale, ms.Exposure(0.0), **BANDS)
    )[0].notes
    assert note.startswith("50 % of the pixels are saturated")


def test_what_is_black_in_a_scene_is_a_warning_of_its_render_and_not_of_its_frames(
    tmp_path: Path,
) -> None:
    """D65 ends at 830 nm; the camera sees on to 1000."""
    path = write_scene(
        tmp_path,
        scene_text('<emitter type="constant"><spectrum type="d65" name="radiance"/></emitter>'),
    )
    light, (warning,) = told(lambda: ms.render(path, WIDER, EXPOSURE, **SMALL))
    assert (
        "black outside 360 to 830 nm" in str(warning.message) and warning.filename == __file__
    )
    assert light.notes == light.statistics.notes and str(warning.message) in " · ".join(
        light.notes
    )
    frames, others = told(lambda: ms.expose(light))
    assert not any("black outside" in str(one.message) for one in others) and set(
        light.notes
    ) < set(frames.notes)
    assert len(told(lambda: ms.capture(path, WIDER, EXPOSURE, **SMALL))[1]) == 1
    series = ms.render_frames(path, WIDER, EXPOSURE, frames=2, **SMALL)
    assert [len(told(lambda: next(series))[1]) for _ in range(2)] == [1, 0]


def test_an_unusual_temperature_is_told_before_the_first_ray(scene_file: Path) -> None:
    """As an error it stops the render: no pass is done."""
    passes = list[object]()
    with warnings.catch_warnings():
        warnings.simplefilter("error", ms.SensorWarning)
        with pytest.raises(ms.SensorWarning, match="if 25 is in °C"):
            cold = ms.Exposure(0.02, 25)
            ms.capture(scene_file, TABLE1, cold, **SMALL | {"progress": passes.append})
    assert not passes
