"""The benchmarks run, tiny, and say finite numbers; what they time is right, and says so itself."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import mutations
import pytest
from helpers import BENCHMARKS

import mitsuba_sensor


def run(script: str, *arguments: str) -> Any:
    """What a benchmark prints with --json."""
    command = [sys.executable, str(BENCHMARKS / script), *arguments, "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def numbers(tree: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Every number of a result, with the path that leads to it."""
    if isinstance(tree, dict | list):
        for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield from numbers(value, f"{path}/{key}")
    elif isinstance(tree, int | float) and not isinstance(tree, bool):
        yield path, tree


def assert_speeds(found: Any, *names: str) -> None:
    """Each name has seconds, Mpx/s and ratios, all finite and above 0."""
    assert set(names) <= set(found)
    for path, number in numbers(found):
        assert math.isfinite(number) and number > 0, f"{path} is {number}"


def test_the_plain_chain_makes_the_frames_that_expose_makes() -> None:
    for camera, found in run("plain_chain.py", "--mpx", "0.03").items():
        assert found["agrees"], f"{camera}: {found}"


WELL_KNOWN = {
    "coverage",
    "numba",
    "torch",
    "jax",
    "pandas",
    "xarray",
    "dask",
    "astropy",
    "pyxel",
    "galsim",
    "getframes",
}


@pytest.mark.parametrize(
    "folder", [BENCHMARKS, BENCHMARKS.parent / "examples"], ids=lambda folder: folder.name
)
def test_no_script_has_the_name_of_a_package(folder: Path) -> None:
    """A script's folder comes first on the path of imports, so that its neighbours would hide the package."""
    taken = WELL_KNOWN | sys.stdlib_module_names | set(packages_distributions())
    ours = {path.stem for path in folder.glob("*.py")}
    assert ours or not folder.exists()
    assert not ours & taken


TINY = ("--mpx", "0.01", "--content", "ramp", "--turns", "1")


@pytest.mark.exhaustive
def test_every_case_has_a_speed_and_a_ratio() -> None:
    arguments = "--electrons 1 1000 --engines numpy drjit --parts cases"
    speed = run("backend_speed.py", *TINY, *arguments.split())
    engines = {"numpy", "drjit"} - set(speed["refused"])
    assert [row["electrons"] for row in speed["cases"]["rows"]] == [1, 1000]
    for row in speed["cases"]["rows"]:
        assert_speeds(row["engines"], "plain", *engines)
        assert row["engines"]["plain"]["ratio_to_plain"] == 1
    assert_speeds(speed["cases"]["summary"], *engines)


@pytest.mark.exhaustive
def test_first_frames_are_timed_in_new_processes() -> None:
    arguments = "--electrons 1000 --engines drjit --parts first"
    speed = run("backend_speed.py", *TINY, *arguments.split())
    if speed["refused"]:
        pytest.skip(speed["refused"]["drjit"])
    first = speed["first"]["drjit"]
    assert all(
        first[name] > 0 for name in ("fresh_first_s", "cached_first_s", "steady_s", "compile_s")
    )
    assert math.isfinite(first["cached_compile_s"])


@pytest.mark.exhaustive
def test_the_first_command_is_timed() -> None:
    variants = run("first_command.py", "--runs", "0", "--width", "12")["variants"]
    assert "error" not in variants["scalar_spectral"]
    for found in variants.values():
        assert "error" in found or all(math.isfinite(x) and x > 0 for x in found.values())


@pytest.mark.exhaustive
def test_coverage_of_the_error_bars_is_a_share_of_the_pixels() -> None:
    for row in run("error_bar_coverage.py", "--quick"):
        assert 0 <= row["z1"] <= row["z2"] <= 1, row


def assert_positive(tree: Any) -> None:
    """All numbers are finite and above 0."""
    for path, number in numbers(tree):
        assert math.isfinite(number) and number > 0, f"{path} is {number}"


@pytest.mark.exhaustive
def test_a_render_is_timed_against_plain_mitsuba_in_one_process_and_in_new_ones() -> None:
    arguments = "--variants scalar_spectral --spp 16 --size 8 --turns 1 --processes 0"
    (found,) = run("render_cost.py", *arguments.split()).values()
    assert_positive(found)
    assert {"plain 1 band", "ours 1 band", "ours channels", "ours 30 bands"} <= set(
        found["warm"]
    )


@pytest.mark.exhaustive
def test_denoised_light_is_compared_with_a_reference() -> None:
    """16 samples of a Cornell box of 32 × 32 pixels: denoised, the median squared error is at most two thirds."""
    scene = str(BENCHMARKS.parent / "scenes" / "cornell_box.xml")
    sizes = ("--width", "32", "--spp", "16", "--reference", "256", "--seeds", "1")
    (row,) = run("denoise.py", "--scenes", scene, *sizes)
    assert all(math.isfinite(number) for _, number in numbers(row))
    assert row["denoised"]["median"] < 0.67 * row["raw"]["median"]
    assert row["denoised"]["z2"] > 0.85


@pytest.mark.exhaustive
def test_every_simulator_has_a_run_time_and_an_error() -> None:
    found = run("simulators.py", "--turns", "1")["simulators"]
    assert len(found) >= 3
    for name, one in found.items():
        assert_positive({name: one})
        assert one["error_dn"] < 0.02 or not name.startswith("this package"), name


def test_every_mutation_is_of_a_text_that_the_package_has_once() -> None:
    package = Path(mitsuba_sensor.__file__).parent
    assert len(mutations.MUTATIONS) >= 40
    assert not [x for x in mutations.MUTATIONS if mutations.place_of(x, package) is None]


@pytest.mark.exhaustive
def test_each_mutation_fails_a_quick_test() -> None:
    found = run("mutations.py")
    assert found["mutations"] >= 40 and not found["missed"], found


@pytest.mark.exhaustive
def test_a_dataset_survives_kills() -> None:
    found = run("dataset_runs.py", "--samples", "4", "--width", "16", "--kills", "4")
    assert found["same_bytes"] and not found["torn_shards"]
    assert_positive({name: found[name] for name in ("bytes_per_sample", "seconds_per_sample")})


@pytest.mark.exhaustive
def test_theory_and_frames_of_a_shipped_camera_agree() -> None:
    arguments = "--serials 8 --frames 2 --cases konnik"
    assert all(row["ok"] for row in run("theory.py", *arguments.split())["rows"])
