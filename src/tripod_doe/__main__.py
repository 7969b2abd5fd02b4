"""`python -m tripod_doe` is the command `tripod-doe`."""

import sys

from tripod_doe.cli import main

if __name__ == "__main__":
    sys.exit(main())
