"""The forces of the model by companion matrices in numpy, for comparison of run time and error.

The tip of a beam is at an intersection of a circle about its base with the ellipse. With t = tan(phi/2) that is a
quartic, whose roots are the eigenvalues of a 4 x 4 companion matrix. Every beam of the channel is solved at every
position; the forces are the paper's, with normals of unit length.

    python3 peer_companion.py WIDTH_M BEAMS PITCH_M FROM_M TO_M POSITIONS REPEATS

prints one JSON document: the forces at the positions and the seconds of every repeat, one by one with numpy.roots
and with all matrices in a single numpy.linalg.eigvals.
"""

import json
import sys
import time

import numpy as np

RX, RY, L, MU = 0.09, 0.05, 0.027, 0.53
KT = 5.3e9 * (0.03 * 0.00012**3 / 12) / L


def quartic(u, width):
    """Coefficients, highest first, of |P(t) - base|^2 = L^2 times (1 + t^2)^2, with P on the ellipse.

    u is the forward distance of the base from the body's middle: an array of any shape.
    """
    base = width / 2 + L
    u = np.asarray(u)
    # x = RX (1 - t^2)/(1 + t^2) - u, y = 2 RY t/(1 + t^2) - base
    a2, a0 = -RX - u, RX - u
    b2, b1, b0 = -base, 2 * RY, -base
    one = np.ones_like(u)
    return np.stack(
        [
            a2**2 + b2**2 - L**2,
            2 * b2 * b1 * one,
            2 * a2 * a0 + 2 * b2 * b0 + b1**2 - 2 * L**2,
            2 * b1 * b0 * one,
            a0**2 + b0**2 - L**2,
        ],
        axis=-1,
    )


def force(t, u):
    """F_x of the root that lies furthest forward; 0 if no root is deflected forward."""
    real = np.abs(t.imag) < 1e-9 * (1 + np.abs(t.real))
    x = np.where(real, RX * (1 - t.real**2) / (1 + t.real**2) - u[..., None], -np.inf)
    best = np.take_along_axis(t.real, x.argmax(-1)[..., None], -1)[..., 0]
    forward = x.max(-1)
    touching = forward >= 0
    phi = 2 * np.arctan(best)
    theta = np.arcsin(np.clip(np.where(touching, forward, 0) / L, -1, 1))
    norm = np.sqrt(RY**2 * np.cos(phi) ** 2 + RX**2 * np.sin(phi) ** 2)
    return -KT / L * theta * (RY * np.cos(phi) + MU * RX * np.sin(phi)) / norm * touching


def one_by_one(positions, bases, width):
    totals = []
    for x in positions:
        u = bases - x
        roots = np.array([np.roots(c) for c in quartic(u, width)])
        totals.append(2 * force(roots, u).sum())
    return np.array(totals)


def all_at_once(positions, bases, width):
    u = bases[None, :] - positions[:, None]
    c = quartic(u, width)
    companion = np.zeros(u.shape + (4, 4))
    companion[..., 0, :] = -c[..., 1:] / c[..., :1]
    companion[..., [1, 2, 3], [0, 1, 2]] = 1
    return 2 * force(np.linalg.eigvals(companion).astype(complex), u).sum(-1)


def main():
    width, beams, pitch, first, last, count, repeats = sys.argv[1:]
    bases = float(pitch) * np.arange(int(beams))
    positions = np.linspace(float(first), float(last), int(count))
    report = {}
    for solve in (one_by_one, all_at_once):
        solve(positions[:2], bases, float(width))
        seconds = []
        for _ in range(int(repeats)):
            start = time.perf_counter()
            totals = solve(positions, bases, float(width))
            seconds.append(time.perf_counter() - start)
        report[solve.__name__] = {"seconds": seconds, "totals": totals.tolist()}
    json.dump(report, sys.stdout)


if __name__ == "__main__":
    main()
