"""The denoiser example learns on a small dataset, and denoises scenes that it has not seen."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from mitsuba_sensor.dataset.plan import load_plan

ROOT = Path(__file__).parents[2]
PAIRS = ROOT / "examples" / "denoiser_pairs.toml"
SMALLER = {"width = 160": "width = 48", "spp = 128": "spp = 16"}


def test_no_scene_and_no_chip_of_the_test_is_in_training() -> None:
    scenes, chips = (
        {"train": set[str](), "test": set[str]()},
        {"train": set[str](), "test": set[str]()},
    )
    for task in load_plan(PAIRS).tasks():
        for sample in task.samples:
            scenes[sample.split].add(sample.values["scene"])
            chips[sample.split].add(f"{sample.values['camera']} {sample.values['serial']}")
    assert scenes["test"] == {"first_frame", "caustic"} and scenes["train"].isdisjoint(
        scenes["test"]
    )
    assert len(chips["test"]) == 2 and chips["train"].isdisjoint(chips["test"])


@pytest.mark.exhaustive
def test_a_network_leaves_less_noise_than_there_was_in_a_scene_that_it_has_not_seen(
    tmp_path: Path,
) -> None:
    """After 400 steps on two small renders by one camera, which is enough for smooth surfaces: 1.5 and 2.2 dB."""
    pytest.importorskip("jax")
    text = PAIRS.read_text("utf-8")
    for old, new in SMALLER.items():
        assert old in text
        text = text.replace(old, new)
    tables, grid, rest = text.partition("\n[grid]")
    left_out = ('name = "night_crossing"', 'camera = "sony_a7s2"')
    kept = [one for one in tables.split("\n[[") if not any(name in one for name in left_out)]
    text = "\n[[".join(kept) + grid + rest
    (tmp_path / "small.toml").write_text(text, "utf-8")
    command = [sys.executable, str(ROOT / "examples" / "train_a_denoiser.py"), "-o", "pairs"]
    command += ["--dataset", "small.toml", "--steps", "400", "--json"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")][-1]
    assert len(rows) == 6 and {row["pair"][0] for row in rows} == {"first_frame", "caustic"}
    for row in rows:
        scene, _, stops = row["pair"]
        if scene == "caustic" and stops in ("-5 EV", "-7 EV"):
            assert row["psnr_db"]["network"] > row["psnr_db"]["noisy"] + 0.7
    with Image.open(tmp_path / "pairs" / "denoised.png") as picture:
        assert picture.width > 4 * 48
