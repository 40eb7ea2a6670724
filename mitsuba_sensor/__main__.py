"""The program mitsuba-sensor, also as ``python -m mitsuba_sensor``."""

from .stopping import stop_at_signals


def main() -> None:
    """Run the command line. It can be stopped from here on, before anything else is imported."""
    stop_at_signals()
    from .cli import app

    app(prog_name="mitsuba-sensor")


if __name__ == "__main__":
    main()
