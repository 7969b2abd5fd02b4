"""Every sentence on a factor against the truth, on many random designs of all kinds.

    python benchmarks/sentences.py [--designs 100]

The tests check three designs of each kind (`tests/analyses/test_findings_hold.py`); this checks as many as wanted, and ends
at the first sentence that is not true.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tests" / "analyses"))
from test_findings_hold import KINDS, check_designs


def main(arguments: list[str] | None = None) -> None:
    """Check them, and print a line for each kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--designs", type=int, default=100, help="designs of each kind")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    options = parser.parse_args(arguments)
    for kind in options.kinds:
        check_designs(kind, range(options.designs))
        print(f"{kind}: no sentence of {options.designs} designs lies")


if __name__ == "__main__":
    main()
