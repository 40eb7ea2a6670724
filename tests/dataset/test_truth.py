"""Facts on samples are true: equal settings have one key, different settings have different keys."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.datasets import SCENES, plan_of, samples_of

import mitsuba_sensor as ms
from mitsuba_sensor.dataset.checks import checked_counts
from mitsuba_sensor.dataset.forecast import forecast
from mitsuba_sensor.dataset.keys import key_of, seed_of
from mitsuba_sensor.dataset.plan import PlannedSample
from mitsuba_sensor.dataset.run import run
from mitsuba_sensor.render.variants import fastest_variant
from mitsuba_sensor.sensor.checks import as_photons
from mitsuba_sensor.sensor.metering import electrons_of

OWN_LENS = """<scene version="3.0.0">
  <sensor type="camera"><float name="focal_length_mm" value="20"/><float name="f_number" value="8"/>
    <float name="focus_distance_m" value="3"/>
    <film type="photosensor"><string name="camera" value="konnik_table1"/><integer name="width" value="16"/>
      <integer name="height" value="16"/></film></sensor>
  <emitter type="constant"><spectrum name="radiance" value="1e-4"/></emitter>
</scene>"""


def samples(roots: Path = SCENES, **changes: Any) -> list[PlannedSample]:
    plan = plan_of(roots, **changes)
    checked_counts(plan)
    return samples_of([*plan.tasks()])


def keys(**changes: Any) -> list[str]:
    return [one.key for one in samples(**changes)]


def made(folder: Path, roots: Path = SCENES, **changes: Any) -> ms.Dataset:
    found = run(plan_of(roots, **changes), folder, workers=0, progress=False)
    assert not found.failed, found.failed
    return ms.Dataset(folder)


@pytest.fixture
def own_lens(tmp_path: Path) -> Path:
    (tmp_path / "own.xml").write_text(OWN_LENS)
    return tmp_path


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"grid": {"exposure_s": [1]}}, {"grid": {"exposure_s": [1.0]}}),
        ({"grid": {"exposure_s": [0]}}, {"grid": {"exposure_s": [-0.0]}}),
        (
            {"grid": {"parameters.radiance": [1e-4]}},
            {"grid": {"parameters.radiance": ["0.0001"]}},
        ),
        ({"grid": {"f_number": [2]}}, {"grid": {"camera.lens.f_number": [2.0]}}),
        ({"grid": {"serial": [1], "frames": [1], "exposure_ev": [0.0], "repetition": [0]}}, {}),
        *(
            (
                {"cameras": [{"camera": "sony_a7s2"}], "grid": {"gain": [400]}},
                {"cameras": [{"camera": "sony_a7s2"}], "grid": {"gain": [gain]}},
            )
            for gain in ("400", 400.0)
        ),
        (
            {
                "cameras": [{"camera": "konnik_table1", "set": {"adc": {"bits": 12}}}]
            },  # adc.bits = 12 without quotes
            {"cameras": [{"camera": "konnik_table1", "set": {"adc.bits": 12}}]},
        ),
    ],
)
def test_the_same_settings_have_the_same_key(
    one: dict[str, Any], other: dict[str, Any]
) -> None:
    assert keys(**one) == keys(**other)


def test_too_many_samples_are_refused_before_they_are_listed() -> None:
    grid = {
        name: [*range(1000)] for name in ("temperature_k", "repetition", "serial", "frames")
    }
    grid["frames"] = [*range(1, 1001)]
    with pytest.raises(
        ms.InputError, match="1000000000000 samples; it can have at most 1000000000"
    ):
        samples(grid=grid)


def test_a_camera_that_a_dataset_names_has_nothing_of_the_scene(
    own_lens: Path, tmp_path: Path
) -> None:
    """The scene has f/8; the camera has its own f-number, and doubling it quarters the light: the cos⁴ law in the
    form (1/N)², within 2 % (five standard errors of the renders)."""
    usual = ms.load_camera("konnik_table1").lens.f_number
    cameras = [
        {"camera": "konnik_table1", "name": "own"},
        {"camera": "konnik_table1", "name": "set", "set": {"lens": {"f_number": 2 * usual}}},
    ]
    common: dict[str, Any] = {
        "scenes": [{"name": "own", "file": "own.xml"}],
        "outputs": ["electrons"],
    }
    found = made(
        tmp_path / "out", own_lens, cameras=cameras, grid={"exposure_s": [0.01]}, **common
    )
    own, stopped = (
        next(one for one in found if one.values["camera"] == name) for name in ("own", "set")
    )
    ratio = own.read("electrons").mean() / stopped.read("electrons").mean()
    assert ratio == pytest.approx(4, rel=0.02)
    notes = own.facts["light"]["notes"]
    assert any(note.startswith("ignored the scene's lens.f_number") for note in notes)


def test_a_varied_focus_is_that_of_each_sample(own_lens: Path) -> None:
    cameras = [{"camera": "konnik_table1", "set": {"lens": {"prescription": "double_gauss"}}}]
    found = samples(
        roots=own_lens,
        scenes=[{"name": "own", "file": "own.xml"}],
        cameras=cameras,
        grid={"focus_m": [1.0, 2.0]},
    )
    assert [one.config["camera"]["lens"]["focus_m"] for one in found] == [1.0, 2.0]


@pytest.mark.exhaustive
def test_light_in_a_cube_is_for_cameras_of_any_quantum_efficiency(tmp_path: Path) -> None:
    """Half the efficiency gives exactly half the electrons of the same light; the error names its camera; a camera with
    colour filters knows the illuminant. Each is the camera's own render within its error."""
    low_high = {"quantum_efficiency.wavelengths_nm": [400, 700]}
    cameras = [
        {
            "camera": "konnik_table1",
            "name": str(qe),
            "set": {"quantum_efficiency.value": qe, **low_high},
        }
        for qe in (0.6, 0.3)
    ] + [{"camera": "bayer_2mp"}]
    outputs = ["raw", "electrons", "irradiance"]
    render = {"spp": 128, "width": 16, "spectral": "cube"}
    scenes, grid = [{"name": "cornell", "file": "cornell_box.xml"}], {"exposure_s": [0.01]}
    high, low, colour = made(
        tmp_path / "out",
        cameras=cameras,
        outputs=outputs,
        render=render,
        scenes=scenes,
        grid=grid,
    )
    np.testing.assert_allclose(high.read("electrons"), 2 * low.read("electrons"), rtol=1e-5)
    assert (
        high.facts["electrons_error_of"]
        == low.facts["electrons_error_of"]
        == "a detector that is flat over the band"
    )
    (tmp_path / "light.exr").write_bytes(colour.view_files["irradiance.exr"])
    light = ms.read_irradiance(tmp_path / "light.exr")
    assert light.rendered_for is not None and light.rendered_for.illuminant is not None
    camera, exposure = ms.load_camera("bayer_2mp"), ms.Exposure(0.01)
    own = ms.render(SCENES / "cornell_box.xml", camera, exposure, spp=128, width=16, seed=5)
    expected = electrons_of(
        as_photons(ms.collect(own, camera, exposure), camera), camera, exposure
    )
    assert colour.read("electrons").mean() == pytest.approx(expected.mean(), rel=0.05)


def test_a_plan_estimates_the_render_noise_of_each_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in the run, within 30 % (32 of 64 samples of a small image); files are only in the user's cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    efficiencies = {"dull": 0.02, "keen": 0.9}
    tables: dict[str, Any] = {
        "scenes": [{"name": "cornell", "file": "cornell_box.xml"}],
        "cameras": [
            {"camera": "konnik_table1", "name": x, "set": {"quantum_efficiency.value": qe}}
            for x, qe in efficiencies.items()
        ],
        "grid": {"exposure_s": [0.01]},
        "render": {"spp": 64, "width": 20, "wavelength_nm": 550},
        "outputs": ["raw", "aovs"],
    }
    plan = plan_of(**tables)
    estimate = forecast(plan, checked_counts(plan))
    assert not [*(tmp_path / "cache" / "mitsuba-sensor").iterdir()]
    monkeypatch.undo()
    ratios = estimate.noise_ratios
    for sample in made(tmp_path / "out", **tables):
        ratio = sample.facts["light"]["noise_ratio_median"]
        assert ratios[sample.values["camera"]] == pytest.approx(ratio, rel=0.3)
    assert estimate.noise_ratio == ratios["keen"] > 3 * ratios["dull"]


def test_a_sample_is_a_render_and_an_exposure_of_its_own(tmp_path: Path) -> None:
    """ms.render with the seed of the view and ms.expose with the seed of the sample recreate it from the settings."""
    grid = {
        "exposure_s": [0.01, 0.02],
        "f_number": [2.0],
        "gain": [800],
        "temperature_k": [313],
    }
    cameras = [{"camera": "sony_a7s2", "set": {"pixel.prnu": 0.02}, "without": ["shot_noise"]}]
    scenes = [
        {"name": "cornell", "file": "cornell_box.xml", "parameters": {"lamp_cd_per_m2": 500}}
    ]
    found = made(tmp_path / "out", cameras=cameras, scenes=scenes, grid=grid)
    camera = (
        ms.load_camera("sony_a7s2")
        .replace(**{"pixel.prnu": 0.02, "lens.f_number": 2.0})
        .without("shot_noise")
    )
    exposure = ms.Exposure(0.01, 313)
    options: dict[str, Any] = {
        "spp": 16,
        "width": 16,
        "parameters": {"lamp_cd_per_m2": 500},
        "repeatable": True,
    }
    seed = seed_of(key_of(found[0].facts["view"]["config"]))
    options["variant"] = fastest_variant(
        "llvm"
    ).name  # that of every dataset, whatever is set in this process
    light = ms.render(
        SCENES / "cornell_box.xml",
        camera.at_gain(800),
        exposure,
        seed=seed,
        denoise=False,
        **options,
    )
    for sample, time_s in zip(found, (0.01, 0.02), strict=True):
        frames = ms.expose(
            light,
            camera,
            ms.Exposure(time_s, 313),
            serial=1,
            seed=sample.facts["seeds"]["seed"],
            gain=800,
        )
        np.testing.assert_array_equal(sample.read("raw"), frames.digital)
        assert sample.facts["system_gain_dn_per_e"] == camera.at_gain(800).system_gain_dn_per_e
