"""Names of the sensors of a scene, which are names of folders too: the id, or the number from 0."""

from __future__ import annotations

import re

ALL_SENSORS = "all"
"""Asks for a frame of every sensor of a scene."""

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,63}")
"""An id that can be the name of a folder and is no number."""


def sensor_name(given_id: str, number: int) -> str:
    """The id of a sensor, or its number where it has none that can be the name of a folder."""
    if NAME.fullmatch(given_id) and given_id != ALL_SENSORS:
        return given_id
    return str(number)
