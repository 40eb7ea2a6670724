"""The subject of a check, and its result: level, place in the file, fact and remedy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...camera.camera import Camera
from ...core import Doubt, Float64Array
from ...optics.intrinsics import View
from ..scene.parsed_scene import ParsedScene
from ..variants import MitsubaObject, mitsuba
from .spectra import Property, Range, light_range, properties_of

ORDER = ("black", "wrong", "note", "fact")
NAMED_MAX = 4  # lines or parameters named in one finding
TOLERANCE_NM = 1e-3


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    level : "black", radiance is missing; "wrong", a value means something else than expected; "note"; or "fact", which
        changes nothing in a frame and is not among the notes of a render.
    where : lines in the scene file.  what : fact and consequence.  remedy : what to do, or what was done.
    data_nm : wavelengths with data, if the finding is that data end; else None.
    beyond : assumption about the scene at other wavelengths.
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
        """Return True if something is black or wrong."""
        return self.level in ("black", "wrong")

    @property
    def as_note(self) -> str:
        """Sentence among the notes of a render; a doubt if something is black or wrong."""
        return Doubt(self) if self.is_serious else str(self)

    def to_dict(self) -> dict[str, str]:
        """Return plain values, ready for JSON."""
        names = ("level", "where", "what", "remedy")
        return {name: getattr(self, name) for name in names}


Found: TypeAlias = Iterator[Finding]


@dataclass(frozen=True, eq=False)
class Subject:
    """A parsed scene, and the bands and camera that it is rendered for.

    band_nm : ends of all bands together.  unit_m : metres per scene unit; None if unknown.
    """

    scene: ParsedScene
    band_nm: Range
    camera: Camera | None
    unit_m: float | None

    @cached_property
    def properties(self) -> list[Property]:
        """The spectra of emitters, materials and media."""
        return properties_of(self.scene)

    @cached_property
    def lights(self) -> list[tuple[MitsubaObject, Range]]:
        """Each emitter, and the wavelengths at which it can shine."""
        nodes = enumerate(self.scene.state.nodes)
        return [
            (node, light_range(node, [one for one in self.properties if one.number == number]))
            for number, node in nodes
            if node.type == mitsuba().ObjectType.Emitter
        ]

    @property
    def is_dark(self) -> bool:
        """Return True if the scene has lights but none with a spectrum in the bands."""
        (low_nm, high_nm), lights = self.band_nm, self.lights
        return bool(lights) and not any(
            low < high_nm and high > low_nm for _, (low, high) in lights
        )

    def is_covered_by(self, data_nm: Range) -> bool:
        """Return True if the data cover all bands."""
        low_nm, high_nm = self.band_nm
        return data_nm[0] <= low_nm + TOLERANCE_NM and data_nm[1] >= high_nm - TOLERANCE_NM

    def beyond(self, data_nm: Range) -> str:
        """Return the extent of the bands, and how much the camera detects without data."""
        low_nm, high_nm = self.band_nm
        extent = f"the bands extend from {low_nm:g} to {high_nm:g} nm"
        if self.camera is None:
            return extent
        edges_nm = np.linspace(low_nm, high_nm, max(round(high_nm - low_nm), 1) + 1)
        nm = (edges_nm[1:] + edges_nm[:-1]) / 2
        photoelectrons = np.atleast_2d(self.camera.qe(nm)) * nm  # of a flat spectrum
        is_beyond = (nm < data_nm[0]) | (nm > data_nm[1])
        name, share = largest_share(self.camera, photoelectrons, is_beyond)
        return (
            f"{extent}, where the {name} pixels detect {100 * share:.1f} % of a flat spectrum"
        )

    def lines(self, nodes: Sequence[MitsubaObject]) -> str:
        """Return the lines of nodes in the scene file."""
        return lines_of(self.scene, nodes)


class Built(NamedTuple):
    """A scene built by Mitsuba.  world : its shapes and emitters.  view : through the lens of the camera."""

    world: MitsubaObject
    sensor: MitsubaObject
    integrator: MitsubaObject
    view: View


def most_serious_first(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings in the order black, wrong, note, fact."""
    return sorted(findings, key=lambda finding: ORDER.index(finding.level))


def lines_of(scene: ParsedScene, nodes: Sequence[MitsubaObject]) -> str:
    """Return ``line 3`` or ``lines 3, 9 and 4 more``; each look-up reads the file, so only a few are made."""
    named = list(dict.fromkeys(scene.where(node) for node in nodes[:NAMED_MAX]))
    more = f" and {len(nodes) - NAMED_MAX} more" if len(nodes) > NAMED_MAX else ""
    lines = [place.removeprefix("line ") for place in named if place.startswith("line ")]
    if len(lines) < len(named):  # of included files, or of a dict
        return f"{', '.join(named)}{more}"
    return f"line{'s' * (len(lines) > 1)} {', '.join(lines)}{more}"


def places(count: int, noun: str = "place") -> str:
    """Return ``1 place``, ``2 places``."""
    return f"{count} {noun}{'s' * (count > 1)}"


def largest_share(
    camera: Camera, electrons: Float64Array, is_beyond: NDArray[np.bool_]
) -> tuple[str, float]:
    """Return the filter with the largest fraction of its electrons, shape (F, B), in some bands, shape (B,), and that
    fraction."""
    total, beyond = electrons.sum(axis=1), electrons[:, is_beyond].sum(axis=1)
    shares = np.divide(beyond, total, out=np.zeros_like(total), where=total > 0)
    return camera.filter_names[int(np.argmax(shares))], float(shares.max())
