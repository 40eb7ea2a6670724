"""Rows of a text table separated by commas, semicolons or tabs, as spreadsheets write it."""

import csv
import re
from collections.abc import Collection, Mapping

from .errors import InputError

# The first one in the header counts; with ; and tab, a comma is a decimal comma.
SEPARATORS = ";\t,"
SEPARATED = "separated by commas, semicolons or tabs"  # for messages
TITLE = re.compile(
    r"(?P<name>.*?)[\s_/]*(?:\[(?P<b>.*)\]|\((?P<p>.*)\)|(?<=[\s_/])(?P<w>[^\s_/]+))"
)


def rows_of(text: str, first_names: Collection[str] = ()) -> list[list[str]]:
    """Return the stripped cells of every line; lines that start with # are comments.

    With semicolons or tabs, 0,5 means 0.5. Raises InputError for a cell of 131072 characters or more.
    first_names : names of the first column; a comment that starts with one is a header, as from numpy.savetxt.
    """
    lines = []
    for line in map(str.strip, text.removeprefix("\ufeff").splitlines()):
        if line.startswith("#"):
            line = line.lstrip("# \t")
            name, _ = name_and_unit(re.split(f"[{SEPARATORS}]", line)[0])
            if name.lower() not in first_names:
                continue
        lines += [line] if line else []
    separator = next((mark for mark in SEPARATORS if lines and mark in lines[0]), ",")
    rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    try:
        return [[cell.strip().replace(",", ".") for cell in row] for row in rows]
    except csv.Error as error:
        raise InputError(
            f"a line is not a row of cells {SEPARATED}: {error}; fix it."
        ) from None


def name_and_unit(title: str) -> tuple[str, str]:
    """Return ("time", "ms") for time_ms, time [ms], time (ms) and time / ms. µ becomes u, and % percent."""
    plain = re.sub("[\N{MICRO SIGN}\N{GREEK SMALL LETTER MU}]", "u", title.strip())
    plain = plain.replace("%", "percent")
    whole = TITLE.fullmatch(plain)
    if whole is None:
        return plain, ""
    return whole["name"], (whole["b"] or whole["p"] or whole["w"] or "").strip()


def named_column(
    number: int, title: str, units: Mapping[str, float], names: Collection[str] = ()
) -> tuple[str, str]:
    """Return name and unit of a column, counted from 1. Raises ValueError if the unit is unclear.

    names : allowed names in lower case; empty allows any name.
    """
    name, unit = name_and_unit(title)
    if name and unit in units and (not names or name.lower() in names):
        return name, unit
    wanted = " or ".join(f"{next(iter(names), 'NAME')}_{unit}" for unit in units)
    raise ValueError(
        f"column {number} is called {title[:60]!r}; name it {wanted} to state its unit, in columns {SEPARATED}"
    )
