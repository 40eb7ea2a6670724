"""The pages of docs: each is in the index, its code runs, and what is generated for the site is in the package."""

from __future__ import annotations

import importlib.util
import inspect
import json
import re
import shlex
import tomllib
from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer.main
from helpers import ROOT
from helpers.marks import exhaustive
from helpers.pages import blocks, fenced, lines

import mitsuba_sensor as ms
from mitsuba_sensor.cli import app
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.render.scene.motion import read_motion
from mitsuba_sensor.render.scene.parse_scene import parse
from mitsuba_sensor.render.scene.plugin_parameters import (
    FILM_PARAMETERS,
    PASSED_ON_PARAMETERS,
    SENSOR_PARAMETERS,
)
from mitsuba_sensor.render.variants import choose_variant, use, variant_restored
from mitsuba_sensor.stages.chain import ORDER

DOCS = ROOT / "docs"
PAGES = {path.stem: path.read_text("utf-8") for path in sorted(DOCS.glob("*.md"))}
WITH_CODE = [name for name, text in PAGES.items() if blocks(text) and name != "camera-file"]
"""camera-file.md has tests of its own."""

SMALL = {
    "render": ("--width", "16", "--spp", "16", "--no-denoise"),
    "fpn-maps": ("--rows", "11", "--width", "16"),
}
"""What the commands of the pages get in addition here."""

LONG_PAGES = {
    *("datasets", "exports-and-training", "exposure-and-colour", "frames", "hdr"),
    *("image-quality", "lab", "light-and-time", "noise-budget", "optics-and-pixels"),
    *("rendering", "start"),
}
"""Their commands and calls are those of other pages, with other options; or have tests of their own."""

LONG = r"\bstudy\b|\bcharacterize\b|\bsheet\b|imx477|my\.toml|--noise-ratio|--render-noise|--motion|--dng|\bdataset\b"
LONG += r"|_split_pixel --electrons"
"""What only the command line's parser sees here: it takes long, and has tests of its own."""


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


GENERATED = load(DOCS / "generated.py")


def parsed(arguments: list[str]) -> None:
    """Let the command line's own parser read a command; it raises where an option or an argument is wrong."""
    command: Any = typer.main.get_command(app)
    while hasattr(command, "resolve_command"):
        context = command.make_context(
            command.name, list(arguments), help_option_names=[], allow_extra_args=True
        )
        _, command, arguments = command.resolve_command(context, arguments)
    command.make_context(command.name, list(arguments))


def run(command: str, cli: Callable[..., Any]) -> None:
    program, *arguments = shlex.split(command.removesuffix("|| true"), comments=True)
    assert program == "mitsuba-sensor", command
    if re.search(LONG, command):
        parsed(arguments)
        return
    done = cli(*arguments, *SMALL.get(arguments[0], ()))
    assert done.exit_code == 0, (command, done.stderr)


def run_python(text: str, names: dict[str, Any]) -> None:
    """Run a block with images of 36 columns; the variant of Mitsuba is that of before afterwards.

    PyTorch is no dependency: what is for it is read alone, where it is not there.
    """
    code = compile(re.sub(r"\bwidth=\d+", "width=36", text), "page", "exec")
    if "import torch" not in text or importlib.util.find_spec("torch") is not None:
        use(choose_variant("scalar_spectral"))
        with variant_restored():
            exec(code, names)


@pytest.mark.parametrize(
    "name", [exhaustive(name) if name in LONG_PAGES else name for name in WITH_CODE]
)
def test_the_code_of_a_page_runs_in_its_order(
    name: str, checkout_folder: Path, cli: Callable[..., Any]
) -> None:
    """Renders have 16 columns and 16 samples. Python goes on with the names of the blocks before it."""
    names: dict[str, Any] = {}
    for block in blocks(PAGES[name]):
        if block.language == "sh":
            for command in lines(block.text):
                if not command.startswith("pip"):
                    run(command, cli)
                elif "&&" in command:
                    run(command.partition("&& ")[2], cli)
        elif block.language == "xml" and (file := re.match(r"<!-- ([\w.]+) -->\n", block.text)):
            (checkout_folder / file.group(1)).write_text(
                block.text.partition("\n")[2], encoding="utf-8"
            )
        elif block.language == "python" and "needs LLVM" not in block.text:
            run_python(block.text, names)
    if name == "tutorial":  # its noise budget is of a frame that is not clipped
        assert (names["metered"].digital > 0.95 * (2**12 - 1)).mean() < 0.01


@pytest.mark.exhaustive
@pytest.mark.skipif(bool(backend_problem("llvm")), reason="needs LLVM")
def test_blocks_that_need_llvm_run() -> None:
    (text,) = (one.text for one in blocks(PAGES["python"]) if "needs LLVM" in one.text)
    run_python(text, {})


def test_all_code_has_a_language_that_the_tests_know() -> None:
    languages = {block.language for text in PAGES.values() for block in blocks(text)}
    assert languages == {"sh", "python", "xml", "toml", "console"}


def test_every_page_is_in_the_index_once() -> None:
    listed = [page for pages in GENERATED.pages_of(PAGES["index"]).values() for page in pages]
    assert sorted(listed) == sorted({*PAGES, "studies/README"} - {"index"})


def test_the_notebook_is_the_tutorial() -> None:
    """Its cells of code are the Python blocks of the page. `python docs/generated.py` writes it."""
    text = (ROOT / "examples/tutorial.ipynb").read_text("utf-8")
    code = ["".join(c["source"]) for c in json.loads(text)["cells"] if c["cell_type"] == "code"]
    python = [one.text for one in blocks(PAGES["tutorial"]) if one.language == "python"]
    assert [f"{one}\n" for one in code] == python
    assert text == GENERATED.notebook(PAGES["tutorial"])
    for link in re.findall(r"\]\((?!https?:)([^)#]+)", text):
        assert (ROOT / "examples" / link).exists(), link


def test_start_begins_with_the_first_command_of_the_readme() -> None:
    first = lines(fenced((ROOT / "README.md").read_text("utf-8"), "sh"))[0]
    assert lines(fenced(PAGES["start"], "sh"))[0] == first


def test_every_mark_of_a_page_is_replaced() -> None:
    marks = re.findall(r"<!-- generated: (\w+) -->", "".join(PAGES.values()))
    assert sorted(marks) == sorted(GENERATED.PARTS)
    whole = GENERATED.with_generated_parts(PAGES["api"])
    assert "<!-- generated" not in whole and "autofunction" in whole


def test_the_pages_have_the_tables_that_the_package_makes_now() -> None:
    changed = [name for name, text in PAGES.items() if GENERATED.with_tables(text) != text]
    assert not changed, "`python docs/generated.py` writes the tables of these pages"
    begun = re.findall(r"^<!-- table: (\w+), ", "".join(PAGES.values()), re.M)
    assert sorted(begun) == sorted(GENERATED.IN_PAGES)


def commands(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    """A command and all below it; those of the program are imported when they are asked for."""
    yield name, command
    if hasattr(command, "list_commands"):
        for inner_name in command.list_commands(None):
            yield from commands(command.get_command(None, inner_name), f"{name} {inner_name}")


def test_the_command_line_page_has_every_command_and_every_option_in_its_place() -> None:
    headings = re.split(r"^## (.+)$", PAGES["command-line"], flags=re.M)[1:]
    parts = dict(zip(*[iter(headings)] * 2, strict=True))
    whole = dict(commands(typer.main.get_command(app), "mitsuba-sensor"))
    found = {
        name.removeprefix("mitsuba-sensor "): one
        for name, one in whole.items()
        if not hasattr(one, "list_commands")
    }
    assert len(found) > 15 and set(parts) == set(found)
    for name, text in parts.items():
        for option in found[name].params:
            assert all(
                re.search(rf"(?<![\w-]){re.escape(one)}(?![\w-])", text)
                for one in option.opts
                if one[0] == "-"
            )


def test_the_api_page_has_every_public_name_once() -> None:
    named = re.findall(
        r"^\.\. (?:auto|py:)(\w+):: mitsuba_sensor\.([\w.]+)$", GENERATED.api(), re.M
    )
    of_lab = [f"lab.{name}" for name in ms.lab.__all__]
    assert sorted(name for _, name in named) == sorted([*ms.__all__, *of_lab])
    for kind, name in named:
        value = attrgetter(name)(ms)
        assert (kind == "function") == inspect.isfunction(value)


def test_the_page_of_the_stages_has_them_in_the_order_of_the_chain_with_their_keys() -> None:
    page = GENERATED.stages()
    assert re.findall(r"autoclass:: [\w.]+\.(\w+)$", page, re.M) == [
        stage.__name__ for stage in ORDER
    ]
    for part, stage in zip(page.split("\n## "), ORDER, strict=True):
        keys = set(stage.fields.model_fields) if stage.fields else set()
        assert set(re.findall(r"^\| `(\w+)` \|", part, re.M)) == keys


def test_the_motion_of_the_page_is_one() -> None:
    motion = read_motion(tomllib.loads(fenced(PAGES["light-and-time"], "toml")))
    assert motion.camera is not None and set(motion.objects) == {"fan", "ball"}


SCENE = """<scene version="3.0.0"><sensor type="camera">{sensor}
    <film type="photosensor">{film}</film></sensor><emitter type="constant"/></scene>"""


def test_every_plugin_parameter_of_the_page_is_read_as_its_example_says(tmp_path: Path) -> None:
    """All examples together are one scene, but for the metering, which takes the place of an exposure time."""
    given = {
        one.name: one for one in (*FILM_PARAMETERS, *SENSOR_PARAMETERS, *PASSED_ON_PARAMETERS)
    }
    tables = GENERATED.film(), GENERATED.sensor()
    assert [re.findall(r"^\| `(\w+)` \|", one, re.M) for one in tables] == [
        [one.name for one in FILM_PARAMETERS],
        [one.name for one in (*SENSOR_PARAMETERS, *PASSED_ON_PARAMETERS)],
    ]
    film, sensor = ("\n".join(re.findall(r"`(<.+>)` \|$", one, re.M)) for one in tables)
    path = tmp_path / "scene.xml"
    path.write_text(
        SCENE.format(film=film.replace(given["exposure_s"].xml, ""), sensor=sensor),
        encoding="utf-8",
    )
    assert parse(path, {}).settings.meter == given["meter"].example
    path.write_text(
        SCENE.format(film=film.replace(given["meter"].xml, ""), sensor=sensor), encoding="utf-8"
    )
    found = parse(path, {}).settings
    assert found.camera is not None and found.camera.name == given["camera"].example
    for name in (
        "exposure_s",
        "temperature_k",
        "seed",
        "serial",
        "wavelength_nm",
        "bandwidth_nm",
        "focal_length_mm",
    ):
        assert getattr(found, name) == float(given[name].example), name
    assert {name: str(value) for name, value in found.size.items()} == {
        name: given[name].example for name in found.size
    }
    assert (
        len(found.size) == 6
        and found.spectral == given["spectral"].example
        and found.unit_m == 0.01
    )
    assert found.camera.lens.f_number == 2.8 and found.camera.lens.pupil_magnification == 1.1
    assert found.camera.lens.transmission_curve == (0.9, 0.95) and found.focus_distance_m == 2


def test_the_camera_in_a_scene_file_of_the_page_is_one(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    (text,) = (one.text for one in blocks(PAGES["scene"]) if one.text.startswith("<sensor"))
    path.write_text(
        f'<scene version="3.0.0">{text}<emitter type="constant"/></scene>', encoding="utf-8"
    )
    settings = parse(path, {}).settings
    assert settings.camera is not None and (settings.camera.adc.bits, settings.exposure_s) == (
        14,
        0.1,
    )


def test_every_example_is_in_the_gallery_with_a_picture() -> None:
    rows = re.findall(r"^\| (\[.*) \|$", PAGES["tutorial"].partition("## Gallery")[2], re.M)
    examples = [re.findall(r"\]\(\.\./examples/([\w.]+)\)", row) for row in rows]
    assert sorted(name for names in examples for name in names) == sorted(
        path.name for path in (ROOT / "examples").iterdir() if path.suffix in (".py", ".toml")
    )
    assert all(re.search(r"!\[[^]]{10,}\]\([\w/-]+\.png\)$", row) for row in rows)
