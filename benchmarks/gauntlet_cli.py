"""Hostile texts through files and the command line: each ends in a clear message or the right answer, and soon.

    python benchmarks/gauntlet_cli.py [--texts 10000] [--seed 1]

The texts are those of gauntlet_http.py. They stand in study and workflow files, tables, records and cubes, and in flags;
every command reads them, in this process, as `tripod-doe` does. A fault is an exit code other than 0, 2 and 3, a
traceback, a control character on the terminal, more than 5 s of CPU time, or a file outside of the directory named.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import random
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from gauntlet_http import MOST_SECONDS, PARAMETERS, PIECES, STUDIES, damaged
from tqdm import tqdm

from tripod_doe.cli.main import main as tripod_doe

CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
RECORD = "rotation_deg,thrust_n\n" + "".join(f"{angle},{angle % 7}\n" for angle in range(0, 721, 10))


def slightly(text: str, chance: random.Random) -> str:
    """The text as it is, cut, with one character altered, or damaged."""
    place = chance.randrange(len(text))
    return chance.choice(
        (text, text[:place], text[:place] + chance.choice('0-e.,;=\n"*') + text[place + 1 :], damaged(text, chance))
    )


def words_of(chance: random.Random, folder: Path, finished: Path) -> list[str]:
    """A call of the command line; the files that it reads are written into the folder."""
    study = slightly(chance.choice(STUDIES), chance)
    texts = {
        "study.toml": study,
        "t.csv": slightly("torque_n_m\n1\n2\n", chance),
        "s.toml": damaged(STUDIES[0], chance),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", errors="surrogatepass")
    file = str(folder / "study.toml")
    match chance.randrange(8):
        case 0 | 1 | 2:
            return ["plan", file, "--no-timing"]
        case 3:
            values = ((chance.choice(PARAMETERS), chance.choice(("4", chance.choice(PIECES)))) for _ in range(2))
            flags = (f"--{name.replace('_', '-')}={value}" for name, value in values)
            return ["simulate", "--model=equilibrium", *flags]
        case 4:
            flag, good = chance.choice(
                (("variable", "thrust_rms"), ("select", "joint_angle_deg=4"), ("where", "joint_angle_deg > 4"))
            )
            words = ["query", str(finished / "cube.nc"), f"--{flag}={slightly(good, chance)}"]
            return words if flag == "variable" else [*words, "--variable=thrust_rms"]
        case 5:
            record = folder / "record.csv"
            record.write_text(slightly(RECORD, chance), encoding="utf-8", errors="surrogatepass")
            return ["compare", str(finished), str(record), "--select=joint_angle_deg=4", f"--output={folder / 'out'}"]
        case 6:
            damaged_cube = bytearray((finished / "cube.nc").read_bytes())
            for _ in range(chance.randint(1, 3)):
                damaged_cube[chance.randrange(len(damaged_cube))] = chance.randrange(256)
            cube = folder / "cube.nc"
            cube.write_bytes(damaged_cube[: chance.choice((None, chance.randrange(len(damaged_cube))))])
            return ["query", str(cube), "--variable=thrust_rms"]
        case _:
            return ["check", file]


def fault_of(words: list[str]) -> tuple[int, str]:
    """Exit code of a call and what is wrong with it; empty where nothing is."""
    output, messages = io.StringIO(), io.StringIO()
    started = time.process_time()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(messages):
        try:
            code = tripod_doe(words)
        except SystemExit as ended:  # argparse
            code = ended.code if isinstance(ended.code, int) else 1
    seconds, said = time.process_time() - started, output.getvalue() + messages.getvalue()
    if code not in (0, 2, 3) or "Traceback" in said:
        return code, f"exit code {code}: {said[-500:]}"
    if code and not messages.getvalue().strip():
        return code, "no message"
    if seconds > MOST_SECONDS:
        return code, f"{seconds:.1f} s"
    return code, "a control character" if CONTROL.search(said) else ""


def main() -> None:
    """Make the calls, and print what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--texts", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance, codes, faults = random.Random(options.seed), Counter[tuple[str, int]](), list[str]()
    with tempfile.TemporaryDirectory() as name:
        folder, finished = Path(name) / "texts", Path(name) / "finished"
        (Path(name) / "study.toml").write_text(STUDIES[0])
        os.chdir(name)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            assert tripod_doe(["run", "study.toml", "--out", str(finished), "--workers", "0"]) == 0
        before = sorted(path for path in Path(name).rglob("*") if folder not in path.parents)
        for number in tqdm(range(options.texts)):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            words = words_of(chance, folder, finished)
            code, fault = fault_of(words)
            codes[words[0], code] += 1
            if fault:
                faults.append(f"{number}: {fault}: {words!r:.300} {(folder / 'study.toml').read_bytes()[:300]!r}")
        after = sorted(path for path in Path(name).rglob("*") if path != folder and folder not in path.parents)
        elsewhere = set(after) ^ (set(before) - {folder})
    print(*faults, *(f"written elsewhere: {path}" for path in elsewhere), sep="\n")
    print(f"{options.texts:,} texts: {dict(sorted(codes.items()))}; {len(faults) + len(elsewhere)} faults")
    sys.exit(bool(faults or elsewhere))


if __name__ == "__main__":
    main()
