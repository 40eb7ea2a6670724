"""Numbers as people write them: what to write in place of ``0.5 %``, ``10 500`` and ``0,5``."""

from __future__ import annotations

import re

NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
PERCENT = re.compile(rf"({NUMBER})\s*%")
GROUPED = re.compile(r"[+-]?\d{1,3}(?:[ '’_\u00a0\u202f]\d{3})+(?:\.\d+)?")
COMMAS = re.compile(r"[+-]?\d{1,3}(?:,\d{3})+")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+")
THOUSANDS = re.compile(rf"({NUMBER})\s*k")
WITH_UNIT = re.compile(rf"{NUMBER}\s*([A-Za-zµ°].*)")


def number_hint(name: str, value: object) -> str:
    """What a text in place of a number means, or what is to be left out of it; empty where that is not known.

    name : of the number, which ends in percent where its unit is that.
    """
    text = ""
    if isinstance(value, str) and len(value) < 100:
        text = value.strip()
    if percent := PERCENT.fullmatch(text):
        factor = 0.01
        if name.endswith("percent"):
            factor = 1.0
        return f"{text!r} is {float(percent[1]) * factor:.10g}"
    if GROUPED.fullmatch(text):
        return f"{text!r} is {re.sub('[^0-9.+-]', '', text)}"
    if COMMAS.fullmatch(text):
        whole = text.replace(",", "")
        if text.count(",") > 1:
            return f"{text!r} is {whole}"
        return f"{text!r} is {whole}, or {text.replace(',', '.')}"
    if DECIMAL_COMMA.fullmatch(text):
        return f"{text!r} is {float(text.replace(',', '.')):.10g}"
    if thousands := THOUSANDS.fullmatch(text):
        return f"{text!r} is {1000 * float(thousands[1]):.10g}"
    if unit := WITH_UNIT.fullmatch(text):
        return f"write the number alone, without {unit[1]!r}"
    return ""
