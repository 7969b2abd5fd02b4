"""Takes pictures of docs/tutorials out of the reports that the commands of the tutorials make, their numbers inside.

python docs/pictures/tutorial_reports.py docs/pictures

The tutorials run in a folder of their own; their tests hold the numbers in the pictures against the reports.
"""

import base64
import contextlib
import os
import re
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]

PICTURES = {
    "2_your_joint": {"tutorial_joint": ("my_joint.html", "")},
    "3_first_question": {
        "tutorial_angle": ("results/grease/report/index.html", "thrust_amplitude_order_3-joint_angle_deg"),
        "tutorial_shares": ("results/which_friction/report/index.html", "contribution-order-3"),
    },
    "4_from_records_to_frictions": {"tutorial_agreement": ("results/comparison/index.html", "agreement")},
    "5_from_tolerances_to_a_decision": {
        "tutorial_distribution": ("results/series/report/index.html", "tolerance-1"),
        "tutorial_waveforms": ("results/design/report/index.html", "waveforms"),
    },
}
"""Pictures of each tutorial: their names, the page, and the figure there by its name; the first one without a name."""


def numbers(page: Path, name: str) -> str:
    """The numbers of a figure of a report, as its link holds them."""
    text = page.read_text(encoding="utf-8")
    return base64.b64decode(re.search(rf'download="{name}\.csv" href="data:[^,]*;base64,([^"]*)"', text)[1]).decode()


def picture(page: Path, name: str) -> str:
    """A figure of a report as an SVG file with its numbers, or the first drawing of a page."""
    text = page.read_text(encoding="utf-8")
    if not name:
        return text[text.index("<svg") : text.index("</svg>")] + "</svg>\n"
    before = text.partition(f'download="{name}.csv"')[0]
    drawing = before[before.rindex("<svg") : before.rindex("</svg>")]
    return f"{drawing}<!--\n{numbers(page, name)}-->\n</svg>\n"


def make(folder: Path) -> None:
    """Run the tutorials, and write their pictures into a folder."""
    sys.path.insert(0, str(ROOT / "tests"))
    from executed_page import execute_page

    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        for tutorial, pictures in PICTURES.items():
            os.makedirs(tutorial)
            with contextlib.chdir(tutorial):
                execute_page(ROOT / "docs" / "tutorials" / f"{tutorial}.md")
                for file, place in pictures.items():
                    text = picture(Path(place[0]), place[1])
                    (folder / f"{file}.svg").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    make(Path(sys.argv[1]).absolute())
