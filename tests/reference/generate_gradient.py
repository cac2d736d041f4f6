#!/usr/bin/env python3
"""Reference derivatives of ln A and H by 1/gamma, p, lambda and shift: differences of direct integrals.

    python3 generate_gradient.py      write gradient.csv beside this file (about ten minutes)

A and H(a) = a Lambda(a) come from generate.py, whose integrals agree to 1e-23, and know nothing of derivatives. Differences of
fourth order and more, with steps of 1e-4 and less of the distance to the border of the domain, are then good to 1e-12. At
gamma = inf and at shift = 0 they are one-sided.
"""

import csv
import sys
from pathlib import Path

from generate import FIRST, PRINTED_DIGITS, Shape
from mpmath import mp, mpf

mp.dps = 40

# gamma, p, lambda, shift. Each line says what it is for.
SHAPES = [
    ("2", "1", "0", "0"),  # GGX's point
    ("inf", "1", "0", "0"),  # Beckmann's
    ("1.7", "1", "0.25", "0.5"),
    ("2.3", "1.4", "0.3", "0.5"),
    ("6.5", "0.3", "-0.4", "0.75"),  # a cusp
    ("inf", "0.5", "0.5", "1.25"),  # a corner, infinite gamma
    ("1.52", "1", "0", "0.125"),  # 2 p gamma - 3 = 0.04
    ("1.25", "12", "-0.5", "2"),  # a box with a power tail
    ("40", "2.5", "0.9", "8"),  # a skewed ring
    ("5000", "0.75", "0", "0"),  # almost infinite gamma
]
ARGUMENTS = ["0.05", "0.5", "1.5", "6"]
# points of a difference in units of its step
CENTRAL = [-2, -1, 1, 2]
FORWARD = [0, 1, 2, 3, 4]


def weights(points):
    """Of the first derivative at 0, exact for polynomials."""
    n = len(points)
    powers = mp.matrix(n, n)
    for k in range(n):
        for j, x in enumerate(points):
            powers[k, j] = mpf(x) ** k
    right = mp.matrix(n, 1)
    right[1] = 1
    return list(mp.lu_solve(powers, right))


def values(theta, arguments):
    """ln A and H at each argument, for 1/gamma, p, lambda and shift."""
    inverse, p, lam, shift = theta
    gamma = mp.inf if inverse == 0 else 1 / inverse
    shape = Shape(gamma, p, lam, shift, read=mpf)
    whole, _, _ = shape.distribution(FIRST, [])
    return [-mp.log(2 * whole)] + [shape.masking(FIRST, a) / (mp.pi * whole) for a in arguments]


def step(theta, k):
    """Step and points for parameter `k`."""
    inverse, p, lam, shift = theta
    # 2 p gamma > 3
    room = [2 * p / 3 - inverse, p - 3 * inverse / 2, 1 - abs(lam), mpf(1)][k]
    if k == 0 and inverse == 0:
        return mpf("1e-5") * room, FORWARD
    if k == 3 and shift == 0:
        # the first terms that differences do not see are those in shift^(1 + 2p)
        return mpf("1e-10"), FORWARD
    size = [inverse, p, mpf(1), shift][k]
    return mpf("1e-4") * min(room, size), CENTRAL


def main():
    arguments = [mpf(float(a)) for a in ARGUMENTS]
    rows = []
    for n, texts in enumerate(SHAPES):
        gamma, p, lam, shift = (mpf(float(t)) for t in texts)
        theta = [mpf(0) if mp.isinf(gamma) else 1 / gamma, p, lam, shift]
        for k, name in enumerate(["inverse_gamma", "p", "lambda", "shift"]):
            h, points = step(theta, k)
            total = [mpf(0)] * (1 + len(arguments))
            for x, weight in zip(points, weights(points)):
                moved = [t + (h * x if j == k else 0) for j, t in enumerate(theta)]
                total = [t + weight / h * v for t, v in zip(total, values(moved, arguments))]
            for what, value in zip(["ln A"] + ARGUMENTS, total):
                quantity, argument = ("ln A", "") if what == "ln A" else ("H", what)
                rows.append([*texts, name, quantity, argument, mp.nstr(value, PRINTED_DIGITS)])
            print(f"\r{n + 1} of {len(SHAPES)} shapes, by {name}    ", end="", file=sys.stderr)
    path = Path(__file__).with_name("gradient.csv")
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["gamma", "p", "lambda", "shift", "by", "quantity", "argument", "value"])
        writer.writerows(rows)
    print(f"\n{len(rows)} rows", file=sys.stderr)


if __name__ == "__main__":
    main()
