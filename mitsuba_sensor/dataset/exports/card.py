"""Dataset card: README.md with counts, noise of the cameras, values, how to read it, licence and hashes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...files.png import write_png
from ...files.texts import write_page
from ...output.contact_sheet import SheetRow, contact_sheet
from ..store.record import CARD, SHEET

DIFFERS = (
    "Where two numbers stand, axes of the dataset set fields of the camera, and samples differ: "
    "`samples.csv` has K and the black level of each, for its digital numbers."
)
QUANTILES = ("lowest", "1 %", "median", "99 %", "highest")
UNITS = (
    "K [DN/e-]",
    "temporal dark noise [e-]",
    "saturation [e-]",
    "black level [DN]",
    "white level [DN]",
)


@dataclass(frozen=True)
class CameraNumbers:
    """One camera at one gain setting, and the values of its samples.

    noise : by the name of a read-out, and of the whole frame under an empty one: smallest and largest over the samples
        of EMVA 1288's K [DN/e-], temporal dark noise [e-] of a short exposure and saturation [e-], black and white
        level [DN]; None where it has none.
    digital_dn, electrons_e : QUANTILES of its frames: lowest and highest of all, medians over the samples between.
    """

    name: str
    gain: str
    samples: int
    noise: Mapping[str, Sequence[tuple[float, float] | None]]
    digital_dn: Sequence[float]
    electrons_e: Sequence[float]


@dataclass(frozen=True)
class CardFacts:
    """What a card says.

    figures : what → how many.  splits : split → samples, scenes, renders and chips.  hashes : what → SHA-256.
    how_to_read : code.  pictures : rows of the contact sheet.  render_noise : how large it is; notes : other sentences.
    remarks : those of them that a run says also.
    """

    name: str
    description: str
    licence: str
    figures: Mapping[str, str | int]
    cameras: Sequence[CameraNumbers]
    hashes: Mapping[str, str]
    splits: Mapping[str, tuple[int | str, ...]] = field(default_factory=dict)
    how_to_read: str = ""
    pictures: Sequence[SheetRow] = ()
    versions: Mapping[str, str | None] = field(default_factory=dict)
    render_noise: str = ""
    notes: Sequence[str] = ()
    remarks: tuple[str, ...] = ()


def write_card(folder: Path, facts: CardFacts) -> None:
    """Write README.md, and contact_sheet.png where there are pictures. Raises InputError."""
    if facts.pictures:
        write_png(folder / SHEET, contact_sheet(facts.pictures))
    write_page(folder / CARD, card_text(facts))


def card_text(facts: CardFacts) -> str:
    """The Markdown of the card."""
    sheet = ""
    if facts.pictures:
        sheet = f"![Some of the frames, as the camera's preview: a row for each scene and view]({SHEET})"
    splits: list[tuple[str | int, ...]] = [
        (name or "–", *numbers) for name, numbers in facts.splits.items()
    ]
    noise = [row for x in facts.cameras for row in _noise(x)]
    versions = ", ".join(
        f"{name} {version}" for name, version in facts.versions.items() if version
    )
    parts = [
        f"# {facts.name}",
        facts.description,
        sheet,
        _table(("", ""), list(facts.figures.items())),
        facts.render_noise,
        *facts.notes,
        "## Splits" if splits else "",
        _table(("split", "samples", "scenes", "renders", "chips"), splits),
        "## Noise of the cameras",
        "EMVA 1288 figures of the datasheets: overall system gain K, temporal dark noise and saturation.",
        DIFFERS if any(" to " in str(cell) for row in noise for cell in row[3:]) else "",
        _table(("camera", "gain setting", "samples", *UNITS), noise),
        "## Values",
        "Digital numbers of the raw frames, and photoelectrons that the light makes on average: lowest and highest of "
        "the samples; between them the median over the samples of each quantile.",
        _table(
            ("camera", "gain setting", "", *QUANTILES),
            [row for x in facts.cameras for row in _values(x)],
        ),
        "## How to read",
        f"```\n{facts.how_to_read.strip()}\n```" if facts.how_to_read else "",
        "## Licence",
        facts.licence or "None is given: ask who made it before you pass it on.",
        "## Hashes (SHA-256)",
        _table(("of", "SHA-256"), list(facts.hashes.items())),
        f"Made with {versions}." if versions else "",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _range(ends: tuple[float, float] | None) -> str | float | None:
    """One value, or the smallest and the largest."""
    if ends is None or _cell(ends[0]) == _cell(ends[1]):
        return ends and ends[0]
    return f"{_cell(ends[0])} to {_cell(ends[1])}"


def _noise(camera: CameraNumbers) -> Iterator[tuple[str | float | None, ...]]:
    """A row of the whole frame, and one of each read-out that it is combined from."""
    for readout, ends in camera.noise.items():
        name = camera.name
        if readout:
            name = f"{camera.name}, read-out {readout}"
        yield name, camera.gain, camera.samples, *map(_range, ends)


def _values(camera: CameraNumbers) -> list[tuple[str | float, ...]]:
    return [
        (camera.name, camera.gain, "raw frame [DN]", *camera.digital_dn),
        (camera.name, camera.gain, "photoelectrons [e-]", *camera.electrons_e),
    ]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str | float | None]]) -> str:
    """A Markdown table; none without rows."""
    lines = [heads, ["---"] * len(heads), *([_cell(value) for value in row] for row in rows)]
    if rows:
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return ""


def _cell(value: str | float | None) -> str:
    """Numbers to five digits or whole, thousands apart; text without what would end the cell."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return " ".join(value.split()).replace("|", "\\|")
    if isinstance(value, int) or 1e4 <= abs(value) < 1e9:
        return f"{value:,.0f}".replace(",", " ")
    if 1e3 <= abs(value) < 1e4:
        return f"{value:,.1f}".replace(",", " ").removesuffix(".0")
    return f"{value:.5g}"
