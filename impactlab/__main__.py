"""The command line, ``python -m impactlab``."""

import sys

from impactlab.command_line.main import main

if __name__ == "__main__":
    sys.exit(main())
