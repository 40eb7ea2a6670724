"""Denoised photoelectrons and their error bars.

denoise.py filters two halves of a render and weights the result by its estimated error, network.py calls Intel Open
Image Denoise, and guides.py traces the auxiliary images for it.
"""
