"""Numbers as people write them, ``0.5 %``, ``10 500`` and ``0,5``, and how to write them here."""

from __future__ import annotations

import re

NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
PERCENT = re.compile(rf"({NUMBER})\s*%")
GROUPED = re.compile(r"[+-]?\d{1,3}(?:[ '’_\u00a0\u202f]\d{3})+(?:\.\d+)?")
COMMAS = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+")
THOUSANDS = re.compile(rf"({NUMBER})\s*k")
F_NUMBER = re.compile(rf"[fF]/?({NUMBER})")
WITH_UNIT = re.compile(rf"{NUMBER}\s*([A-Za-zµ°].*)")


def number_hint(name: str, value: object) -> str:
    """Return how to write the number that a text means; empty if the text does not look like a number.

    name : of the number; a name that ends in percent takes percentages as they are.
    """
    text = value.strip() if isinstance(value, str) and len(value) < 100 else ""
    number = ""
    if percent := PERCENT.fullmatch(text):
        number = f"{float(percent[1]) * (1.0 if name.endswith('percent') else 0.01):.10g}"
    elif GROUPED.fullmatch(text):
        number = re.sub("[^0-9.+-]", "", text)
    elif COMMAS.fullmatch(text):
        number = text.replace(",", "")
        if text.count(",") == 1:
            number += f" or {text.replace(',', '.')}"
    elif DECIMAL_COMMA.fullmatch(text):
        number = f"{float(text.replace(',', '.')):.10g}"
    elif thousands := THOUSANDS.fullmatch(text):
        number = f"{1000 * float(thousands[1]):.10g}"
    elif f_number := F_NUMBER.fullmatch(text):
        number = f_number[1]
    elif unit := WITH_UNIT.fullmatch(text):
        return f"omit {unit[1]!r}"
    return f"write {number} for {text!r}" if number else ""
