"""Frames as real cameras leave them: jittering temperatures, folder names, descriptors, stuck lines, many notes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.small_cameras import SmallCamera

import mitsuba_sensor as ms
from mitsuba_sensor.files.raw_files import RawFile
from mitsuba_sensor.lab.frames import bench as bench_module
from mitsuba_sensor.lab.frames.bench import Bench, read_bench
from mitsuba_sensor.lab.frames.soundness import with_lines_filled
from mitsuba_sensor.lab.frames.stack import Stack, merged
from mitsuba_sensor.lab.measure.emva_linear import emva_linear
from mitsuba_sensor.lab.measure.measurement import measure_bench

CAMERA = SmallCamera()


def test_frames_within_one_kelvin_are_one_stack_and_the_bench_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CCD-TEMP of -20 ± 0.3 °C and of 0 °C in 12 headers each."""
    kelvins = {}
    rng = np.random.default_rng(1)
    for number in range(24):
        file = tmp_path / f"dark_{number:02}.npy"
        np.save(file, np.full((8, 8), number, np.uint16))
        kelvins[file.name] = 253.15 + 20 * (number % 2) + rng.uniform(-0.3, 0.3)

    def read(path: Path) -> RawFile:
        return RawFile(np.load(path)[None], 1.0, kelvins[path.name])

    monkeypatch.setattr(bench_module, "read_raw", read)
    bench = read_bench(tmp_path)
    assert [len(stack) for stack in bench.darks] == [12, 12]
    assert [stack.temperature_k for stack in bench.darks] == pytest.approx(
        [253.15, 273.15], abs=0.2
    )
    assert len(bench.notes) == 2 and "are taken as 253" in bench.notes[0]
    (measured,) = measure_bench(bench)
    assert sum("(within 1 K)" in note for note in measured.notes) == 1


def descriptor_of(folder: Path) -> Path:
    """Images of a small camera with the descriptor of EMVA 1288 beside them."""
    rng = np.random.default_rng(2)
    lines = ["# made by a test", "v 4.0", "n 12 40 32"]
    for number, photons in enumerate(np.linspace(0, 18_000, 20)):
        lines.append(
            "d 10000000" if not photons else f"b 10000000 {photons:.3f}".replace(".", ",")
        )
        for frame, image in enumerate(CAMERA.frames(rng, float(photons), 2, (32, 40))):
            np.save(folder / f"image {number}_{frame}.npy", image)
            lines.append(f"i .\\image {number}_{frame}.npy")
    path = folder / "EMVA1288_Data.txt"
    path.write_text("\n".join(lines))
    return path


def test_a_descriptor_of_emva_1288_is_read(tmp_path: Path) -> None:
    bench = read_bench(descriptor_of(tmp_path))
    assert len(bench.darks) == 1 and len(bench.flats) == 19
    assert {stack.bits for stack in bench.stacks} == {12}
    assert bench.flats[0].exposure_s == pytest.approx(0.01)
    found = emva_linear(bench.darks, bench.flats)
    assert found["K"].covers(0.3) and found["η"].covers(0.6), str(found["η"])
    path, short = tmp_path / "EMVA1288_Data.txt", "the longest exposure is 10 µs"
    assert not bench.notes
    path.write_text(
        path.read_text().replace("10000000", "9999")
    )  # microseconds for nanoseconds
    assert short in read_bench(path).notes[0]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("i a.npy", "line 1"),
        ("b 1 x\ni a.npy", "line 1: 'x'"),
        ("b 1\ni a.npy", "b has 1 arguments"),
        ("d 5\ni missing.tif", "line 2"),
        ("hello world", "'hello'"),
        ("v 4.0", "data.txt"),
    ],
)
def test_broken_descriptors_are_refused_with_the_line(
    text: str, named: str, tmp_path: Path
) -> None:
    path = tmp_path / "data.txt"
    path.write_text(text)
    with pytest.raises(ms.InputError, match=named):
        read_bench(path)


def with_stuck_lines(stack: Stack) -> Stack:
    """Column 7 at the largest code, row 30 dark: 1.4 % of the pixels of 64 × 150."""
    frames = stack.frames.copy()
    frames[:, :, 7], frames[:, 30] = 4095, 0
    return replace(stack, frames=frames)


def test_a_stuck_column_and_a_dead_row_cost_no_figure_its_interval() -> None:
    rng = np.random.default_rng(3)
    darks, flats = CAMERA.bench(rng, 4, (64, 150), 20)
    longer = [replace(CAMERA.stack(rng, 0.0, 4, (64, 150)), exposure_s=t) for t in (0.1, 1.0)]
    stacks = (with_stuck_lines(stack) for stack in (*darks, *longer))
    bench = Bench((), tuple(stacks), tuple(with_stuck_lines(flat) for flat in flats))
    (measured,) = measure_bench(bench)
    assert "of their neighbours: row 30 and column 7" in measured.notes[0]
    for symbol, true in (("K", 0.3), ("η", 0.6), ("σ_d", 6.0)):
        figure = measured.figures[symbol]
        assert figure.covers(true) and not figure.clipped, str(figure)
    assert math.isfinite(measured.figures["µ_I.mean"].value)
    assert not measured.hidden
    twin = ms.lab.fit(bench)
    assert any("row 30 and column 7" in note for note in twin.notes)
    assert twin.base.gain.quantity.covers(0.3) and twin.base.prnu("pixel").quantity.value < 0.02


def test_stuck_lines_of_a_mosaic_are_filled_by_lines_of_their_filter() -> None:
    rng = np.random.default_rng(8)
    tile = (("R", "G"), ("G", "B"))
    light = np.tile(np.array([[100.0, 200.0], [200.0, 300.0]]), (50, 60))
    flat = np.round(64 + light + rng.normal(0, 2, (2, 100, 120))).astype(np.uint16)
    dark = np.round(64 + rng.normal(0, 2, (2, 100, 120))).astype(np.uint16)
    flat[:, :, 21] = dark[:, :, 21] = 4095
    stacks = (Stack(dark, 0.1, 0.0, tile=tile), Stack(flat, 0.1, 99.0, tile=tile))
    filled, note = with_lines_filled(Bench((), stacks[:1], stacks[1:]))
    assert "column 21" in note
    np.testing.assert_array_equal(filled.flats[0].frames[:, :, 21], flat[:, :, 19])
    np.testing.assert_array_equal(filled.darks[0].frames[:, :, 22], dark[:, :, 22])


def test_uneven_light_and_even_sensors_have_no_stuck_lines() -> None:
    """Light that falls off to a third in the corners; and a sensor of 60 % dead columns, which is another case."""
    rng = np.random.default_rng(4)
    darks, flats = CAMERA.bench(rng, 2, (60, 80), 6)
    y, x = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 80), indexing="ij")
    uneven = CAMERA.stack(rng, 9000 * (1 - 0.33 * (x**2 + y**2)), 2, (60, 80))
    dead = flats[3].frames.copy()
    dead[:, :, ::3] = 64
    for flat in (uneven, replace(flats[3], frames=dead)):
        bench = Bench((), tuple(darks), (flat,))
        assert with_lines_filled(bench) == (bench, "")


def test_notes_that_differ_by_numbers_and_stack_are_one_sentence() -> None:
    notes = [f"flat_{n}.tiff: frame means drift by {n}.5 DN, removed" for n in range(85)]
    assert merged([*notes, "another note", "another note"]) == [
        "flat_0.tiff: frame means drift by 0.5 DN, removed (and 84 more stacks alike)",
        "another note",
    ]
