"""The built-in simulator: by hand, recorded, or driven by drive.py (see --help)."""

import sys

from pilot.commands.simulator import main

if __name__ == "__main__":
    sys.exit(main())
