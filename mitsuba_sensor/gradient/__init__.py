"""Derivatives of a frame with respect to light and camera.

Start with gradient.py: differentiable() returns frames whose codes have derivatives. law_slopes.py differentiates the
mean and variance of pixels, parameters.py treats camera fields as variables.
"""
