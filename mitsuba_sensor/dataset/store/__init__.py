"""The folder of a dataset: its entries, their records and names, shards of many samples; knows of no plan."""
