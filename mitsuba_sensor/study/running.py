"""Run a study: what is measured already is read from files, what is found becomes a page, numbers and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.versions import machine, versions
from ..files.appearing import output_folder, require_folder, write_drawing
from ..files.texts import write_json, write_page
from ..output.measurements import Measurements
from ..pages.drawing import png
from ..pages.html_page import html
from ..pages.page import Study
from .kit import Kit, Progress

PAGE, NUMBERS, MEASUREMENTS = "study.html", "study.json", "measurements"


@dataclass(frozen=True)
class StudyFolder:
    """Where a study keeps its measurements and writes what it finds.

    question : all that decides what is measured.  about : what the page says of how it was made.
    records : classes that its measurements consist of.  every_picture : as a PNG file, not only the first.
    """

    folder: Path
    name: str
    question: Mapping[str, object]
    about: Mapping[str, object]
    records: tuple[type, ...] = ()
    every_picture: bool = False

    def measurements(self, force: bool = False) -> Measurements:
        """What is measured already.  force : nothing, it is measured again."""
        require_folder(self.folder)
        question = {
            "study": self.name,
            **self.question,
            "machine": machine(),
            "versions": versions(),
        }
        return Measurements(self.folder / MEASUREMENTS, question, force, self.records)

    def run(
        self,
        study: Callable[[Kit], Study],
        known: Measurements,
        progress: Progress | None = None,
    ) -> Study:
        """Measure what is not known and write everything; measurements stay where the rest is stopped."""
        resumed = len(known)
        kit = Kit(known, progress)
        outcome = study(kit)
        made = {"machine": machine(), "versions": versions(), "resumed_measurements": resumed}
        seconds = {"seconds": round(kit.seconds, 1), "longest_step": kit.longest_step}
        outcome = replace(outcome, data={**outcome.data, **self.about, **made, **seconds})
        self._write(outcome)
        return outcome

    @property
    def written(self) -> tuple[str, ...]:
        """Names of the files that people read; a ``*`` stands for any text."""
        return PAGE, NUMBERS, f"{self.name}*.png"

    def _write(self, outcome: Study) -> None:
        if self.every_picture:
            pictures = outcome.pictures
        else:
            pictures = outcome.pictures[:1]
        names = [f"{self.name}-{number}.png" for number in range(1, len(pictures) + 1)]
        names[:1] = [f"{self.name}.png"]
        with output_folder(self.folder, [PAGE, NUMBERS, *names]) as scratch:
            write_page(scratch / PAGE, html(outcome))
            write_json(scratch / NUMBERS, outcome.to_dict())
            for name, picture in zip(names, pictures, strict=False):
                write_drawing(scratch / name, png(picture))
