"""Instruments of automotive imaging (IEEE 2020): shares of pixels or frames, with 95 % intervals.

contrast.py measures how often pixels of two patches show their contrast, flicker.py what frames of a flickering light
show.
"""
