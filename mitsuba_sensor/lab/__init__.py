"""Estimators: numbers in, quantities with intervals out; knows no simulator."""
