"""Instruments for automotive imaging (IEEE 2020): probabilities with 95 % intervals.

contrast.py measures how often pixels of two patches show their contrast, flicker.py how a flickering light appears.
"""
