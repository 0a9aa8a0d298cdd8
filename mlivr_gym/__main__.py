"""`python -m mlivr_gym` runs the command `mlivr-gym`."""

import sys

from mlivr_gym.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
