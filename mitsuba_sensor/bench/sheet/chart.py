"""What every chart of the sheet has: its light, its frames, its instrument, and theory beside."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from ...camera.camera import Camera
from ...files.texts import Facts
from ...lab.frames.bench import Bench
from ...lab.quantity import Quantity
from ..datasheet import Said
from .light import ChartLight, ChartScene
from .setting import Setting

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Theory = Mapping[str, Mapping[str, Said]]
"""By the name of the colour filter, then by the symbol of the figure."""
Lights = Sequence[ChartLight]


@dataclass(frozen=True, eq=False)
class Taken:
    """Frames of a chart.

    bench : scenes are pictures of the chart, darks and flats are as the instrument asks.
    facts : what is known of the chart, as in ``chart.toml`` beside the frames of a real camera.
    """

    bench: Bench
    facts: Facts = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Measured:
    """What an instrument found behind one colour filter.

    figures : its quantities.  drawings : what to draw, by title.  refused : sentences of what could not be measured.
    """

    filter_name: str
    figures: Sequence[Quantity]
    drawings: Mapping[str, Callable[[Axes], object]] = field(default_factory=dict)
    refused: Sequence[str] = ()


class Chart(Protocol):
    """A chart of the sheet.

    name : of the folder of its frames; frames of a real camera are in folders whose names begin with ``kind``.
    title : above its part of the page.
    """

    @property
    def name(self) -> str: ...

    @property
    def kind(self) -> str: ...

    @property
    def title(self) -> str: ...

    def suits(self, camera: Camera) -> bool:
        """Whether the chart shows anything of this camera."""

    def scenes(self, camera: Camera) -> list[ChartScene]:
        """What is to be rendered for this camera."""

    def take(self, setting: Setting, lights: Lights) -> Taken:
        """Frames of the chart; lights : of its scenes, in their order."""

    def theory(self, setting: Setting, lights: Lights) -> Theory:
        """Figures in closed form, those that there are."""

    def draw_theory(self, said: Mapping[str, Said], ax: Axes) -> None:
        """Add the figures of theory to a drawing of what was measured, where they can be drawn."""

    def measure(self, taken: Taken) -> Sequence[Measured]:
        """What the instrument finds, of a simulated camera as of a real one."""
