"""What came of a case, and whether it is what must come."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.errors import InputError


@dataclass(frozen=True)
class Got:
    """What came, as text with numbers, and whether it is what must come."""

    text: str
    passed: bool


def agree(found: Any, exact: Any, allowed: Any = 0.0, unit: str = "") -> Got:
    """Numbers, each within ``allowed`` (absolute) of what they must be; NaN is not."""
    values, off = np.asarray(found, dtype=np.float64), np.abs(np.subtract(found, exact, dtype=np.float64))
    text = f"{values.min():.8g}" + (f" … {values.max():.8g}" if values.size > 1 else "")
    return Got(f"{text}{unit}, off by {off.max():.2g}", bool((off <= allowed).all()))


def relative(found: Any, exact: Any, allowed: float, unit: str = "") -> Got:
    """Numbers, each within ``allowed`` of itself."""
    return agree(found, exact, allowed * np.abs(exact), unit)


def holds(text: str, *conditions: Any) -> Got:
    """What came as text, and whether all these hold."""
    return Got(text, all(bool(condition) for condition in conditions))


def refusal(action: Callable[[], Any], part: str) -> Got:
    """An InputError that says ``part``, in one sentence."""
    try:
        action()
    except InputError as error:
        return Got(str(error), part in str(error) and "\n" not in str(error))
    return Got("nothing was refused", False)


def together(*answers: Got) -> Got:
    """Several answers as one."""
    return Got("; ".join(answer.text for answer in answers), all(answer.passed for answer in answers))


def shown(x: Any) -> str:
    """A number as people write it: 0.01, 300, 1e-9, 1e30; anything else as it is."""
    if not isinstance(x, float):
        return str(x)
    text = repr(x) if abs(x) < 1e6 else f"{x:g}"
    mantissa, e, power = text.partition("e")
    return f"{mantissa}e{int(power)}" if e else text.removesuffix(".0")
