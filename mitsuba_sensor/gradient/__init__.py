"""Derivatives of a frame with respect to light and camera.

gradient.py comes first: differentiable() returns frames whose codes have derivatives. law_slopes.py has the derivatives
of the law of a pixel, parameters.py the numbers of a camera as variables.
"""
