"""A result of the check of a scene: how serious it is, where it is in the file, and what to do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ...core import Doubt
from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject

Range: TypeAlias = tuple[float, float]

ORDER = ("black", "wrong", "note", "fact")
NAMED_MAX = 4  # lines or parameters named in one finding


@dataclass(frozen=True)
class Finding:
    """One result of the check.

    level : "black", radiance that is missing; "wrong", a value with another meaning than expected;
        "note"; or "fact", which changes nothing in a frame and is no note of a render.
    where : lines in the scene file.  what : description.  remedy : what to do, or what was done.
    data_nm : the wavelengths for which there are data, where the finding is that they end; else None.
    beyond : what is true of the scene at other wavelengths.
    """

    level: Literal["black", "wrong", "note", "fact"]
    where: str
    what: str
    remedy: str
    data_nm: Range | None = None
    beyond: str = "data of the scene end"

    def __str__(self) -> str:
        return f"{self.what} ({self.where}); {self.remedy}"

    @property
    def is_serious(self) -> bool:
        """Whether something is black or wrong."""
        return self.level in ("black", "wrong")

    @property
    def as_note(self) -> str:
        """The sentence among the notes of a render: a doubt where something is black or wrong."""
        return Doubt(self) if self.is_serious else str(self)

    def to_dict(self) -> dict[str, str]:
        """Plain values, ready for JSON."""
        names = ("level", "where", "what", "remedy")
        return {name: getattr(self, name) for name in names}


def most_serious_first(findings: Iterable[Finding]) -> list[Finding]:
    """The findings, black before wrong before notes before facts."""
    return sorted(findings, key=lambda finding: ORDER.index(finding.level))


def lines_of(scene: ParsedScene, nodes: list[MitsubaObject]) -> str:
    """``line 3``, ``lines 3, 9 and 4 more``.

    A look-up reads the file, so only the named ones are looked up.
    """
    named = list(dict.fromkeys(scene.where(node) for node in nodes[:NAMED_MAX]))
    more = f" and {len(nodes) - NAMED_MAX} more" if len(nodes) > NAMED_MAX else ""
    lines = [place.removeprefix("line ") for place in named if place.startswith("line ")]
    if len(lines) < len(named):  # of included files, or of a dict
        return f"{', '.join(named)}{more}"
    return f"line{'s' * (len(lines) > 1)} {', '.join(lines)}{more}"


def places(count: int, noun: str = "place") -> str:
    """``1 place``, ``2 places``."""
    return f"{count} {noun}{'s' * (count > 1)}"
