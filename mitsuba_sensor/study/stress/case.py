"""A case of the stress study: an input at the edge of what is allowed, what must come of it, and who is asked."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np

from ...core.backend import Backend
from ...core.exposure import Exposure
from ...core.frame import Frame
from ...core.llvm import backend_problem, drjit
from ...core.sensor_window import SensorWindow
from ...core.signals import Electrons
from ...sensor.camera import Camera, load_camera
from ...sensor.chain import chain
from ...sensor.run import choose_backend
from ..statistics import Array
from .got import Got, shown

FLOAT32, FLOAT64 = 2.0**-24, 2.0**-53
"""Unit roundoff: how far the nearest number of that precision may be, relative to the number (IEEE 754)."""
SIGMAS = 5.0
"""Averages may be this many standard errors off: chance exceeds it in 6 of 10 million comparisons of normal values."""
RARE = 5.0
"""And counts by this many more: of counts with a mean far below one, chance makes 5 more in one of a million cases."""
TENTH = Exposure(0.1)
NAME = "konnik_table1"


def table1(**changes: Any) -> Camera:
    """The paper's camera. changes : of its datasheet, with ``__`` for the dot of a field."""
    return load_camera(NAME).replace(**{name.replace("__", "."): value for name, value in changes.items()})


def stage_of(name: str, **changes: Any) -> Any:
    """One stage of that camera, by its name."""
    return next(stage for stage in chain(table1(**changes)) if stage.label.lower() == name)


@dataclass(frozen=True)
class Engine:
    """Who computes.

    name : for people.  word, precision : what ``expose`` calls it; of a renderer, its Mitsuba variant.
    compiler : of Dr.Jit, that it needs on this machine.
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
        """The options of :func:`expose` that choose it."""
        return {"engine": self.word, "precision": self.precision}

    @property
    def unit(self) -> float:
        """Its unit roundoff."""
        return FLOAT64 if self.precision == "float64" else FLOAT32

    @cached_property
    def arithmetic(self) -> Backend:
        """Who does the arithmetic."""
        return choose_backend(self.word, self.precision, 0)

    def frame(self, shape: tuple[int, int], exposure: Exposure = TENTH) -> Frame:
        """A frame whose pixels this engine computes."""
        return Frame(exposure, SensorWindow(7, shape, backend=self.arithmetic), 5)

    def take(self, values: Any, frame: Frame) -> Any:
        """Numbers of the host, for this engine."""
        return self.arithmetic.from_numpy(np.asarray(values, dtype=np.float64), frame.window)

    def give(self, signals: Sequence[Any], frame: Frame) -> list[Array]:
        """Signals on the host, (H, W) float64 each; a compiled engine runs one kernel for all of them."""
        if self.arithmetic.compiled:
            drjit().eval([x for x in signals if not np.isscalar(x)])
        return [np.asarray(self.arithmetic.to_numpy(x, frame.window), dtype=np.float64) for x in signals]

    def through(self, values: Any, *stages: Any, electrons: bool = False, exposure: Exposure = TENTH) -> Array:
        """Numbers (H, W) through some stages. electrons : whether they enter as electrons, else as volts."""
        frame = self.frame(np.shape(values), exposure)
        signal = self.take(values, frame)
        signal = Electrons(signal) if electrons else signal
        for stage in stages:
            signal = stage.sample(signal, frame)
        return self.give([signal.total if isinstance(signal, Electrons) else signal], frame)[0]


ONCE = Engine("no engine", "", "float64")  # formulas of Python numbers, and what is refused before anybody computes
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
class Case:
    """One input, at one stage.

    theme : what is driven to its edge.  stage : who must bear it.  given, expected : as text.
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


ONLY_ONCE = (ONCE,)


def cases_of(
    theme: str,
    stage: str,
    given: str,
    expected: str,
    check: Callable[..., Got],
    values: Iterable[Any] = ((),),
    asked: tuple[Engine, ...] = ENGINES,
    seconds: float = 0.02,
) -> list[Case]:
    """A case for each of ``values``: arguments of the check behind the engine, which also fill the texts' ``{}``.

    A check that is asked only once has no engine among its arguments. The others : as in :class:`Case`.
    """
    found = []
    for value in values:
        arguments = value if isinstance(value, tuple) else (value,)
        of, at, must = (text.format(*map(shown, arguments)) for text in (stage, given, expected))
        found.append(Case(theme, of, at, must, partial(_ask, check, arguments), asked, seconds))
    return found


def _ask(check: Callable[..., Got], arguments: tuple[Any, ...], engine: Engine) -> Got:
    return check(*arguments) if engine is ONCE else check(engine, *arguments)


@dataclass(frozen=True)
class Verdict:
    """An engine's answer to a case. passed : None where the engine is not on this machine."""

    case: Case
    engine: Engine
    got: str
    passed: bool | None
    seconds: float = 0.0


def verdict_of(case: Case, engine: Engine) -> Verdict:
    """Ask. A warning of NumPy is a NaN on its way and an exception is no answer: both fail."""
    started = time.perf_counter()
    try:
        with warnings.catch_warnings(), np.errstate(divide="warn", over="warn", invalid="warn"):
            warnings.simplefilter("error", RuntimeWarning)
            got = case.check(engine)
    except Exception as error:  # whatever it is, it is the answer of a case and must not end the study
        got = Got(f"{type(error).__name__}: {error}", False)
    return Verdict(case, engine, got.text, bool(got.passed), time.perf_counter() - started)
