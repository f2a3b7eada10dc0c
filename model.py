"""Train a network to steer: python model.py --data RECORDING (see --help)."""

import sys

from pilot.commands.train import main

if __name__ == "__main__":
    sys.exit(main())
