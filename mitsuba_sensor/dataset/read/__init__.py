"""Samples for those who use them: opened, shown, drawn and listed."""
