"""The command fit: a folder of frames becomes a camera file, maps and a page, or nothing at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.camera.figures import saturation_e
from mitsuba_sensor.cli import app
from mitsuba_sensor.files.npz import read_fpn_maps
from mitsuba_sensor.lab.frames.bench import read_bench, readouts_of_bench
from mitsuba_sensor.stages.gains import gain_dn_per_e

LEVELS = (0.02, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0, 1.2)
CAMERA = ms.load_camera("konnik_table1").replace(
    **{
        "sensor.rows": 40,
        "sensor.columns": 48,
        "adc.black_level_dn": 64.0,
        "readout.row_noise_e": 5.0,
    }
)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bias, dark and flat frames of a small camera, with a manifest."""
    folder = tmp_path_factory.mktemp("bench")
    lines = ["bits = 12", "wavelength_nm = 550"]

    def take(name: str, photons: float, time_s: float, count: int, seed: int) -> None:
        made = ms.expose(photons, CAMERA, ms.Exposure(time_s), frames=count, seed=seed)
        np.save(folder / f"{name}.npy", made.digital)
        about = f'[[stack]]\nfiles = "{name}.npy"\nkind = "{name[:4]}"\nexposure_s = {time_s}'
        lines.append(f"{about}\ntemperature_k = 298.15\nphotons = {photons}")

    take("bias", 0.0, 0.0, 16, 1)
    take("dark_short", 0.0, 0.01, 16, 2)
    take("dark_long", 0.0, 2.0, 16, 3)
    for number, level in enumerate(LEVELS):
        take(f"flat_{number}", level * 55_000.0, 0.01, 16 if level == 0.5 else 4, 10 + number)
    (folder / "bench.toml").write_text("\n".join(lines), "utf-8")
    return folder


def run(*arguments: object) -> tuple[int, str]:
    found = CliRunner().invoke(app, ["fit", *map(str, arguments)])
    return found.exit_code, found.output + (found.stderr if found.stderr_bytes else "")


def test_a_folder_becomes_a_camera_file_with_maps_and_a_page(
    frames: Path, tmp_path: Path
) -> None:
    """K within 2 %, seven standard errors; all distances pass but in 1 of 100 twins, and the seeds are fixed."""
    code, text = run("--frames", frames, "-o", tmp_path / "mine.toml")
    assert code == 0, text
    files = ["mine.html", "mine.npz", "mine.toml"]
    assert sorted(one.name for one in tmp_path.iterdir()) == files
    camera = ms.load_camera(tmp_path / "mine.toml")
    assert camera.name == "mine" and camera.sensor.rows == 40
    assert gain_dn_per_e(camera) == pytest.approx(gain_dn_per_e(CAMERA), rel=0.02)
    assert "12 frames" in camera.sources["source_follower.read_noise_e"]
    maps = read_fpn_maps(tmp_path / "mine.npz")
    dark = ms.expose(0.0, camera, ms.Exposure(0.01), maps=maps, frames=4)
    assert dark.digital.mean() == pytest.approx(
        np.load(frames / "dark_short.npy").mean(), abs=1
    )
    assert "data:image/svg+xml" in (tmp_path / "mine.html").read_text("utf-8")
    assert run("--frames", frames, "-o", tmp_path / "mine.toml")[0] == 2, "needs --force"


def test_frames_that_show_no_gain_write_nothing(frames: Path, tmp_path: Path) -> None:
    lines = (frames / "bench.toml").read_text("utf-8").split("[[stack]]")
    only_dark = "[[stack]]".join(one for one in lines if "flat" not in one)
    dark = tmp_path / "dark"
    dark.mkdir()
    (dark / "bench.toml").write_text(only_dark, "utf-8")
    for name in ("bias", "dark_short", "dark_long"):
        (dark / f"{name}.npy").write_bytes((frames / f"{name}.npy").read_bytes())
    code, text = run("--frames", dark, "-o", tmp_path / "mine.toml")
    assert code == 2 and "has no flat fields" in " ".join(text.split())
    assert not list(tmp_path.glob("mine*"))


def test_a_comparison_says_what_the_datasheet_is_of_and_what_it_lacks(
    frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the exposure of the flat fields; η needs the wavelength of the light. Its page is not drawn here."""
    monkeypatch.setattr("mitsuba_sensor.pages.html_page.html", str)
    for path in frames.glob("*.npy"):
        (tmp_path / path.name).symlink_to(path)
    manifest = (frames / "bench.toml").read_text("utf-8").replace("wavelength_nm = 550", "")
    (tmp_path / "bench.toml").write_text(manifest, "utf-8")
    asked = ["--frames", str(tmp_path), "--camera", "konnik_table1", "-o", str(tmp_path)]
    found = CliRunner().invoke(app, ["characterize", *asked])
    text = " ".join(found.output.split())
    assert "the numbers of konnik_table1 at 0.01 s and 298.15 K; σ_d includes" in text, text
    assert "η is not compared" in text and "give --wavelength-nm 525" in text
    assert "temporal noise are measured without the stacks of many frames" in text


DUAL_GAIN = ms.load_camera("scmos_dual_gain")
KELVIN = 228.15


def save_combined(folder: Path, stacks: dict[str, tuple[float, float, int]], side: int) -> None:
    """Frames of a dual-gain camera as `render` writes them, and a manifest.

    stacks : name → photoelectrons, exposure time [s] and number of frames.
    """
    camera = DUAL_GAIN.replace(**{"sensor.rows": side, "sensor.columns": side})
    lines = ["bits = 17", "wavelength_nm = 550"]
    for number, (name, (electrons, time_s, count)) in enumerate(stacks.items()):
        light = ms.Photons(np.full((side, side), electrons), detected=True)
        exposure = ms.Exposure(time_s, KELVIN)
        ms.expose(light, camera, exposure, frames=count, seed=number).save(folder / name)
        kind = name.partition("_")[0]
        lines += ["[[stack]]", f'files = "{name}/frame.tiff"', f'kind = "{kind}"']
    (folder / "bench.toml").write_text("\n".join(lines), "utf-8")


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore::mitsuba_sensor.SensorWarning")
def test_frames_of_a_dual_gain_camera_are_fitted_by_readout(tmp_path: Path) -> None:
    """K and σ_read of each within 1 %: three and five standard errors. The seeds are fixed."""
    stacks = {"bias": (0.0, 0.0, 24), "dark_1": (0.0, 1.0, 12), "dark_20": (0.0, 20.0, 12)}
    for name, camera in DUAL_GAIN.readout_cameras.items():
        for share in (0.04, 0.15, 0.3, 0.45, 0.6, 0.75, 1.1):
            stacks[f"flat_{name}_{share:g}"] = share * saturation_e(camera), 0.01, 10
    save_combined(tmp_path, stacks, 80)
    out = tmp_path / "twin"
    out.mkdir()
    like = "--like", "scmos_dual_gain"
    code, text = run("--frames", tmp_path, "-o", out / "mine.toml", *like)
    assert code == 0, text
    files = ["mine.high.npz", "mine.html", "mine.low.npz", "mine.toml"]
    assert sorted(one.name for one in out.iterdir()) == files
    twin = ms.load_camera(out / "mine.toml")
    for name, camera in DUAL_GAIN.readout_cameras.items():
        found = twin.at_readout(name)
        assert gain_dn_per_e(found) == pytest.approx(gain_dn_per_e(camera), rel=0.01)
        noise_e = camera.source_follower.read_noise_e
        assert found.source_follower.read_noise_e == pytest.approx(noise_e, rel=0.01)
        maps = read_fpn_maps(out / f"mine.{name}.npz")
        ms.expose(0.0, found, ms.Exposure(0.01, KELVIN), maps=maps)


def test_frames_of_a_readout_are_its_pages_with_its_own_bits(tmp_path: Path) -> None:
    """Of a manifest, and of the names of folders; a file without pages of that name is refused."""
    save_combined(tmp_path, {"dark_1": (0.0, 0.01, 2), "flat_1": (5_000.0, 0.01, 2)}, 8)
    assert readouts_of_bench(tmp_path) == ("high", "low")
    combined, low = read_bench(tmp_path), read_bench(tmp_path, readout="low")
    assert (combined.flats[0].bits, low.flats[0].bits) == (17, 12)
    black_dn = DUAL_GAIN.at_readout("low").adc.black_level_dn
    gain = DUAL_GAIN.at_readout("low").system_gain_dn_per_e
    mean_dn = black_dn + 5_000 * gain
    assert low.flats[0].mean.mean() == pytest.approx(mean_dn, rel=0.02)
    (tmp_path / "bench.toml").unlink()
    assert len(read_bench(tmp_path, readout="high").stacks) == 2
    (tmp_path / "flat_1" / "readouts.tiff").unlink()
    with pytest.raises(ms.InputError, match="combines the readouts high, low"):
        read_bench(tmp_path, readout="low")
    (tmp_path / "flat_1" / "frame.tiff").unlink()
    with pytest.raises(ms.InputError, match=r"no frames of a readout 'lov'.*mean 'low'"):
        read_bench(tmp_path, readout="lov")
    (tmp_path / "dark_1" / "readouts.tiff").unlink()
    code, text = run("--frames", tmp_path, "-o", tmp_path / "mine.toml")
    assert code == 2 and "write readouts.tiff with it" in " ".join(text.split())
