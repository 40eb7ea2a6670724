"""Derivatives of a frame with respect to light and camera.

gradient.py comes first: differentiable() returns frames whose codes have a slope. conditional_slope.py is that of the
converter, given the electrons; field_derivatives.py are those of the fields of a camera file.
"""
