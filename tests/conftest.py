"""Fixtures of several tests: a tiny scene, light without a render, the backends, the command line in this process."""

from __future__ import annotations

import gc
import os

gc.disable()  # while tests are collected, see pytest_collection_finish
# One process a processor: threads of OpenBLAS that wait for each other take a third of the time of fits.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
import pytest
import typer.main
import typer.testing
from helpers import ROOT
from typer.testing import CliRunner

from mitsuba_sensor.core.backend import NUMPY_FLOAT64
from mitsuba_sensor.core.llvm import backend_problem, drjit
from mitsuba_sensor.render.variants import fastest_variant
from mitsuba_sensor.sensor.run import choose_backend
from mitsuba_sensor.theory import expected, input_noise

SCENE = """
<scene version="3.0.0">
    <default name="level" value="0.0002"/>
    <default name="exposure_s" value="0.1"/>
    <integrator type="path"><integer name="max_depth" value="3"/></integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world"><lookat origin="0, 2, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film>
    </sensor>
    <shape type="sphere"><bsdf type="diffuse"><spectrum name="reflectance" value="0.5"/></bsdf></shape>
    <emitter type="constant"><spectrum name="radiance" value="$level"/></emitter>
</scene>
"""


typer.testing._get_command = cache(typer.main.get_command)
"""The parser of the command line is built once, not for each call: 25 ms."""

REPORTED_IN = {
    *("cli", "dataset", "files", "output", "render"),
    *("test_capture.py", "test_docs.py", "test_first_day.py", "test_light_remembers.py"),
    *("test_notebook.py", "test_notes.py", "test_metering.py", "test_gain_ladder.py"),
}
"""Folders and modules whose tests are not of the theory."""

STATES: dict[str, Any] = {}
"""Of the random numbers of each module that has an RNG, as it was imported."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The slowest tests begin first, so that every processor has work to the end."""
    items.sort(key=lambda item: item.path.name not in ("test_readme.py", "test_benchmarks.py"))
    for module in {item.module for item in items if isinstance(item, pytest.Function)}:
        if hasattr(module, "RNG"):
            STATES[module.__name__] = module.RNG.bit_generator.state


def pytest_collection_finish() -> None:
    """Collect no garbage among tests and modules, which stay: it takes a tenth of the time."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def _same_chance_in_every_order(request: pytest.FixtureRequest) -> None:
    """The random numbers of a module's RNG do not depend on which of its tests this process ran before."""
    if request.module.__name__ in STATES:
        request.module.RNG.bit_generator.state = STATES[request.module.__name__]


@pytest.fixture(autouse=True, scope="module")
def _theory_of_few_pixels(request: pytest.FixtureRequest) -> Iterator[None]:
    """Where theory is only reported, it is averaged over 4 windows instead of 16, and noise ratios are interpolated
    between exposure levels 13 % apart: less than half the time."""
    with pytest.MonkeyPatch.context() as patch:
        if {*request.path.relative_to(Path(__file__).parent).parts} & REPORTED_IN:
            patch.setattr(expected, "WINDOWS", 4)
            patch.setattr(expected, "WINDOWS_MAX", 4)
            patch.setattr(input_noise, "LEVELS", 129)
        yield


@pytest.fixture(autouse=True, scope="module")
def _datasets_compile_no_kernels(request: pytest.FixtureRequest) -> Iterator[None]:
    """Samples are rendered in a scalar variant, but for those of tests/dataset/test_truth.py."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name == "dataset" and request.path.stem != "test_truth":
            for name in ("light", "make"):
                place = f"mitsuba_sensor.dataset.{name}.fastest_variant"
                patch.setattr(place, lambda *backends: fastest_variant())
        yield


@pytest.fixture(autouse=True, scope="session")
def _integrators_are_compiled_once() -> Iterator[None]:
    """Mitsuba compiles its integrators of Python again whenever a variant is set: 0.25 s."""
    compile_syntax: Any = drjit().syntax
    codes: dict[Any, Any] = {}

    def syntax(function: Any = None, **options: Any) -> Any:
        if function is None:
            return partial(syntax, **options)
        code = function.__code__
        if code not in codes:
            codes[code] = compile_syntax(function, **options).__code__
        return FunctionType(codes[code], function.__globals__, argdefs=function.__defaults__)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drjit(), "syntax", syntax)
        yield


@pytest.fixture
def few_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same four windows in a test whose claim does not depend on their number."""
    monkeypatch.setattr(expected, "WINDOWS", 4)
    monkeypatch.setattr(expected, "WINDOWS_MAX", 4)


@pytest.fixture(autouse=True, scope="session")
def _slow_tests_say_no_progress() -> Iterator[None]:
    """What is written to stderr must not depend on how fast this machine is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mitsuba_sensor.core.progress.TICK_S", 1e6)
        yield


@pytest.fixture
def checkout_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What a checkout has, without what a command writes."""
    for name in ("scenes", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(params=("float64", "numpy", "drjit"))
def backend(request: pytest.FixtureRequest) -> Any:
    """Every backend in turn: the reference, NumPy in float32, and the compiled kernel where LLVM is usable."""
    if request.param == "float64":
        return NUMPY_FLOAT64
    if request.param == "drjit" and (problem := backend_problem("llvm")):
        pytest.skip(problem)
    return choose_backend(request.param, "float32", 0)


@pytest.fixture(scope="session")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A grey ball under a grey sky, 16 × 12 pixels, exposed for 0.1 s, with a level [W m⁻² sr⁻¹ nm⁻¹]."""
    path = tmp_path_factory.mktemp("scene") / "ball.xml"
    path.write_text(SCENE, encoding="utf-8")
    return path


@pytest.fixture
def cli() -> Callable[..., Any]:
    """Call the command line in this process: cli("render", scene, "-o", folder).exit_code, .stdout, .stderr."""
    from mitsuba_sensor.cli import app

    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope="session")
def light() -> Any:
    """Irradiance made by hand, 12 × 16 pixels, three bands: about half a full well of konnik_table1 in 0.1 s."""
    from mitsuba_sensor.render.light.irradiance import Irradiance
    from mitsuba_sensor.render.light.statistics import RenderStatistics

    random = np.random.default_rng(7)
    data = random.uniform(1e-5, 4e-5, (12, 16, 3)).astype(np.float32)
    statistics = RenderStatistics(
        passes=8,
        samples_per_pixel=64,
        seconds=1.5,
        variant="scalar_spectral",
        sampler="multijitter",
        noise_ratio_median=1.5,
        noise_ratio_p95=2.5,
        noise_ratio_max=float("inf"),
        noise_ratio_asked=None,
        ended_by="spp",
        reliable=True,
        firefly_fraction=0.0,
        spectral="cube",
        negative=1,
        non_finite=2,
        notes=("the film was replaced", "λ is Greek"),
        scene_sha256="0" * 64,
        aperture_f_number=None,
    )
    return Irradiance(
        data=data,
        wavelengths_nm=np.array([545.0, 555.25, 1000.5]),
        bandwidths_nm=np.array([10.0, 10.5, 2 / 3]),
        standard_error=(data * 0.01).astype(np.float32),
        relative_error=np.full((12, 16), 0.01, dtype=np.float32),
        statistics=statistics,
    )


@pytest.fixture
def light_file(light: Any, tmp_path: Path) -> Path:
    """That light as an irradiance.exr."""
    from mitsuba_sensor.output.exr import write_irradiance_exr

    path = tmp_path / "light" / "irradiance.exr"
    path.parent.mkdir()
    write_irradiance_exr(path, light)
    return path
