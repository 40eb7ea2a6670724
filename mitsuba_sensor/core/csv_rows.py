"""Rows of a table in a text file: separated by commas, semicolons or tabs, as spreadsheets write them."""

import csv
import re
from collections.abc import Collection, Mapping

from .errors import InputError

SEPARATORS = ";\t,"  # the first of them in the header separates; with the others a comma may be a decimal comma
SEPARATED = "separated by commas, semicolons or tabs"  # for what is said of a file that is not
TITLE = re.compile(
    r"(?P<name>.*?)[\s_/]*(?:\[(?P<b>.*)\]|\((?P<p>.*)\)|(?<=[\s_/])(?P<w>[^\s_/]+))"
)


def rows_of(text: str, first_names: Collection[str] = ()) -> list[list[str]]:
    """The cells of every line, without spaces around them; lines that begin with # are comments.

    Where semicolons or tabs separate, 0,5 is 0.5. Raises InputError for a cell of 131072 characters or more.
    first_names : of the first column; a comment that begins with one is a header, as numpy.savetxt writes it.
    """
    lines = []
    for line in map(str.strip, text.removeprefix("\ufeff").splitlines()):
        if line.startswith("#"):
            line = line.lstrip("# \t")
            name, _ = name_and_unit(re.split(f"[{SEPARATORS}]", line)[0])
            if name.lower() not in first_names:
                continue
        lines += [line] if line else []
    separator = next((one for one in SEPARATORS if lines and one in lines[0]), ",")
    rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    try:
        return [[cell.strip().replace(",", ".") for cell in row] for row in rows]
    except csv.Error as error:
        raise InputError(
            f"a line is no row of cells {SEPARATED}: {error}; correct it."
        ) from None


def name_and_unit(title: str) -> tuple[str, str]:
    """("time", "ms") of time_ms, time [ms], time (ms) and time / ms; no unit of time. µ is u, and % percent."""
    plain = re.sub("[\N{MICRO SIGN}\N{GREEK SMALL LETTER MU}]", "u", title.strip())
    plain = plain.replace("%", "percent")
    whole = TITLE.fullmatch(plain)
    if whole is None:
        return plain, ""
    return whole["name"], (whole["b"] or whole["p"] or whole["w"] or "").strip()


def named_column(
    number: int, title: str, units: Mapping[str, float], names: Collection[str] = ()
) -> tuple[str, str]:
    """Name and unit of a column of a header, counted from 1. Raises ValueError where its unit is not sure.

    names : one of which it must have, in any writing; without them it may have any.
    """
    name, unit = name_and_unit(title)
    if name and unit in units and (not names or name.lower() in names):
        return name, unit
    wanted = " or ".join(f"{next(iter(names), 'NAME')}_{unit}" for unit in units)
    raise ValueError(
        f"column {number} is called {title[:60]!r}; call it {wanted}, so that the unit is sure, in columns {SEPARATED}"
    )
