"""Cameras from files of other programs: frames of the imported camera have the noise that the file says.

Everything is seeded; comparisons of a variance of N numbers ask for 5 standard errors, √(2/N) each.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from scipy import stats

import mitsuba_sensor as ms
from mitsuba_sensor.output.importers.import_camera import import_camera
from mitsuba_sensor.stages.gains import gain_dn_per_e

SHAPE = (400, 500)
FLAT = {"pixel.prnu": 0.0, "readout.dsnu_col": 0.0, "dark_current.rate_e_per_s": 0.0}
TUNING = {
    "version": 2.0,
    "target": "bcm2835",
    "algorithms": [
        {"rpi.black_level": {"black_level": 4096}},
        {"rpi.noise": {"reference_constant": 0, "reference_slope": 2.767}},
        {"rpi.awb": {}},
        {"rpi.ccm": {}},
    ],
}
"""The parts that are read of libcamera's src/ipa/rpi/vc4/data/imx477.json, commit 26bfadc."""
TABLE = {
    "SonyA7S2_100": {"Kmax": 0.09563, "lam": 0.14875287, "sigGs": 1.0067395, "sigTL": 0.70181876, "sigR": 0.1391465,
                     "wp": 16383, "bl": 512},
    "SonyA7S2_2000": {"Kmax": 1.9126, "lam": -0.012963797, "sigGs": 2.653871, "sigTL": 1.4356787, "sigR": 0.33124214,
                      "wp": 16383, "bl": 512},
    "SonyA7S2_6400": {"Kmax": 6.12032, "lam": -0.07517104, "sigGs": 7.1163535, "sigTL": 3.4502964, "sigR": 0.7218788,
                      "wp": 16383, "bl": 512},
}  # fmt: skip
"""Three rows of the calibration of PMN (Feng et al., ACM MM 2022), data_process/process."""


def written(folder: Path, name: str, data: Any) -> Path:
    path = folder / name
    path.write_text(data if isinstance(data, str) else json.dumps(data), "utf-8")
    return path


def measured(camera: ms.Camera, photoelectrons: float, frames: int = 2) -> tuple[float, float]:
    """Mean and temporal variance of flat frames, in the colour that the reference wavelength suits best [DN, DN²]."""
    camera = camera.replace(
        **{key: x for key, x in FLAT.items() if key != "readout.dsnu_col" or x != 0.0}
    )
    qe = camera.qe([camera.quantum_efficiency.reference_nm])[:, 0]
    light = np.full(SHAPE, photoelectrons / qe.max())
    found = ms.expose(light, camera, ms.Exposure(0.01), frames=frames).digital.astype(
        np.float64
    )
    found = found[:, camera.filter_index(SHAPE) == qe.argmax()]
    return found.mean(), 0.5 * np.var(found[0] - found[1])


@pytest.mark.parametrize("bits", [10, 12])
def test_frames_of_a_tuned_sensor_have_the_slope_of_rpi_noise(
    tmp_path: Path, bits: int
) -> None:
    """σ = slope·√value in the scale of 16 bits, above the read noise and the rounding."""
    like = ms.load_camera("bayer_2mp").replace(
        **{"adc.bits": bits, "source_follower.read_noise_e": 2.0}
    )
    camera = import_camera(written(tmp_path, "imx477.json", TUNING), like)
    scale = 2.0 ** (16 - bits)
    assert camera.adc.black_level_dn * scale == 4096
    assert len(camera.quantum_efficiency.curves) == 3
    assert gain_dn_per_e(camera) * scale == pytest.approx(2.767**2, rel=1e-5)
    mean, variance = measured(camera, 3000.0)
    shot = variance - 1 / 12 - (2.0 * gain_dn_per_e(camera)) ** 2
    slope = np.sqrt(shot / (mean - camera.adc.black_level_dn) * scale)
    assert slope == pytest.approx(2.767, rel=0.5 * 5 * np.sqrt(2 / 1e5) + 2e-3)


def test_a_constant_of_rpi_noise_is_the_noise_of_darkness_and_shading_is_that_of_the_table(
    tmp_path: Path,
) -> None:
    """The constant is in DN at 16 bits; a table of 1/cos⁴ comes back as the cos⁴ of the image heights."""
    like = ms.load_camera("bayer_2mp")
    width, height = 1920 * 5.86e-3, 1200 * 5.86e-3
    x, y = (((np.arange(n) + 0.5) / n - 0.5) * side for n, side in ((16, width), (12, height)))
    lut = (1 + (x[None] ** 2 + y[:, None] ** 2) / 64) ** 2
    algorithms = [
        {"rpi.noise": {"reference_constant": 40.0, "reference_slope": 2.0}},
        {"rpi.alsc": {"luminance_lut": lut.ravel().tolist()}},
    ]
    camera = import_camera(written(tmp_path, "a.json", {"algorithms": algorithms}), like)
    _, variance = measured(camera, 0.0)
    assert np.sqrt(variance - 1 / 12) * 16 == pytest.approx(40.0, rel=0.02)
    heights = np.array(camera.lens.relative_illumination_heights_mm)
    expected = (1 + heights**2 / 64) ** -2.0
    np.testing.assert_allclose(
        camera.lens.relative_illumination[:-1], expected[:-1] / expected[0], atol=0.03
    )


def dng(path: Path, iso: int, s: float, o: float) -> Path:
    """A DNG of 14 bits whose tags say this noise."""
    extra = [
        (51041, "d", 6, (s, o) * 3, True), (50714, "H", 1, 512, True), (50717, "H", 1, 16383, True),
        (50708, "s", 0, "Example 1", True), (34855, "H", 1, iso, True), (50706, "B", 4, (1, 4, 0, 0), True),
    ]  # fmt: skip
    tifffile.imwrite(
        path,
        np.full((40, 60), 512, np.uint16),
        photometric=32803,
        extratags=extra,
        metadata=None,
    )
    return path


def test_frames_of_a_dng_have_the_variance_of_its_noise_profile(tmp_path: Path) -> None:
    """Var = S·x + O of the signal between black and white, in darkness and at 40 %."""
    s, o = 4e-5, 3e-7
    camera = import_camera(dng(tmp_path / "a.dng", 400, s, o))
    assert (camera.name, camera.sensor.columns, camera.sensor.rows, camera.adc.bits) == (
        "Example 1",
        60,
        40,
        14,
    )
    camera = camera.replace(**{"sensor.columns": SHAPE[1], "sensor.rows": SHAPE[0]})
    span = 16383 - 512
    for light_e in (0.0, 0.4 / s):
        mean, variance = measured(camera, light_e)
        x = (mean - 512) / span
        assert (variance - 1 / 12) / span**2 == pytest.approx(
            s * x + o, rel=5 * np.sqrt(2 / 1e5) + 2e-3
        )


def test_frames_of_a_calibration_have_its_gain_and_the_noise_of_pixels_and_rows(
    tmp_path: Path,
) -> None:
    """ISO 6400 of PMN's Sony A7S II: σ of the normal law that they fitted too is ours to 1.5 %; the tails."""
    camera = import_camera(
        written(tmp_path, "a7s2.json", {"SonyA7S2_6400": TABLE["SonyA7S2_6400"]})
    )
    row = TABLE["SonyA7S2_6400"]
    assert (camera.adc.bits, camera.adc.black_level_dn) == (14, 512)
    assert gain_dn_per_e(camera) == pytest.approx(row["Kmax"], rel=1e-5)
    dark = ms.expose(
        np.zeros(SHAPE),
        camera.replace(**FLAT | {"readout.dsnu_col": 0.0}),
        ms.Exposure(0.0),
        frames=2,
    )
    off = (dark.digital[0].astype(float) - dark.digital[1]) / np.sqrt(2)
    assert off.std() == pytest.approx(np.hypot(row["sigGs"], row["sigR"]), rel=0.015)
    assert off.mean(axis=1).std() == pytest.approx(
        np.hypot(row["sigR"], off.std() / np.sqrt(SHAPE[1])), rel=0.15
    )
    assert camera.source_follower.read_noise_shape == pytest.approx(row["lam"], rel=1e-5)
    one = dark.digital[0] - 512.0
    law = stats.tukeylambda(row["lam"], scale=row["sigTL"])
    assert np.mean(np.abs(one) > 25) == pytest.approx(2 * law.sf(25.5), rel=0.25)


def test_every_iso_of_a_calibration_is_a_gain_setting(tmp_path: Path) -> None:
    """Each is the camera of that row alone; numbers that one row has not are in none."""
    camera = import_camera(written(tmp_path, "all.json", TABLE))
    assert [one.label for one in camera.gains] == [
        "100",
        "2000",
        "6400",
    ] and camera.gain is None
    for name, row in TABLE.items():
        alone = import_camera(written(tmp_path, "one.json", {name: row}))
        at = camera.at_gain(name.split("_")[1])
        assert alone.gains == () and gain_dn_per_e(at) == pytest.approx(
            gain_dn_per_e(alone), rel=1e-5
        )
        assert (at.source_follower, at.readout) == (alone.source_follower, alone.readout)
        assert at.source_follower.read_noise_shape == pytest.approx(row["lam"], rel=1e-5)
    without = {**TABLE["SonyA7S2_100"], "iso": 100}
    del without["lam"], without["bl"]
    camera = import_camera(
        written(tmp_path, "some.json", [without, {**TABLE["SonyA7S2_6400"], "iso": 6400}])
    )
    assert (
        {one.read_noise_shape for one in camera.gains}
        == {one.black_level_dn for one in camera.gains}
        == {None}
    )


def test_the_shipped_ladder_of_the_sony_a7s2_is_its_calibration(tmp_path: Path) -> None:
    """To the four digits of the file; so where this table has a row."""
    shipped = {one.label: one for one in ms.load_camera("sony_a7s2").gains}
    for one in import_camera(written(tmp_path, "a7s2.json", TABLE)).gains:
        for field, value in one.model_dump(
            exclude={"name", "full_well_e"}, exclude_none=True
        ).items():
            near = pytest.approx(
                value, rel=5e-4, abs=5e-4 if field == "read_noise_shape" else 0
            )
            assert getattr(shipped[one.label], field) == near, (one.label, field)


def test_dngs_of_several_iso_numbers_are_a_ladder(tmp_path: Path) -> None:
    """K = S·(white − black), σ_read = √O/S of each file."""
    profiles = {100: (4e-5, 3e-7), 800: (3e-4, 2e-6)}
    camera = import_camera(
        [dng(tmp_path / f"{iso}.dng", iso, *both) for iso, both in profiles.items()]
    )
    for iso, (s, o) in profiles.items():
        at = camera.at_gain(iso)
        assert gain_dn_per_e(at) == pytest.approx(s * (16383 - 512), rel=1e-5)
        assert at.source_follower.read_noise_e == pytest.approx(np.sqrt(o) / s, rel=1e-5)
        assert at.adc.black_level_dn == 512


REPORT = """<results><sensitivity><K><Short>System Gain</Short><Value>0.25</Value></K><QE><Value>62.5</Value></QE>
<sigma_d><Value>6.4</Value></sigma_d><u_e_sat><Value>12000</Value></u_e_sat></sensitivity>
<dark_current><u_I_mean><Value>3.5</Value></u_I_mean></dark_current>
<spatial><PRNU1288><Value>0.7</Value></PRNU1288><DSNU1288><Value>2.4</Value></DSNU1288></spatial></results>"""


def test_an_emva_report_gives_back_its_own_figures(tmp_path: Path) -> None:
    """K by the photon transfer of its frames, σ_d and the saturation; QE as it is, and falling towards 1000 nm."""
    camera = import_camera(written(tmp_path, "r.xml", REPORT))
    qe = camera.qe([camera.quantum_efficiency.reference_nm, 1000.0])[0]
    assert qe[0] == 0.625 and 0 < qe[1] < 0.05 and camera.pixel.full_well_e == 12000
    assert (camera.pixel.prnu, camera.dark_current.rate_e_per_s) == (0.007, 3.5)
    assert camera.readout.dsnu_col * camera.pixel.full_well_e == pytest.approx(2.4)
    (dark, noise), (bright, variance) = (measured(camera, light_e) for light_e in (0.0, 6000.0))
    assert (variance - noise) / (bright - dark) == pytest.approx(
        0.25, rel=5 * np.sqrt(2 / 2e5) + 2e-3
    )
    assert np.sqrt(noise - 1 / 12) / 0.25 == pytest.approx(6.4, rel=0.015)
    plain = "<results><inverse_K>4</inverse_K><sigma_d>6.4</sigma_d></results>"
    assert gain_dn_per_e(import_camera(written(tmp_path, "p.xml", plain))) == pytest.approx(
        0.25, rel=1e-5
    )


PRESET = """
name = "Example sCMOS"
sensor_type = "SCMOS"
resolution = [300, 400]
pixel_size_um = 6.5
full_well_e = 18000.0
bit_depth = 16
gain_e_per_adu = 0.3
bias_offset_adu = 100.0
read_noise_e = 1.4
dark_current_e_per_s = 0.2
dark_current_ref_temp_c = -10.0
dark_current_doubling_temp_c = 6.0
nonlinearity = 0.01
[qe_curve]
wavelength_nm = [400.0, 550.0, 900.0]
qe = [0.6, 0.95, 0.3]
"""


def test_a_preset_of_getframes_is_the_same_camera(tmp_path: Path) -> None:
    """Gain, temperature and QE in our units; what we have no field for is said."""
    camera = import_camera(written(tmp_path, "preset.toml", PRESET))
    assert (camera.sensor.rows, camera.sensor.columns, camera.filter_names) == (
        300,
        400,
        ("mono",),
    )
    assert gain_dn_per_e(camera) == pytest.approx(1 / 0.3, rel=1e-5)
    assert camera.dark_current.at_temperature_k == pytest.approx(263.15)
    np.testing.assert_allclose(camera.qe([400.0, 550.0, 900.0])[0], [0.6, 0.95, 0.3])
    assert "ignored: nonlinearity" in camera.description
    assert camera.source_follower.read_noise_e == 1.4


CCD = PRESET.replace("SCMOS", "CCD")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("t.json", TUNING),
        ("a.json", TABLE),
        ("r.xml", REPORT),
        ("p.toml", PRESET),
        ("c.toml", CCD),
    ],
)
def test_an_imported_camera_is_a_camera_file_without_faults_and_every_number_has_a_source(
    tmp_path: Path, name: str, data: Any
) -> None:
    """It loads to an equal camera; each source names the file, or says what is assumed."""
    camera = import_camera(written(tmp_path, name, data))
    file = written(tmp_path, "camera.toml", camera.to_toml())
    assert ms.load_camera(file) == camera
    assert not ms.check_camera(file), ms.check_camera(file)
    assert all(
        text.startswith((f"{name}: ", "assumed: ")) for text in camera.sources.values()
    ), camera.sources


def tuning(*algorithms: Any) -> Any:
    return {"algorithms": list(algorithms)}


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.doc", "", "libcamera"),
        ("a.json", "{", "JSON"),
        ("a.json", [], "algorithms"),
        ("a.json", tuning({"rpi.lux": {}}), "reference_slope rpi.lux"),
        ("a.json", tuning({"rpi.noise": {"reference_slop": 2}}), "reference_slope reference_slop"),
        ("a.toml", 'sensor_type = "CMOS"\nread_noise = 2.0', "read_noise_e"),
        ("a.json", tuning({"rpi.noise": {"reference_slope": -1}}), "reference_slope -1"),
        ("a.json", tuning({"rpi.noise": {"reference_slope": 2}}, {"rpi.alsc": {"luminance_lut": [1]}}), "192"),
        ("a.json", {"x_100": {"lam": 0.1}}, "'x_100' siggs"),
        ("a.json", {"x_100": {"K": "big", "sigGs": 1}}, "K 'big'"),
        ("a.csv", "iso,K\n", "iso sigGs"),
        ("a.xml", "<a>", "XML"),
        ("a.xml", "<a><QE>60</QE></a>", "K sigma_d"),
        ("a.toml", "x = 1", "sensor_type gain_e_per_adu"),
        ("a.toml", PRESET.replace("SCMOS", "EMCCD"), "EMCCD"),
        ("a.dng", "no", "DNG"),
    ],
)  # fmt: skip
def test_a_bad_file_is_one_sentence_with_file_value_and_a_way_out(
    tmp_path: Path, name: str, data: Any, words: str
) -> None:
    with pytest.raises(ms.InputError) as error:
        import_camera(written(tmp_path, name, data))
    said = str(error.value)
    assert all(word in said for word in (name, *words.split())) and said[-1] in ".)?", said


def test_missing_files_and_several_files_are_refused(tmp_path: Path) -> None:
    one = written(tmp_path, "a.json", TUNING)
    files = ([], [one, one], tmp_path / "none.json", tmp_path / "none.npy", "getframes:none")
    for given, said in zip(files, ("files", "2", "none", "none", "getframes"), strict=True):
        with pytest.raises(ms.InputError, match=said):
            import_camera(given)


PROFILE = {
    "Kmin": np.float64(0.0939),
    "Kmax": np.float64(6.01),
    "G_shape": np.array([0.11, 0.0, -0.09, -0.13]),
    "color_bias": np.zeros((3, 4)),
    "Profile-1": {
        "G_scale": {"slope": np.float64(0.462), "bias": 0.5657, "sigma": 0.263},
        "g_scale": {"slope": 0.5407, "bias": 1.2185, "sigma": 0.25},
        "R_scale": {"slope": 0.5275, "bias": -0.5917, "sigma": 0.25},
    },
}
"""As ELD's release has them, of the Sony A7S2; numbers to three or four digits."""


def test_a_noise_profile_of_eld_becomes_gain_settings_on_its_lines(tmp_path: Path) -> None:
    path = tmp_path / "SonyA7S2_params.npy"
    np.save(path, np.array(PROFILE, dtype=object), allow_pickle=True)
    camera = import_camera(path)
    assert [gain.label for gain in camera.gains] == [str(100 * 2**k) for k in range(7)]
    assert gain_dn_per_e(camera) == pytest.approx(0.0939, rel=1e-5)
    assert camera.adc.bits == 14 and camera.adc.black_level_dn == 800
    for field in ("adc.bits", "adc.black_level_dn"):
        assert camera.sources[field].startswith("assumed: the program of ELD")
    given = ms.load_camera("bayer_2mp").replace(**{"adc.bits": 12, "adc.black_level_dn": 64.0})
    asked = import_camera(path, like=given)
    assert asked.adc.bits == 12 and asked.adc.black_level_dn == 64
    assert asked.gains[3].black_level_dn == 64
    top = camera.at_gain("6400")
    gain = gain_dn_per_e(top)
    assert gain == pytest.approx(6.01, rel=1e-5)
    shape = -0.045  # the median
    assert top.source_follower.read_noise_shape == pytest.approx(shape)
    scale = np.exp(0.462 * np.log(6.01) + 0.5657)
    noise_dn = stats.tukeylambda.std(shape) * scale
    read_dn = top.source_follower.read_noise_e * gain
    assert read_dn**2 + 1 / 12 == pytest.approx(noise_dn**2, rel=1e-4)
    row_dn = np.exp(0.5275 * np.log(6.01) - 0.5917)
    assert top.readout.row_noise_e * gain == pytest.approx(row_dn, rel=1e-4)


def profile_file(folder: Path, value: Any) -> Path:
    array = np.empty((), dtype=object)
    array[()] = value
    np.save(folder / "a.npy", array, allow_pickle=True)
    return folder / "a.npy"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({"Kmin": 1.0}, "Kmax"),
        ([1, 2], "list"),
        ({**PROFILE, "Kmax": "much"}, "'much'"),
        ({**PROFILE, "Profile-1": {}}, "G_scale"),
    ],
)
def test_what_is_no_profile_is_refused(value: Any, said: str, tmp_path: Path) -> None:
    with pytest.raises(ms.InputError, match=said):
        import_camera(profile_file(tmp_path, value))


CALLS = {
    "REDUCE": b"cbuiltins\nprint\n(X\x04\0\0\0oopstR.",
    "OBJ": b"(cbuiltins\nprint\nX\x04\0\0\0oopso.",
    "INST": b"(X\x04\0\0\0oopsibuiltins\nprint\n.",
    "NEWOBJ": b"cbuiltins\nprint\n(X\x04\0\0\0oopst\x81.",
    "NEWOBJ_EX": b"cbuiltins\nprint\n(X\x04\0\0\0oopst}\x92.",
    "STACK_GLOBAL": b"X\x08\0\0\0builtinsX\x05\0\0\0print\x93(X\x04\0\0\0oopstR.",
    "PERSID": b"Poops\n.",
    "EXT1": b"\x82\x01)R.",
    "BUILD of a class": b"cnumpy\ndtype\n}X\x05\0\0\0orderX\x01\0\0\0>sb.",
    "doubled 40 times": b"(K\x01l" + b"".join(
        b"q" + bytes([k]) + b"(h" + bytes([k]) + b"h" + bytes([k]) + b"l" for k in range(40)
    ) + b".",
    "a list of itself": b"]q\x00h\x00a.",
    "object 2 147 483 646": b"]r\xfe\xff\xff\x7f.",
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_no_code_of_a_pickle_calls_anything_or_takes_the_memory(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = profile_file(tmp_path, {})
    path.write_bytes(path.read_bytes()[:128] + b"\x80\x04" + CALLS[name])
    with pytest.raises(ms.InputError, match=r"a\.npy"):
        import_camera(path)
    assert "oops" not in capfd.readouterr().out


@pytest.mark.parametrize("seed", range(10))
def test_broken_bytes_of_a_profile_are_refused(seed: int, tmp_path: Path) -> None:
    """Ten files with 12 bytes changed, cut somewhere: a camera or one sentence, nothing else."""
    rng = np.random.default_rng(seed)
    path = profile_file(tmp_path, PROFILE)
    data = bytearray(path.read_bytes())
    for place in rng.integers(100, len(data), 12):
        data[place] = rng.integers(256)
    path.write_bytes(data[: rng.integers(200, len(data) + 1)])
    with contextlib.suppress(ms.InputError):
        import_camera(path)
