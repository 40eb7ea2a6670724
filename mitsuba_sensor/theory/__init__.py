"""What the frames of a camera are expected to be.

``expected`` has averages over pixels, sensor units and frames, by samples; on it stand ``report``, ``noise_budget``,
``plan`` and ``dynamic_range``. ``clean`` has the mean and variance of every pixel of one sensor unit: in closed form for a
straight chain (``straight``), else by the frames of a lattice (``lattice``). ``input_noise`` follows from it.
"""
