"""``python -m tripod_doe.cli`` is ``tripod-doe``."""

import sys

from tripod_doe.cli.main import main

sys.exit(main())
