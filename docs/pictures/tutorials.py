"""Makes the pictures of docs/tutorials: sketches, and curves of the reference joint with their numbers inside.

python docs/pictures/tutorials.py docs/pictures
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.patches import Arc, FancyArrowPatch, FancyBboxPatch, Polygon, Rectangle

import tripod_doe as td
from tripod_doe.motion_page.drawing import joint_drawing
from tripod_doe.page_parts.charts.chart import COLOURS, INK, LINES, MUTED, Chart, drawing, legend_above

BLUE, ORANGE, GREEN, *_ = COLOURS


def plain(axes, wide, high):
    """Axes without ticks, one unit of data as long in both directions, with words of the size of the text."""
    axes.set_axis_off()
    axes.set_xlim(*wide)
    axes.set_ylim(*high)
    axes.set_aspect("equal")


def arrow(axes, start, end, colour, style="-|>", width=1.8):
    """An arrow between two points."""
    axes.add_patch(
        FancyArrowPatch(start, end, arrowstyle=style, mutation_scale=12, color=colour, lw=width, shrinkA=0, shrinkB=0)
    )


def words(axes, place, text, colour=INK, at="center", turned=0.0):
    """A few words at a point."""
    axes.text(*place, text, color=colour, ha=at, va="center", rotation=turned, rotation_mode="anchor")


def side_view() -> Chart:
    """The joint from the side, at an angle: why a roller moves along its groove once per revolution, to and fro."""
    theta, radius = np.radians(18), 1.0
    along, across = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
    with drawing(6.2, 3.0) as (figure, axes):
        plain(axes, (-3.0, 4.0), (-2.35, 2.35))
        axes.add_patch(Rectangle((-1.7, -1.9), 3.4, 3.8, fc="#eef3f8", ec="#8b96a3", lw=0.8))
        axes.add_patch(Rectangle((-2.9, -0.16), 1.2, 0.32, fc="#eef3f8", ec="#8b96a3", lw=0.8))
        for side in (1, -1):
            axes.add_patch(
                Rectangle((-1.5, side * radius - 0.78), 3.2, 1.56, fc="white", ec="#8b96a3", lw=0.8, ls="--")
            )
            place = side * across / np.cos(theta)
            corners = [place + s * 0.72 * along + t * 0.26 * across for s, t in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
            axes.add_patch(Polygon(corners, fc="#cfdeee", ec=BLUE, lw=1.2))
            axes.plot(*np.array([[0, 0], place]).T, color=INK, lw=5, solid_capstyle="round")
        axes.plot(*np.array([[0, 0], 3.6 * along]).T, color=INK, lw=5, solid_capstyle="round")
        axes.plot([-2.9, 3.9], [0, 0], color=MUTED, lw=0.8, ls="-.")
        axes.add_patch(Arc((0, 0), 4.6, 4.6, theta1=0, theta2=np.degrees(theta), color=ORANGE, lw=1.2))
        words(axes, (2.55, 0.38), "joint angle θ", ORANGE, "left")
        words(axes, (0.5, -2.12), "housing with its grooves", MUTED, "left")
        words(axes, (2.6, 1.2), "intermediate shaft with the spider", INK, "center", np.degrees(theta))
        for side in (1, -1):
            x = (side * across / np.cos(theta))[0]
            arrow(axes, (x, side * 2.0), (0, side * 2.0), BLUE, "<|-|>", 1.2)
        words(axes, (-0.42, 2.1), "R tan θ", BLUE, "right")
        arrow(axes, (-2.9, 0.75), (-2.1, 0.75), GREEN)
        words(axes, (-2.95, 1.02), "thrust, positive", GREEN, "left")
    caption = (
        "A tripod joint from the side at a joint angle: a roller stands ahead on one side and behind on the other."
    )
    data = pd.DataFrame({"joint_angle_deg": [18.0]})
    return Chart("joint_from_the_side", "The joint at an angle", caption, figure, data)


def slip() -> Chart:
    """The contact of a roller seen along the normal force: rolling, slip, and the part of friction along the groove."""
    beta = np.radians(25)
    rolling, axis = np.array([np.cos(beta), np.sin(beta)]), np.array([np.sin(beta), -np.cos(beta)])
    with drawing(6.2, 2.9) as (figure, axes):
        plain(axes, (-3.4, 3.6), (-1.75, 1.55))
        axes.add_patch(Rectangle((-3.3, -0.75), 6.8, 1.5, fc="#eef3f8", ec="#8b96a3", lw=0.8, ls="--"))
        corners = [s * 1.05 * rolling + t * 0.55 * axis for s, t in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        axes.add_patch(Polygon(corners, fc="#cfdeee", ec=BLUE, lw=1.2))
        speed = 2.6
        roll = speed * np.cos(beta) * rolling
        arrow(axes, (0, 0), (speed, 0), INK)
        arrow(axes, (0, 0), roll, BLUE)
        arrow(axes, roll, (speed, 0), ORANGE)
        arrow(axes, (0, 0), -1.35 * axis, GREEN)
        arrow(axes, (0, 0), (-1.35 * axis[0], 0), GREEN, width=2.6)
        axes.plot(*np.array([-1.35 * axis, [-1.35 * axis[0], 0]]).T, color=GREEN, lw=0.8, ls=":")
        axes.plot(*np.array([-1.45 * axis, 1.6 * axis]).T, color=MUTED, lw=0.8, ls="-.")
        words(axes, (3.45, -0.2), "speed along the groove, v", INK, "right")
        words(axes, (2.5, 1.2), "rolls: v cos β", BLUE, "left")
        words(axes, (2.72, 0.5), "slips: v sin β", ORANGE, "left")
        words(axes, (-0.75, 1.28), "friction μN", GREEN, "right")
        words(axes, (-3.25, 0.2), "μN sin β along the groove", GREEN, "left")
        words(axes, (0.75, -1.5), "axis of the trunnion", MUTED, "left")
        words(axes, (-3.25, -0.95), "groove, along the axis of the housing", MUTED, "left")
    caption = (
        "A roller in its groove, seen along the normal force: it can roll across its trunnion only, so a part of its "
        "speed is slip, and friction against it has a part along the groove."
    )
    return Chart("roller_slip", "Why a roller pushes", caption, figure, pd.DataFrame({"tilt_deg": [25.0]}))


def three_grooves() -> Chart:
    """The force in each groove over a revolution, and their sum."""
    joint = td.simulate()
    turned = joint["rotation_deg"].values[:360:6]
    data = pd.DataFrame({"rotation_deg": turned, "thrust_n": joint["thrust"].values[:360:6]})
    with drawing(6.2, 3.2) as (figure, axes):
        for groove in (1, 2, 3):
            force = joint["groove_thrust"].sel(groove=groove).values[:360:6]
            data[f"groove_{groove}_n"] = force
            axes.plot(turned, force, ls=LINES[groove], color=COLOURS[groove], lw=1.1, label=f"groove {groove}")
        axes.plot(turned, data["thrust_n"], color=BLUE, lw=2.2, label="sum")
        axes.set_xticks(range(0, 361, 60))
        axes.set_xlim(0, 360)
        axes.set_xlabel("rotation angle of the housing (deg)")
        axes.set_ylabel("axial force on the housing (N)")
        legend_above(axes, 4)
    caption = "Axial force of each groove of the reference joint over a revolution, and their sum, the thrust force."
    return Chart("three_grooves", "Three grooves and their sum", caption, figure, data)


def skewed_needle() -> Chart:
    """Needles of a trunnion unrolled: the friction of a skewed one turns the roller."""
    psi = np.radians(14)
    along, across = np.array([np.cos(psi), np.sin(psi)]), np.array([-np.sin(psi), np.cos(psi)])
    with drawing(6.2, 2.7) as (figure, axes):
        plain(axes, (-3.4, 3.6), (-1.55, 1.5))
        for place in (-1.05, 1.05):
            axes.add_patch(
                FancyBboxPatch((-2.0, place - 0.22), 4.0, 0.44, "round,pad=0.02", fc="#eef3f8", ec="#8b96a3", lw=0.8)
            )
        corners = [s * 2.0 * along + t * 0.22 * across for s, t in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        axes.add_patch(Polygon(corners, fc="#f6d9c9", ec=ORANGE, lw=1.2))
        axes.plot([-2.6, 2.6], [0, 0], color=MUTED, lw=0.8, ls="-.")
        axes.add_patch(Arc((0, 0), 4.3, 4.3, theta1=0, theta2=np.degrees(psi), color=ORANGE, lw=1.2))
        words(axes, (2.2, 0.27), "skew ψ", ORANGE, "left")
        tip = 1.55 * along
        arrow(axes, (0, 0), tip, GREEN)
        arrow(axes, (tip[0], 0), tip, GREEN, width=2.6)
        words(axes, (1.3, 0.62), "friction of the needle", GREEN, "right")
        words(axes, (1.1, -0.42), "its part around the trunnion turns the roller", GREEN)
        arrow(axes, (-3.2, -0.45), (-2.3, -0.45), INK, "<|-|>")
        words(axes, (-2.75, -0.7), "plunging", INK)
        words(axes, (-3.3, 0.12), "axis of the trunnion", MUTED, "left")
    caption = "Needles of a trunnion, unrolled: friction acts along a needle, so a skewed one turns its roller."
    return Chart("skewed_needle", "What a skewed needle does", caption, figure, pd.DataFrame({"skew_deg": [14.0]}))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (folder / "joint_to_scale.svg").write_text(joint_drawing({}) + "\n", encoding="utf-8")
    for chart in (side_view(), slip(), three_grooves(), skewed_needle()):
        text = f"{chart.svg().removesuffix('</svg>')}<!--\n{chart.csv()}-->\n</svg>\n"
        (folder / f"{chart.name}.svg").write_text(text, encoding="utf-8")
