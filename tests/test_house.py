"""The rules of the house, read from the source: who may import whom, who prints, who opens files."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import mitsuba_sensor

PACKAGE = Path(mitsuba_sensor.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
IDS = [str(path.relative_to(PACKAGE)) for path in MODULES]

# A room may import the rooms of its own floor and of those below.
FLOORS = (("core",), ("sensor",), ("optics",), ("io", "render"), ("lab", "study"), ("cli",))
FLOOR = {domain: number for number, rooms in enumerate(FLOORS) for domain in rooms}
FRONT_DOOR = ("__init__.py", "__main__.py")

# Each foreign library has one door: where it may be imported.
DOORS = {
    "mitsuba": ("render/",),
    "drjit": ("render/", "optics/", "core/arrays.py", "core/drjit_backend.py", "core/llvm.py"),
    "OpenEXR": ("io/exr.py",),
    "tifffile": ("io/files.py",),
    "PIL": ("io/files.py",),
    "matplotlib": ("study/plots.py",),
    "colour": ("render/spectra.py",),
    "typer": ("cli/",),
    "rich": ("cli/",),
    "pydantic": ("sensor/",),
    "pyoidn": ("render/denoise.py",),
}
# What a first `import mitsuba_sensor` need not wait for: together these take more than five seconds.
SLOW = {"mitsuba", "drjit", "colour", "OpenEXR", "tifffile", "typer", "matplotlib", "scipy.signal", "scipy.stats"}
STAGES = ("sensor/electrons.py", "sensor/volts.py", "sensor/digital.py")
# Reading is allowed in more places: a camera's own text, scenes, the machine, the bytes that tell which LLVM it has.
OPENERS = (
    "io/files.py",
    "io/exr.py",
    "io/journal.py",
    "io/metadata.py",
    "sensor/camera.py",
    "sensor/qe_file.py",
    "sensor/lens_file.py",
    "core/llvm.py",
    "render/scene_file.py",
    "render/motion.py",
)
WRITERS = ("io/files.py", "io/journal.py")


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path) -> Iterator[str]:
    """Absolute dotted names of everything a module imports, inside functions too, annotations (TYPE_CHECKING) not."""
    package = ("mitsuba_sensor", *path.relative_to(PACKAGE).parent.parts)
    for node in executed(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join((*above, *((node.module,) if node.module else ())))
            yield from (f"{base}.{alias.name}" for alias in node.names)


def executed(node: ast.AST) -> Iterator[ast.AST]:
    """Every node but those below ``if TYPE_CHECKING:``."""
    if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
        return
    yield node
    for child in ast.iter_child_nodes(node):
        yield from executed(child)


def room_of(name: str) -> str:
    """engine, sensor, …, or the module's own name at the top: cli, doctor."""
    return name.split("/")[0].removesuffix(".py")


@pytest.mark.parametrize("path", MODULES, ids=IDS)
def test_imports_go_one_way(path: Path) -> None:
    if name_of(path) in FRONT_DOOR:
        return
    mine = FLOOR[room_of(name_of(path))]
    for imported in imports(path):
        parts = imported.split(".")
        if parts[0] == "mitsuba_sensor" and len(parts) > 1 and parts[1] in FLOOR:
            assert FLOOR[parts[1]] <= mine, f"{name_of(path)} reaches up to {imported}"
        elif parts[0] == "mitsuba_sensor":
            assert room_of(name_of(path)) == "cli", f"{name_of(path)} uses the guests' door: {imported}"


@pytest.mark.parametrize("path", MODULES, ids=IDS)
def test_each_foreign_library_has_one_door(path: Path) -> None:
    for imported in imports(path):
        doors = DOORS.get(imported.split(".")[0])
        assert doors is None or name_of(path).startswith(doors), f"{name_of(path)} imports {imported}"


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_knows_the_engine_and_nothing_else(name: str) -> None:
    neighbours = {domain for stage in STAGES for domain in (stage.replace("/", ".").removesuffix(".py"),)}
    for imported in imports(PACKAGE / name):
        assert not imported.startswith(("numpy", "scipy", "mitsuba.", "drjit")), f"{name} imports {imported}"
        assert not any(imported.startswith(f"mitsuba_sensor.{other}") for other in neighbours), f"{name}: {imported}"


@pytest.mark.parametrize("path", MODULES, ids=IDS)
def test_only_the_command_line_prints(path: Path) -> None:
    if room_of(name_of(path)) != "cli":
        calls = [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call)]
        assert not [call.lineno for call in calls if isinstance(call.func, ast.Name) and call.func.id == "print"]


@pytest.mark.parametrize("path", MODULES, ids=IDS)
def test_only_files_py_opens_and_writes_files(path: Path) -> None:
    name = name_of(path)
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called in ("open", "read_text", "read_bytes"):
                assert name in OPENERS, f"{name}:{node.lineno} reads a file"
            if called in ("write_text", "write_bytes", "mkdir", "unlink", "rmtree"):
                assert name in WRITERS, f"{name}:{node.lineno} writes a file"


@pytest.mark.parametrize("path", MODULES, ids=IDS)
def test_no_module_is_longer_than_350_lines(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 350


def test_the_front_door_has_at_most_20_names() -> None:
    assert len(mitsuba_sensor.__all__) <= 20
    assert all(hasattr(mitsuba_sensor, name) for name in mitsuba_sensor.__all__)


def test_importing_the_package_changes_nothing() -> None:
    code = (
        "import os, sys; before = dict(os.environ)\n"
        "import mitsuba_sensor\n"
        "assert dict(os.environ) == before, 'environment changed'\n"
        f"loaded = {SLOW} & set(sys.modules)\n"
        "assert not loaded, f'{loaded} imported'\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=dict(os.environ))
    assert done.returncode == 0, done.stderr
