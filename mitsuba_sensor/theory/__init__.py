"""What the frames of a camera are expected to be.

``expected`` averages four samples of each pixel: two frames of each of two sensor units. ``report``, ``noise_budget``,
``plan`` with ``plan_trial``, and ``dynamic_range`` stand on it. ``clean`` has the mean and variance of each pixel of
one sensor unit: in closed form (``straight``) or by the frames of a lattice (``lattice``). ``input_noise`` compares
render noise with them, ``stage_check`` the ``moments`` of a stage with its samples.
"""
