"""Datasets in the files of other programs."""
