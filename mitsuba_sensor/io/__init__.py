"""What is kept: images, spectra and reports on disk."""
