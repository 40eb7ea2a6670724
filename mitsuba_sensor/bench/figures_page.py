"""A camera in the laboratory: every figure with its interval, beside the datasheet's if there is one, and plots."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from ..lab.frames.bench import Bench
from ..lab.measure.measurement import INSTRUMENTS, Measurement, measure
from ..lab.quantity import TWO_SIDED, Quantity
from ..lab.statistics.estimators import z_limit
from ..pages.page import Drawing, MarkedRow, Section, Study, study_of, table
from .datasheet import Said

MAIN = ("K", "η", "LE", "σ_d", "µ_e.sat", "SNR_max", "DR", "PRNU1288", "DSNU1288", "σ_row", "σ_col", "µ_I.mean", "T_d")
MAIN_HEADINGS = "symbol | measured | from | to | unit | datasheet"
HEADINGS = "symbol | figure | measured | from | to | unit | datasheet | z | section | note"


def figures_of(bench: Bench, progress: Callable[[int, int, str], None]) -> tuple[Measurement, ...]:
    """What all instruments find in the frames of a bench; told the instruments done, all of them, and the next one."""
    titles, filters = [], len(bench.of_filters())

    def begins(title: str) -> None:
        titles.append(title)
        progress(len(titles) - 1, filters * INSTRUMENTS, f"measuring: {title}")

    return measure(bench, begins)


def characterized(
    name: str, measured: Sequence[Measurement], datasheet: Mapping[str, Mapping[str, Said]], **about: object
) -> Study:
    """The study of one camera.

    datasheet : by name of the filter and symbol; empty for a camera of which only frames are known.
    about : what the page and report.json say beside the figures.
    """
    comparisons = sum(one.symbol in datasheet.get(m.filter_name, {}) for m in measured for one in m.figures.values())
    limit = z_limit(comparisons)
    sections = [_section(one, datasheet.get(one.filter_name, {}), limit) for one in measured]
    figures = {
        one.filter_name or "all pixels": {
            "figures": [
                {**figure.to_dict(), **_beside(figure, datasheet.get(one.filter_name, {}))}
                for figure in one.figures.values()
            ],
            "notes": one.notes,
            "refused": one.refused,
        }
        for one in measured
    }
    return study_of("characterize", f"{name} in the laboratory", sections, measured=figures, z_limit=limit, **about)


def _section(measured: Measurement, datasheet: Mapping[str, Said], limit: float) -> Section:
    where = f" behind {measured.filter_name}" if measured.filter_name else ""
    rows = [_row(one, datasheet, limit) for one in measured.figures.values()]
    compared = [row for row in rows if row[0] in ("good", "bad")]
    wrong = [row for row in compared if row[0] == "bad"]
    findings = []
    if compared:
        findings.append(
            f"{len(compared) - len(wrong)} of {len(compared)} figures{where} are those of the datasheet within their "
            f"95 % intervals or by less than {limit:.1f} standard errors"
        )
    findings += [
        f"{row[1][0]}{where}: measured {row[1][2]:.4g}, datasheet {row[1][6]:.4g} {row[1][5]}" for row in wrong
    ]
    if measured.hidden:
        findings.append(f"no value{where}, since values of the frames are clipped: {', '.join(measured.hidden)}")
    findings += [f"not measured{where}: {title}: {sentence}" for title, sentence in measured.refused.items()]
    findings += [f"{note}{where}" for note in measured.notes]
    shown = [(mark, (row[0], *row[2:7])) for mark, row in rows if row[0] in MAIN]
    main = table(f"Main figures{where}", MAIN_HEADINGS, (("" if mark == "good" else mark, row) for mark, row in shown))
    drawings = [Drawing(f"{name}{where}", draw) for name, draw in measured.drawings.items()]
    holds = not wrong and not measured.hidden
    return Section(tuple(findings), holds, (main, *drawings, table(f"All figures{where}", HEADINGS, rows)))


def _row(figure: Quantity, datasheet: Mapping[str, Said], limit: float) -> MarkedRow:
    beside = _beside(figure, datasheet)
    numbers = (_known(one) for one in (figure.value, figure.low, figure.high))
    row = (figure.symbol, figure.name, *numbers, figure.unit, beside.get("datasheet"), beside.get("z"), figure.section)
    if "datasheet" not in beside or not math.isfinite(figure.value):
        return "", (*row, figure.note)
    return ("good" if abs(beside["z"]) < limit else "bad"), (*row, figure.note)


def _beside(figure: Quantity, datasheet: Mapping[str, Said]) -> dict[str, float]:
    """The datasheet's value, and how far the interval is outside of its range, in standard errors of the figure."""
    if figure.symbol not in datasheet:
        return {}
    said = datasheet[figure.symbol]
    nearest = min(max(figure.value, said.low), said.high)
    half = figure.high - figure.value if nearest > figure.value else figure.value - figure.low
    error = half / TWO_SIDED
    z = (figure.value - nearest) / error if error > 0 else 0.0 if figure.low <= nearest <= figure.high else math.inf
    return {"datasheet": said.value, "z": z}


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
