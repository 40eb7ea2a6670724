"""What the commands leave behind and print: each once with --json, and what people read."""

from __future__ import annotations

import io
import json
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from helpers.scenes import SCENES
from PIL import Image
from rich.console import Console

import mitsuba_sensor as ms
from mitsuba_sensor.cli.progress import render_progress
from mitsuba_sensor.cli.summaries import NOTES_MAX, summary
from mitsuba_sensor.cli.tables import ResultTable, number, view
from mitsuba_sensor.core import Doubt
from mitsuba_sensor.render import doctor
from mitsuba_sensor.render.passes.stop_criterion import RenderProgress

Cli = Callable[..., Any]
OUTPUTS = {"frame.tiff", "frame.png", "frame_brightened.png", "irradiance.exr", "frame.json"}


@pytest.fixture(scope="module")
def rendered(scene_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny scene, rendered once with two frames."""
    from typer.testing import CliRunner

    from mitsuba_sensor.cli import app

    folder = tmp_path_factory.mktemp("rendered") / "out"
    asked = f"--spp 16 --denoise --frames 2 -D level=0.0001 --set adc.bits=14 -o {folder}"
    done = CliRunner().invoke(app, ["render", str(scene_file), *asked.split()])
    assert done.exit_code == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def report(rendered: Path) -> dict[str, Any]:
    return json.loads((rendered / "frame.json").read_text(encoding="utf-8"))


JSON = {  # command → names that its JSON has
    "render SCENE -o OUT --spp 16": {"summary", "notes", "camera", "stages", "versions"},
    "expose LIGHT -o OUT": {"summary", "notes", "camera", "stages", "versions"},
    "budget LIGHT": {"source", "mean_dn", "temporal_dn2", "spatial_dn2", "share"},
    "plan LIGHT --tolerance-dn 0.5": {"camera", "tolerance_dn", "stages", "clipped", "pixels"},
    "cameras list imx": {"name", "technology", "columns", "rows", "description"},
    "cameras show konnik_table1": {"sensor", "sources", "notes", "emva1288"},
    "cameras new OUT.toml": {"file", "name", "sources", "assumed", "notes"},
    "cameras check konnik_table1": {"findings", "airy_disk", "pixel_mtf"},
    "cameras lenses": {"name", "focal_length_mm", "surfaces", "source"},
    "scenes list": {"name", "description"},
    "scenes show still_life": {"file", "sensors", "emitters", "parameters"},
    "fpn-maps -o OUT.npz --rows 4 --width 6": {"prnu", "dark_fpn"},
    "lint SCENE": {"level", "where", "what", "remedy"},
}


@pytest.mark.parametrize(("line", "names"), JSON.items())
def test_stdout_is_json_and_nothing_else(
    line: str, names: set[str], scene_file: Path, light_file: Path, tmp_path: Path, cli: Cli
) -> None:
    """And without --json a few lines for people, none of which is JSON."""
    for name, place in {"SCENE": scene_file, "LIGHT": light_file}.items():
        line = line.replace(name, str(place))
    asked = line.replace("OUT", str(tmp_path / "OUT")).split()
    done = cli(*asked, "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout, parse_constant=pytest.fail)
    rows = found if isinstance(found, list) else [found]
    assert all(names <= row.keys() for row in rows)
    shown = cli(*asked, *(["--force"] if "OUT.toml" in line else []))
    assert shown.exit_code == 0 and shown.stdout.strip()[0] not in "[{"


def test_the_raw_frames_and_the_preview_are_what_the_report_says(
    rendered: Path, report: dict[str, Any]
) -> None:
    assert {path.name for path in rendered.iterdir()} == OUTPUTS
    raw = tifffile.imread(rendered / "frame.tiff")
    assert raw.dtype == np.uint16 and raw.shape == (2, 12, 16) and raw.max() < 2**14
    assert raw.mean() == pytest.approx(report["stages"][-1]["mean_frame"], rel=1e-9)
    assert (raw[0] != raw[1]).any(), "two frames must not share their temporal noise"
    picture = np.asarray(Image.open(rendered / "frame.png"))
    assert picture.dtype == np.uint8 and picture.shape == (12, 16)


def test_the_report_holds_all_that_is_needed_to_make_the_frame_again(
    report: dict[str, Any],
) -> None:
    assert report["camera"]["adc"]["bits"] == 14
    assert report["camera"]["sources"]["adc.bits"] == "set by the user"
    assert report["exposure"] == {"time_s": 0.1, "temperature_k": 298.15}
    assert report["seeds"] == {"seed": 1, "serial": 1, "first_frame": 0}
    assert report["origin"]["parameters"] == {"level": "0.0001"}
    assert len(report["origin"]["scene_sha256"]) == 64
    assert report["versions"]["mitsuba-sensor"] == ms.__version__
    assert report["render"]["samples_per_pixel"] == 16 and report["times_s"]["render"] > 0
    counts = {"clipped_full_well", "clipped_adc_low", "clipped_adc_high", "negative"}
    assert counts | {"non_finite"} <= report["counts"].keys()


def test_expose_makes_the_same_bits_as_render_without_rendering(
    rendered: Path, report: dict[str, Any], tmp_path: Path, cli: Cli
) -> None:
    """In a tenth of the time the render's noise is less beside the sensor's."""
    same = ("--exposure-s", 0.1, "--frames", 2, "--set", "adc.bits=14")
    light = rendered / "irradiance.exr"
    assert cli("expose", light, "-o", tmp_path / "a", *same).exit_code == 0
    assert {path.name for path in (tmp_path / "a").iterdir()} == OUTPUTS - {light.name}
    made = (tmp_path / "a" / "frame.tiff").read_bytes()
    assert made == (rendered / "frame.tiff").read_bytes()
    assert cli("expose", light, "-o", tmp_path / "b", "--exposure-s", 0.01).exit_code == 0
    shorter = json.loads((tmp_path / "b" / "frame.json").read_text("utf-8"))["render_noise"]
    ratio = report["render_noise"]["over_sensor_median"]
    assert ratio == pytest.approx(report["render"]["noise_ratio_median"], rel=1e-3)
    assert ratio / 30 < shorter["over_sensor_median"] < ratio / 10


@pytest.mark.parametrize(("bits", "kind"), [(8, np.uint8), (20, np.uint32)])
def test_the_raw_file_is_as_wide_as_the_converter_and_open_to_all_whom_the_umask_allows(
    bits: int, kind: type, light_file: Path, tmp_path: Path, cli: Cli
) -> None:
    done = cli("expose", light_file, "-o", tmp_path, "--set", f"adc.bits={bits}")
    assert done.exit_code == 0 and tifffile.imread(tmp_path / "frame.tiff").dtype == kind
    mask = os.umask(0)
    os.umask(mask)
    assert (tmp_path / "frame.tiff").stat().st_mode & 0o777 == 0o666 & ~mask


def test_a_tolerance_leaves_out_what_the_plan_says(
    light_file: Path, tmp_path: Path, cli: Cli
) -> None:
    said = cli("expose", light_file, "-o", tmp_path, "--tolerance-dn", 0.5).stdout
    found = json.loads((tmp_path / "frame.json").read_text("utf-8"))
    plan = json.loads(cli("plan", light_file, "--tolerance-dn", 0.5, "--json").stdout)
    assert found["left_out"] == [one["stage"] for one in plan["stages"] if not one["kept"]]
    assert found["left_out"] and found["options"]["tolerance_dn"] == 0.5
    assert f"left out: {', '.join(found['left_out'])}" in " ".join(said.split())


def test_every_frame_with_a_render_of_its_own_has_its_own_clean_frame(
    scene_file: Path, tmp_path: Path, cli: Cli
) -> None:
    asked = shlex.split(
        "--spp 16 --frames 2 --render-noise per-frame --clean --wavelength-nm 550"
    )
    assert cli("render", scene_file, "-o", tmp_path, *asked).exit_code == 0
    clean = tifffile.imread(tmp_path / "clean.tiff")
    assert clean.shape == (2, 12, 16) and (clean[0] != clean[1]).any()


def test_a_render_prints_a_dozen_lines_with_photons_signal_and_noise(
    tmp_path: Path, cli: Cli
) -> None:
    """What nobody gave is said with its option; files of an earlier result that are replaced are named."""
    small = ("--width", 16, "--spp", 4, "--no-denoise", "-o", tmp_path)
    scene = SCENES / "cornell_box.xml"
    said = cli("render", scene, *small).stdout
    found = json.loads((tmp_path / "frame.json").read_text("utf-8"))
    assert len(said.splitlines()) <= 20
    last, photons = found["stages"][-1], found["photons"]
    assert f"signal: mean {number(last['mean_frame'])} DN" in said
    assert f"photons per pixel: {number(photons['min'])} … {number(photons['median'])}" in said
    assert "K = 0.1241 DN/e-" in said and "render noise:" in said
    assert "konnik_table1 (--camera)" in said and "replaced" not in said
    again = cli("render", scene, *small, "--camera", "konnik_table1", "--clean").stdout
    assert (
        "--camera" not in again
        and "clean.tiff" in again
        and "replaced an earlier result (frame.tiff" in again
    )


@pytest.mark.filterwarnings("ignore::mitsuba_sensor.SensorWarning")
@pytest.mark.parametrize("count", [0, NOTES_MAX + 3])
def test_few_notes_are_printed_and_doubts_come_first(
    count: int, light: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {**ms.capture(light, "sony_a7s2", ms.Exposure(0.1)).metadata}
    found["notes"] = [
        *(9 * letter for letter in "abcdefgh"[:count]),
        Doubt("not what was meant"),
    ]
    lines = printed(summary(found, "out"), 200).splitlines()
    assert lines[0].startswith("sony_a7s2 at no gain setting, K = 0.09563 DN/e-, 0.1 s")
    notes = [line for line in lines if line.startswith("note: ")]
    assert notes[0] == "note: not what was meant" and len(notes) == min(count + 1, NOTES_MAX)
    more = [line for line in lines if line.endswith("more notes: frame.json")]
    assert len(more) == (count >= NOTES_MAX)


@pytest.mark.filterwarnings("ignore::mitsuba_sensor.SensorWarning")
def test_a_summary_repeats_no_note_wraps_its_lines_and_gives_no_ratio_of_a_saturated_pixel(
    light: Any,
) -> None:
    """The note on the temperature is printed before the work begins."""
    found = {**ms.capture(light, "sony_a7s2", ms.Exposure(0.1, 25.0)).metadata}
    assert any("temperature_k is 25" in note for note in found["notes"])
    text = printed(summary(found, "out"), 60)
    assert "is 25;" not in text and "render noise: variance" in text
    of_light = {
        **found,
        "notes": ["no lamp"],
        "render": {**found["render"], "notes": ["no lamp"]},
    }
    assert "no lamp" not in printed(summary(of_light, "out"), 60), "a note of an earlier render"
    assert "no lamp" in printed(summary({**of_light, "sensor": {}}, "out"), 60)
    assert max(map(len, text.splitlines())) <= 60
    pixels = found["image"]["rows"] * found["image"]["columns"]
    found["counts"] = {**found["counts"], "clipped_adc_high": pixels}
    assert "not measurable in the median pixel, which is saturated" in " ".join(
        printed(summary(found, "out"), 60).split()
    )


def printed(what: Any, width: int) -> str:
    console = Console(record=True, width=width, file=io.StringIO(), color_system=None)
    console.print(what, highlight=False, crop=False)
    return console.export_text()


@pytest.mark.parametrize("width", [40, 80])
def test_no_number_of_a_narrow_table_is_cut(width: int) -> None:
    """A terminal that is too narrow gets a table wider than itself; units in brackets are no markup."""
    hard = (13093.0, 1.2e-115, 1e9, 123456.7, 0.00012345, 2345678.9, -0.5)
    table = ResultTable(("case [s]", *(f"column {k}" for k in range(9))), "title", "below")
    for name in "abc":
        table.add_row(f"case {name}", *(f"{hard[k % 7]:.9g}" for k in range(9)))
    rows = [{"name": "a", "values [DN]": list(hard), "is_it": True, "none": None}]
    for what in (table, view({"rows": rows, "text": "x", "more": {"a": {"b": 1.5}}})):
        narrow, wide = (
            sorted(re.findall(r"[\d.e+-]*\d[\d.e+-]*", printed(what, columns)))
            for columns in (width, 400)
        )
        assert narrow == wide
    assert "case [s]" in printed(table, 400) and "below" in printed(table, 400)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (0.0, "0"), (-8.8e-13, "0"), (4.9e-5, "0"), (0.00012345, "0.0001"), (0.012345, "0.0123"),
        (0.5, "0.5"), (12.3456, "12.35"), (13093.2, "13093"), (1e9, "1e+09"), (-0.25, "-0.25"),
    ],
)  # fmt: skip
def test_numbers_have_four_digits_and_at_most_four_decimals(
    value: float | None, text: str
) -> None:
    assert number(value) == text


def test_the_bar_says_what_is_done_and_no_share_where_no_end_is_known() -> None:
    console = Console(width=100, file=io.StringIO(), force_terminal=True, color_system=None)
    with render_progress(console, {}, "reading the light") as progress:
        bar = console._live_stack[-1]

        def after(step: RenderProgress | None) -> str:
            if step is not None:
                progress(step)
            return printed(bar.get_renderable(), 100)

        assert "reading the light" in after(None) and "%" not in after(None)
        assert re.search("rendering .*10 %", after(RenderProgress(1, 10)))
        ended_by_noise = after(RenderProgress(30, 0, 0.25))
        assert "%" not in ended_by_noise and "render noise 0.25 ×" in ended_by_noise
        assert re.search("frame 2 of 4 .*25 %", after(RenderProgress(1, 4, doing="exposing")))


def test_cameras_list_and_show_have_the_facts_of_every_camera(cli: Cli) -> None:
    listed = json.loads(cli("cameras", "list", "--json").stdout)
    assert [one["name"] for one in listed] == ms.list_cameras()
    for one in listed[::7]:
        shown = cli("cameras", "show", one["name"])
        fields, unset = (
            shown.stdout.index("\nadc.bits"),
            shown.stdout.index("\nsensor.polarizers"),
        )
        assert fields < unset and shown.exit_code == 0, "unset fields are last"
    schema = json.loads(cli("cameras", "schema").stdout)
    assert {"sensor", "pixel", "adc", "lens"} <= set(schema["properties"])


@pytest.mark.exhaustive
def test_doctor_survives_and_says_what_works() -> None:
    command = [sys.executable, "-m", "mitsuba_sensor", "doctor", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    findings = json.loads(done.stdout)
    assert done.returncode == 0 and findings["works"] and findings["python"]["works"]
    assert {one["name"]: one["works"] for one in findings["variants"]}["scalar_spectral"]
    assert findings["versions"]["drjit"] and all(one["reason"] for one in findings["llvm"])


def test_doctor_reports_a_render_that_kills_its_process_and_a_missing_llvm(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    killed = (-signal.SIGABRT, "", "LLVM ERROR: Cannot select")
    monkeypatch.setattr(doctor, "_run", lambda _: killed)
    found = doctor.examine()
    assert not found["works"] and "SIGABRT" in found["variants"][0]["reason"]
    slow = {"render": {"variant": "scalar_spectral"}, "times_s": {"render": 1.0}}
    monkeypatch.setattr(doctor, "_run", lambda _: (0, json.dumps(slow), ""))
    found = doctor.examine()
    assert found["works"] and any("libllvm" in remedy for remedy in found["remedies"])
