"""Denoised photoelectrons: fewer samples for the same noise, with error bars that still hold.

denoise.py comes first: it filters two independent halves of a render behind each colour filter. network.py is Open
Image Denoise, guides.py are the auxiliary images it looks at, combine.py weighs what it returns against the render, and
filter_bands.py makes spectral bands agree with the result.
"""
