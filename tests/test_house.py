"""Rules of the package, read from its source: who imports whom, where files are opened, how large things may be."""

from __future__ import annotations

import ast
import functools
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import mitsuba_sensor

PACKAGE = Path(mitsuba_sensor.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

ORDER = (("core",), ("sensor",), ("optics",), ("io", "render"), ("pipeline",), ("dataset", "lab", "study"), ("cli",))
"""A sub-package may import those of its own place and those before it."""
PLACE = {name: number for number, names in enumerate(ORDER) for name in names}
PUBLIC_API = ("__init__.py", "__main__.py")
USERS_OF_THE_PUBLIC_API = ("cli", "study", "dataset", "pipeline")

IMPORTED_IN = {
    "mitsuba": ("render/",),
    "drjit": ("core/",),
    "OpenEXR": ("io/exr.py",),
    "tifffile": ("io/files.py",),
    "PIL": ("io/files.py",),
    "matplotlib": ("study/drawing.py",),
    "colour": ("render/spectra.py",),
    "typer": ("cli/",),
    "rich": ("cli/",),
    "pydantic": ("sensor/", "render/"),
    "pyoidn": ("render/denoise.py",),
}
"""Foreign library → the one place that imports it."""

SLOW = {"mitsuba", "drjit", "colour", "OpenEXR", "tifffile", "typer", "matplotlib", "scipy.signal", "scipy.stats"}
"""What `import mitsuba_sensor` does not import: together these take more than five seconds."""

READERS = (
    "io/",
    "sensor/camera.py",
    "sensor/qe_file.py",
    "sensor/lens_file.py",
    "core/llvm.py",
    "render/scene_file.py",
    "render/motion.py",
)
"""Files are read in io/, and: a camera's own text, scenes, the bytes that tell which LLVM this machine has."""
WRITERS = ("io/",)


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


@functools.cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@functools.cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(text_of(path))


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


def sub_package(name: str) -> str:
    """core, sensor, …, or the module's own name at the top: pipeline."""
    return name.split("/")[0].removesuffix(".py")


def test_imports_go_one_way() -> None:
    wrong = []
    for path in MODULES:
        mine = sub_package(name_of(path))
        for imported in imports(path) if name_of(path) not in PUBLIC_API else ():
            library, _, rest = imported.partition(".")
            if library == "mitsuba_sensor":
                other = rest.partition(".")[0]
                allowed = PLACE[other] <= PLACE[mine] if other in PLACE else mine in USERS_OF_THE_PUBLIC_API
                wrong += [] if allowed else [f"{name_of(path)} imports {imported}"]
    assert not wrong, wrong


def test_each_foreign_library_is_imported_in_one_place() -> None:
    wrong = [
        f"{name_of(path)} imports {imported}"
        for path in MODULES
        for imported in imports(path)
        if not name_of(path).startswith(IMPORTED_IN.get(imported.partition(".")[0], ""))
    ]
    assert not wrong, wrong


def calls(path: Path) -> Iterator[tuple[str, str]]:
    """Name of every function or method that a module calls, and where."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            yield name, f"{name_of(path)}:{node.lineno}"


def test_only_the_command_line_prints() -> None:
    wrong = [
        f"{place} prints"
        for path in MODULES
        for called, place in calls(path)
        if called == "print"
        if sub_package(name_of(path)) != "cli"
    ]
    assert not wrong, wrong


def test_files_are_read_and_written_in_io() -> None:
    wrong = []
    for path in MODULES:
        for called, place in calls(path):
            reads = called in ("open", "read_text", "read_bytes") and not place.startswith(READERS)
            writes = called in ("write_text", "write_bytes", "mkdir", "unlink", "rmtree")
            if reads or (writes and not place.startswith(WRITERS)):
                wrong.append(f"{place} calls {called}")
    assert not wrong, wrong


def public(node: ast.Module | ast.ClassDef) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Public functions and classes of a module, and the public methods of those classes."""
    for child in node.body:
        if isinstance(child, ast.FunctionDef | ast.ClassDef) and not child.name.startswith("_"):
            yield child
            if isinstance(child, ast.ClassDef):
                yield from public(child)


def test_public_names_have_docstrings_and_return_types() -> None:
    """98 % at least have a docstring, all have a return type; every module has a docstring."""
    assert all(ast.get_docstring(tree_of(path)) for path in MODULES)
    names = [(name_of(path), node) for path in MODULES for node in public(tree_of(path))]
    silent = [f"{where}: {node.name}" for where, node in names if not ast.get_docstring(node)]
    assert len(silent) <= 0.02 * len(names), silent
    assert not [
        f"{where}: {node.name}" for where, node in names if isinstance(node, ast.FunctionDef) and node.returns is None
    ]


def test_the_public_api_has_at_most_20_names() -> None:
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
