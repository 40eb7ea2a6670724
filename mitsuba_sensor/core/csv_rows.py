"""Rows of a table in a text file: separated by commas, semicolons or tabs, as spreadsheets write them."""

import csv

from .errors import InputError

SEPARATORS = ";\t,"  # the first of them in the header separates; with the others a comma may be a decimal comma
SEPARATED = "separated by commas, semicolons or tabs"  # for what is said of a file that is not


def rows_of(text: str) -> list[list[str]]:
    """The cells of every line, without spaces around them; lines that begin with # are comments.

    Where semicolons or tabs separate, 0,5 is 0.5. Raises InputError for a cell of 131072 characters or more.
    """
    lines = [line for line in text.splitlines() if line.strip() and line.lstrip()[:1] != "#"]
    separator = next((one for one in SEPARATORS if lines and one in lines[0]), ",")
    rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
    try:
        return [[cell.strip().replace(",", ".") for cell in row] for row in rows]
    except csv.Error as error:
        raise InputError(
            f"a line is no row of cells {SEPARATED}: {error}; correct it."
        ) from None
