"""Datasets in the files of other programs: calibrations, instance masks, tar shards, and a card of what they hold."""
