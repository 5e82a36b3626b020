"""The command line: one file per command, and the edge where time is read and people are spoken to."""

from cableway.cli.entry import main as main
