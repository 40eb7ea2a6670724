"""What a dataset file asks for: its samples as a function of their numbers, and their splits."""
