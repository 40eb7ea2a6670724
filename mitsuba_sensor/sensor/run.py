"""Frames of one window and light: computed strip by strip of rows, on threads of the host or by a compiled kernel."""

import os
import threading
from collections.abc import Callable, Container, Hashable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Electrons, Frame, InputError, Photons, SensorWindow, nearest
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend, PendingStrip
from ..core.llvm import backend_problem
from .options import Engine
from .stage import Chain, Stage, sample, total

ENGINES = get_args(Engine)
# Pixels in all frames together from which on "auto" compiles a kernel. NumPy needs a second for them on two
# processors, and so long does a new process need for Dr.Jit, the kernel and the maps (benchmarks/backend_speed.py).
WORTH_COMPILING = 2**23
# Fields of Electrons that can have one value per pixel before the shot noise.
LAYERS = ("light", "yield_mean", "yield_variance", "variance_e2")
Sinks = dict[str, NDArray[Any]]


def choose_backend(engine: str, precision: str, pixels: int) -> Backend:
    """The backend for so many pixels; InputError for an engine that is unknown or missing, or compiled and float64."""
    if engine not in ENGINES:
        known = f"{', '.join(ENGINES)}.{nearest(str(engine), ENGINES)}"
        raise InputError(f"engine is {engine!r}; it must be one of {known}")
    if precision == "float64":
        if engine in ("drjit", "cuda"):
            raise InputError(
                f"engine is {engine!r} and precision float64, asked for or found to be needed; compiled engines are "
                "float32: take numpy, or precision float32."
            )
        return NUMPY_FLOAT64
    if engine == "numpy" or (engine == "auto" and (pixels < WORTH_COMPILING or backend_problem("llvm"))):
        return NUMPY_FLOAT32
    backend = "cuda" if engine == "cuda" else "llvm"
    problem = backend_problem(backend)
    if problem:
        way_out = "take engine numpy" + (", or apt-get install libllvm19" if backend == "llvm" else "")
        raise InputError(f"engine is {engine!r}, but there is {problem}; {way_out}.")
    from ..core.drjit_backend import DrJitBackend  # imports Dr.Jit

    return DrJitBackend(backend)


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def row_strips_of(shape: tuple[int, int], pixels: int) -> Iterator[slice]:
    """Whole rows of about so many pixels; no result depends on how many."""
    height = max(pixels // shape[1], 1)
    for start in range(0, shape[0], height):
        yield slice(start, min(start + height, shape[0]))


@dataclass(eq=False)
class FrameRunner:
    """Frames of one window and one light, strip by strip of rows; FPN maps stay with their strips between the frames.

    On NumPy as many strips as there are processors are in flight; a compiled kernel shares them out by itself.
    """

    stages: Chain
    light: Photons
    first: Frame
    _parts: dict[int, tuple[SensorWindow, Electrons | None]] = field(default_factory=dict)
    _maps: dict[Hashable, NDArray[Any]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        backend = self.first.window.backend
        self._rows = list(row_strips_of(self.first.window.shape, backend.strip_pixels))
        workers = 1 if backend.compiled else min(processors(), len(self._rows))
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None

    def frames(self, first: int, count: int, sinks_of: Callable[[int], Sinks]) -> Iterator[Sinks]:
        """Frames ``first``, first + 1, …, each into the arrays (H, W) of ``sinks_of(index)``, by the signal's name.

        A compiled engine traces the next strip while it computes one; there a frame comes when the next has begun.
        """
        before, ready = PendingStrip(), None
        try:
            for index in range(first, first + count):
                sinks = sinks_of(index)
                for job in self._jobs(index, sinks, index + 1 == first + count):
                    before.wait()
                    job.launch()
                    before.copy()
                    before = job
                    if ready is not None:
                        yield ready
                        ready = None
                ready = sinks
                if not self.first.window.backend.compiled:
                    yield ready
                    ready = None
            before.wait()
            before.copy()
            if ready is not None:
                yield ready
        finally:  # also when nobody asks for the rest: release the threads and the maps
            self._parts.clear()
            self._maps.clear()
            if self._pool:
                self._pool.shutdown()

    def _jobs(self, index: int, sinks: Sinks, last: bool) -> Iterator[PendingStrip]:
        """One job per strip; on the host they are done."""
        numbers = range(len(self._rows))
        if self._pool is None:
            yield from (self._strip(number, index, sinks, last) for number in numbers)
        else:
            for done in [self._pool.submit(self._strip, number, index, sinks, last) for number in numbers]:
                yield done.result()

    def _strip(self, number: int, index: int, sinks: Sinks, last: bool) -> PendingStrip:
        rows = self._rows[number]
        strip = self.light.crop_rows(rows)
        if new := number not in self._parts:
            window, start = self.first.window.crop_rows(rows), None
            if window.backend.compiled:
                start = begin(self.stages, strip, replace(self.first, window=window))
        else:
            window, start = self._parts.pop(number)
        frame = Frame(self.first.exposure, window, self.first.seed, index)
        found = {"photons"}
        if "photons" in sinks:
            sinks["photons"][rows] = strip.total
        for name, signal in signals(self.stages, strip if start is None else start, frame):
            found.add(name)
            if name == "digital":
                require_kept(sinks, found)
                if not last:
                    self._keep(number, window, start, new)
                return window.backend.pending(signal, window, sinks[name][rows])
            if name in sinks:
                sinks[name][rows] = window.backend.to_numpy(signal, window)
        raise AssertionError("the last stage of a chain delivers digital numbers")

    def _keep(self, number: int, window: SensorWindow, start: Electrons | None, new: bool) -> None:
        """Keep a strip's maps for the next frame; on the host in one array per map, whole, so that memory stays so."""
        self._parts[number] = window, start
        if not new or window.backend.compiled:
            return
        shape, rows = self.first.window.shape, self._rows[number]
        for key, strip in list(window.cached_values.items()):
            if isinstance(strip, np.ndarray) and strip.shape == window.shape:
                with self._lock:
                    if key not in self._maps:
                        self._maps[key] = np.empty(shape, strip.dtype)
                    whole = self._maps[key]
                whole[rows] = strip
                window.cached_values[key] = whole[rows]


def require_kept(asked: Iterable[str], found: Container[str]) -> None:
    """Raise InputError unless the chain delivers every signal that was asked for."""
    for name in asked:
        if name not in found:
            raise InputError(
                f"keep names {name!r}, and this chain does not hold photoelectrons and dark electrons apart; keep "
                "'electrons', their sum."
            )


def begin(stages: Chain, light: Photons, frame: Frame) -> Electrons:
    """What a compiled backend computes once for many frames: mean photoelectrons, and all FPN maps."""
    window, host = frame.window, frame.on(NUMPY_FLOAT32).window
    parts = [  # on the host, a few rows at a time
        stages[0].sample(light.crop_rows(rows), replace(frame, window=host.crop_rows(rows), _blocks={}))
        for rows in row_strips_of(window.shape, NUMPY_FLOAT32.strip_pixels)
    ]
    layers = {
        name: window.backend.from_numpy(np.concatenate([getattr(part, name) for part in parts]), window)
        for name in LAYERS
        if isinstance(getattr(parts[0], name), np.ndarray)
    }
    del parts  # no longer needed, and as large as the light
    electrons = Electrons(**layers)
    sample(stages[1:], electrons, replace(frame, _blocks={}))  # traced and discarded: this makes the maps
    window.backend.evaluate(window)
    return electrons


def signals(stages: Chain, start: Photons | Electrons, frame: Frame) -> Iterator[tuple[str, Array]]:
    """One frame through the chain, from photons or from photoelectrons; (name, signal) where the unit changes."""
    signal: Array = start
    left = stages if isinstance(start, Photons) else stages[1:]
    for stage, following in zip(left, (*left[1:], None), strict=True):
        signal = stage.sample(signal, frame)
        if following is None or following.domain != stage.domain:
            yield from named(stage, signal, last=following is None)


def named(stage: Stage, signal: Array, last: bool) -> Iterator[tuple[str, Array]]:
    """The signal behind the last stage of a domain, under the names that ``expose(keep=…)`` knows."""
    if last:
        yield "digital", signal
    elif stage.domain != "photons":
        if isinstance(signal, Electrons):
            yield "photoelectrons", signal.light
            yield "dark_electrons", signal.dark
        yield stage.domain, total(signal)
