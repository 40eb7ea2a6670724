"""Configuration of Sphinx: the Markdown pages of this folder as a site, with the parts that are made of the package.

pip install '.[docs]' && sphinx-build -W --keep-going -d build/doctrees docs site
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from generated import pages_of, signature, with_bullets, with_generated_parts

import mitsuba_sensor

project, author = "mitsuba_sensor", "mitsuba_sensor developers"
version = release = mitsuba_sensor.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton"]
exclude_patterns = ["studies/work", "_build"]
html_theme, html_title = "furo", f"mitsuba_sensor {version}"
html_show_copyright = html_copy_source = False
smartquotes = False  # --options keep both of their dashes
myst_heading_anchors = 4  # links to headings, as on GitHub
python_maximum_signature_line_length = 80  # longer ones have a line for each parameter
autodoc_member_order = "bysource"


def setup(app: Any) -> None:
    """Fill in what is generated, and list the pages beside the text of the index in its order."""
    app.connect("source-read", _complete)
    app.connect("autodoc-process-docstring", _as_bullets)
    app.connect("autodoc-process-signature", _with_types)
    app.connect("autodoc-skip-member", _is_of_pydantic)


def _complete(_app: Any, page: str, source: list[str]) -> None:
    source[0] = with_generated_parts(source[0])
    if page == "index":
        for title, pages in pages_of(source[0]).items():
            source[0] += (
                f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n"
                + "\n".join(pages)
                + "\n```\n"
            )


def _as_bullets(
    _app: Any, _what: str, _name: str, _of: Any, _options: Any, lines: list[str]
) -> None:
    lines[:] = with_bullets(lines)


def _with_types(
    _app: Any, what: str, _name: str, value: Any, _options: Any, *_found: str
) -> tuple[str, str] | None:
    return signature(value) if what in ("function", "method", "class") else None


def _is_of_pydantic(
    _app: Any, _what: str, name: str, _value: Any, _skip: bool, _options: Any
) -> bool | None:
    return True if name.startswith("model_") else None
