"""Data sets of transitions on disk: a folder of checksummed shards and a manifest; docs/datasets.md has the format."""
