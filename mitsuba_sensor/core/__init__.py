"""Foundations of all stages: units, signals, arrays, random numbers, backends, frames, errors.

The names in __init__.pyi are loaded on first use, so the command line starts without NumPy.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
