"""The parameters of <film type="photosensor"> and <sensor type="camera"> in the id of a film of Mitsuba.

The only data that a film of Mitsuba can carry is its id; what is built from the two elements can so be read again.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

from ..variants import MitsubaObject
from .plugin_names import OWN_PLUGINS

_, FILM, _ = OWN_PLUGINS


class PluginParameters(NamedTuple):
    """film : of the photosensor.  sensor : of the camera around it; None where there is none."""

    film: dict[str, Any]
    sensor: dict[str, Any] | None = None

    def id(self) -> str:
        """As the id of a film."""
        return f"{FILM} {json.dumps(self._asdict())}"


def parameters_of(film: MitsubaObject) -> PluginParameters | None:
    """Those of a film that a photosensor became; None of any other."""
    kind, _, text = film.id().partition(" ")
    return PluginParameters(**json.loads(text)) if kind == FILM and text else None
