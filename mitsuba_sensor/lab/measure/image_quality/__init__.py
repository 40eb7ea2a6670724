"""Instruments for image quality: images of charts in, quantities with 95 % intervals out.

slanted_edge.py measures the MTF of an edge: it finds the edge, removes uneven light, fits the edge spread
(edge_spread.py) and returns a curve with its error (modulation.py). siemens_star.py measures the MTF of a star,
dead_leaves.py of a texture, step_chart.py response, speed, noise and dynamic range of patches (patches.py).
"""
