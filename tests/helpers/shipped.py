"""Shipped cameras by what their tests need of them."""

import mitsuba_sensor as ms

ONE_READOUT = [name for name in ms.list_cameras() if not ms.load_camera(name).readouts]
"""Those that read every pixel once: figures, plans, maps and gradients are of one read-out."""
