"""The command line mitsuba-sensor: flags in, files and tables out; the only package that prints."""

from .app import app

__all__ = ["app"]
