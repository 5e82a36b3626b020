"""`python -m cableway`: the same as the `cableway` command."""

import sys

from cableway.cli import main

if __name__ == "__main__":
    sys.exit(main())
