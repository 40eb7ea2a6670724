"""mitsuba-sensor: the words of the library on the command line. The only room that prints."""

from . import rendering, frames, plans, studies, lint, catalogue  # noqa: F401, I001  each hangs its commands on the app, in the order of --help
from .app import app

__all__ = ["app"]
