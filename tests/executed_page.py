"""Pages of the documentation as programs: their blocks are executed in order, and what they print is compared.

A block of the language `bash` holds commands `tripod-doe ...` and `python FILE`, one of `python` is executed in a
namespace that the page shares, and one of `text` right below either is what a terminal shows: lines of three dots stand for
any lines, three dots in a line for any part of it. Numbers agree within 2 %, two units of their last digit, or 1e-4 of
the largest number in their line, since models may change their last digits; all else must be the same. A block after the words "as `FILE`:" is written to that
file, and a block of the language `diff` after "in `FILE`:" changes it. `<!-- exit code N -->` above a block of commands is the exit code of its last one, 0 if omitted; the same comment with
`not executed` leaves a block out. Lines on the first compilation of kernels, and on the progress of a slow
machine, do not count.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import re
import runpy
import shlex
from dataclasses import dataclass
from pathlib import Path

from tripod_doe.cli import main

ROOT = Path(__file__).parent.parent
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_FILE = re.compile(r"(?:as|in)\s+`([\w./-]+)`[^`]*:\s*$")
_MARK = re.compile(r"<!-- (exit code (\d+)|not executed) -->\s*$")
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?")
_WAITING = re.compile(
    r"compiling kernels of |compiled in \d+ s$|.* is compiling kernels, once for all|[\d,]+ of [\d,]+ \w+ \(\d+ %\) after "
)
_NEAR = 0.02
_LAST_DIGITS = 2.001
_OF_LARGEST = 1e-4
_COUNTS = 20


@dataclass
class Block:
    """One block of a page, with what the page says of it."""

    language: str
    text: str
    line: int
    file: str = ""  # written to this file, or changes it
    code: int = 0  # expected exit code
    executed: bool = True
    shown: str | None = None  # what the page says that it prints


def blocks_of(page: Path) -> list[Block]:
    """The blocks of a page in their order; each takes a block of text right below as its output."""
    text, blocks, end = page.read_text(encoding="utf-8"), [], 0
    for fence in _FENCE.finditer(text):
        before, end = text[end : fence.start()], fence.end()
        if fence[1] == "text" and blocks and not before.strip():
            blocks[-1].shown = fence[2]
            continue
        mark, named = _MARK.search(before), _FILE.search(_MARK.sub("", before).rstrip())
        block = Block(fence[1], fence[2], text.count("\n", 0, fence.start()) + 1, named[1] if named else "")
        if mark:
            block.executed, block.code = mark[1] != "not executed", int(mark[2] or 0)
        blocks.append(block)
    return blocks


def execute_page(page: Path) -> None:
    """Execute a page in the current folder; an error says which line of the page is wrong, and what was printed."""
    namespace: dict = {"__name__": "__main__"}
    for block in blocks_of(page):
        if block.file:
            _write(block, page)
        elif block.language in ("bash", "python") and block.executed:
            printed = _commands(block, page) if block.language == "bash" else _python(block, page, namespace)
            if block.shown is not None and (wrong := difference(block.shown, printed)):
                raise AssertionError(f"{page.name}:{block.line}: {wrong}; it prints\n{printed}")


def _write(block: Block, page: Path) -> None:
    path, text = Path(block.file), block.text
    if block.language == "diff":
        lines, text = text.splitlines(keepends=True), path.read_text(encoding="utf-8")
        before, after = ("".join(line[1:] for line in lines if line[0] in signs) for signs in (" -", " +"))
        assert text.count(before) == 1, f"{page.name}:{block.line}: not once in {path}:\n{before}"
        text = text.replace(before, after)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _commands(block: Block, page: Path) -> str:
    printed = io.StringIO()
    *earlier, last = block.text.replace("\\\n", " ").strip().splitlines()
    for line, expected in [*zip(earlier, itertools.repeat(0)), (last, block.code)]:
        program, *words = shlex.split(line, comments=True)
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            if program == "tripod-doe":
                try:
                    code = main(words)
                except SystemExit as ended:  # --help and --version
                    code = ended.code
            else:
                assert program == "python", f"{page.name}:{block.line}: not a command of a page: {line}"
                code = 0
                runpy.run_path(words[0], run_name="__main__")
        assert code == expected, f"{page.name}:{block.line}: exit code {code}: {line}\n{printed.getvalue()}"
    return printed.getvalue()


def _python(block: Block, page: Path, namespace: dict) -> str:
    printed = io.StringIO()
    code = compile("\n" * block.line + block.text, str(page), "exec")
    with contextlib.redirect_stdout(printed):
        exec(code, namespace)
    return printed.getvalue()


def difference(shown: str, printed: str) -> str:
    """The first line of a page that was not printed; empty if all were."""
    lines = [line.rstrip() for line in printed.replace("\r", "\n").splitlines() if not _WAITING.match(line)]
    at, skips = 0, False
    for line in (line.rstrip() for line in shown.splitlines()):
        if line == "...":
            skips = True
            continue
        there = range(at, len(lines)) if skips else range(at, min(at + 1, len(lines)))
        found = next((place for place in there if same_line(line, lines[place])), None)
        if found is None:
            return f"shown, but not printed there: {line!r}"
        at, skips = found + 1, False
    return "" if skips or at == len(lines) else f"printed, but not shown: {lines[at]!r}"


def same_line(shown: str, printed: str) -> bool:
    """Whether both lines have the same words and nearly the same numbers."""
    pattern = r"\s+".join(_pattern(word) for word in shown.split())
    match = re.fullmatch(pattern, printed.strip())
    if match is None:
        return False
    numbers = _NUMBER.findall(shown)
    largest = max((abs(_value(number)) for number in numbers), default=0.0)
    return all(near(*pair, largest) for pair in zip(numbers, match.groups(), strict=True))


def _pattern(word: str) -> str:
    """A word as a pattern in which each number is a group."""
    parts, end = [], 0
    for number in _NUMBER.finditer(word):
        parts += [_any(word[end : number.start()]), r"([-+]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?)"]
        end = number.end()
    return "".join([*parts, _any(word[end:])])


def _any(text: str) -> str:
    return re.escape(text).replace(re.escape("..."), ".*?")


def near(shown: str, printed: str, largest: float = 0.0) -> bool:
    """Whether two numbers agree, in a line whose largest number is given; whole numbers below 20 are exact."""
    digits = shown.partition("e")[0].partition(".")[2]
    power = int(shown.partition("e")[2] or 0)
    value, other = _value(shown), _value(printed)
    if not digits and not power:
        return abs(value - other) <= (max(1.0, _NEAR * abs(value)) if abs(value) >= _COUNTS else 0.0)
    unit = 10.0 ** (power - len(digits))
    return abs(value - other) <= max(_NEAR * abs(value), _LAST_DIGITS * unit, _OF_LARGEST * largest)


def _value(number: str) -> float:
    return float(number.replace(",", ""))
