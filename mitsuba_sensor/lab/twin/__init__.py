"""The twin of a camera from its own bias, dark and flat frames: figures with intervals, a camera file, maps."""

from .fit import Twin, fit

__all__ = ["Twin", "fit"]
