"""Export a model as an ONNX file: python export.py model.pt (see --help)."""

import sys

from pilot.commands.export import main

if __name__ == "__main__":
    sys.exit(main())
