"""Draw the constraint types of the solver config as SVG, for docs/reference/solver.md.

python scripts/constraint_drawings.py            # writes docs/images/constraints/*.svg
"""

from __future__ import annotations

import math
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "docs/images/constraints"
WIDTH, HEIGHT = 220, 130
TOOL, OBJECT, ALLOWED = "#00796b", "#c2410c", "#94a3b8"

Point = tuple[float, float]


def arrow(start: Point, end: Point, color: str) -> str:
    """Return an arrow as SVG; points are pixels, y downwards."""
    angle = math.atan2(end[1] - start[1], end[0] - start[0])
    wings = [(end[0] - 9 * math.cos(angle + side), end[1] - 9 * math.sin(angle + side)) for side in (0.4, -0.4)]
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in (end, *wings))
    return f'{line(start, end, color)}<polygon points="{head}" fill="{color}"/>'


def line(start: Point, end: Point, color: str, dashed: bool = False) -> str:
    """Return a line as SVG."""
    dash = ' stroke-dasharray="4 3"' if dashed else ""
    (x1, y1), (x2, y2) = start, end
    return f'<line x1="{x1:g}" y1="{y1:g}" x2="{x2:g}" y2="{y2:g}" stroke="{color}" stroke-width="2"{dash}/>'


def dot(at: Point, color: str, text: str = "", dx: float = 8, dy: float = 4) -> str:
    """Return a keypoint with its name as SVG."""
    return f'<circle cx="{at[0]:g}" cy="{at[1]:g}" r="4" fill="{color}"/>{label(at[0] + dx, at[1] + dy, text, color)}'


def label(x: float, y: float, text: str, color: str = "#475569") -> str:
    """Return a text as SVG."""
    return f'<text x="{x:g}" y="{y:g}" fill="{color}" font-size="11" font-family="sans-serif">{text}</text>'


def cone(apex: Point, angle: float, half: float, length: float) -> str:
    """Return the sector of allowed directions as SVG; angles in degrees, 0 to the right, positive downwards."""
    ends = [
        (apex[0] + length * math.cos(a), apex[1] + length * math.sin(a))
        for a in map(math.radians, (angle - half, angle + half))
    ]
    (x1, y1), (x2, y2) = ends
    path = f"M{apex[0]:g},{apex[1]:g} L{x1:.1f},{y1:.1f} A{length:g},{length:g} 0 0 1 {x2:.1f},{y2:.1f} Z"
    return f'<path d="{path}" fill="{ALLOWED}" opacity="0.35"/>'


def _axis(orthogonal: bool, keypoints: bool) -> list[str]:
    tool = (40.0, 65.0)
    target = (140.0, 100.0), ((140.0, 30.0) if orthogonal else (205.0, 100.0))
    parts = [cone(tool, 0, 18, 75), arrow(tool, (108, 55 if not orthogonal else 72), TOOL)]
    parts += [dot(tool, TOOL, "axis_from", -32, -10), label(84, 88 if orthogonal else 46, "axis_to", TOOL)]
    parts.append(arrow(*target, OBJECT))
    if keypoints:
        parts += [dot(target[0], OBJECT, "target_axis_from", -58, 18), dot(target[1], OBJECT)]
        parts.append(label(150, target[1][1] - 8, "target_axis_to", OBJECT))
    else:
        parts.append(label(136, 118, "target_axis", OBJECT))
    return parts


def drawings() -> dict[str, str]:
    """Return the drawings by constraint type."""
    box = f'<rect x="92" y="38" width="52" height="52" fill="{ALLOWED}" opacity="0.35"/>'
    tool, target = (104.0, 52.0), (118.0, 64.0)
    found = {
        "point2point_constraint": [
            box,
            dot(tool, TOOL, "keypoint", -62, 0),
            dot(target, OBJECT, "target", 10, 8),
            label(88, 106, "± tolerance"),
        ],
        "frame_axis_parallel": _axis(False, False),
        "frame_axis_orthogonal": _axis(True, False),
        "keypoint_axis_parallel": _axis(False, True),
        "keypoint_axis_orthogonal": _axis(True, True),
        "point2point_cost": [
            line((50, 40), (165, 95), ALLOWED, dashed=True),
            dot((50, 40), TOOL, "keypoint", 8, -4),
            dot((165, 95), OBJECT, "target", -14, 20),
            label(112, 58, "weight · d²"),
        ],
        "point2plane_cost": [
            line((20, 95), (200, 95), OBJECT),
            arrow((60, 95), (60, 60), OBJECT),
            label(26, 54, "target_axis", OBJECT),
            dot((150, 35), TOOL, "keypoint", 8, 0),
            line((150, 35), (150, 95), ALLOWED, dashed=True),
            label(156, 70, "weight · d²"),
            dot((100, 95), OBJECT, "target", -12, 18),
        ],
    }
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}">'
    ground = f'<rect width="{WIDTH}" height="{HEIGHT}" rx="6" fill="#ffffff"/>'
    return {name: f"{head}\n{ground}\n" + "\n".join(parts) + "\n</svg>\n" for name, parts in found.items()}


if __name__ == "__main__":
    for name, text in drawings().items():
        (FOLDER / f"{name}.svg").write_text(text, encoding="utf-8")
