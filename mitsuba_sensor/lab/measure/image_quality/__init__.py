"""Instruments for image quality: pictures of charts in, quantities with 95 % intervals out.

slanted_edge.py measures the modulation transfer at an edge: it finds the edge, removes uneven light, fits the edge
spread (edge_spread.py) and returns a curve with its error (modulation.py).

siemens_star.py measures the same at a star, dead_leaves.py in a texture.

step_chart.py measures response, speed, noise and dynamic range from patches (patches.py).
"""
