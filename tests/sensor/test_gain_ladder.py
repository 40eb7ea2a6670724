"""The gain ladder of a camera: what was put in per setting is measured from frames of that setting.

Frames of 512 × 512 pixels: the difference of two shows a variance to 0.28 %. A relative error of 1.4 % is five of these
standard errors (6e-7 false alarms a figure), the seeds are fixed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import mitsuba_sensor as ms
from mitsuba_sensor.camera.figures import saturation_e
from mitsuba_sensor.core.units import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C
from mitsuba_sensor.output.exr import write_irradiance_exr
from mitsuba_sensor.stages.gains import gain_dn_per_e, sense_gain_v_per_e

LADDER: list[dict[str, Any]] = [
    {
        "iso": 100,
        "gain_dn_per_e": 0.25,
        "read_noise_e": 8.0,
        "black_level_dn": 64,
        "full_well_e": 15_000,
    },
    {
        "iso": 400,
        "gain_dn_per_e": 1.0,
        "read_noise_e": 4.5,
        "black_level_dn": 66,
        "full_well_e": 15_000,
    },
    {
        "name": "hcg 400",
        "gain_dn_per_e": 1.0,
        "read_noise_e": 1.5,
        "black_level_dn": 80,
        "full_well_e": 3000,
    },
]
for one, sense_uv in zip(LADDER, (30.0, 30.0, 150.0), strict=True):
    one["sense_gain_uv_per_e"] = sense_uv
CAMERA = ms.load_camera("konnik_table1").replace(gains=LADDER)
SETTINGS: dict[int | str, dict[str, Any]] = {
    one.get("iso", one.get("name")): one for one in LADDER
}
EVEN = CAMERA.replace(
    **{"pixel.prnu": 0.0, "readout.dsnu_col": 0.0, "quantum_efficiency.value": 1.0}
)
SHAPE, TOLERANCE = (512, 512), 0.014
DARK = ms.Exposure(0.0)


def pair(camera: ms.Camera, photons: float, **options: Any) -> tuple[float, float]:
    """Mean and temporal variance of two frames [DN, DN²]."""
    one, two = ms.expose(
        np.full(SHAPE, photons), camera, DARK, frames=2, engine="numpy", **options
    ).digital.astype(int)
    return float((one + two).mean() / 2), float((one - two).var() / 2)


@pytest.mark.parametrize("setting", SETTINGS)
def test_gain_read_noise_and_black_level_of_a_setting_are_measured_from_its_frames(
    setting: int | str,
) -> None:
    """Photon transfer: K = Δσ²/Δμ, σ_read = √(σ_dark² − 1/12)/K, the mean of darkness, the highest code."""
    given = SETTINGS[setting]
    (dark, quiet), (bright, shot) = (
        pair(EVEN, 0.0, gain=setting),
        pair(EVEN, 2000.0, gain=setting),
    )
    k = (shot - quiet) / (bright - dark)
    assert k == pytest.approx(given["gain_dn_per_e"], rel=TOLERANCE)
    assert math.sqrt(quiet - 1 / 12) / k == pytest.approx(given["read_noise_e"], rel=TOLERANCE)
    assert dark == pytest.approx(given["black_level_dn"], abs=5 * math.sqrt(quiet / 2) / 512)
    top = ms.expose(np.full((4, 4), 1e6), EVEN, DARK, gain=setting).digital.astype(float).mean()
    filled = given["black_level_dn"] + given["gain_dn_per_e"] * given["full_well_e"]
    assert top == pytest.approx(min(4095, filled), abs=5 * k * given["read_noise_e"])


@pytest.mark.parametrize("setting", SETTINGS)
def test_a_camera_at_a_setting_has_its_numbers_exactly(setting: int | str) -> None:
    camera, given = CAMERA.at_gain(setting), SETTINGS[setting]
    assert (
        camera.gain == str(setting)
        and camera.name == CAMERA.name
        and camera.gains == CAMERA.gains
    )
    assert gain_dn_per_e(camera) == pytest.approx(given["gain_dn_per_e"], rel=1e-12)
    assert camera.source_follower.read_noise_e == given["read_noise_e"]
    assert (camera.adc.black_level_dn, camera.pixel.full_well_e) == (
        given["black_level_dn"],
        given["full_well_e"],
    )
    assert camera.sources["adc.full_scale_v"] == f"gain setting {setting}"
    assert (
        camera.notes == ()
        and camera.at_gain(setting) is camera
        and camera.at_gain(None) is camera
    )


def test_the_conversion_gain_is_a_step_in_everything_that_the_sense_node_decides() -> None:
    """kTC noise √(k_B·T·C)/q with C = q/A_SN: five times the conversion gain, √5 times fewer electrons."""
    soft = EVEN.replace(**{"readout.reset": "hard"})
    for setting in (400, "hcg 400"):
        camera = soft.at_gain(setting)
        farads = ELEMENTARY_CHARGE_C / sense_gain_v_per_e(camera)
        ktc_e = math.sqrt(BOLTZMANN_J_PER_K * DARK.temperature_k * farads) / ELEMENTARY_CHARGE_C
        expected = math.hypot(ktc_e, SETTINGS[setting]["read_noise_e"])
        _, variance = pair(camera.replace(**{"adc.black_level_dn": 500}), 0.0)
        assert math.sqrt(variance - 1 / 12) / gain_dn_per_e(camera) == pytest.approx(
            expected, rel=TOLERANCE
        )


def test_fixed_patterns_are_the_same_at_every_setting_and_offsets_of_columns_keep_their_volts() -> (
    None
):
    camera = CAMERA.replace(**{"pixel.dsnu_e": 5.0, "readout.dsnu_row": 0.002})
    base = ms.fpn_maps(camera, (40, 60), serial=7)
    for setting in SETTINGS:
        at = camera.at_gain(setting)
        maps, volts = (
            ms.fpn_maps(at, (40, 60), serial=7),
            sense_gain_v_per_e(at) / sense_gain_v_per_e(camera),
        )
        for name in ("prnu", "dark_fpn", "dsnu_pixel_e"):
            np.testing.assert_array_equal(maps[name], base[name])
        for name in ("dsnu_col_e", "dsnu_row_e"):
            np.testing.assert_allclose(maps[name] * volts, base[name], rtol=1e-6)


def test_two_settings_share_no_temporal_noise_and_the_way_to_a_setting_does_not_count() -> None:
    """|ρ| < 5/√n; 400 and "hcg 400" have the same gain, so that shared noise would be a correlation of 1."""
    light = np.full((256, 256), 500.0)
    frames = {setting: ms.expose(light, EVEN, DARK, gain=setting) for setting in SETTINGS}
    codes = [one.digital.ravel() for one in frames.values()]
    codes.append(ms.expose(light, EVEN, DARK).digital.ravel())
    for k, one in enumerate(codes):
        for other in codes[:k]:
            assert abs(np.corrcoef(one, other)[0, 1]) < 5 / 256
    around = ms.expose(light, EVEN.at_gain(100).at_gain("hcg 400"), DARK, gain=400.0)
    np.testing.assert_array_equal(around.digital, frames[400].digital)
    assert around.first.key == frames[400].first.key != frames[100].first.key
    with pytest.raises(ms.InputError, match="the datasheet differs"):
        frames[400].minus(frames[100])


@pytest.mark.parametrize("engine", ["numpy", "drjit"])
def test_every_way_to_ask_for_a_setting_is_the_same_frame(engine: str) -> None:
    light, at = np.full((12, 16), 800.0), CAMERA.at_gain("hcg 400")
    options: Any = {"engine": engine, "serial": 3, "seed": 4}
    expected = ms.expose(light, at, DARK, **options).digital
    found = [ms.expose(light, CAMERA, DARK, gain="hcg 400", **options).digital]
    found += [next(ms.stream(light, CAMERA, DARK, gain="hcg 400", **options))[None]]
    found += [
        ms.Sensor(CAMERA, serial=3)
        .expose(light, DARK, gain="hcg 400", engine=engine, seed=4)
        .digital
    ]
    found += [ms.Sensor(at, serial=3).expose(light, DARK, engine=engine, seed=4).digital]
    for one in found:
        np.testing.assert_array_equal(one, expected)
    iso = [
        ms.expose(light, CAMERA, DARK, gain=x, **options).digital
        for x in (400, 400.0, "400", " 400 ")
    ]
    assert all(np.array_equal(one, iso[0]) for one in iso) and not np.array_equal(
        iso[0], expected
    )


def test_a_sensor_changes_its_setting_from_call_to_call() -> None:
    """The maps stay; frames of every setting are those of expose."""
    sensor, light = ms.Sensor(CAMERA, serial=3), np.full((12, 16), 800.0)
    for number, setting in enumerate((100, "hcg 400", 100, 400)):
        fresh = ms.expose(light, CAMERA, DARK, serial=3, gain=setting, first_frame=number)
        np.testing.assert_array_equal(
            sensor.expose(light, DARK, gain=setting).digital, fresh.digital
        )


def test_derivatives_are_those_of_the_setting() -> None:
    """One more photoelectron is K more DN, and the frame is that of expose."""
    light = np.full((32, 32), 800.0)
    frame = ms.differentiable(light, EVEN, ms.Exposure(0.1), "photons", gain=400).frame()
    np.testing.assert_array_equal(
        frame.codes,
        ms.expose(light, EVEN, ms.Exposure(0.1), gain=400, engine="drjit").digital[0],
    )
    assert frame.forward("photons").mean() == pytest.approx(1.0, rel=0.01)


def test_read_noise_has_the_shape_of_its_setting() -> None:
    """Share of pixels beyond 4 σ, of SciPy's Tukey-lambda law; 2 million pixels, 5 standard errors of the count."""
    shapes = {"100": 0.14, "400": -0.2}
    rungs = [
        {"iso": int(iso), "gain_dn_per_e": 20.0, "read_noise_e": 2.0, "read_noise_shape": x}
        for iso, x in shapes.items()
    ]
    tails = {
        "source_follower.read_noise_distribution": "tukey_lambda",
        "source_follower.read_noise_shape": 0.0,
    }
    camera = EVEN.replace(
        **{**tails, "adc.black_level_dn": 1000.0, "adc.bits": 14}, gains=rungs
    )
    for setting, shape in shapes.items():
        at = camera.at_gain(setting)
        assert (at.source_follower.read_noise_shape, at.notes) == (shape, ())
        dark = ms.expose(np.zeros((1000, 2000)), at, DARK, engine="numpy").digital - 1000.0
        assert dark.std() == pytest.approx(40, rel=0.01)
        expected = (
            2
            * stats.tukeylambda.sf(160.5 / 40 * stats.tukeylambda.std(shape), shape)
            * dark.size
        )
        assert (np.abs(dark) > 160).sum() == pytest.approx(
            expected, abs=5 * math.sqrt(expected)
        )


def test_light_is_metered_for_the_setting_and_remembers_it(
    light: Any, scene_file: Path, tmp_path: Path
) -> None:
    """Half the saturation, half the time; the irradiance of a render is exposed again as it was."""
    times = {
        one: ms.expose(light, CAMERA, "auto", gain=one).first.exposure.time_s
        for one in SETTINGS
    }
    ends = {one: saturation_e(CAMERA.at_gain(one)) for one in SETTINGS}
    assert ends[100] == pytest.approx(15_000) and ends[400] == pytest.approx(4095 - 66)
    for one in SETTINGS:
        assert times[one] / times[100] == pytest.approx(ends[one] / ends[100], rel=0.01)
    options: Any = {"spp": 4, "wavelength_nm": 550.0, "variant": "scalar_spectral"}
    taken = ms.capture(scene_file, CAMERA, ms.Exposure(0.01), gain="hcg 400", **options)
    assert taken.metadata["camera"]["gain"] == "hcg 400" == taken.frames.camera.gain
    taken.save(tmp_path / "out")
    file = str(tmp_path / "out" / "irradiance.exr")
    np.testing.assert_array_equal(ms.capture(file).frames.digital, taken.frames.digital)
    again = ms.capture(file, gain=100)
    assert again.frames.camera == CAMERA.at_gain("hcg 400").at_gain(100)
    rendered = ms.render(scene_file, CAMERA, ms.Exposure(0.01), gain=100, **options)
    assert rendered.rendered_for.camera == CAMERA.at_gain(100)


def test_a_camera_file_keeps_the_ladder_and_the_setting(tmp_path: Path) -> None:
    for camera in (CAMERA, CAMERA.at_gain(100), CAMERA.at_gain("hcg 400")):
        path = tmp_path / "mine.toml"
        path.write_text(camera.to_toml(), encoding="utf-8")
        assert ms.load_camera(path) == camera and ms.check_camera(path) == ()


REFUSED: dict[str, tuple[Any, str]] = {
    "unknown": (
        800,
        r"gain is '800'; the gain settings of konnik_table1 are 100, 400, hcg 400\.",
    ),
    "misspelt": ("hgc 400", "gain is 'hgc 400'; the gain settings"),
    "no setting": (True, "gain is True; pass an ISO number or the name"),
    "a list": ([400], r"gain is \[400\]; pass an ISO number"),
    "NaN": (float("nan"), "gain is 'nan'; the gain settings"),
    "below all": (-3, "gain is '-3'; the gain settings"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_setting_that_there_is_not_is_one_sentence(name: str) -> None:
    setting, said = REFUSED[name]
    for call in (CAMERA.at_gain, lambda x: ms.expose(np.ones((2, 2)), CAMERA, DARK, gain=x)):
        with pytest.raises(ms.InputError, match=said):
            call(setting)


def test_a_camera_without_a_ladder_says_so() -> None:
    with pytest.raises(
        ms.InputError,
        match=r"gain is '800', and bayer_2mp has no gain settings; add \[\[gains\]\]",
    ):
        ms.load_camera("bayer_2mp").at_gain(800)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no name": (
        {"gains": [{"gain_dn_per_e": 1.0, "read_noise_e": 1.0}]},
        "needs an iso",
    ),
    "two names": (
        {"gains": [{"iso": 100, "name": "a", "gain_dn_per_e": 1.0, "read_noise_e": 1.0}]},
        "either an iso or a name",
    ),
    "twice": ({"gains": [LADDER[0], LADDER[0]]}, "2 gain settings are called '100'"),
    "number and text": (
        {"gains": [LADDER[0], {**LADDER[2], "name": "100.0"}]},
        "2 gain settings are called '100'",
    ),
    "half a column": (
        {"gains": [LADDER[0], {"iso": 200, "gain_dn_per_e": 1.0, "read_noise_e": 1.0}]},
        "'100' has black_level_dn and '200' has none; give it in all or in none",
    ),
    "no gain": ({"gains": [{"iso": 100, "read_noise_e": 1.0}]}, "gain_dn_per_e is missing"),
    "negative": ({"gains": [{**LADDER[0], "gain_dn_per_e": -1.0}]}, "gain_dn_per_e is -1.0"),
    "shape of a normal": (
        {"gains": [{**LADDER[0], "read_noise_shape": 0.1}]},
        "gain setting '100': read_noise_shape is 0.1, and a normal read noise has none; .*; or unset gains",
    ),
    "shape beyond": (
        {
            "source_follower.read_noise_distribution": "tukey_lambda",
            "source_follower.read_noise_shape": 0.1,
            "gains": [{**LADDER[0], "read_noise_shape": -0.5}],
        },
        "gain setting '100': read_noise_shape is -0.5; that of tukey_lambda must be from -0.45 to 0.2",
    ),
    "by hand": ({"gain": "400"}, r"take camera\.at_gain\('400'\), or --gain 400"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_ladder_that_cannot_be_is_refused(name: str) -> None:
    changes, said = WRONG[name]
    with pytest.raises(ms.InputError, match=said):
        CAMERA.replace(**changes)


def test_a_camera_that_left_its_setting_says_so(tmp_path: Path) -> None:
    """Numbers that were changed since, and a setting that is written by hand, are notes; none that is not there."""
    changed = CAMERA.at_gain(400).replace(
        **{"adc.bits": 14, "source_follower.read_noise_e": 9.0}
    )
    assert [note.split(";")[0] for note in changed.notes] == [
        "gain is '400', whose gain_dn_per_e is 1, and the camera's is 4",
        "gain is '400', whose read_noise_e is 4.5, and the camera's is 9",
    ]
    assert CAMERA.at_gain(400).replace(gain=None).notes == ()
    path = tmp_path / "mine.toml"
    path.write_text(
        CAMERA.to_toml().replace('# gain = "800"', 'gain = "400"'), encoding="utf-8"
    )
    found = ms.check_camera(path)
    assert (
        len(found) == 5
        and {one.level for one in found} == {"warning"}
        and {one.field for one in found} == {"gain"}
    )
    path.write_text(
        CAMERA.to_toml().replace('# gain = "800"', 'gain = "800"'), encoding="utf-8"
    )
    (error,) = ms.check_camera(path)
    assert (
        error.level == "error"
        and "gain is '800'; its settings are 100, 400, hcg 400" in error.text
    )


def test_the_command_line_takes_settings(
    light: Any, tmp_path: Path, cli: Callable[..., Any]
) -> None:
    """--gain and --iso are one; --set overrules a setting; an unknown setting exits with 2 and writes nothing."""
    file, source = tmp_path / "mine.toml", tmp_path / "light.exr"
    file.write_text(CAMERA.to_toml(), encoding="utf-8")
    write_irradiance_exr(source, light)
    found = {}
    for flag, value in (("--gain", "400"), ("--iso", "400"), ("--gain", "hcg 400")):
        out = tmp_path / f"out{len(found)}"
        done = cli(
            "expose", source, "-o", out, "--camera", file, "--exposure-s", "0.001", flag, value
        )
        assert done.exit_code == 0 and f"at gain {value}" in done.stdout, done.stderr
        found[flag, value] = json.loads((out / "frame.json").read_text("utf-8"))
    assert found["--gain", "400"]["camera"] == found["--iso", "400"]["camera"]
    assert found["--gain", "hcg 400"]["camera"]["gain"] == "hcg 400"
    assert found["--gain", "hcg 400"]["image"]["black_level_dn"] == 80
    set_too = ("--set", "adc.black_level_dn=99", "--verbose")
    done = cli(
        "expose",
        source,
        "-o",
        tmp_path / "set",
        "--camera",
        file,
        "--exposure-s",
        "1",
        "--iso",
        "400",
        *set_too,
    )
    assert (
        done.exit_code == 0
        and "black_level_dn is 66, and the camera's is 99" in done.stdout.replace("\n", " ")
    )
    done = cli("expose", source, "-o", tmp_path / "no", "--camera", file, "--iso", "800")
    assert (
        done.exit_code == 2
        and "the gain settings of konnik_table1 are 100, 400, hcg 400" in done.stderr
    )
    assert not (tmp_path / "no").exists()


def test_the_settings_of_a_camera_are_shown(tmp_path: Path, cli: Callable[..., Any]) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(CAMERA.at_gain(100).to_toml(), encoding="utf-8")
    shown = cli("cameras", "show", file).stdout
    for said in ("gain setting", "100 (set)", "hcg 400", "sense_gain_uv_per_e", "0.25"):
        assert said in shown
    assert len(json.loads(cli("cameras", "show", file, "--json").stdout)["gains"]) == 3
    assert "gains" not in cli("cameras", "show", "konnik_table1").stdout


def test_stages_of_ones_own_stay_at_every_setting() -> None:
    class Fixed(ms.Stage):
        domain = "volts"

        def sample(self, signal: Any, frame: Any) -> Any:
            return signal + 0.01

    camera = CAMERA.with_stage(Fixed(), after="sense_node").at_gain(400)
    assert len(camera.added) == 1
    shift = 0.01 / sense_gain_v_per_e(camera)
    dark = ms.expose(
        np.zeros(SHAPE), camera.replace(**{"readout.dsnu_col": 0.0}), DARK
    ).digital.mean()
    assert dark == pytest.approx(66 + shift, abs=5 * 4.5 / 512)
