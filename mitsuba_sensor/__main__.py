"""The command line, for ``python -m mitsuba_sensor``."""

from .cli import app

app(prog_name="mitsuba-sensor")
