"""The twin of a camera from its bias, dark and flat frames: figures with intervals, a camera file, and maps."""

from .fit import Twin, fit

__all__ = ["Twin", "fit"]
