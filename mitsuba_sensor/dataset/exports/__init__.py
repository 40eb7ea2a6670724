"""Exports of datasets to files for other programs."""
