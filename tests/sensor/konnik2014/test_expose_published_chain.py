"""The published chain by expose(chain="konnik2014") and on the command line.

(Its numbers against the records of the released code are in test_released_code.py.)
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import mitsuba_sensor as ms
from mitsuba_sensor.core.sensor_window import SensorWindow
from mitsuba_sensor.files.texts import to_json
from mitsuba_sensor.sensor.konnik2014 import Konnik2014Settings, chain_of
from mitsuba_sensor.stages.stage import sample

TABLE1 = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)
LIGHT = np.linspace(0.0, 60_000.0, 15 * 20).reshape(15, 20)
PUBLISHED: dict[str, Any] = {"chain": "konnik2014"}


@pytest.mark.parametrize(
    "changes", [{}, {"adc.bits": 8}, {"readout.reset": "hard", "pixel.prnu": 0.02}], ids=str
)
def test_expose_gives_the_numbers_of_the_published_chain(changes: dict[str, Any]) -> None:
    camera = TABLE1.replace(**changes)
    frames = ms.expose(
        LIGHT,
        camera,
        EXPOSURE,
        seed=5,
        serial=9,
        frames=2,
        first_frame=3,
        origin=(7, 11),
        **PUBLISHED,
    )
    stages = chain_of(Konnik2014Settings.from_camera(camera))
    window = SensorWindow(9, LIGHT.shape, (7, 11), camera=camera.name)
    for index in range(2):
        expected = sample(stages, ms.Photons(LIGHT), ms.Frame(EXPOSURE, window, 5, 3 + index))
        np.testing.assert_array_equal(frames.digital[index], expected)
    assert frames.stages == stages


def test_it_is_another_chain_than_the_default_which_is_physics() -> None:
    default = ms.expose(LIGHT, TABLE1, EXPOSURE).digital
    np.testing.assert_array_equal(
        ms.expose(LIGHT, TABLE1, EXPOSURE, chain="physical").digital, default
    )
    assert (ms.expose(LIGHT, TABLE1, EXPOSURE, **PUBLISHED).digital != default).mean() > 0.5
    parameter = inspect.signature(ms.expose).parameters["chain"]
    assert parameter.default == "physical" and "'konnik2014'" in str(ms.expose.__doc__)


def test_the_noise_budget_names_every_stage_and_theory_and_frame_agree() -> None:
    """10 000 pixels of half a well; the column stripes are one number per column, so the mean is looked at loosely."""
    frames = ms.expose(np.full((20, 500), 25_000.0), TABLE1, EXPOSURE, **PUBLISHED)
    report = json.loads(to_json(frames.report))
    assert [line["name"] for line in report["stages"]][-1] == "published adc"
    assert len(report["stages"]) == len(frames.stages)
    for line in report["stages"]:
        error = 5 * line["sigma_expected"] / np.sqrt(500)
        assert line["mean_frame"] == pytest.approx(line["mean_expected"], abs=error + 1e-12)
    assert report["stages"][-1]["mean_frame"] == pytest.approx(frames.digital.mean())


@pytest.mark.parametrize(
    ("bits", "kind"), [(7, np.uint8), (8, np.uint16), (12, np.uint16), (16, np.uint32)]
)
def test_the_code_too_many_fits_into_the_type(bits: int, kind: type) -> None:
    """The published converter clips at 2^bits, one code above the range; it must not wrap to 0."""
    camera = TABLE1.replace(**{"adc.bits": bits})
    digital = ms.expose(np.full((3, 4), 1e9), camera, EXPOSURE, **PUBLISHED).digital
    assert digital.dtype == kind and digital.max() == 2**bits
    assert digital.min() > 0.97 * 2**bits


def test_one_wavelength_may_come_as_a_band_and_signals_can_be_kept() -> None:
    flat = ms.expose(
        LIGHT, TABLE1, EXPOSURE, keep=("photons", "electrons", "volts"), **PUBLISHED
    )
    band = ms.expose(LIGHT[..., None], TABLE1, EXPOSURE, wavelengths_nm=[550.0], **PUBLISHED)
    np.testing.assert_array_equal(flat.digital, band.digital)
    np.testing.assert_array_equal(flat.photons[0], LIGHT)
    np.testing.assert_array_equal(flat.electrons, np.floor(flat.electrons))
    assert (
        flat.electrons.max() == 33_000 and 2.9 < flat.volts.min() < flat.volts.max() < 3.15
    ), "node voltages, V_REF − S"


CANNOT: dict[str, tuple[Any, str, dict[str, Any], str]] = {
    "unknown name": (
        LIGHT,
        "konnik_table1",
        {"chain": "konnik"},
        "chain is 'konnik'; it must be one of physical, kon",
    ),
    "no name": (LIGHT, "konnik_table1", {"chain": None}, "chain is None; it must be"),
    "a cube": (
        np.ones((3, 4, 2)),
        "konnik_table1",
        {**PUBLISHED, "wavelengths_nm": [500.0, 600.0]},
        "2 bands and the published code has one",
    ),
    "colour filters": (LIGHT, "bayer_2mp", PUBLISHED, r"3 colour filter\(s\)"),
    "measured maps": (
        LIGHT,
        "konnik_table1",
        {**PUBLISHED, "maps": {"prnu": np.ones((15, 20))}},
        "makes its own",
    ),
}


@pytest.mark.parametrize("case", CANNOT)
def test_what_the_published_chain_cannot_do_is_refused_in_one_sentence(case: str) -> None:
    light, camera, options, said = CANNOT[case]
    with pytest.raises(ms.InputError, match=said) as caught:
        ms.expose(light, ms.load_camera(camera), EXPOSURE, **options)
    assert "\n" not in str(caught.value)


def test_a_plan_is_for_the_physical_chain_only() -> None:
    plan = ms.plan(TABLE1, EXPOSURE, LIGHT)
    with pytest.raises(ms.InputError, match="chain is 'konnik2014' and a plan is given"):
        ms.expose(LIGHT, TABLE1, EXPOSURE, plan=plan, **PUBLISHED)


def test_the_command_line_renders_one_wavelength_with_the_published_chain(
    scene_file: Path, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    options = ("--chain", "konnik2014", "--wavelength-nm", 550, "--spp", 16, "--verbose")
    done = cli("render", scene_file, "-o", tmp_path / "out", *options)
    assert done.exit_code == 0, (done.exception, done.stderr)
    assert "photon shot" in " ".join(done.stdout.split())
    report = json.loads((tmp_path / "out" / "frame.json").read_text(encoding="utf-8"))
    assert report["chain"] == "konnik2014" and report["effects"] == []
    raw = tifffile.imread(tmp_path / "out" / "frame.tiff")
    assert raw.shape == (12, 16) and raw.mean() == pytest.approx(
        report["stages"][-1]["mean_frame"]
    )
    again = cli(
        "expose",
        tmp_path / "out" / "irradiance.exr",
        "-o",
        tmp_path / "again",
        "--chain",
        "konnik2014",
        "--exposure-s",
        report["exposure"]["time_s"],
    )
    assert again.exit_code == 0, again.stderr
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "again" / "frame.tiff"), raw)


def test_the_command_line_refuses_a_cube_with_a_sentence(
    light_file: Path, tmp_path: Path, cli: Any
) -> None:
    done = cli("expose", light_file, "-o", tmp_path / "out", "--chain", "konnik2014")
    assert (
        done.exit_code == 2
        and "3 bands and the published code has one wavelength" in done.stderr
    )
    assert not (tmp_path / "out").exists()


CROSSTALK = [[0.0, 0.02, 0.0], [0.02, 0.92, 0.02], [0.0, 0.02, 0.0]]
RTS = {"dark_current.rts_fraction": 0.1, "dark_current.rts_amplitude_e_per_s": 50.0}


@pytest.mark.parametrize(
    ("fields", "label", "way_out"),
    [
        ({"readout.ipc_coupling": 0.01}, "inter-pixel capacitance", "set readout.ipc_coupling"),
        ({"pixel.blooming": 1.0}, "blooming", "set pixel.blooming to 0"),
        ({"pixel.hits_per_cm2_s": 1.0}, "radiation hits", "camera.without('radiation_hits')"),
        (RTS, "RTS pixels", "camera.without('rts_pixels')"),
        ({"quantum_efficiency.crosstalk": CROSSTALK}, "crosstalk", "unset quantum_efficiency"),
    ],
)
def test_an_effect_that_the_published_chain_lacks_is_refused(
    fields: dict[str, object], label: str, way_out: str
) -> None:
    camera = ms.load_camera("konnik_table1").replace(**fields)
    with pytest.raises(ms.InputError) as refused:
        ms.expose(100.0, camera, ms.Exposure(0.1), chain="konnik2014")
    assert f"has {label}, which the published chain lacks" in str(refused.value)
    assert way_out in str(refused.value)
