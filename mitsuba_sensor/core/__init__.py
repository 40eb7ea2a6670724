"""What every stage is computed with: units, signals, arrays, random numbers, backends, frames, errors.

The names of __init__.pyi are loaded when they are first used, so that the command line begins without NumPy.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
