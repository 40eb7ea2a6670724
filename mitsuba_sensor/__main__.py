"""The program mitsuba-sensor, or ``python -m mitsuba_sensor``."""

import sys

from . import __version__
from .stopping import stop_at_signals


def main() -> None:
    """Run the command line, which signals can stop even during imports."""
    stop_at_signals()
    from .files.output_pipe import outlast_readers

    outlast_readers()
    if sys.argv[1:] == ["--version"]:  # without loading the command line
        sys.stdout.write(f"mitsuba-sensor {__version__}\n")
        return
    from .cli import app

    app(prog_name="mitsuba-sensor")


if __name__ == "__main__":
    main()
