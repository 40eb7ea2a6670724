"""The command line mitsuba-sensor: flags in, files and tables out; the only package that prints."""

from . import commands, catalogue, laboratory, twins, datasets, studies  # noqa: F401, I001  each adds its commands, as in --help
from .app import app

__all__ = ["app"]
