"""The fixed patterns of a chip in a file: written, read, given back to a camera; and files that are none."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.files import npz
from mitsuba_sensor.render.load.scene import Scene

TABLE1 = ms.load_camera("konnik_table1")
SIZE = ("--rows", 12, "--width", 16)
NARROW = ("--wavelength-nm", 550, "--spp", 16)
Cli = Callable[..., Any]


def test_patterns_come_back_bit_by_bit(tmp_path: Path) -> None:
    found = ms.fpn_maps(TABLE1, (12, 16), serial=7)
    npz.write_fpn_maps(tmp_path / "chip.npz", found)
    back = npz.read_fpn_maps(tmp_path / "chip.npz")
    assert list(back) == list(found)
    for name, values in found.items():
        assert back[name].dtype == np.float64 and back[name].tobytes() == values.tobytes()
    assert [path.name for path in tmp_path.iterdir()] == ["chip.npz"], "no temporary file stays"


def archive(**arrays: Any) -> bytes:
    whole = io.BytesIO()
    np.savez_compressed(whole, **arrays)
    return whole.getvalue()


def single() -> bytes:
    whole = io.BytesIO()
    np.save(whole, np.ones((3, 4)))
    return whole.getvalue()


GOOD = archive(prnu=np.random.default_rng(1).uniform(0.9, 1.1, (12, 16)))
BAD = {
    "nothing": b"",
    "text": b"prnu = 1.0",
    "cut short": GOOD[: len(GOOD) // 2],
    "without its end": GOOD[:-5],
    "damaged": GOOD[:400] + bytes(byte ^ 255 for byte in GOOD[400:420]) + GOOD[420:],
    "a single array": single(),
    "Python objects": archive(prnu=np.array([{}, None], dtype=object)),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_file_of_patterns_is_refused_in_one_sentence(
    case: str, tmp_path: Path
) -> None:
    (tmp_path / "bad.npz").write_bytes(BAD[case])
    with pytest.raises(ms.InputError, match=r"bad.npz .*mitsuba-sensor fpn-maps") as caught:
        npz.read_fpn_maps(tmp_path / "bad.npz")
    assert "\n" not in str(caught.value)


@pytest.fixture
def chip(tmp_path: Path, cli: Cli) -> Path:
    """The patterns of serial 7, written by the command line."""
    path = tmp_path / "chip7.npz"
    done = cli("fpn-maps", "-o", path, "--serial", 7, *SIZE)
    assert done.exit_code == 0, done.stderr
    return path


def test_the_command_line_writes_what_patterns_returns_and_says_what_is_in_it(
    chip: Path, tmp_path: Path, cli: Cli
) -> None:
    for name, values in ms.fpn_maps(TABLE1, (12, 16), serial=7).items():
        np.testing.assert_array_equal(npz.read_fpn_maps(chip)[name], values)
    said = cli("fpn-maps", "-o", tmp_path / "x.npz", *SIZE).stdout
    assert "x.npz" in said and "dark_fpn" in said and "12, 16" in said
    spread = json.loads(cli("fpn-maps", "-o", tmp_path / "x.npz", *SIZE, "--json").stdout)
    assert spread["prnu"]["shape"] == [12, 16]
    assert spread["prnu"]["mean"] == pytest.approx(1, abs=5 * 0.005 / np.sqrt(192))
    assert spread["dsnu_col_e"]["sigma"] > 0


def test_without_a_size_the_whole_sensor_is_written(tmp_path: Path, cli: Cli) -> None:
    sides = ("--set", "sensor.rows=5", "--set", "sensor.columns=9")
    done = cli("fpn-maps", "-o", tmp_path / "x.npz", *sides, "--json")
    assert json.loads(done.stdout)["prnu"]["shape"] == [5, 9]


def test_a_frame_of_given_maps_is_the_frame_of_their_sensor(
    chip: Path, light_file: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Serial 1 with the maps of serial 7 is serial 7, byte by byte in the same temporal noise, and no other."""
    monkeypatch.setattr(ms.stages.Frame, "key", 5)
    arguments = {"given": ("--fpn-maps", chip), "own": ("--serial", 7), "other": ()}
    for name, more in arguments.items():
        done = cli("expose", light_file, "-o", tmp_path / name, "--frames", 2, *more)
        assert done.exit_code == 0, done.stderr
    raw = {name: (tmp_path / name / "frame.tiff").read_bytes() for name in arguments}
    assert raw["given"] == raw["own"] != raw["other"]
    report = json.loads((tmp_path / "given" / "frame.json").read_text(encoding="utf-8"))
    assert {"prnu", "dsnu_col_e"} <= set(report["given_maps"])


def test_a_render_takes_given_patterns_as_well(
    chip: Path, scene_file: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ms.stages.Frame, "key", 5)
    for name, more in {"given": ("--fpn-maps", chip), "own": ("--serial", 7)}.items():
        done = cli("render", scene_file, "-o", tmp_path / name, *NARROW, *more)
        assert done.exit_code == 0, done.stderr
    assert (tmp_path / "given" / "frame.tiff").read_bytes() == (
        tmp_path / "own" / "frame.tiff"
    ).read_bytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--fpn-maps", "PRNV"), "Did you mean 'prnu'"),
        (("--serial", -1), "serial is -1"),
    ],
    ids=["unknown map", "serial"],
)
def test_what_expose_would_refuse_is_refused_before_the_render(
    arguments: Any,
    said: str,
    scene_file: Path,
    tmp_path: Path,
    cli: Cli,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A render may take an hour."""
    places = {"PRNV": tmp_path / "prnv.npz", "PRNU": tmp_path / "prnu.npz"}
    for path in places.values():
        npz.write_fpn_maps(path, {path.stem: np.ones((12, 16))})
    monkeypatch.setattr(Scene, "render", lambda *_: pytest.fail("rendered for nothing"))
    done = cli(
        "render",
        scene_file,
        "-o",
        tmp_path / "out",
        *(places.get(argument, argument) for argument in arguments),
    )
    assert done.exit_code == 2 and said in done.stderr, (done.exception, done.stderr)
    assert not (tmp_path / "out").exists()
