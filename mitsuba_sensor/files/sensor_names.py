"""Names of the sensors of a scene, which are also folder names: the id, or the number from 0."""

from __future__ import annotations

import re

ALL_SENSORS = "all"
"""Selects every sensor of a scene."""

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,63}")
"""An id that can name a folder and is not a number."""


def sensor_name(given_id: str, number: int) -> str:
    """Return the id of a sensor, or its number if the id cannot name a folder."""
    if NAME.fullmatch(given_id) and given_id != ALL_SENSORS:
        return given_id
    return str(number)
