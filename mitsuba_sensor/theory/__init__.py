"""What the frames of a camera are expected to be.

``expected`` averages four samples of each pixel: two frames of each of two sensor units. ``report``, ``noise_budget``,
``plan`` and ``dynamic_range`` stand on it. ``clean`` has the mean and variance of each pixel of one sensor unit: in
closed form (stages/straight.py) or by the frames of a lattice (``lattice``). ``input_noise`` compares render noise with
them. ``stage_check`` looks at a stage that a user wrote.
"""
