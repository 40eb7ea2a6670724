"""Samples are made: counted beforehand, in this process, in workers of this machine or of a cluster."""
