"""What does a run of the full model cost, with the third order asked for to 0.5 %, beside an older commit?

    python benchmarks/full_model.py [--against COMMIT] [--model needles|rollers] [--rounds 1]

Five points (`workload.POINTS`): the reference point with skews, three others at 12, 7 and 15 deg with uneven skews, and
a slow one at 18 deg. Both versions take turns, as in `regression.py`. Told are CPU seconds, force evaluations, both
orders, and the ratio of the prices. An older commit gets a compile cache of its own, which is filled first.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from regression import HERE, Version
from workload import POINTS


def turns(name: str, count: int, rounds: int, trees: dict[Path, str | None]) -> list[list[dict]]:
    """The turns of every version, which run one after the other."""
    versions = [Version(name, count, tree, cache) for tree, cache in trees.items()]
    for version in versions:
        version.answer()
    found = [[version.turn() for version in versions] for _ in range(rounds)]
    for version in versions:
        version.__exit__()
    return found


def tell(point: int, found: list[list[dict]]) -> float:
    """Print one point; the price of the first version over that of the last."""
    for name, one in zip(("here", "there"), found[-1], strict=False):
        second, third = one["orders"]
        evaluations = one["counted"]["force_evaluations"]
        print(
            f"point {point} {name:6s} {one['cpu_seconds']:6.2f} CPU-s, {evaluations:6d} evaluations, "
            f"tolerance {one['tolerance']:.2g}, second {second:.4f} N, third {third:.4f} N {one['detail']}",
            flush=True,
        )
    ratio = float(np.median([one[0]["cpu_seconds"] / one[-1]["cpu_seconds"] for one in found]))
    print(f"point {point} {ratio:.2f} of the price", flush=True)
    return ratio


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", metavar="COMMIT")
    parser.add_argument("--model", default="needles", choices=("needles", "rollers"))
    parser.add_argument("--rounds", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        trees: dict[Path, str | None] = {HERE.parent: None}
        if given.against:
            tree = Path(folder) / "tree"
            subprocess.run(
                ["git", "-C", HERE, "worktree", "add", "--quiet", "--detach", tree, given.against], check=True
            )
            trees[tree] = str(Path(folder) / "cache")
        try:
            ratios = [tell(k, turns(f"accurate-{given.model}", k, given.rounds, trees)) for k in range(len(POINTS))]
        finally:
            if given.against:
                subprocess.run(["git", "-C", HERE, "worktree", "remove", "--force", tree], check=True)
    print(f"all points: {np.exp(np.mean(np.log(ratios))):.2f} of the price")


if __name__ == "__main__":
    main()
