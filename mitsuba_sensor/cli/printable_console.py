"""The terminal, on which control characters in text of files and names are shown escaped."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from ..core.printable import printable
from ..files.output_pipe import BROKEN_PIPE, silence_output


class PrintableConsole(Console):
    """A console whose styles are our own: control characters in the texts themselves are escaped."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Pieces of text with a style; those of a progress bar that move the cursor stay as they are."""
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else printable(text, keep="\n"), style, control)

    def on_broken_pipe(self) -> None:
        """Nobody reads any more."""
        silence_output()
        raise SystemExit(BROKEN_PIPE)
