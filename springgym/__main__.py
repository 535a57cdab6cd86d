"""``python -m springgym``: the command ``springgym``, for environments without scripts on the path."""

import sys

from springgym.cli import main

if __name__ == "__main__":
    sys.exit(main())
