"""The program mitsuba-sensor, also as ``python -m mitsuba_sensor``."""

import io
import sys

from .stopping import stop_at_signals


def main() -> None:
    """Run the command line. It can be stopped from here on, before anything else is imported."""
    stop_at_signals()
    if isinstance(sys.stdout, io.TextIOWrapper):  # of a terminal without × and µ
        sys.stdout.reconfigure(errors="replace")
    from .cli import app
    from .files.output_pipe import flush_output

    try:
        app(prog_name="mitsuba-sensor")
    finally:
        flush_output()


if __name__ == "__main__":
    main()
