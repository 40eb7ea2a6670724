"""What a study hands over: findings, tables and plots as plain values, for a terminal, a program and a page alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Literal

from .statistics import Known, Values

Mark = Literal["", "good", "bad", "best", "dim"]  # as it must be, not as it must be, the one to take, of no weight
MarkedRow = tuple[Mark, Sequence[object]]
Level = tuple[float, str]  # value and text of a line across a plot, to compare with


@dataclass(frozen=True)
class Table:
    """Rows under headings with the unit in them. Numbers stay numbers; None is "not measured"."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    marks: tuple[Mark, ...] = ()  # one per row, or none at all
    note: str = ""


def table(title: str, headings: str, rows: Iterable[MarkedRow], note: str = "") -> Table:
    """A table whose headings are separated by `` | ``, of rows with their marks."""
    marked = list(rows)
    marks, cells = tuple(mark for mark, _ in marked), tuple(tuple(row) for _, row in marked)
    return Table(title, tuple(headings.split(" | ")), cells, marks if any(marks) else (), note)


@dataclass(frozen=True)
class Line:
    """Points of one kind."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    error: tuple[float, ...] = ()  # half the length of the vertical bars, or none
    joined: bool = True  # whether a line joins them
    dashed: bool = False
    colour: int | None = None  # lines of one number share a colour, by default each has its own
    ringed: tuple[int, ...] = ()  # indices of points with a ring


@dataclass(frozen=True)
class Plot:
    """Lines over two axes."""

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    log_x: bool = True
    log_y: bool = True
    level: Level | None = None
    note: str = ""


@dataclass(frozen=True)
class Bars:
    """Groups of horizontal bars: name of a series → a value per label (None: no bar), and half the whiskers' length."""

    title: str
    x_label: str
    labels: tuple[str, ...]
    series: Mapping[str, Sequence[float | None]]
    error: Mapping[str, Sequence[float | None]] = field(default_factory=dict)
    log_x: bool = False
    level: Level | None = None
    note: str = ""


@dataclass(frozen=True)
class Grid:
    """Verdicts: rows × columns of marks, a coloured cell each; ``texts`` are what stands in the cells."""

    title: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    marks: tuple[tuple[Mark, ...], ...]
    texts: tuple[tuple[str, ...], ...]
    note: str = ""


Picture = Plot | Bars | Grid
Part = Table | Picture


@dataclass(frozen=True)
class Section:
    """What one part of a study found."""

    findings: tuple[str, ...]  # sentences that answer the question, the most important first, each with its numbers
    passed: bool  # whether everything that must hold does
    parts: tuple[Part, ...]  # in the order of reading


@dataclass(frozen=True)
class Study(Section):
    """The outcome of a study. data : what it was made with, and what was measured, ready for JSON."""

    name: str
    title: str
    data: Known

    def to_dict(self) -> Values:
        """study.json."""
        parts = [{"kind": type(part).__name__.lower(), **asdict(part)} for part in self.parts]
        about = {"study": self.name, "title": self.title, "findings": list(self.findings), "passed": self.passed}
        return {**about, **self.data, "parts": parts}


def study_of(name: str, title: str, sections: Sequence[Section], **data: object) -> Study:
    """Sections as one study."""
    findings = tuple(finding for section in sections for finding in section.findings)
    parts = tuple(part for section in sections for part in section.parts)
    return Study(findings, all(section.passed for section in sections), parts, name, title, data)
