"""What a dataset has: its index and what it is made from; verified, repaired, pushed to a store of objects."""
