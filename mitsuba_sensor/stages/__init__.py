"""The signal chain: from photons to digital numbers; each effect is a stage in a file.

stage.py is what all stages are, chain.py their order. effects/ has a file for each: its fields in a camera file, what
it does to a frame, its fixed patterns. datasheet.py and usual_range.py are the types and ranges of such fields,
gains.py the factors from electrons to codes. straight.py is the law of the code of each pixel of a straight chain. The
other modules are distributions and models that effects share.
"""

from ..core import Array as Array
from ..core import Electrons as Electrons
from ..core import Frame as Frame
