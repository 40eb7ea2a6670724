"""The signal chain from photons to digital numbers; each effect is a stage in a separate file.

stage.py defines a stage, chain.py the order of stages. effects/ has one file per effect: its fields in a camera file,
its ``sample``, its fixed patterns. datasheet.py and usual_range.py define types and ranges of these fields, gains.py
the factors from electrons to codes. straight.py computes the probability distribution of each pixel's code for a
straight chain. The other modules are distributions and models that effects share.
"""

from ..core import Array as Array
from ..core import Electrons as Electrons
from ..core import Frame as Frame
