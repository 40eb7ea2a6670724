"""What the stress study compares: numbers with those that must come, refusals with their sentence, by engine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import mitsuba_sensor as ms

from ..kit import read_table

SIGMAS = 5.0
"""Standard errors that averages may be off: chance exceeds it in 6 of 10 million normal values."""

TENTH = ms.Exposure(0.1)
CASES = read_table(Path(__file__).with_name("cases.toml"))
SKY = Path(__file__).with_name("sky.xml")


class Got(NamedTuple):
    """What came, as text with numbers, and whether it is what must come."""

    text: str
    passed: bool


class Row(NamedTuple):
    """One case: what is looked at, the input, what must come, what came."""

    subject: str
    given: str
    expected: str
    got: Got


Rows = Iterator[Row]


def within(
    values: ArrayLike, exact: ArrayLike, allowed: ArrayLike = 0.0, unit: str = ""
) -> Got:
    """Numbers, each within ``allowed`` (absolute) of what they must be; NaN is not."""
    found = np.asarray(values, dtype=np.float64)
    off = np.abs(np.subtract(found, exact, dtype=np.float64))
    span = f"{found.min():.8g}" + (f" … {found.max():.8g}" if found.size > 1 else "")
    return Got(f"{span}{unit}, off by {off.max():.2g}", bool((off <= allowed).all()))


def together(*answers: Got) -> Got:
    """Several answers as one."""
    return Got(
        "; ".join(answer.text for answer in answers), all(answer.passed for answer in answers)
    )


def refusal(part: str, action: Callable[[], object]) -> Got:
    """The InputError of an action, which must say ``part`` in one sentence."""
    try:
        action()
    except ms.InputError as error:
        text = str(error)
        return Got(text, part in text and "\n" not in text)
    return Got("nothing was refused", False)


def table1(**changes: object) -> ms.Camera:
    """The paper's camera.  changes : of its datasheet, with ``__`` for the dot of a field."""
    changed = {name.replace("__", "."): value for name, value in changes.items()}
    return ms.load_camera("konnik_table1").replace(**changed)


@dataclass(frozen=True)
class Engine:
    """What computes.

    option : of ``expose``; of a renderer, which has no precision, its Mitsuba variant.
    """

    name: str
    option: Any = ""
    precision: Any = None

    def expose(
        self,
        light: ms.Photons | ArrayLike,
        camera: ms.Camera,
        exposure: ms.Exposure = TENTH,
        **more: Any,
    ) -> ms.Frames:
        """Frames of this engine."""
        return ms.expose(
            light, camera, exposure, engine=self.option, precision=self.precision, **more
        )

    def render(self, **options: Any) -> ms.Irradiance:
        """A render of the sky by this variant, one band about 550 nm."""
        asked = {"wavelength_nm": 550.0, "variant": self.option, "denoise": False, **options}
        return ms.render(SKY, table1(), TENTH, **asked)


@cache
def problem_of(engine: Engine) -> str | None:
    """What an engine says when it is asked for one pixel."""
    try:
        if engine.precision is not None:
            engine.expose(np.ones((1, 1)), table1())
        elif engine.option:
            engine.render(spp=1)
    except ms.InputError as error:
        return str(error)
    return None


NO_ENGINE = Engine("no engine")
"""For what is refused before any pixel is computed."""

ENGINES = tuple(Engine(*row) for row in CASES["engines"]["sensor"])
RENDERERS = tuple(Engine(*row) for row in CASES["engines"]["renderers"])
