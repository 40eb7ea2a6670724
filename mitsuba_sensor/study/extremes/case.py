"""A case: an input at the edge of what is allowed, what must come of it, and who is asked."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.backend import Backend
from ...core.errors import InputError
from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.llvm import backend_problem
from ...core.sensor_window import SensorWindow
from ...sensor.run import choose_backend

FLOAT32, FLOAT64 = 2.0**-24, 2.0**-53
"""Unit roundoff: how far the nearest number of that precision may be, relative to the number (IEEE 754)."""

SIGMAS = 5.0
"""Averages may be this many standard errors off: chance exceeds it in 6 of 10 million comparisons of normal values."""

RARE = 5.0
"""And counts by this many more: of counts with a mean far below one, chance makes 5 more in one of a million cases."""


@dataclass(frozen=True)
class Engine:
    """Who computes.

    name : for people.  word, precision : what ``expose`` calls it; of a renderer, its Mitsuba variant.
    backend : what it needs on this machine.
    """

    name: str
    word: str
    precision: Literal["float32", "float64"] = "float32"
    compiler: str = "scalar"

    @property
    def problem(self) -> str | None:
        """Why it cannot be asked on this machine, or None."""
        return None if self.compiler == "scalar" else backend_problem(self.compiler)

    @property
    def how(self) -> dict[str, Any]:
        """The words of :func:`expose` that choose it."""
        return {"engine": self.word, "precision": self.precision}

    @property
    def unit(self) -> float:
        """Its unit roundoff."""
        return FLOAT64 if self.precision == "float64" else FLOAT32

    @cached_property
    def backend(self) -> Backend:
        """The engine itself."""
        return choose_backend(self.word, self.precision, 0)

    def frame(self, shape: tuple[int, int], exposure: Exposure, serial: int = 7, seed: int = 5) -> Frame:
        """A frame whose pixels this engine computes."""
        return Frame(exposure, SensorWindow(serial, shape, backend=self.backend), seed)

    def take(self, values: Any, frame: Frame) -> Any:
        """Numbers of the host, for this engine."""
        return self.backend.take(np.asarray(values, dtype=np.float64), frame.window)

    def give(self, signals: Sequence[Any], frame: Frame) -> list[NDArray[np.float64]]:
        """Signals on the host, (H, W) float64 each; a compiled engine runs one kernel for all of them."""
        if not self.backend.on_host:
            self.backend.dr.eval([x for x in signals if not np.isscalar(x)])  # type: ignore[attr-defined]
        return [np.asarray(self.backend.to_numpy(x, frame.window), dtype=np.float64) for x in signals]


ONCE = Engine("no engine", "", "float64")
"""Formulas of Python numbers, and what is refused before anybody computes."""

ENGINES = (
    Engine("NumPy float64", "numpy", "float64"),
    Engine("NumPy float32", "numpy"),
    Engine("LLVM float32", "drjit", compiler="llvm"),
    Engine("CUDA float32", "cuda", compiler="cuda"),
)
RENDERERS = (
    Engine("Mitsuba scalar", "scalar_spectral"),
    Engine("Mitsuba LLVM", "llvm_ad_spectral", compiler="llvm"),
    Engine("Mitsuba CUDA", "cuda_ad_spectral", compiler="cuda"),
)


@dataclass(frozen=True)
class Got:
    """What came, in words with numbers, and whether it is what must come."""

    words: str
    passed: bool


@dataclass(frozen=True)
class Case:
    """One input, at one stage.

    theme : what is driven to its edge.  stage : who must bear it.  given, expected : in words.
    check : asks one engine.  asked : which engines.  seconds : about how long one takes on two cores.
    """

    theme: str
    stage: str
    given: str
    expected: str
    check: Callable[[Engine], Got]
    asked: tuple[Engine, ...] = ENGINES
    seconds: float = 0.02

    @property
    def name(self) -> str:
        """No other case has it."""
        return f"{self.theme} | {self.stage} | {self.given}"


@dataclass(frozen=True)
class Verdict:
    """An engine's answer to a case. passed : None where the engine is not on this machine."""

    case: Case
    engine: Engine
    got: str
    passed: bool | None
    seconds: float = 0.0


def once(theme: str, stage: str, given: str, expected: str, check: Callable[[], Got]) -> Case:
    """A case that has nothing to do with engines."""
    return Case(theme, stage, given, expected, lambda _: check(), (ONCE,))


def judge(case: Case, engine: Engine) -> Verdict:
    """Ask. A warning of NumPy is a NaN on its way and an exception is no answer: both fail."""
    started = time.perf_counter()
    try:
        with warnings.catch_warnings(), np.errstate(divide="warn", over="warn", invalid="warn"):
            warnings.simplefilter("error", RuntimeWarning)
            got = case.check(engine)
    except Exception as error:  # whatever it is, it is the answer of a case and must not end the study
        got = Got(f"{type(error).__name__}: {error}", False)
    return Verdict(case, engine, got.words, bool(got.passed), time.perf_counter() - started)


def near(found: float, expected: float, tolerance: float, unit: str = "") -> Got:
    """A number within ``tolerance`` (absolute) of what is expected."""
    return Got(f"{found:.8g}{unit}", math.isfinite(found) and abs(found - expected) <= tolerance)


def relative(found: float, expected: float, tolerance: float, unit: str = "") -> Got:
    """A number within ``tolerance`` of itself."""
    return near(found, expected, tolerance * abs(expected), unit)


def largest(off: float, tolerance: float, words: str) -> Got:
    """A largest deviation within its tolerance."""
    return Got(f"{words} {off:.2g}", bool(off <= tolerance))  # NaN is not


def refusal(action: Callable[[], Any], words: str) -> Got:
    """An InputError that says ``words``, in one sentence."""
    try:
        action()
    except InputError as error:
        text = str(error)
        return Got(text, words in text and "\n" not in text)
    return Got("nothing was refused", False)


def together(answers: Sequence[Got]) -> Got:
    """Several answers as one."""
    return Got("; ".join(answer.words for answer in answers), all(answer.passed for answer in answers))


def shown(x: float) -> str:
    """A number as people write it: 0.01, 300, 1e-9, 1e30."""
    text = repr(float(x)) if abs(x) < 1e6 else f"{x:g}"
    mantissa, e, power = text.partition("e")
    return f"{mantissa}e{int(power)}" if e else text.removesuffix(".0")
