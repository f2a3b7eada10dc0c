"""Make a clip of a recorded drive: python video.py run1 (see --help)."""

import sys

from pilot.commands.video import main

if __name__ == "__main__":
    sys.exit(main())
