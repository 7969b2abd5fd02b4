"""Makes the records of a stranger's rig: own names, ugly formats, a poor tachometer, a joint that nobody is told.

It shares no code with the package: the thrust comes from `td.simulate` in a process of its own, and everything else is
written here. The rig has a reversed force sensor with a preload and a drift, three recorders (a
German one with a header, decimal commas and Latin-1; one that writes UTF-16 and tabs; one with quotes and milliseconds),
and tachometers of 1, 6 and 60 pulses whose contacts bounce and miss.

Run as: python benchmarks/stranger_rig.py FOLDER [--model needles] [--records 15] [--seed 1] [--joint 1]
    python benchmarks/stranger_rig.py FOLDER --drawing 3 --records 6 --model rollers

--drawing draws a whole joint and its operating points, one kind a number (see `KINDS`), and writes fit.toml beside them.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import subprocess
import sys
from pathlib import Path

HIDDEN = {
    "groove_sliding_friction": 0.068,
    "needle_sliding_friction": 0.047,
    "initial_skew_1_deg": 0.45,
    "initial_skew_2_deg": -0.3,
}
DRAWING = {
    "needle_length_mm": 9.5,
    "bearing_radial_clearance_mm": 0.02,
    "roller_radius_mm": 15.5,
    "needle_axial_clearance_mm": 0.25,
}
POINTS = [
    (4, 180, 500), (5, 90, 900), (6, 240, 400), (6.5, 130, 700), (7, 300, 600), (8, 60, 1000), (8, 200, 300),
    (9, 150, 800), (10, 280, 500), (10.5, 110, 1100), (11, 220, 650), (12, 80, 450), (12.5, 170, 900), (13, 260, 350),
    (14, 140, 750),
]  # fmt: skip
MIDDLE = {
    "groove_sliding_friction": (0.045, 0.12),
    "needle_sliding_friction": (0.03, 0.08),
    "initial_skew_1_deg": (-0.6, 0.6),
    "initial_skew_2_deg": (-0.6, 0.6),
}
KINDS = {  # ranges of joint angle, torque, speed and skews
    1: ((5, 12), (80, 300), (400, 1000), 0.6),
    2: ((0.8, 4), (80, 300), (400, 1000), 0.6),  # small angles
    3: ((11, 17), (60, 200), (300, 800), 0.6),  # large angles
    4: ((4, 11), (-250, -60), (300, 900), 0.6),  # coast
    5: ((4, 12), (80, 300), (90, 200), 0.6),  # slow
    6: ((4, 10), (80, 300), (1500, 2600), 0.6),  # fast
    7: ((4, 12), (100, 400), (400, 1000), 1.5),  # strong skews
    8: ((5, 12), (15, 50), (400, 1000), 0.6),  # little torque
    9: ((3, 14), (50, 350), (100, 2000), 0.2),  # weak skews, wide ranges
    10: ((5, 9), (180, 220), (590, 610), 0.6),  # records that hardly differ
}
SECONDS = 2.6
COMPUTE = """import json, sys, tripod_doe as td
answers = [td.simulate(**point) for point in json.load(sys.stdin)]
json.dump([[one[f"thrust_{part}"].values.tolist() for part in ("amplitude", "phase_deg")] for one in answers], sys.stdout)
"""


def orders_of(model: str, points: list[tuple[float, float, float]]) -> list[list[tuple[float, float]]]:
    """Amplitude and phase of the orders of the hidden joint at each point."""
    names = ("joint_angle_deg", "torque_n_m", "speed_rpm")
    values = [{"model": model, **HIDDEN, **DRAWING, **dict(zip(names, point, strict=True))} for point in points]
    done = subprocess.run([sys.executable, "-c", COMPUTE], input=json.dumps(values).encode(), capture_output=True)
    if done.returncode:
        sys.exit(done.stderr.decode()[-2000:])
    return [list(zip(*answer, strict=True)) for answer in json.loads(done.stdout)]


def signals(orders, rpm, pulses, dice, rate):
    """Rows of time, force, tachometer, torque ripple, speed."""
    turns, gain, high, rows = dice.random(), 1.0, False, []
    bounce = -1
    skipped = False
    for sample in range(int(rate * SECONDS)):
        time = sample / rate
        speed = rpm * (1 + 0.004 * math.sin(2 * math.pi * 0.7 * time))
        before = turns
        turns += speed / 60 / rate
        if int(turns) > int(before):
            gain = 1 + 0.004 * dice.gauss(0, 1)
        phi = 2 * math.pi * turns
        force = gain * sum(a * math.cos(k * phi + math.radians(p)) for k, (a, p) in enumerate(orders))
        force += 0.02 * orders[3][0] * dice.gauss(0, 1) + 37 + 1.5 * time + 0.3 * math.sin(2 * math.pi * 50 * time)
        up = turns * pulses % 1 < 0.4
        if up and not high:
            skipped = dice.random() < 0.02
            bounce = sample + dice.choice((0, 0, 2, 3)) if rate * 60 / rpm / pulses > 40 else -1
        high = up
        level = 5.0 if up and not skipped and sample != bounce else 0.1
        rows.append((time, -force, level + 0.05 * dice.gauss(0, 1), speed))
    return rows


def number(value: float, digits: int, comma: bool) -> str:
    text = f"{value:.{digits}f}"
    return text.replace(".", ",") if comma else text


def german(path: Path, point, rows, dice) -> None:
    lines = [
        "Prüfstand 4;Gelenkprüfung", "Prüfer;Müller", f"Beugewinkel;{number(point[0], 1, True)};°",
        f"Drehmoment [Nm];{number(point[1], 0, True)}", "", "Messzeit;Axialkraft Gehäuse;Drehzahlgeber;Öltemperatur;Bemerkung",
        "s;kN;V;°C;",
    ]  # fmt: skip
    for time, force, tacho, _ in rows:
        lost = dice.random() < 0.001
        lines.append(";".join([number(time, 5, True), "-" if lost else number(force / 1000, 7, True), number(tacho, 2, True),
                               number(61 + time, 1, True), ""]))  # fmt: skip
    path.write_bytes("\r\n".join([*lines, ""]).encode("latin-1"))


def tabbed(path: Path, point, rows, dice) -> None:
    lines = ["Recorder XR-7", "Channels: 5", "Time\tAxial force\tTacho\tDrive torque\tPressure", "s\tN\tV\tNm\tbar"]
    for time, force, tacho, _ in rows:
        torque = point[1] * (1 + 0.01 * dice.gauss(0, 1))
        lines.append(f"{time:.5f}\t{force:.4f}\t{tacho:.2f}\t{torque:.2f}\t2.1")
    path.write_bytes("\n".join([*lines, ""]).encode("utf-16"))


def quoted(path: Path, point, rows, dice) -> None:
    lines = ["# made by logger 2.3", '"t (ms)","F_ax (N)","Speed pulse","Speed (1/min)"']
    for time, force, tacho, speed in rows:
        lines.append(f'"{1000 * time:.2f}","{force:.4f}","{tacho:.2f}","{speed:.1f}"')
    path.write_text("\n".join([*lines, ""]), encoding="utf-8-sig")


def hide(joint: int) -> None:
    """Draw another hidden joint by its number, and write it on standard output."""
    dice = random.Random(f"joint {joint}")
    HIDDEN.update({name: round(dice.uniform(low, high), 4) for name, (low, high) in MIDDLE.items()})
    print(json.dumps(HIDDEN))


def draw(kind: int, records: int, variant: str) -> str:
    """Draw a joint of other geometry with its operating points; the text of a fit file with what its drawing states."""
    dice = random.Random(f"drawing {kind}{variant}")
    angles, torques, speeds, skew = KINDS[kind]
    pitch = round(dice.uniform(17, 30), 1)
    count, bearing = dice.randint(20, 33), round(0.82 * pitch, 2)
    roller = round(0.76 * pitch, 1)
    DRAWING.update(
        pitch_radius_mm=pitch, roller_radius_mm=roller, roller_width_mm=round(0.69 * roller, 1),
        needle_count=count, needle_pitch_diameter_mm=bearing, needle_diameter_mm=round(math.pi * bearing / count - 0.012, 3),
        needle_length_mm=round(0.6 * roller, 1), bearing_radial_clearance_mm=round(dice.uniform(0.01, 0.03), 3),
        needle_axial_clearance_mm=round(dice.uniform(0.15, 0.4), 2),
    )  # fmt: skip
    hidden = {**MIDDLE, "initial_skew_1_deg": (-skew, skew), "initial_skew_2_deg": (-skew, skew)}
    HIDDEN.update({name: round(dice.uniform(low, high), 4) for name, (low, high) in hidden.items()})
    POINTS[:] = [
        (round(dice.uniform(*angles), 1), round(dice.uniform(*torques)), round(dice.uniform(*speeds)))
        for _ in range(records)
    ]
    print(json.dumps(HIDDEN))
    bounds = {"groove_sliding_friction": (0.02, 0.15), "needle_sliding_friction": (0.01, 0.1)}
    bounds |= dict.fromkeys(
        ("initial_skew_1_deg", "initial_skew_2_deg"), (-2 if skew > 1 else -1, 2 if skew > 1 else 1)
    )
    lines = [
        "[fit]",
        f'name = "Joint {kind} of a stranger"',
        "[base]",
        *(f"{name} = {value}" for name, value in DRAWING.items()),
    ]
    lines += [f"[unknowns.{name}]\nlow = {low}\nhigh = {high}" for name, (low, high) in bounds.items()]
    return "\n".join(
        [
            *lines,
            "[records]",
            'files = ["Lauf *"]',
            'pattern = "Lauf * {joint_angle_deg}grad {torque_n_m}Nm.*"',
            "sign = -1",
            "",
        ]
    )


def make(folder: Path, model: str, records: int, seed: int, rate: float = 5000.0) -> None:
    """Write the records; one at whose point the hidden joint has no answer is left out, and named."""
    dice = random.Random(seed)
    folder.mkdir(parents=True, exist_ok=True)
    points = POINTS[:records]
    for at, (point, orders) in enumerate(zip(points, orders_of(model, points), strict=True)):
        if not all(math.isfinite(value) for order in orders for value in order):
            print(f"no record {at + 1}: {model} has no answer at {point}", file=sys.stderr)
            continue
        write, end, pulses = [(german, "asc", 1), (tabbed, "txt", 6), (quoted, "csv", 60)][at % 3]
        angle = f"{point[0]:g}".replace(".", "p")
        rows = signals(orders, point[2], pulses, dice, rate)
        write(folder / f"Lauf {at + 1:02d} {angle}grad {point[1]}Nm.{end}", point, rows, dice)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--model", default="needles")
    parser.add_argument("--records", type=int, default=15)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=5000.0, help="samples a second")
    parser.add_argument("--joint", type=int, help="another hidden joint, drawn by this number and printed")
    parser.add_argument("--drawing", type=int, choices=KINDS, help="another joint with its fit file")
    parser.add_argument("--variant", default="", help="any text, for another joint of the same kind")
    given = parser.parse_args()
    if given.joint is not None:
        hide(given.joint)
    if given.drawing is not None:
        given.folder.mkdir(parents=True, exist_ok=True)
        (given.folder / "fit.toml").write_text(draw(given.drawing, given.records, given.variant))
    make(given.folder, given.model, given.records, given.seed, given.rate)
