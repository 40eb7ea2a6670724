"""The sensor side of the work-precision diagrams: engines, precisions, samplers of the Poisson law, plans."""
