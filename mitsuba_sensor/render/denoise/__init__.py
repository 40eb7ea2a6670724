"""Denoised photoelectrons and their error bars.

denoise.py filters two halves of a render and takes as much of the result as they prove right, network.py calls Intel
Open Image Denoise, and guides.py traces the auxiliary images that it looks at.
"""
