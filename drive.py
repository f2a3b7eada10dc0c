"""Drive the simulator: python drive.py model.pt [run1] (see --help)."""

import sys

from pilot.commands.drive import main

if __name__ == "__main__":
    sys.exit(main())
