"""Links, images, anchors and names that the documentation mentions: each must exist."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

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


def test_every_link_image_and_anchor_of_a_page_resolves() -> None:
    broken = []
    for page in PAGES:
        for target in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text("utf-8"))):
            if re.match(r"https?:|mailto:", target):
                continue
            file, _, anchor = target.partition("#")
            path = (page.parent / file).resolve() if file else page
            if not path.exists() or (anchor and anchor not in anchors(path)):
                broken.append(f"{page.name}: {target}")
    assert not broken, broken


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


def test_files_and_tests_that_a_page_names_exist() -> None:
    unknown = []
    for page in PAGES:
        text = page.read_text("utf-8")
        named = re.findall(r"`(test_\w+?)(…?)`", text)
        unknown += [
            f"{page.name}: {name}"
            for name, more in named
            if not any(t == name or (more and t.startswith(name)) for t in names_of_tests())
        ]
        unknown += [f"{page.name}: {name}" for name in missing_files(text)]
    assert not unknown, unknown


def test_files_that_docstrings_and_comments_name_exist() -> None:
    found = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in (*MODULES, *SCRIPTS)
        for prose in re.finditer(r'""".*?"""|#[^\n]*', path.read_text("utf-8"), re.DOTALL)
        for name in missing_files(prose.group())
    ]
    assert not found, "\n".join(found)
