"""Look at recordings in the browser: python inspect_data.py data/ (see --help)."""

import sys

from pilot.commands.inspect_data import main

if __name__ == "__main__":
    sys.exit(main())
