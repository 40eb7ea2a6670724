"""The render side of the work-precision diagrams: series of passes held against a reference."""
