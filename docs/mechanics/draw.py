#!/usr/bin/env python3
"""Draws the mechanics as SVG, in mm: `python3 docs/mechanics/draw.py --gap 1.4 > mine.svg`.

The defaults are those of the sensor model (crates/simulation/src/sensor_model/parameters.rs), so that what
`shellcal synth` says holds for what is drawn.
"""

import argparse

#: Board from above: place of each photointerrupter, and what its reflector is tilted about.
CHANNELS = [(18, 15, ""), (-18, 15, ""), (-18, -15, ""), (18, -15, ""), (0, 20, "y"), (0, -20, "y"),
            (20, 0, "x"), (-20, 0, "x")]
SCALE = 6.0


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    for name, default, what in [
        ("gap", 1.2, "between photointerrupter and reflector at rest"),
        ("travel", 0.5, "of the plate each way, before it meets the stops"),
        ("tilt", 30.0, "of the tilted reflectors, degrees"),
        ("board", 56.0, "edge of the board"),
        ("springs-x", 25.0, "of the springs from the middle"),
        ("springs-y", 20.0, "of the springs from the middle"),
        ("spring-height", 6.0, "of a spring at rest"),
        ("plate", 1.6, "thickness of the reflector plate"),
    ]:
        parser.add_argument(f"--{name}", type=float, default=default, metavar="MM", help=f"{what} [{default}]")
    return parser.parse_args()


def rect(x, y, width, height, style):
    return (f'<rect x="{x * SCALE:.1f}" y="{y * SCALE:.1f}" width="{width * SCALE:.1f}"'
            f' height="{height * SCALE:.1f}" {style}/>')


def line(points, style='stroke="#333" fill="none"'):
    path = " ".join(f"{x * SCALE:.1f},{y * SCALE:.1f}" for x, y in points)
    return f'<polyline points="{path}" {style}/>'


def text(x, y, words, anchor="middle"):
    return f'<text x="{x * SCALE:.1f}" y="{y * SCALE:.1f}" text-anchor="{anchor}">{words}</text>'


def spring(x, top, bottom, turns=4):
    step = (bottom - top) / (2 * turns)
    points = [(x + (1 if i % 2 else -1), top + i * step) for i in range(1, 2 * turns)]
    return line([(x, top), *points, (x, bottom)])


def from_above(a, x, y):
    half = a.board / 2
    parts = [rect(x - half, y - half, a.board, a.board, 'fill="#e8f0e8" stroke="#333"')]
    for number, (cx, cy, about) in enumerate(CHANNELS, 1):
        parts.append(rect(x + cx - 1.6, y - cy - 1.35, 3.2, 2.7, 'fill="#456" stroke="none"'))
        parts.append(text(x + cx, y - cy - 2, f"{number}{' tilt ' + about if about else ''}"))
    for sx in (-1, 1):
        for sy in (-1, 1):
            place = f'cx="{(x + sx * a.springs_x) * SCALE:.1f}" cy="{(y + sy * a.springs_y) * SCALE:.1f}"'
            parts.append(f'<circle {place} r="{1.5 * SCALE:.1f}" fill="none" stroke="#a33"/>')
    parts.append(text(x, y + half + 4, f"board {a.board:g} × {a.board:g}; springs at ±{a.springs_x:g}, ±{a.springs_y:g}"))
    parts.append(line([(x, y), (x + 8, y)], 'stroke="#06c" fill="none"') + text(x + 9.5, y + 0.7, "x"))
    parts.append(line([(x, y), (x, y - 8)], 'stroke="#06c" fill="none"') + text(x, y - 8.7, "y"))
    return parts


def from_the_side(a, x, y):
    half, sensor = a.board / 2, 1.1
    top = y - sensor - a.gap - a.plate
    parts = [rect(x - half, y, a.board, 1.6, 'fill="#e8f0e8" stroke="#333"')]
    parts.append(rect(x - half - 6, top, a.board + 12, a.plate, 'fill="#ddd" stroke="#333"'))
    for cx, _, about in [CHANNELS[0], CHANNELS[1], CHANNELS[4]]:
        parts.append(rect(x + cx - 1.6, y - sensor, 3.2, sensor, 'fill="#456" stroke="none"'))
        turn = f' transform="rotate({-a.tilt if about else 0}' \
               f' {(x + cx) * SCALE:.1f} {(top + a.plate) * SCALE:.1f})"'
        parts.append(rect(x + cx - 1.5, top + a.plate - 0.1, 3, 0.2, f'fill="#c80" stroke="none"{turn}'))
    base = top + a.spring_height
    for sx in (-1, 1):
        parts.append(spring(x + sx * (a.springs_x + 3), top + a.plate, base))
        parts.append(rect(x + sx * (a.springs_x + 3) - 2, base, 4, 0.8, 'fill="#999" stroke="none"'))
    shell = [(x - half - 6, top), (x - half, top - 9), (x + half, top - 9), (x + half + 6, top)]
    parts.append(line(shell, 'stroke="#333" fill="none" stroke-width="2"'))
    parts.append(text(x, top - 10, "shell, glued or screwed to the plate"))
    notes = [f"gap at rest {a.gap:g} ± 0.1", f"stops at ±{a.travel:g} of travel", f"reflectors tilted by {a.tilt:g}° ± 1°",
             f"springs {a.spring_height:g} at rest, all four alike to 2 %", "plate flat to 0.05; nothing else touches it"]
    parts += [text(x - half - 6, y + 6 + 3.2 * i, note, "start") for i, note in enumerate(notes)]
    return parts


def main():
    a = arguments()
    width, height = a.board + 24, 2 * a.board + 52
    drawn = from_above(a, width / 2, a.board / 2 + 4) + from_the_side(a, width / 2, a.board + 32)
    print(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width * SCALE:.0f} {height * SCALE:.0f}"'
          ' font-family="sans-serif" font-size="12">')
    print(f'<rect width="100%" height="100%" fill="white"/>\n{chr(10).join(drawn)}\n</svg>')


if __name__ == "__main__":
    main()
