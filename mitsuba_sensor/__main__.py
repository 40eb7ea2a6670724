"""The program mitsuba-sensor, also as ``python -m mitsuba_sensor``."""

import sys

from . import __version__
from .stopping import stop_at_signals


def main() -> None:
    """Run the command line. It can be stopped from here on, before anything else is imported."""
    stop_at_signals()
    from .files.output_pipe import outlast_readers

    outlast_readers()
    if sys.argv[1:] == ["--version"]:  # at once: the command line takes a while to load
        sys.stdout.write(f"mitsuba-sensor {__version__}\n")
        return
    from .cli import app

    app(prog_name="mitsuba-sensor")


if __name__ == "__main__":
    main()
