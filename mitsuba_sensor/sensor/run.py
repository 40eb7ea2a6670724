"""Compute frames of one window and light in strips of rows, on threads of the host or by a compiled kernel."""

from __future__ import annotations

import math
import operator
import sys
import threading
from collections import Counter
from collections.abc import Callable, Container, Hashable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..core import Array, Electrons, Frame, InputError, SensorWindow, nearest
from ..core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64, Backend, PendingStrip
from ..core.llvm import backend_problem, llvm_remedy
from ..stages.stage import Chain, Stage, sample, total
from .options import Engine
from .threads import processors

if TYPE_CHECKING:
    from .detection import Detected, DetectedByKernel

ENGINES = get_args(Engine)
COMPILED_MIN = 2**23
"""Pixels in all frames from which "auto" compiles a kernel. NumPy takes a second for them on two processors, as
long as a new process for Dr.Jit, the kernel and the maps (benchmarks/backend_speed.py)."""
COMPILED_MIN_LOADED = 2**20
"""The same once Dr.Jit's LLVM backend is loaded: a new kernel takes NumPy's time for a megapixel."""
Sinks = dict[str, NDArray[Any]]

INPUT_REFERRED = "input_referred_electrons"
"""The swing at the converter over A_SN·A_SF·A_CDS, the small-signal gain: electrons with read noise, offsets and
curves, without black level, rounding and clips of the converter."""


def choose_backend(engine: str, precision: str, pixels: int) -> Backend:
    """Return the backend for so many pixels. Raises InputError if the engine is unknown, missing, or has no float64."""
    if engine not in ENGINES:
        known = f"{', '.join(ENGINES)}.{nearest(str(engine), ENGINES)}"
        raise InputError(f"engine is {engine!r}; it must be one of {known}")
    if precision == "float64":
        if engine in ("drjit", "cuda"):
            raise InputError(
                f"engine is {engine!r}, but precision is float64 (as given, or as this camera needs); compiled engines "
                "have float32 only: use engine numpy, or precision float32."
            )
        return NUMPY_FLOAT64
    least = COMPILED_MIN
    if "drjit.llvm" in sys.modules:
        least = COMPILED_MIN_LOADED
    if engine == "numpy" or (engine == "auto" and (pixels < least or backend_problem("llvm"))):
        return NUMPY_FLOAT32
    backend = "llvm"
    if engine == "cuda":
        backend = "cuda"
    problem = backend_problem(backend)
    if problem:
        remedy = "use engine numpy" + (f", or {llvm_remedy()}" if backend == "llvm" else "")
        raise InputError(f"engine is {engine!r}, but there is {problem}; {remedy}.")
    from ..core.drjit_backend import DrJitBackend  # imports Dr.Jit

    return DrJitBackend(backend)


def row_strips_of(shape: tuple[int, int], pixels: int) -> Iterator[slice]:
    """Yield slices of whole rows with about so many pixels; no result depends on how many."""
    height = max(pixels // shape[1], 1)
    for start in range(0, shape[0], height):
        yield slice(start, min(start + height, shape[0]))


class Strip(NamedTuple):
    """Rows of a window that are computed together.

    rows : of the result.  around : these and the neighbouring rows that affect them.
    """

    rows: slice
    around: slice

    @classmethod
    def of(cls, rows: slice, reach_px: int, height: int) -> Strip:
        """Return a strip with neighbours of this reach, in a window of this height."""
        return cls(
            rows, slice(max(rows.start - reach_px, 0), min(rows.stop + reach_px, height))
        )

    @property
    def inside(self) -> slice:
        """The rows of the result, counted from the first computed row."""
        return slice(self.rows.start - self.around.start, self.rows.stop - self.around.start)


def strips_of(stages: Chain, window: SensorWindow) -> list[Strip]:
    """Return the strips in which this chain is computed; no result depends on their number.

    There is one strip if stages couple neighbours further away than a strip is high, or in a compiled kernel.
    """
    height, width = window.shape
    reach_px, backend = sum(stage.reach_px for stage in stages), window.backend
    whole = reach_px and (backend.compiled or reach_px * width > backend.strip_pixels)
    strips = []
    for rows in row_strips_of(window.shape, height * width if whole else backend.strip_pixels):
        strips.append(Strip.of(rows, reach_px, height))
    return strips


@dataclass(eq=False)
class StripWindows:
    """The window of a sensor as strips of rows that keep their FPN maps.

    On the host the map of all strips is one array, so memory does not grow from frame to frame.
    """

    window: SensorWindow
    strips: list[Strip]
    _strips: dict[int, SensorWindow] = field(default_factory=dict)
    _maps: dict[Hashable, NDArray[Any]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def strip(self, number: int) -> SensorWindow:
        """Return a strip, with its maps if they were kept."""
        return self._strips.get(number) or self.window.crop_rows(self.strips[number].around)

    def keep(self, number: int, strip: SensorWindow) -> None:
        """Keep the maps of a strip for later frames."""
        if number in self._strips:
            return
        self._strips[number] = strip
        for key, values in [] if strip.backend.compiled else list(strip.cached_values.items()):
            if isinstance(values, np.ndarray) and values.shape == strip.shape:
                with self._lock:
                    if key not in self._maps:
                        self._maps[key] = np.empty(self.window.shape, values.dtype)
                    whole = self._maps[key]
                rows = self.strips[number].around
                whole[rows] = values
                strip.cached_values[key] = whole[rows]

    @property
    def bytes(self) -> int:
        """Memory of the maps, on the host or in a compiled backend."""
        size = self.window.shape[0] * self.window.shape[1]
        if not self.window.backend.compiled:
            return sum(values.nbytes for values in self._maps.values())
        return (
            4
            * size
            * max((len(strip.cached_values) for strip in self._strips.values()), default=0)
        )


@dataclass(eq=False)
class FrameRunner:
    """Computes frames of one window and one light in strips, which keep their FPN maps between frames.

    NumPy computes one strip per processor at a time.
    counts : collects the clipped pixels of the first frame by their cause; None to count none.
    strips : of the window of ``first``; a :class:`Sensor` keeps them between calls.
    """

    stages: Chain
    light: Detected | DetectedByKernel
    first: Frame
    counts: Counter[str] | None = None
    strips: StripWindows | None = None
    _starts: dict[int, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._own, self._kept = (
            self.strips is None,
            self.strips or self._new_strips(),
        )
        if self.first.window.backend.compiled:
            workers = 1
        else:
            workers = min(processors(), len(self._kept.strips))
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None

    def frames(
        self, first: int, count: int, sinks_of: Callable[[int], Sinks]
    ) -> Iterator[Sinks]:
        """Yield the arrays (H, W) of ``sinks_of(index)``, filled with frames ``first``, first + 1, ….

        A compiled engine traces the next strip while it computes one, and yields a frame when the next has begun.
        """
        before, ready = PendingStrip(), None
        try:
            for index in range(first, first + count):
                sinks = sinks_of(index)
                for job in self._jobs(index, sinks, index + 1 == first + count):
                    before.wait()
                    job.launch()
                    self._copy(before)
                    before = job
                    if ready is not None:
                        yield ready
                        ready = None
                ready = sinks
                if not self.first.window.backend.compiled:
                    yield ready
                    ready = None
            before.wait()
            self._copy(before)
            if ready is not None:
                yield ready
        finally:  # also if the generator is closed early: release threads, light and maps
            self._starts.clear()
            if self._own:
                self._kept = self._new_strips()
            if self._pool:
                self._pool.shutdown()

    def _new_strips(self) -> StripWindows:
        window = self.first.window
        return StripWindows(window, strips_of(self.stages, window))

    def _copy(self, strip: PendingStrip) -> None:
        strip.copy()
        if self.counts is not None:
            self.counts.update(strip.counts)

    def _jobs(self, index: int, sinks: Sinks, last: bool) -> Iterator[PendingStrip]:
        """Yield one job per strip; on the host they are complete."""
        numbers = range(len(self._kept.strips))
        if self._pool is None:
            yield from (self._strip(number, index, sinks, last) for number in numbers)
        else:
            for done in [
                self._pool.submit(self._strip, number, index, sinks, last) for number in numbers
            ]:
                yield done.result()

    def _strip(self, number: int, index: int, sinks: Sinks, last: bool) -> PendingStrip:
        strip, window = self._kept.strips[number], self._kept.strip(number)
        rows, inside = strip.rows, strip.inside
        frame = replace(self.first, window=window, index=index, _blocks={})
        found = {"photons"}
        if "photons" in sinks:
            sinks["photons"][rows] = self.light.photons.crop_rows(rows).total
        masks = dict[str, Array]()
        counted = self.counts is not None and index == self.first.index
        start = self._start(number, frame, last)
        for name, signal in signals(self.stages, start, frame, masks if counted else None):
            found.add(name)
            if name == "digital":
                require_kept(sinks, found)
                if not (last and self._own):
                    self._kept.keep(number, window)
                delivered = signal()
                if strip.around != rows:
                    delivered = window.backend.to_numpy(delivered, window)[inside]
                    masks = {
                        name: np.broadcast_to(mask, window.shape)[inside]
                        for name, mask in masks.items()
                    }
                return window.backend.pending(delivered, window, sinks[name][rows], masks)
            if name in sinks:
                sinks[name][rows] = window.backend.to_numpy(signal(), window)[inside]
        raise AssertionError("the last stage of a chain delivers digital numbers")

    def _start(self, number: int, frame: Frame, last: bool) -> Array:
        """Return the mean photoelectrons of a strip; a compiled backend keeps its arrays for the next frame."""
        if not frame.window.backend.compiled:
            return self.light.now().crop_rows(self._kept.strips[number].around).signal
        if number in self._starts:
            if last:
                return self._starts.pop(number)
            return self._starts[number]
        kept = bool(frame.window.cached_values)
        start = begin(
            self.stages,
            self.light.on_backend(self._kept.strips[number].around, frame),
            frame,
            kept,
        )
        if not last:
            self._starts[number] = start
        return start


def require_kept(asked: Iterable[str], found: Container[str]) -> None:
    """Raise InputError unless the chain has every signal that was asked for."""
    for name in asked:
        if name not in found:
            raise InputError(
                f"keep names {name!r}, but this chain does not separate photoelectrons and dark electrons, and its "
                "voltages have an offset; keep 'electrons', their sum, or 'volts'."
            )


def begin(stages: Chain, electrons: Array, frame: Frame, kept: bool = False) -> Array:
    """Return the mean photoelectrons for a compiled backend, after making FPN maps unless they are kept."""
    window = frame.window
    if not kept:
        # traced and discarded: this makes the maps
        sample(stages[1:], electrons, replace(frame, _blocks={}))
        window.backend.evaluate(window)
    return electrons


def signals(
    stages: Chain, start: Array, frame: Frame, masks: dict[str, Array] | None = None
) -> Iterator[tuple[str, Callable[[], Array]]]:
    """Yield name and getter of each signal of a frame, from the output of the first stage.

    masks : collects the masks of pixels that stages mark, by name.
    """
    signal = start
    for number, (stage, following) in enumerate(zip(stages, (*stages[1:], None), strict=True)):
        if number:
            signal = stage.sample(signal, frame)
        if masks is not None:
            masks |= stage.marked(total(signal), frame)
        if following is None or following.domain != stage.domain:
            yield from named(stage, signal, last=following is None)
        if following is stages[-1] and stage.domain == "volts":
            per_volt = frame.number(1 / math.prod(one.nominal_gain for one in stages[:-1]))
            yield INPUT_REFERRED, partial(operator.mul, per_volt, signal)


def named(stage: Stage, signal: Array, last: bool) -> Iterator[tuple[str, Callable[[], Array]]]:
    """Yield the signal after the last stage of a domain, by its names in ``expose(keep=…)``."""
    if last:
        yield "digital", lambda: signal
    elif stage.domain != "photons":
        if isinstance(signal, Electrons):
            yield "photoelectrons", lambda: signal.light
            yield "dark_electrons", lambda: signal.dark
        yield stage.domain, lambda: total(signal)
