"""Draw thruster layouts seen from above, as SVG in docs/images; `make docs` runs it and a test compares."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from hydro.core.geometry.layouts import laid_out
from hydro.core.vehicle.description import Thruster

IMAGES = Path(__file__).with_name("images")
LAYOUTS = {
    "bluerov2": "BlueROV2, ArduSub frame vectored",
    "bluerov2_heavy": "BlueROV2 heavy, ArduSub frame vectored_6dof",
}
SIDES = (1.0, 0.8, 0.4)
"""Box of the drawn hull: length, width, height."""
SCALE, WIDTH, HEIGHT = 260.0, 420, 430
"""Pixels per unit of the box, and size of the drawing."""
ARROW, RADIUS = 46.0, 15.0
"""Length of an arrow and radius of a thruster in pixels."""
STYLE = 'font-family="sans-serif" text-anchor="middle"'


def drawing(layout: str) -> str:
    """Return the drawing of a layout: x forward is up, y right is right.

    Arrows show the thrust of a positive command; a cross in a circle is a thrust down, away from the viewer.
    """
    return "\n".join([*_frame(layout), *_thrusters(layout), "</svg>", ""])


def _frame(layout: str) -> Iterator[str]:
    """Yield the head of the file, the hull's box, and the axes."""
    yield f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" {STYLE}>'
    yield f"<title>{LAYOUTS[layout]}, seen from above</title>"
    yield (
        '<defs><marker id="tip" markerWidth="8" markerHeight="8" refX="5" refY="3" orient="auto">'
        '<path d="M0,0 L6,3 L0,6 z" fill="#c0392b"/></marker></defs>'
    )
    yield f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>'
    yield f'<text x="{WIDTH / 2:g}" y="22" font-size="15">{LAYOUTS[layout]}</text>'
    left, top = _at(0.5 * SIDES[0], -0.5 * SIDES[1])
    size = f'width="{SCALE * SIDES[1]:g}" height="{SCALE * SIDES[0]:g}"'
    yield f'<rect x="{left:g}" y="{top:g}" {size} rx="14" fill="#eaf2f8" stroke="#5d6d7e"/>'
    yield f'<text x="{WIDTH / 2:g}" y="{top - 8:g}" font-size="13" fill="#5d6d7e">ahead (x)</text>'
    foot = "arrow: thrust of a positive command; cross: down, away from the viewer"
    yield f'<text x="{WIDTH / 2:g}" y="{HEIGHT - 14}" font-size="11" fill="#5d6d7e">{foot}</text>'


def _thrusters(layout: str) -> Iterator[str]:
    """Yield each thruster with its number and direction."""
    for number, thruster in enumerate(laid_out(layout, 1.0, SIDES), start=1):  # type: ignore[arg-type]
        yield from _thruster(number, thruster)


def _thruster(number: int, thruster: Thruster) -> Iterator[str]:
    """Yield one thruster: an arrow in the plane, or a circle with a cross for a thrust down."""
    assert thruster.position is not None
    assert thruster.direction is not None
    x, y = _at(*thruster.position[:2])
    ahead, right, down = thruster.direction
    if abs(down) < 0.5:
        tip = f'x2="{x + ARROW * right:.1f}" y2="{y - ARROW * ahead:.1f}"'
        yield (
            f'<line x1="{x:.1f}" y1="{y:.1f}" {tip} stroke="#c0392b" stroke-width="3" '
            'marker-end="url(#tip)"/>'
        )
    else:
        reach = RADIUS + 7.0
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{reach:g}" fill="#ffffff" stroke="#c0392b"/>'
        inner = reach * 0.7071
        for slope in (1.0, -1.0):
            yield (
                f'<line x1="{x - inner:.1f}" y1="{y - slope * inner:.1f}" x2="{x + inner:.1f}" '
                f'y2="{y + slope * inner:.1f}" stroke="#c0392b"/>'
            )
    yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{RADIUS:g}" fill="#ffffff" stroke="#34495e"/>'
    yield f'<text x="{x:.1f}" y="{y + 5:.1f}" font-size="14">{number}</text>'


def _at(x: float, y: float) -> tuple[float, float]:
    """Return the pixel of a point of the body."""
    return WIDTH / 2 + SCALE * y, HEIGHT / 2 - SCALE * x


def main() -> None:
    """Write all drawings."""
    for layout in LAYOUTS:
        (IMAGES / f"layout-{layout}.svg").write_text(drawing(layout))


if __name__ == "__main__":
    main()
