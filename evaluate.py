"""How well does a model drive? python evaluate.py model.pt (see --help)."""

import sys

from pilot.commands.evaluate import main

if __name__ == "__main__":
    sys.exit(main())
