"""Hostile texts through the service: each ends in a clear message or the right answer, within 5 s, and writes nothing.

    python benchmarks/gauntlet_http.py [--texts 10000] [--seed 1]

A server of its own runs in a process of its own. Texts are made from studies by damaging them: bytes removed, repeated,
swapped or replaced by control characters, quotes, brackets, huge numbers, names that lead elsewhere; they go as studies
and files to /plans and /runs, as bodies that are no JSON, as parameters to /simulate, and as words of queries and
addresses. At the end the server still answers, as much as it did at the start, and no file stands outside of its folder.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request
from collections import Counter
from pathlib import Path

from tqdm import tqdm

MOST_SECONDS = 5.0
STUDIES = (
    '[study]\nname = "a"\n[base]\nmodel = "equilibrium"\n[factors.joint_angle_deg]\nvalues = [4, 8]\n',
    '[study]\nname = "b"\n[factors.torque_n_m]\nlow = 1\nhigh = 9\n[design]\nkind = "sobol"\nsamples = 8\n'
    '[analysis.sobol]\n[responses.r]\nformula = "max(thrust_rms)"\n',
    '[study]\nname = "c"\n[design]\nkind = "table"\ntable = "t.csv"\n[keep]\noutputs = ["thrust_rms"]\n',
    '[workflow]\nname = "d"\n[steps.one]\nkind = "study"\nstudy = "s.toml"\n[steps.two]\nkind = "effects"\ninputs = ["one"]\n',
)
PIECES = (
    "\0", "\x1b[2J", "\u202e", '"', '\\"' * 500, "'''", '"""', "[" * 500, "{" * 200, "]", "=", ".", "..", "/", "../" * 9,
    "/etc/passwd", "9" * 400, "-9" * 20, "1e400", "nan", "inf", "-inf", "1e308", "true", "[[a]]", "[a.b.c]", "#", "\n" * 300,
    "function = 'evil:f'", "=cmd|' /C calc'!A0", "%00", "%s%n", "${jndi:x}", "{{7*7}}", "<script>alert(1)</script>", "\ud83d",
    "é" * 300, "__import__('os')", "thrust_rms" * 300, "0x" + "f" * 300, "1_0" * 99, "1979-05-27T07:32:00Z",
)  # fmt: skip
PARAMETERS = ("joint_angle_deg", "torque_n_m", "needle_count", "model", "scene", "replicate", "cycles", "nowhere")


def damaged(text: str, chance: random.Random) -> str:
    """A text that was changed in a few places."""
    for _ in range(chance.randint(1, 4)):
        place = chance.randrange(len(text) + 1)
        end = min(len(text), place + chance.randrange(12))
        match chance.randrange(4):
            case 0:
                text = text[:place] + text[end:]
            case 1:
                text = text[:place] + text[place:end] * chance.choice((2, 50)) + text[end:]
            case _:
                text = text[:place] + chance.choice(PIECES) + text[end:]
    return text[:100_000]


def request_of(chance: random.Random, run: str) -> tuple[str, bytes | None]:
    """An address, and a body where it has one."""
    study = damaged(chance.choice(STUDIES), chance)
    key = "workflow" if "workflow" in study[:30] else "study"
    files = {"t.csv": damaged("torque_n_m\n1\n2\n", chance), "s.toml": damaged(STUDIES[0], chance)}
    match chance.randrange(8):
        case 0 | 1:
            return "/api/v1/plans", _json({key: study, "files": files, "timing": False})
        case 2:
            return "/parts/price", _json({key: study, "files": files, "timing": False})
        case 3:
            return "/parts/form", _json({"study": study})
        case 4:
            values = {
                chance.choice(PARAMETERS): chance.choice((*PIECES, 10**30, 1e300, None, [], {})) for _ in range(3)
            }
            return "/api/v1/simulate", _json({"model": "equilibrium"} | values)
        case 5:
            return "/api/v1/runs", damaged(json.dumps({key: study}), chance).encode("utf-8", "surrogatepass")
        case 6:
            words = [
                (chance.choice(("variable", "select", "where", "step")), damaged("order=3", chance)) for _ in range(4)
            ]
            return f"/api/v1/runs/{run}/query?{urllib.parse.urlencode(words, errors='surrogatepass')}"[:60_000], None
        case _:
            return "/" + urllib.parse.quote(damaged("api/v1/runs/x/report/", chance), errors="surrogatepass")[
                :60_000
            ], None


def _json(body: object) -> bytes:
    return json.dumps(body).encode()


def judged(status: int, text: bytes, seconds: float) -> str:
    """What is wrong with an answer; empty where nothing is."""
    if status >= 500:
        return f"status {status}"
    if seconds > MOST_SECONDS:
        return f"{seconds:.1f} s"
    if status >= 400 and text.startswith(b"{") and not all(each["message"] for each in json.loads(text)["errors"]):
        return "no message"
    return "a control character" if b"\x1b" in text else ""


def main() -> None:
    """Send the texts, and print what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--texts", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance, statuses, faults = random.Random(options.seed), Counter[int](), list[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "results"
        words = [
            sys.executable,
            "-m",
            "tripod_doe.cli",
            "serve",
            "--folder",
            str(folder),
            "--port",
            "0",
            "--workers",
            "0",
        ]
        server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        assert server.stdout is not None
        address, _, token = server.stdout.readline().strip().partition("/?token=")
        headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}

        def ask(path: str, body: bytes | None) -> tuple[int, bytes]:
            try:
                with urllib.request.urlopen(
                    urllib.request.Request(address + path, body, headers), timeout=120
                ) as answer:
                    return answer.status, answer.read()
            except urllib.error.HTTPError as error:
                with error:
                    return error.code, error.read()

        run = json.loads(ask("/api/v1/runs", _json({"study": STUDIES[0]}))[1])["id"]
        ask("/api/v1/plans", _json({"study": STUDIES[0], "timing": False}))
        for number in tqdm(range(options.texts)):
            path, body = request_of(chance, run)
            started = time.monotonic()
            status, text = ask(path, body)
            statuses[status] += 1
            if fault := judged(status, text, time.monotonic() - started):
                faults.append(f"{number}: {fault}: {path[:200]} {(body or b'')[:300]!r}")
            if status == 201:  # what can run is not what is looked at here
                ask(f"/api/v1/runs/{json.loads(text)['id']}/stop", b"{}")
        assert ask("/api/v1/health", None)[0] == 200
        server.terminate()
        server.wait(20)
        elsewhere = [path for path in Path(name).iterdir() if path != folder]
    print(*faults, *(f"written elsewhere: {path}" for path in elsewhere), sep="\n")
    print(f"{options.texts:,} texts: {dict(sorted(statuses.items()))}; {len(faults) + len(elsewhere)} faults")
    sys.exit(bool(faults or elsewhere))


if __name__ == "__main__":
    main()
