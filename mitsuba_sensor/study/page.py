"""What a study hands over, as plain values: sentences, tables, and pictures as SVG or PNG."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..files.texts import read_toml
from ..lab.statistics.estimators import pareto
from .series import MOST, colours, groups

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .kit import Known, Values

Mark = Literal["", "good", "bad", "best", "dim"]  # as it must be, not as it must be, the one to take, of no weight
MarkedRow = tuple[Mark, Sequence[object]]
Level = tuple[float, str]  # value and text of a line across a plot, to compare with


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
    marked: bool = True  # whether each has a marker
    dashed: bool = False
    colour: int | None = None  # its number; in a study that of its label, through all plots
    ringed: tuple[int, ...] = ()  # indices of points with a ring


def line(label: str, points: Sequence[tuple[float, ...]], **style: Any) -> Line:
    """Through points (x, y) or (x, y, error)."""
    x, y, *error = (tuple(values) for values in zip(*points, strict=True))
    return Line(label, x, y, error[0] if error else (), **style)


def ringed(lines: Sequence[Line]) -> tuple[Line, ...]:
    """With rings around the points that no other of all lines beats in x and y."""
    places = [(n, k) for n, line in enumerate(lines) for k in range(len(line.x))]
    front = {places[i] for i in pareto([(lines[n].x[k], lines[n].y[k]) for n, k in places])}
    return tuple(replace(line, ringed=tuple(k for m, k in sorted(front) if m == n)) for n, line in enumerate(lines))


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

    def _draw(self, axes: Axes) -> float:
        for number, line in enumerate(self.lines):
            look = number if line.colour is None else line.colour
            style: Values = {"marker": MARKERS[look % len(MARKERS)] if line.marked else ""}
            style |= {"markersize": 4.5, "elinewidth": 0.9}
            style |= {"linewidth": 1.4 if line.joined else 0, "linestyle": "--" if line.dashed else "-"}
            style["color"] = f"C{look}"
            axes.errorbar(line.x, line.y, yerr=line.error or None, label=line.label or None, **style)
            x, y = ([values[i] for i in line.ringed] for values in (line.x, line.y))
            axes.scatter(x, y, s=95, facecolors="none", edgecolors="black", zorder=3)
        axes.set(xlabel=self.x_label, ylabel=self.y_label)
        _log_scale(axes, "x", [x for line in self.lines for x in line.x if self.log_x])
        _log_scale(axes, "y", [y for line in self.lines for y in line.y if self.log_y])
        return HEIGHT_IN


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
    colours: Mapping[str, int] = field(default_factory=dict)  # their numbers, by the names of the series

    def _draw(self, axes: Axes) -> float:
        height, rows = 0.8 / len(self.series), np.arange(len(self.labels))
        for number, (name, values) in enumerate(self.series.items()):
            places = rows + (number - (len(self.series) - 1) / 2) * height
            error = np.array(self.error[name], dtype=float) if name in self.error else None
            style: Values = {"label": name if len(self.series) > 1 else None, "error_kw": {"elinewidth": 0.9}}
            style["color"] = f"C{self.colours.get(name, number)}"
            axes.barh(places, np.array(values, dtype=float), height, xerr=error, **style)
        _log_scale(axes, "x", [x for values in self.series.values() for x in values if self.log_x and x is not None])
        axes.set_yticks(rows, self.labels)
        axes.set(xlabel=self.x_label, ylim=(len(rows) - 0.4, -0.6))
        axes.grid(visible=False, axis="y")
        return 1.2 + BAR_IN * len(self.labels) * (len(self.series) + 0.6)


@dataclass(frozen=True)
class Grid:
    """Verdicts: rows × columns of marks, a coloured cell each; ``texts`` are what stands in the cells."""

    title: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    marks: tuple[tuple[Mark, ...], ...]
    texts: tuple[tuple[str, ...], ...]
    note: str = ""

    def _draw(self, axes: Axes) -> float:
        axes.set_axis_off()
        colours = [[CELL[mark] for mark in marks] for marks in self.marks]
        texts = {"cellText": self.texts, "rowLabels": self.rows, "colLabels": self.columns}
        table = axes.table(cellColours=colours, cellLoc="center", bbox=axes.viewLim.unit(), **texts)  # type: ignore[arg-type]
        for (row, _), cell in table.get_celld().items():
            cell.set(edgecolor="white", height=cell.get_height() * (1.0 if row else 1.6))  # a heading has two lines
        return 1.2 + CELL_IN * len(self.rows)


@dataclass(frozen=True)
class Drawing:
    """What something else draws: an instrument of the laboratory, for example, onto axes that it is given."""

    title: str
    draw: Callable[[Axes], object]
    note: str = ""
    level: Level | None = None

    def _draw(self, axes: Axes) -> float:
        self.draw(axes)
        return HEIGHT_IN


Picture = Plot | Bars | Grid | Drawing
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
        shown = [part for part in self.parts if not isinstance(part, Drawing)]  # whose numbers stand in data
        parts = [{"kind": type(part).__name__.lower(), **asdict(part)} for part in shown]
        about = {"study": self.name, "title": self.title, "findings": list(self.findings), "passed": self.passed}
        return {**about, **self.data, "parts": parts}


def study_of(name: str, title: str, sections: Sequence[Section], **data: object) -> Study:
    """Sections as one study."""
    findings = tuple(finding for section in sections for finding in section.findings)
    parts = [one for section in sections for part in section.parts for one in _split(part)]
    return Study(findings, all(section.passed for section in sections), _coloured(parts), name, title, data)


def _split(part: Part) -> list[Part]:
    """A plot of too many lines as several, each with the first line, which the others are compared with."""
    if not isinstance(part, Plot) or len(part.lines) <= MOST:
        return [part]
    plots = [(part.lines[0], *(part.lines[k] for k in some)) for some in groups(len(part.lines))]
    titles = [f"{part.title} ({number} of {len(plots)})" for number in range(1, len(plots) + 1)]
    return [replace(part, title=title, lines=lines) for title, lines in zip(titles, plots, strict=True)]


def _coloured(parts: Sequence[Part]) -> tuple[Part, ...]:
    """The same with one colour for each series, through all plots and bars."""
    lines = [[line.label for line in part.lines] for part in parts if isinstance(part, Plot)]
    found = colours([*lines, *(tuple(part.series) for part in parts if isinstance(part, Bars))])

    def with_colours(part: Part) -> Part:
        if isinstance(part, Plot):
            return replace(part, lines=tuple(replace(line, colour=found[line.label]) for line in part.lines))
        return replace(part, colours={name: found[name] for name in part.series}) if isinstance(part, Bars) else part

    return tuple(map(with_colours, parts))


MARKERS = "osD^vPX*>"  # one more than colours, which colour-blind readers tell apart (Okabe & Ito 2008, and two more)
CELL: dict[Mark, str] = {"good": "#BFE3CF", "bad": "#F2B6A0", "best": "#8CCBA8", "dim": "#EEEEEE", "": "#FFFFFF"}
WIDTH_IN, HEIGHT_IN, BAR_IN, CELL_IN = 8.4, 4.6, 0.2, 0.3
LOOK = read_toml(Path(__file__).with_name("page.toml"))  # CSS of the page, and Matplotlib's settings


def svg(picture: Picture) -> str:
    """An <svg> element to put into a page, below a heading."""
    drawn = _drawn(picture, "svg", {"Date": None}).decode("utf-8")
    return drawn[drawn.index("<svg") :]


def png(picture: Picture) -> bytes:
    """The same with its title, as a PNG file's bytes, about 1000 pixels wide."""
    return _drawn(picture, "png")


def _drawn(picture: Picture, kind: str, metadata: Values | None = None) -> bytes:
    import matplotlib
    from matplotlib.figure import Figure

    buffer = io.BytesIO()
    with matplotlib.rc_context(LOOK["matplotlib"]):
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN))
        axes = figure.subplots()
        figure.set_figheight(picture._draw(axes))  # which knows how high it has to be
        if not isinstance(picture, Grid) and picture.level is not None:
            line = axes.axvline if isinstance(picture, Bars) else axes.axhline
            line(picture.level[0], color="black", linewidth=1, linestyle=":", label=picture.level[1])
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8.5)
        if kind == "png":
            axes.set_title(picture.title, loc="left", fontsize=10.5)
        figure.savefig(buffer, format=kind, dpi=120, bbox_inches="tight", metadata=metadata)
    return buffer.getvalue()


def _log_scale(axes: Axes, name: str, values: list[float]) -> None:
    """Where any value is positive; between decades numbers stand only if there is less than one."""
    positive = [value for value in values if value > 0]
    if positive:
        axes.set(**{f"{name}scale": "log"})
        axis = axes.xaxis if name == "x" else axes.yaxis
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("{x:g}" if max(positive) < 10 * min(positive) else "")
