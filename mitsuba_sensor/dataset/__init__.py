"""Data for training and evaluation: the noise of a camera on images that were made elsewhere."""
