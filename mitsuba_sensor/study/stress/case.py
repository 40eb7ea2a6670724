"""What the stress study compares: numbers of an engine with those that must come, and refusals with their sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from ... import Camera, Exposure, Frames, InputError, Stage, expose, load_camera
from ...core import Array, Electrons, Float64Array, Frame, SensorWindow
from ...core.llvm import backend_problem, drjit
from ...files.texts import read_toml
from ...sensor.run import choose_backend
from ...sensor.stage import sample, total

SIGMAS = 5.0  # standard errors that averages may be off: chance exceeds it in 6 of 10 million normal values
RARE = 5.0  # counts more than a mean far below one explains: chance makes as many in one of a million cases
TENTH = Exposure(0.1)
NAME = "konnik_table1"
CASES = read_toml(Path(__file__).with_name("cases.toml"))


class Got(NamedTuple):
    """What came, as text with numbers, and whether it is what must come."""

    text: str
    passed: bool


Rows = Iterator[tuple[str, str, str, Got]]  # cases of a theme on one engine: stage, input, what must come, what came


def holds(text: str, *conditions: object) -> Got:
    """What came as text, and whether all these hold."""
    return Got(text, all(map(bool, conditions)))


def agree(found: Array, exact: Array, allowed: Array = 0.0, unit: str = "", *also: object) -> Got:
    """Numbers, each within ``allowed`` (absolute) of what they must be; NaN is not. also : what must hold besides."""
    values, off = np.asarray(found, dtype=np.float64), np.abs(np.subtract(found, exact, dtype=np.float64))
    text = f"{values.min():.8g}" + (f" … {values.max():.8g}" if values.size > 1 else "")
    return holds(f"{text}{unit}, off by {off.max():.2g}", (off <= allowed).all(), *also)


def relative(found: Array, exact: Array, allowed: float, unit: str = "") -> Got:
    """Numbers, each within ``allowed`` of itself."""
    return agree(found, exact, allowed * np.abs(exact), unit)


def together(*answers: Got) -> Got:
    """Several answers as one."""
    return holds("; ".join(answer.text for answer in answers), *(answer.passed for answer in answers))


def refusal(part: str, *actions: Callable[[], object]) -> Got:
    """An InputError of each action, which says ``part`` in one sentence."""
    texts = ["nothing was refused"] * len(actions)
    for number, action in enumerate(actions):
        try:
            action()
        except InputError as error:
            texts[number] = str(error)
    return holds("; ".join(texts), *(part in text and "\n" not in text for text in texts))


def shown(x: object) -> str:
    """A number as people write it: 0.01, 300, 1e-9, 1e30; anything else as it is."""
    if not isinstance(x, float):
        return str(x)
    mantissa, e, power = (repr(x) if abs(x) < 1e6 else f"{x:g}").partition("e")
    return f"{mantissa}e{int(power)}" if e else mantissa.removesuffix(".0")


def table1(**changes: object) -> Camera:
    """The paper's camera. changes : of its datasheet, with ``__`` for the dot of a field."""
    return load_camera(NAME).replace(**{name.replace("__", "."): value for name, value in changes.items()})


def stage_of(label: str, **changes: object) -> Any:
    """The first stage of that camera whose label ends so, in small letters."""
    return next(stage for stage in table1(**changes).stages if stage.label.lower().endswith(label))


@dataclass(frozen=True)
class Engine:
    """Who computes. option : of ``expose``; of a renderer, its Mitsuba variant. compiler : of Dr.Jit, that it needs."""

    name: str
    option: Any
    precision: Literal["float32", "float64"] = "float32"
    compiler: str = "scalar"

    @property
    def problem(self) -> str | None:
        """Why it is not on this machine, or None."""
        return None if self.compiler == "scalar" else backend_problem(self.compiler)

    @property
    def unit(self) -> float:
        """Its unit roundoff."""
        return float(np.finfo(self.precision).eps) / 2

    def frame(self, shape: tuple[int, ...], exposure: Exposure = TENTH) -> Frame:
        """A frame (H, W) that this engine computes."""
        backend = choose_backend(self.option, self.precision, 0)
        return Frame(exposure, SensorWindow(7, (shape[0], shape[1]), backend=backend), 5)

    def through(self, values: Array, *stages: Stage, electrons: bool = False, exposure: Exposure = TENTH) -> Array:
        """Numbers (H, W) behind some stages. electrons : whether they enter as photoelectrons, else as volts."""
        frame = self.frame(np.shape(values), exposure)
        start = frame.window.backend.from_numpy(np.asarray(values, dtype=np.float64), frame.window)
        return to_numpy([sample(stages, Electrons(start) if electrons else start, frame)], frame)[0]

    def expose(self, light: Array, camera: Camera, exposure: Exposure = TENTH, **more: Any) -> Frames:
        """A whole frame of it."""
        return expose(light, camera, exposure, engine=self.option, precision=self.precision, **more)


def to_numpy(signals: list[Array], frame: Frame) -> list[Float64Array]:
    """Signals as NumPy arrays (H, W); a compiled backend runs one kernel for all of them."""
    window, arrays = frame.window, [total(signal) for signal in signals]
    if window.backend.compiled:
        drjit().eval([x for x in arrays if not np.isscalar(x)])
    return [np.asarray(window.backend.to_numpy(x, window), dtype=np.float64) for x in arrays]


NO_ENGINE = Engine("no engine", "")  # for formulas of single numbers, and what is refused before any pixel
SCALAR = Engine("Mitsuba scalar", "scalar_spectral")
ENGINES = (
    *(Engine("NumPy float64", "numpy", "float64"), Engine("NumPy float32", "numpy")),
    *(Engine("LLVM float32", "drjit", compiler="llvm"), Engine("CUDA float32", "cuda", compiler="cuda")),
)
RENDERERS = (SCALAR, *(Engine(f"Mitsuba {x.upper()}", f"{x}_ad_spectral", compiler=x) for x in ("llvm", "cuda")))
