"""Links, images, anchors and names that the documentation mentions: each must exist."""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from helpers import ROOT

PACKAGE = ROOT / "mitsuba_sensor"
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path.name != "__main__.py")
SCRIPTS = sorted(
    path
    for folder in ("benchmarks", "reproduction", "examples", "tests")
    for path in (ROOT / folder).rglob("*.py")
)
FOLDERS = (
    "mitsuba_sensor",
    "docs",
    "examples",
    "benchmarks",
    "reproduction",
    "scenes",
    "tests",
)


def without_code(text: str) -> str:
    """Markdown without fenced blocks and without `code`, in which brackets are no links."""
    return re.sub(
        r"`[^`\n]*`", "", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    )


@cache
def anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives to the headings of a page."""
    headings = re.findall(
        r"^#+ +(.*)$",
        re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.S | re.M),
        re.M,
    )
    return {
        re.sub(r"[^\w\- ]", "", re.sub(r"\[(.*?)\]\(.*?\)", r"\1", h).lower()).replace(" ", "-")
        for h in headings
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_image_and_anchor_of_a_page_resolves(page: Path) -> None:
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text("utf-8"))):
        if re.match(r"https?:|mailto:", target):
            continue
        file, _, anchor = target.partition("#")
        path = (page.parent / file).resolve() if file else page
        if not path.exists() or (anchor and anchor not in anchors(path)):
            broken.append(target)
    assert not broken


@cache
def ends_of_paths() -> set[str]:
    """How the paths of the files of the repository end: from each of their slashes on."""
    ends = set[str]()
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*.*"):
            parts = path.relative_to(ROOT).parts
            ends |= {"/" + "/".join(parts[first:]) for first in range(len(parts))}
    return ends


def missing_files(text: str) -> list[str]:
    """Python and Markdown files, and paths below the folders of the repository, that a text names and nobody has."""
    named = re.findall(r"(?<![\w./:*-])[\w./-]*\w\.(?:py|md)\b", text)
    named += re.findall(rf"(?<![\w./:*-])(?:{'|'.join(FOLDERS)})/[\w./-]+\.\w+", text)
    paths = {name: "/" + re.sub(r"^(\.{1,2}/)+", "", name) for name in named}
    return [name for name, path in paths.items() if path not in ends_of_paths()]


@cache
def names_of_tests() -> set[str]:
    """The names of all test files and test functions."""
    paths = sorted((ROOT / "tests").rglob("test_*.py"))
    functions = [
        re.findall(r"^def (test_\w+)", path.read_text("utf-8"), re.M) for path in paths
    ]
    return {path.stem for path in paths} | {name for those in functions for name in those}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_and_tests_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text("utf-8")
    named = re.findall(r"`(test_\w+?)(…?)`", text)
    unknown = [
        name
        for name, more in named
        if not any(t == name or (more and t.startswith(name)) for t in names_of_tests())
    ]
    assert not missing_files(text) + unknown


@cache
def prose(path: Path) -> list[tuple[int, str]]:
    """Line and text of every docstring and comment of a Python file."""
    source, found = path.read_text(encoding="utf-8"), []
    for node in statements(ast.parse(source)):
        inner = node.value if isinstance(node, ast.Expr) else None
        if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
            found.append((node.lineno, inner.value))
    if names_something(after_hashes(source)):  # a comment may; finding the tokens takes long
        for token in tokenize.generate_tokens(io.StringIO(source).readline):
            if token.type == tokenize.COMMENT:
                found.append((token.start[0], token.string))
    return found


def statements(node: ast.AST) -> Iterator[ast.stmt]:
    """Every statement below a node; expressions, which hold no docstrings, are not gone through."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt):
            yield child
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield from statements(child)


def after_hashes(source: str) -> str:
    """Whatever stands behind a # in a line, comments among it."""
    return "\n".join(re.findall("#.*", source))


def names_something(text: str) -> bool:
    """Whether a text names a file that nobody has, or has a role of Sphinx."""
    return bool(missing_files(text)) or ":`" in text


def test_files_that_docstrings_and_comments_name_exist() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in (*MODULES, *SCRIPTS)
        for line, text in prose(path)
        for name in missing_files(text)
    ]
    assert not found, "\n".join(found)


def resolved(name: str, module: ModuleType) -> bool:
    """Whether a name exists: in the module, in one of its classes, in its package, or below mitsuba_sensor."""
    top = importlib.import_module("mitsuba_sensor")
    classes = [value for value in vars(module).values() if inspect.isclass(value)]
    name = name.removeprefix("mitsuba_sensor.").removeprefix(".")
    if any(has(start, name) for start in (module, builtins, top, *classes)):
        return True
    packages = (
        module.__package__ or "",
        (module.__package__ or "").rpartition(".")[0],
        "mitsuba_sensor",
    )
    return any(below(package, name) for package in packages if package)


def below(package: str, name: str) -> bool:
    """Whether a dotted name is a module below a package, or a name in one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join((package, *parts[:n])))
        except ImportError:
            continue
        return n == len(parts) or has(found, ".".join(parts[n:]))
    return False


def has(start: Any, dotted: str) -> bool:
    """Whether ``start.dotted`` exists; a field of a dataclass or of a pydantic model counts."""
    for part in dotted.split("."):
        fields = {
            *getattr(start, "__dataclass_fields__", ()),
            *getattr(start, "model_fields", ()),
        }
        if part in fields:
            return True
        if not hasattr(start, part):
            return False
        start = getattr(start, part)
    return True


def test_functions_classes_and_modules_that_docstrings_name_exist() -> None:
    found = []
    for path in MODULES:
        module = importlib.import_module(
            ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        )
        for line, text in prose(path):
            names = re.findall(r":(?:func|class|mod|meth|attr|data|exc|obj):`~?([\w.]+)`", text)
            found += [
                f"{path.relative_to(ROOT)}:{line}: {name}"
                for name in names
                if not resolved(name, module)
            ]
    assert not found, "\n".join(found)
