"""The sheet of a camera: figures beside theory, light that is kept, real frames, comparison, and what is refused."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.bench.sheet import light, modulation, patches
from mitsuba_sensor.bench.sheet.chart import Setting
from mitsuba_sensor.bench.sheet.charts import chosen_charts
from mitsuba_sensor.bench.sheet.comparison import Sheet, compared
from mitsuba_sensor.bench.sheet.light import ChartScene, fingerprint, light_of
from mitsuba_sensor.bench.sheet.page import sheet_study
from mitsuba_sensor.bench.sheet.sheet import (
    ChartPart,
    Row,
    rows_of,
    sheet_of_frames,
    simulated_sheet,
)
from mitsuba_sensor.cli import app
from mitsuba_sensor.files.user_cache import kept_file
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.image_quality.slanted_edge import slanted_edge
from mitsuba_sensor.render.variants import fastest_variant, use, variant_restored

TINY = ms.load_camera("sony_imx174").replace(
    **{"sensor.rows": 64, "sensor.columns": 64, "readout.dsnu_col": 1e-4, "lens.f_number": 4.0}
)
SMALL = TINY.replace(**{"sensor.rows": 96, "sensor.columns": 96})
"""Large enough for dead leaves."""
DIFFRACTING = TINY.replace(
    **{
        "lens.diffraction": True,
        "lens.f_number": 8.0,
        "pixel.pitch_x_um": 3.0,
        "pixel.pitch_y_um": 3.0,
    }
)
WAVELENGTHS_NM = TINY.quantum_efficiency.wavelengths_nm
DIFFUSION = {"quantum_efficiency.diffusion_um": [3.0] * len(WAVELENGTHS_NM)}
CROSSTALK = [[0, 0.03, 0], [0.03, 0.88, 0.03], [0, 0.03, 0]]
GLARE = {"lens.veiling_glare": 0.1, "lens.glare_width_mm": 0.05}
HEIGHTS_MM = np.linspace(0, 0.36, 37)

SHIPPED_SAMPLES = modulation.EDGE_SPP


@pytest.fixture(autouse=True, scope="module")
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One folder of kept light for all tests, few samples, and one variant: the numbers of a seed are those of it."""
    with pytest.MonkeyPatch.context() as patch, variant_restored():
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "kept"))
        patch.setattr(modulation, "EDGE_SPP", 64)
        patch.setattr(patches, "PATCH_SPP", 16)
        patch.setattr(modulation, "BITMAP_SPP", 16)
        use(fastest_variant("llvm"))
        yield


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, ["sheet", *arguments])


def setting(camera: ms.Camera, seed: int = 1) -> Setting:
    return Setting(camera, "", 298.15, seed, seed)


def part_rows(camera: ms.Camera, *charts: str, seed: int = 1) -> list[Row]:
    parts = simulated_sheet(
        camera, [setting(camera, seed)], chosen_charts(charts), lambda *_: None
    )
    assert not any(part.refused for part in parts)
    return list(rows_of(parts))


@pytest.fixture(scope="module")
def tiny_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("camera") / "tiny.toml"
    file.write_text(TINY.to_toml(), encoding="utf-8")
    return str(file)


@pytest.fixture(scope="module")
def sheet(tiny_file: str) -> Path:
    """The folder of a sheet of two charts."""
    folder = Path(tiny_file).with_name("sheet")
    result = run(tiny_file, "-o", str(folder), "--charts", "steps,led")
    assert result.exit_code == 0, result.output
    return folder


def test_charts_of_a_small_camera_agree_with_theory() -> None:
    """One figure beyond its limit once in 100 sheets, the seed is fixed."""
    charts = chosen_charts(["edge_columns", "star", "steps", "grey", "led"])
    parts = simulated_sheet(SMALL, [setting(SMALL)], charts, lambda *_: None)
    assert [part.name for part in parts] == [one.name for one in charts]
    study = sheet_study(SMALL.name, parts)
    assert study.passed and not study.missing, study.findings
    assert sum(bool(row["mark"]) for row in study.data["rows"]) > 10


def test_the_command_writes_page_json_and_csv_and_renders_once(
    tmp_path: Path, tiny_file: str, sheet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = json.loads((sheet / "sheet.json").read_text(encoding="utf-8"))
    assert written["passed"] and written["camera"] == TINY.name
    with (sheet / "sheet.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert [row["symbol"] for row in table] == [row["symbol"] for row in written["rows"]]
    assert float(table[0]["value"]) == written["rows"][0]["value"]
    page = (sheet / "sheet.html").read_text(encoding="utf-8")
    assert "Response (OECF)" in page and "render noise of the light" in page
    monkeypatch.setattr(light, "render", None)
    again = run(tiny_file, "-o", str(tmp_path / "again"), "--charts", "led", "--json")
    assert again.exit_code == 0, again.output
    values = [row["value"] for row in json.loads(again.stdout)["rows"]]
    assert values == [row["value"] for row in written["rows"] if row["chart"] == "led"]


def test_light_depends_on_the_optics_and_the_chart_only() -> None:
    scene = ChartScene("a", "<scene/>", 64, 550.0)
    sensor = TINY.replace(**{"adc.bits": 10, "source_follower.read_noise_e": 9.0})
    assert fingerprint(scene, sensor) == fingerprint(scene, TINY)
    optics = {"lens.f_number": 5.6, "lens.diffraction": True, "pixel.pitch_x_um": 3.0}
    cameras = [TINY.replace(**{field: value}) for field, value in optics.items()]
    pictures = (scene._replace(bitmap=np.full((8, 8), level)) for level in (1.0, 2.0))
    others = scene._replace(text="<scene />"), scene._replace(samples=65), *pictures
    found = [fingerprint(scene, camera) for camera in (TINY, *cameras)]
    assert len({*found, *(fingerprint(one, TINY) for one in others)}) == 8


def test_a_file_of_light_that_is_broken_is_rendered_again() -> None:
    scene = chosen_charts(["steps"])[0].scenes(TINY)[0]
    rendered = light_of(scene, TINY)
    file = kept_file(light.kept_name(scene, TINY))
    file.write_bytes(file.read_bytes()[:100])
    np.testing.assert_array_equal(light_of(scene, TINY).data, rendered.data)


BAYER = ms.load_camera("bayer_2mp")


def resized(camera: ms.Camera, rows: int, columns: int, **fields: Any) -> ms.Camera:
    return camera.replace(**{"sensor.rows": rows, "sensor.columns": columns, **fields})


def compared_rows(camera: ms.Camera, *charts: str) -> dict[tuple[str, str], Row]:
    """Rows beside theory by filter and symbol, none of them beyond 4 standard errors: once in 15 000 figures."""
    rows = [row for row in part_rows(camera, *charts) if row.beside]
    assert rows and all(abs(row.beside["z"]) < 4 for row in rows), [
        (row, row.beside) for row in rows if abs(row.beside["z"]) >= 4
    ]
    return {(row.filter_name, row.quantity.symbol): row for row in rows}


def theory(row: Row) -> float:
    assert row.said is not None
    return row.said.value


@pytest.mark.parametrize(
    ("fields", "charts"),
    [
        ({"quantum_efficiency.crosstalk": CROSSTALK}, ("edge",)),
        exhaustive({"readout.ipc_coupling": 0.03}, ("edge",)),
        exhaustive({"pixel.fill_factor": 0.25, "pixel.aperture": "square"}, ("edge",)),
        exhaustive(GLARE, ("edge",)),
        exhaustive({**DIFFUSION, "readout.ipc_coupling": 0.03}, ("star", "leaves")),
        exhaustive(GLARE, ("star", "leaves")),
    ],
)
def test_charge_and_light_that_spread_have_the_modulation_of_theory(
    fields: dict[str, Any], charts: tuple[str, ...]
) -> None:
    side = 208 if "star" in charts else 64
    found = compared_rows(resized(TINY, side, side, **fields), *charts)
    assert abs(theory(found["", "MTF(0.5)"]) - 2 / np.pi) > 0.02  # of pixels alone


@pytest.mark.exhaustive
def test_theory_of_a_star_is_the_mean_square_over_its_directions() -> None:
    """Of the apertures of the pixels, in all directions alike: the instrument adds less than 0.001."""
    found = compared_rows(resized(TINY, 208, 208), "star")
    angles = np.linspace(0, 2 * np.pi, 721)[:-1]
    said = {symbol: theory(row) for (_, symbol), row in found.items() if symbol != "MTF50"}
    for symbol, value in said.items():
        frequency = float(symbol[4:-1])
        squares = np.square(
            np.sinc(frequency * np.cos(angles)) * np.sinc(frequency * np.sin(angles))
        )
        assert value == pytest.approx(np.sqrt(squares.mean()), abs=1e-3)
    assert said


@pytest.mark.exhaustive
def test_stars_and_dead_leaves_of_a_mosaic_have_theory_behind_each_filter() -> None:
    found = compared_rows(resized(BAYER, 416, 416), "star", "leaves")
    assert {name for name, _ in found} == {"R", "G", "G (2)", "B"}


@pytest.mark.exhaustive
def test_diffraction_is_in_light_and_theory(monkeypatch: pytest.MonkeyPatch) -> None:
    """f/8 on 3 µm. Samples are those of users."""
    monkeypatch.setattr(modulation, "EDGE_SPP", SHIPPED_SAMPLES)
    assert theory(compared_rows(DIFFRACTING, "edge_columns")["", "MTF(0.5)"]) < 0.35


@pytest.mark.exhaustive
@pytest.mark.parametrize("camera", [TINY, DIFFRACTING], ids=["pinhole", "f/8"])
def test_render_noise_of_an_edge_is_in_its_intervals(
    camera: ms.Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eight renders without noise of the sensor scatter as their intervals say: by 0.3 to 1.95 of the standard error,
    but once in 1000 figures; 8 figures, the seeds are fixed."""
    (scene,), render = chosen_charts(["edge_columns"])[0].scenes(camera), light.render
    monkeypatch.setattr(light, "read_kept", lambda name: None)
    monkeypatch.setattr(light, "keep", lambda name, arrays: None)
    values, errors = [], []
    for number in range(8):

        def with_seed(*args: Any, number: int = number, **options: Any) -> Any:
            return render(*args, **{**options, "seed": number})

        monkeypatch.setattr(light, "render", with_seed)
        curve = slanted_edge(light_of(scene, camera).data[..., 0]).modulation
        found, _ = modulation.of_modulation(curve)
        values.append([one.value for one in found])
        errors.append([one.standard_error for one in found])
    ratios = np.std(values, axis=0, ddof=1) / np.sqrt(np.square(errors).mean(axis=0))
    assert (ratios > 0.3).all() and (ratios < 1.95).all(), ratios


def test_colours_of_a_bayer_camera_are_those_of_its_filters() -> None:
    found = compared_rows(resized(BAYER, 96, 144), "colours", "grey")
    symbols = {symbol for _, symbol in found}
    assert symbols == {
        "ΔE00",
        "ΔE00_max",
        "WB_0",
        "WB_2",
        "RI_0",
        "RI_1",
        "RI_2",
        "CS_0",
        "CS_2",
    }
    assert 0.3 < theory(found["", "ΔE00"]) < 5
    assert found["", "RI_0"].quantity.name.endswith(", R")


@pytest.mark.parametrize(
    ("fields", "corners_percent"),
    [
        ({}, 100 / (1 + 2 * np.tan(np.radians(20)) ** 2) ** 2),
        exhaustive(
            {
                "lens.relative_illumination": (1 - 2.5 * HEIGHTS_MM**2).tolist(),
                "lens.relative_illumination_heights_mm": HEIGHTS_MM.tolist(),
            },
            100 * (1 - 2.5 * 2 * (32 * 5.86e-3) ** 2),
        ),
    ],
)
def test_a_grey_surface_falls_off_as_the_lens_says(
    fields: dict[str, Any], corners_percent: float
) -> None:
    """What the instrument finds in theory is within 0.3 % of the light in the corner itself."""
    found = compared_rows(TINY.replace(**fields), "grey")
    assert theory(found["", "RI_0"]) == pytest.approx(corners_percent, abs=0.3)


def test_a_lamp_flickers_as_the_shutter_leaves_it() -> None:
    """Ideal pulses leave (0.25 − 0.15)/(0.25 + 0.15) of exposures of 0.9 periods; a rolling shutter smooths."""
    rolling = {"sensor.shutter": "rolling", "sensor.row_time_us": 200.0}
    found, smoothed = (compared_rows(one, "led") for one in (TINY, TINY.replace(**rolling)))
    assert set(found) == set(smoothed) == {("", "FMI"), ("", "MMP")}
    assert theory(found["", "FMI"]) == pytest.approx(0.25, abs=1e-9)
    assert theory(smoothed["", "FMI"]) < 0.12


@pytest.mark.exhaustive
def test_intervals_of_edges_and_steps_hold_theory() -> None:
    """25 cameras of other serial numbers and noise, 13 figures each: fewer than 91 % or none outside once in 1000."""
    held = []
    for seed in range(25):
        rows = [row for row in part_rows(TINY, "edge", "steps", seed=seed) if row.beside]
        held += [abs(row.beside["z_of_chip"]) < 1.96 for row in rows]
    assert len(held) > 250
    assert 0.91 < np.mean(held) < 1


def written_frames(folder: Path, bench: Bench) -> None:
    """The stacks of a bench as NumPy files, with a manifest that says what they are."""
    folder.mkdir(parents=True)
    lines = [f"bits = {bench.stacks[0].bits}"]
    named: list[tuple[str, Stack]] = []
    for kind, stacks in (
        ("bias", bench.biases),
        ("dark", bench.darks),
        ("flat", bench.flats),
        ("scene", bench.scenes),
    ):
        named += [(kind, stack) for stack in stacks]
    for number, (kind, stack) in enumerate(named):
        np.save(folder / f"{number}.npy", stack.frames)
        lines += ["[[stack]]", f'files = "{number}.npy"', f'kind = "{kind}"']
        lines += [f"exposure_s = {stack.exposure_s}", "temperature_k = 298.15"]
    (folder / "bench.toml").write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.parametrize(
    "names", [("steps",), exhaustive(("edge_columns", "star", "leaves", "grey", "led"))]
)
def test_frames_on_disk_give_the_figures_of_the_same_camera(
    tmp_path: Path, names: tuple[str, ...]
) -> None:
    """Charts of a simulated camera, written and read as those of a real one."""
    at = setting(SMALL)
    for one in chosen_charts(names):
        name = one.name.replace("columns", "middle")
        taken = one.frames(at, [light_of(scene, SMALL) for scene in one.scenes(SMALL)])
        written_frames(tmp_path / "frames" / name, taken.bench)
        known = dict(taken.facts)
        if "chart" in known:
            np.save(tmp_path / "frames" / "leaves.npy", known["chart"])
            known["chart"] = "../leaves.npy"
        facts = [f"{key} = {json.dumps(value)}" for key, value in known.items()]
        (tmp_path / "frames" / name / "chart.toml").write_text("\n".join(facts))
    result = run("--frames", str(tmp_path / "frames"), "-o", str(tmp_path / "out"), "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)["rows"]
    assert {row["chart"] for row in found} == {
        name.replace("columns", "middle") for name in names
    }
    assert not any(row["mark"] for row in found)
    simulated = {
        (row.chart.replace("edge_columns", "edge_middle"), row.quantity.symbol): row
        for row in part_rows(SMALL, *names)
    }
    for row in found:
        assert row["value"] == simulated[row["chart"], row["symbol"]].to_dict()["value"]
        assert row["temperature_k"] == 298.15


def test_two_sheets_are_compared_figure_by_figure(
    tmp_path: Path, tiny_file: str, sheet: Path
) -> None:
    """Another read noise, and nothing else: DR falls, the response stays. What one sheet has alone is named."""
    both = [str(sheet), str(tmp_path / "loud")]
    louder = ("--set", "source_follower.read_noise_e=40", "--set", "name=loud")
    run(tiny_file, "-o", both[1], "--charts", "steps", "--seed", "2", *louder)
    result = run("--compare", *both, "-o", str(tmp_path / "c"))
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "c" / "comparison.json").read_text(encoding="utf-8"))
    lines = {row["symbol"]: row for row in found["rows"]}
    assert lines["DR"]["z"] < -20 and lines["DR"]["value_b"] < lines["DR"]["value_a"]
    assert abs(lines["s"]["z"]) < 4
    assert lines["s"]["ratio_low"] < 1 < lines["s"]["ratio_high"] or abs(lines["s"]["z"]) > 1.9
    assert "FMI" not in lines and any(
        one.startswith("not compared") for one in found["findings"]
    )
    assert (tmp_path / "c" / "comparison.csv").read_text("utf-8").count("\n") == len(lines) + 1
    assert f"Image quality of {TINY.name} and loud" in found["title"] and not found["verdict"]


def sheet_row(chart: str, filter_name: str, symbol: str, value: float, mark: str = "") -> Any:
    row = Row(
        chart,
        filter_name,
        "",
        298.15,
        ms.lab.Quantity(symbol, symbol, value, 0.9 * value, 1.1 * value, "", ""),
    )
    return row.to_dict() | {"mark": mark}


def test_a_monochrome_camera_is_compared_with_every_filter_and_red_rows_are_counted() -> None:
    mono = Sheet(
        "mono", [sheet_row("edge", "", "MTF50", 0.5), sheet_row("edge", "", "MTF(0.5)", 0.3)]
    )
    colours = [sheet_row("edge", name, "MTF50", 0.25, "bad") for name in ("R", "G")]
    study = compared(mono, Sheet("bayer", [*colours, sheet_row("edge", "R", "ε_render", 0.1)]))
    assert [row["filter"] for row in study.data["rows"]] == ["all / R", "all / G"]
    assert all(row["ratio"] == 0.5 for row in study.data["rows"])
    assert not study.passed and study.failed == ("bayer: edge MTF50",)
    assert any("MTF(0.5)" in str(part) for part in study.parts[-1].rows)  # type: ignore[union-attr]
    with pytest.raises(ms.InputError, match="no figure in common"):
        compared(mono, Sheet("other", [sheet_row("emva", "", "K", 1.0)]))


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", [*range(12), 34])
def test_a_right_camera_has_all_checks_passed(seed: int) -> None:
    """Cameras at random, of small windows: of 40 right ones at most one would fail by chance in 14 of 15 runs; the
    seeds are fixed. Read noise is from 0.005 to 20 DN, that of seed 34 is 0.07 DN."""
    camera = random_camera(seed)
    parts = simulated_sheet(camera, [setting(camera, seed)], chosen_charts(()), lambda *_: None)
    study = sheet_study(camera.name, parts)
    assert study.passed, study.findings


def random_camera(seed: int) -> ms.Camera:
    """Monochrome or Bayer, 8 to 14 bits, K from 0.02 to 4 DN/e-, quiet or loud, even or not."""
    rng = np.random.default_rng(seed)
    bits, full_e = int(rng.integers(8, 15)), float(np.exp(rng.uniform(*np.log([3e3, 1e5]))))
    fields: dict[str, Any] = {
        "sensor.rows": 96 * (side := 1 + seed % 2),
        "sensor.columns": 96 * side,
        "adc.bits": bits,
        "pixel.full_well_e": full_e,
        "adc.full_scale_v": 50e-6 * full_e * float(rng.uniform(1.0, 1.3)),
        "pixel.prnu": float(rng.uniform(0, 0.01)),
        "pixel.dsnu_e": float(rng.uniform(0, 3)),
        "readout.prnu_col": float(rng.choice([0.0, 2e-3])),
        "readout.dsnu_col": float(rng.choice([0.0, 2e-4])),
        "readout.row_noise_e": float(rng.choice([0.0, 0.5])),
        "source_follower.read_noise_e": float(np.exp(rng.uniform(*np.log([0.5, 30])))),
        "adc.black_level_dn": float(rng.uniform(0.01, 0.05) * 2**bits),
        "lens.f_number": float(rng.choice([1.4, 4.0, 8.0])),
        "lens.diffraction": bool(rng.integers(2)),
    }
    name = ("sony_imx174", "bayer_2mp")[side - 1]
    return ms.load_camera(name).replace(**fields)


def test_a_headline_says_whether_all_or_some_of_a_chart_was_not_measured() -> None:
    row = Row("star", "", "", None, ms.lab.Quantity("MTF50", "", 0.3, 0.2, 0.4, "1/pixel", ""))
    parts = [
        ChartPart("emva", "EMVA 1288", "its only setting", [], refused=["no dark frames"]),
        ChartPart(
            "star", "Star", "its only setting", [row], refused=["no ring is in the frame"]
        ),
    ]
    assert sheet_study("camera", parts).missing == ("emva", "some figures of star")


def test_a_misspelt_folder_of_a_chart_is_named(tmp_path: Path) -> None:
    for name in ("emva", "egde", "notes"):
        (tmp_path / name).mkdir()
    result = run("--frames", str(tmp_path))
    assert result.exit_code == 2 and "Did you mean 'edge'?" in result.output.replace("\n", " ")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "needs a camera"),
        (("nikon",), "nikon"),
        (("bayer_2mp", "--gains", "all"), "has no gain settings"),
        (("moravian_c1_5000", "--gains", "9 dB"), "9 dB"),
        (("moravian_c1_5000", "--gains", "0 dB,0 dB"), "repeats"),
        (("bayer_2mp", "--temperatures", "warm"), "'warm'"),
        (("bayer_2mp", "--temperatures", "0"), "kelvin"),
        (("bayer_2mp", "--charts", "edges"), "the charts are"),
        (("konnik_table1", "--charts", "colours"), "needs three"),
        (("omnivision_split_pixel",), "readouts"),
        (("--frames", "nowhere"), "is not a folder"),
        (("--frames", "."), "no folder of a chart"),
        (("--frames", ".", "--gains", "all"), "--gains"),
        (("--compare", "bayer_2mp", "nothing.json"), "nothing.json cannot be read"),
        (("bayer_2mp", "--compare", "a", "b"), "--compare A B"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence_and_nothing_is_written(
    arguments: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2 and said in result.output.replace("\n", " "), result.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("chart", "texts"),
    [
        ("steps", ("", "patches = 3", "=")),
        ("star", ("cycles = 2.5", 'cycles = 72\ncontrast = "high"')),
        ("leaves", ("chart = 3", 'chart = "bench.toml"', 'chart = "0.npy"\nmethod = "best"')),
    ],
)
def test_facts_about_the_chart_of_a_real_camera_are_checked(
    chart: str, texts: Sequence[str], tmp_path: Path
) -> None:
    frames = np.full((2, 64, 64), 100, np.uint16)
    stacks = (Stack(frames, 0.1, bits=12),)
    written_frames(tmp_path / "in" / chart, Bench((), stacks, (), stacks))
    for text in texts:
        (tmp_path / "in" / chart / "chart.toml").write_text(text)
        result = run("--frames", str(tmp_path / "in"), "-o", str(tmp_path / "out"))
        assert result.exit_code == 2 and ".toml" in result.output, result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("chart", "facts"),
    [("edge", ""), ("steps", "patches = [[0, 0, 8, 8]]\nexposure_lxs = [1.0]")],
)
def test_dark_frames_of_another_size_are_refused(
    chart: str, facts: str, tmp_path: Path
) -> None:
    scene, dark = (
        Stack(np.full((2, rows, 64), 100, np.uint16), 0.1, bits=12) for rows in (64, 16)
    )
    folder = tmp_path / chart
    written_frames(folder, Bench((), (dark,), (), (scene,)))
    (folder / "chart.toml").write_text(facts)
    (part,) = sheet_of_frames(tmp_path, None, lambda *told: None)
    assert not part.rows and "take dark frames of the same size" in part.refused[0]
