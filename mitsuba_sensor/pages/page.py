"""The contents of a page as plain values: findings, tables and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Mark = Literal["", "good", "bad", "best", "dim"]
"""Passed, failed, recommended, without effect, or not checked."""
VERDICTS: dict[Mark, str] = {
    "good": "✓ holds",
    "bad": "✗ fails",
    "best": "★ best",
    "dim": "– no effect",
    "": "",
}
"""The verdict column of a marked row."""
MarkedRow = tuple[Mark, Sequence[object]]


@dataclass(frozen=True)
class Table:
    """Rows below headings that include the unit, [1] for a ratio. None means "not measured".

    marks : one for each row, or none.  terminal : headings of the columns on a terminal; None for all.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    marks: tuple[Mark, ...] = ()
    note: str = ""
    terminal: tuple[str, ...] | None = None


def table(
    title: str,
    headings: str,
    rows: Iterable[MarkedRow],
    note: str = "",
    terminal: str | None = None,
) -> Table:
    """Return a table of rows with their marks.  headings, terminal : separated by `` | ``."""
    marked = list(rows)
    marks = tuple(mark for mark, _ in marked)
    cells = tuple(tuple(row) for _, row in marked)
    shown = None if terminal is None else tuple(filter(None, terminal.split(" | ")))
    columns = tuple(headings.split(" | "))
    return Table(title, columns, cells, marks if any(marks) else (), note, shown)


@dataclass(frozen=True)
class Line:
    """Points of one series.  error, x_error : half widths of their vertical and horizontal bars, or none."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    error: tuple[float, ...] = ()
    x_error: tuple[float, ...] = ()
    joined: bool = True
    marked: bool = True
    dashed: bool = False
    star: bool = False  # draw a large star instead of a marker


def line(label: str, points: Sequence[tuple[float, ...]], **style: Any) -> Line:
    """Return a line through points (x, y), (x, y, error) or (x, y, error, x_error)."""
    x, y, *rest = (tuple(values) for values in zip(*points, strict=True))
    error, x_error = (*rest, (), ())[:2]
    return Line(label, x, y, error, x_error, **style)


@dataclass(frozen=True)
class Plot:
    """Lines on two axes.

    levels : name → y of a horizontal line, or x of a vertical line if the name begins with ``|``.
    """

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    log_x: bool = True
    log_y: bool = True
    levels: Mapping[str, float] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Dots:
    """A dot with its interval for each label and series, and a vertical line.

    series : name → (value, low, high) for each label, or None.  level : x of the line, and its name.
    """

    title: str
    x_label: str
    labels: tuple[str, ...]
    series: Mapping[str, Sequence[tuple[float, float, float] | None]]
    level: tuple[float, str]
    log_x: bool = False
    note: str = ""


@dataclass(frozen=True)
class Drawing:
    """A picture that a function draws onto axes."""

    title: str
    draw: Callable[[Axes], object]
    note: str = ""


Picture = Plot | Dots | Drawing
Part = Table | Picture


@dataclass(frozen=True)
class Section:
    """The findings of one part of a study.

    findings : sentences that answer the question, the most important first.  passed : True if all checks hold.
    failed, missing : names of the failed checks and of what was not measured.  omitted : reasons for omitted checks.
    """

    findings: tuple[str, ...]
    passed: bool
    parts: tuple[Part, ...]
    failed: tuple[str, ...] = field(default=(), kw_only=True)
    missing: tuple[str, ...] = field(default=(), kw_only=True)
    omitted: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def complete(self) -> bool:
        """Return True if everything was measured and checked."""
        return not self.missing and not self.omitted


@dataclass(frozen=True)
class Study(Section):
    """The outcome of a study.  data : its inputs and measured values, ready for JSON.

    checked : False for a comparison, which has no verdict.
    """

    name: str
    title: str
    data: Mapping[str, Any]
    checked: bool = field(default=True, kw_only=True)

    @property
    def verdict(self) -> str:
        """Whether all checks passed, which failed or were omitted, and what was not measured."""
        verdicts = []
        if not self.passed:
            verdicts.append("some checks failed")
            if self.failed:
                verdicts[0] += f": {', '.join(self.failed)}"
        if self.missing:
            verdicts.append(f"not measured: {', '.join(self.missing)}")
        verdicts += self.omitted
        return "; ".join(verdicts) or ("all checks passed" if self.checked else "")

    @property
    def headline(self) -> str:
        """The verdict with a ✓ or ✗ in front."""
        sign = "✗ " if not self.passed else "✓ " if self.verdict and self.complete else ""
        return sign + self.verdict

    def to_dict(self) -> dict[str, Any]:
        """Return the contents of study.json; the numbers of drawings are in ``data``."""
        drawn = (part for part in self.parts if not isinstance(part, Drawing))
        parts = [{"kind": type(part).__name__.lower(), **asdict(part)} for part in drawn]
        for part in parts:
            part.pop("terminal", None)
        about = {
            "study": self.name,
            "title": self.title,
            "findings": list(self.findings),
            "passed": self.passed,
            "verdict": self.verdict,
        }
        return {**about, **self.data, "parts": parts}


def study_of(name: str, title: str, sections: Sequence[Section], **data: object) -> Study:
    """Return one study made of several sections."""
    return Study(
        tuple(finding for section in sections for finding in section.findings),
        all(section.passed for section in sections),
        tuple(part for section in sections for part in section.parts),
        name,
        title,
        data,
        failed=tuple(one for section in sections for one in section.failed),
        missing=tuple(dict.fromkeys(one for section in sections for one in section.missing)),
        omitted=tuple(dict.fromkeys(one for section in sections for one in section.omitted)),
    )
