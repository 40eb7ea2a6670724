"""A file with the rows of an EMVA 1288 sheet, ``NAME = VALUE`` in each line, for sheets that are not typed."""

from __future__ import annotations

from pathlib import Path

from ..core import InputError, nearest
from ..files.texts import text_of_file
from .emva_sheet import ROWS, Value, is_asked

OTHER_UNITS = {
    "qe": "qe_percent",
    "prnu": "prnu_percent",
    "dark_temperature_k": "dark_temperature_c",
}
"""Row → its name in a file, where that of the value has another unit."""
NAMES = {OTHER_UNITS.get(row.key, row.key): row for row in ROWS}


def read_sheet(path: str | Path) -> dict[str, Value]:
    """The values of a sheet, by the keys of ROWS. Raises InputError with the line of what cannot be used."""
    texts = _texts(Path(path))
    values: dict[str, Value] = {}
    missing = []
    for name, row in NAMES.items():
        if not is_asked(row, values):
            continue
        if name not in texts and not row.optional:
            missing.append(f"{name} ({row.question})")
            continue
        try:
            values[row.key] = row.value(texts.get(name, ""))
        except InputError as error:
            raise InputError(f"{path}, {name}: {error}") from None
    if missing:
        raise InputError(
            f"{path} has no {', '.join(missing)}; add a line NAME = VALUE of each."
        )
    return values


def _texts(path: Path) -> dict[str, str]:
    """The text of each row that the file names. Raises InputError."""
    texts: dict[str, str] = {}
    lines = text_of_file(
        path, "give a text file with the rows of an EMVA 1288 sheet"
    ).splitlines()
    for number, line in enumerate(lines, start=1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        name, equals, value = (part.strip() for part in content.partition("="))
        if not equals or name not in NAMES:
            raise InputError(
                f"{path}, line {number}: {content[:80]!r} is no row NAME = VALUE; the names are "
                f"{', '.join(NAMES)}.{nearest(name, NAMES)}"
            )
        if name in texts:
            raise InputError(f"{path}, line {number}: {name} is given twice; leave one out.")
        texts[name] = value.strip("\"'")
    return texts
