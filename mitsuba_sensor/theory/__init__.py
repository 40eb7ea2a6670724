"""Expected mean and noise of frames.

``expected`` averages four samples of each pixel: two frames of each of two sensor units. ``report``, ``noise_budget``
and ``plan`` use these averages. ``clean`` computes mean and variance of each pixel of one sensor unit: in closed form
(stages/straight.py) or by the frames of a lattice (``lattice``). ``input_noise`` compares render noise with them.
``stage_check`` tests a user's stage.
"""
