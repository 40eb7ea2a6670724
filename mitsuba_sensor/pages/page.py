"""What a study finds, as plain values: sentences, tables and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

from ..lab.statistics.estimators import pareto
from .series import MOST_SERIES, colours_of_series, plots_of_series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Mark = Literal["", "good", "bad", "best", "dim"]
"""As it must be, not as it must be, the one to take, of no weight."""

MarkedRow = tuple[Mark, Sequence[object]]
Level = tuple[float, str]
"""Value and text of a line across a plot, to compare with."""


@dataclass(frozen=True)
class Table:
    """Rows under headings with the unit in them, [1] for a ratio. Numbers stay numbers; None is "not measured"."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[object, ...], ...]
    marks: tuple[Mark, ...] = ()  # one per row, or none at all
    note: str = ""


def table(title: str, headings: str, rows: Iterable[MarkedRow], note: str = "") -> Table:
    """A table whose headings are separated by `` | ``, of rows with their marks."""
    marked = list(rows)
    marks = tuple(mark for mark, _ in marked)
    cells = tuple(tuple(row) for _, row in marked)
    return Table(title, tuple(headings.split(" | ")), cells, marks if any(marks) else (), note)


@dataclass(frozen=True)
class Line:
    """Points of one series."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    error: tuple[float, ...] = ()  # half the length of the vertical bars, or none
    joined: bool = True  # whether a line joins them
    marked: bool = True  # whether each has a marker
    dashed: bool = False
    colour: int | None = None  # its number; in a study that of its label, through all plots
    ringed: tuple[int, ...] = ()  # indices of points with a ring


def line(label: str, points: Sequence[tuple[float, ...]], **style: Any) -> Line:
    """A line through points (x, y) or (x, y, error)."""
    x, y, *error = (tuple(values) for values in zip(*points, strict=True))
    return Line(label, x, y, error[0] if error else (), **style)


def ringed(lines: Sequence[Line]) -> tuple[Line, ...]:
    """The lines with rings around the points that no other of them beats in x and y."""
    places = [(n, k) for n, line in enumerate(lines) for k in range(len(line.x))]
    best = [places[i] for i in pareto([(lines[n].x[k], lines[n].y[k]) for n, k in places])]
    return tuple(
        replace(line, ringed=tuple(sorted(k for m, k in best if m == n)))
        for n, line in enumerate(lines)
    )


@dataclass(frozen=True)
class Plot:
    """Lines over two axes; a study shows more than eight of them in several plots, each with the first line."""

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
    colours: Mapping[str, int] = field(
        default_factory=dict
    )  # their numbers, by the names of the series


@dataclass(frozen=True)
class Grid:
    """Verdicts: rows × columns of marks, a coloured cell each; ``texts`` are what stands in the cells."""

    title: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    marks: tuple[tuple[Mark, ...], ...]
    texts: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class Drawing:
    """A picture that something else draws: an instrument of the laboratory, onto axes that it is given.

    lines : of pictures that it consists of; it is as many times as high.
    """

    title: str
    draw: Callable[[Axes], object]
    note: str = ""
    lines: int = 1


Picture = Plot | Bars | Grid | Drawing
Part = Table | Picture


@dataclass(frozen=True)
class Section:
    """What one part of a study found."""

    findings: tuple[
        str, ...
    ]  # sentences that answer the question, the most important first, each with its numbers
    passed: bool  # whether everything that must hold does
    parts: tuple[Part, ...]  # in the order of reading
    failed: tuple[str, ...] = field(default=(), kw_only=True)  # names of what does not hold
    missing: tuple[str, ...] = field(default=(), kw_only=True)  # names of what was not measured


@dataclass(frozen=True)
class Study(Section):
    """The outcome of a study.  data : what it was made with, and what was measured, ready for JSON."""

    name: str
    title: str
    data: Mapping[str, Any]

    @property
    def verdict(self) -> str:
        """The headline: that all checks passed, or which failed, and what was not measured."""
        verdicts = []
        if not self.passed:
            verdicts.append("some checks failed")
            if self.failed:
                verdicts[0] += f": {', '.join(self.failed)}"
        if self.missing:
            verdicts.append(f"not measured: {', '.join(self.missing)}")
        return "; ".join(verdicts) or "all checks passed"

    @property
    def pictures(self) -> list[Picture]:
        """Its pictures, in the order of reading."""
        return [part for part in self.parts if not isinstance(part, Table)]

    def to_dict(self) -> dict[str, Any]:
        """The values of study.json; numbers of drawings stand in the data."""
        parts = []
        for part in self.parts:
            if not isinstance(part, Drawing):
                parts.append({"kind": type(part).__name__.lower(), **asdict(part)})
        about = {
            "study": self.name,
            "title": self.title,
            "findings": list(self.findings),
            "passed": self.passed,
            "verdict": self.verdict,
        }
        return {**about, **self.data, "parts": parts}


def study_of(name: str, title: str, sections: Sequence[Section], **data: object) -> Study:
    """Sections as one study: plots of at most eight lines, and one colour for each series through all of them."""
    findings = tuple(finding for section in sections for finding in section.findings)
    passed = all(section.passed for section in sections)
    parts = [part for section in sections for whole in section.parts for part in _split(whole)]
    failed = tuple(name for section in sections for name in section.failed)
    missing = tuple(dict.fromkeys(name for section in sections for name in section.missing))
    coloured = _coloured(parts)
    return Study(findings, passed, coloured, name, title, data, failed=failed, missing=missing)


def _split(part: Part) -> list[Part]:
    """A plot of too many lines as several, each with the first line, which the others are compared with."""
    if not isinstance(part, Plot) or len(part.lines) <= MOST_SERIES:
        return [part]
    groups = plots_of_series(len(part.lines))
    plots: list[Part] = []
    for number, places in enumerate(groups, start=1):
        lines = (part.lines[0], *(part.lines[k] for k in places))
        plots.append(
            replace(part, title=f"{part.title} ({number} of {len(groups)})", lines=lines)
        )
    return plots


def _coloured(parts: Sequence[Part]) -> tuple[Part, ...]:
    """The parts with the same colour for a series in all plots and bars."""
    labels = [[line.label for line in part.lines] for part in parts if isinstance(part, Plot)]
    series = [list(part.series) for part in parts if isinstance(part, Bars)]
    colours = colours_of_series([*labels, *series])
    coloured: list[Part] = []
    for part in parts:
        if isinstance(part, Plot):
            lines = tuple(replace(line, colour=colours[line.label]) for line in part.lines)
            coloured.append(replace(part, lines=lines))
        elif isinstance(part, Bars):
            coloured.append(
                replace(part, colours={name: colours[name] for name in part.series})
            )
        else:
            coloured.append(part)
    return tuple(coloured)
