"""Effects: one file each, with its datasheet fields, its random sample, its theory and its fixed maps."""
