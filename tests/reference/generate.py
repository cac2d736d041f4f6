#!/usr/bin/env python3
"""Reference values of the radial profile and of the masking function, by direct integration.

    python3 generate.py                     write profile.csv beside this file (ten minutes with gmpy2, more without)
    python3 generate.py --verify FILE.csv   compute the rows of FILE.csv anew and print the largest relative difference;
                                            with --decimal the inputs are the decimals themselves, not the binary64 numbers next to them

Nothing here is shared with the Rust core: no closed form and no special function stands behind the values, only
the definition of the profile and quadrature in WORKING_DIGITS digits.

    f(x) = (1 + u/(gamma-1))^(-gamma), exp(-u) for gamma = inf,   u = (|x-m|/c)^(2p),   c = 1 + lambda right of m, 1 - lambda left
    1/(2A) = int_0^inf x f(x) dx        cdf(x) = 2A int_0^x t f(t) dt        sf(x) = 2A int_x^inf t f(t) dt
    Lambda(a) = (2A/(pi a)) int_a^inf f(t) t [sqrt(t^2-a^2) - a acos(a/t)] dt

* Inputs are binary64 numbers, written as the shortest decimal that reads back to them, and enter the arithmetic exactly.
* Every piece is integrated by the double-exponential (tanh-sinh) rule, which does not mind the algebraic kink of |x-m|^(2p)
  at an end of a piece; convergence is relative, and the exponent range of mpmath is unbounded, so that a value of 1e-290 has
  as many digits as one of 1.
* Pieces end at the kink, at the arguments, and where -ln f passes certain levels. A power tail [R, inf) runs in v,
  x = R v^(-1/e), with e = 2 p gamma - 2 (or - 3 with the masking kernel): in v the integrand tends to a constant however
  close e is to zero.
* The whole is done twice with different levels, different R and different cuts of v; a row is written only if both agree
  to AGREEMENT. A, cdf and sf are then compared with incomplete beta and gamma functions, Lambda with its exact expression
  where there is one (p = 1 or p = 1/2 at zero shift).
"""

import argparse
import csv
import sys
import time
from pathlib import Path

from mpmath import mp, mpf

WORKING_DIGITS = 50
AGREEMENT = mpf("1e-19")  # between the two splittings; achieved values are printed at the end
CLOSED_FORM = mpf("1e-20")  # between quadrature and closed form
SMALLEST = mpf("1e-290")  # smaller values are not written: their binary64 neighborhood is coarse
NEGLIGIBLE = mpf("1e-320")  # a piece of less is not refined: f spans thousands of orders of magnitude left of a ring
PRINTED_DIGITS = 21
DROP = 120  # a piece whose integrand is below exp(-DROP) of the peak is left out

mp.dps = WORKING_DIGITS
INF = mp.inf

# gamma, p, lambda, shift. Each line says what it is for.
SHAPES = [
    # heaviest tails: 2 p gamma - 3 from 1e-3 upwards
    ("1.05", "1.5", "0", "0"),
    ("1.05", "1.4291", "-0.3", "0.1"),
    ("1.05", "30", "0.4", "0.5"),
    ("1.5005", "1", "0", "2"),
    ("1.502", "1", "0", "300"),
    ("6.002", "0.25", "0", "0"),
    ("6.002", "0.25", "0.6", "0.8"),
    ("3.2", "0.5", "0", "0"),
    ("1.35", "1.2", "-0.45", "0.25"),
    # sharp cusps, p < 1/2
    ("8", "0.25", "0", "0"),
    ("30", "0.25", "-0.5", "3"),
    ("1000", "0.25", "0", "0"),
    ("inf", "0.25", "0", "0"),
    ("inf", "0.25", "0.3", "10"),
    ("inf", "0.5", "0", "0"),
    ("inf", "0.5", "-0.7", "0.4"),
    # the skew at its limits
    ("1.2", "1.3", "0.999", "0.3"),
    ("1.8", "1", "-0.999", "0.6"),
    ("2", "1", "0.999", "0"),
    ("2", "1", "-0.999", "4"),
    ("inf", "1", "0.999", "0.2"),
    ("inf", "1", "-0.999", "0.2"),
    ("inf", "10", "0.999", "3"),
    # neighbors of a simpler node of the family
    ("2", "1", "0", "1e-8"),
    ("2.5", "1", "0.2", "1e-5"),
    ("2", "1", "1e-9", "0.5"),
    ("2", "1.000001", "0", "0.5"),
    ("2.25", "1", "0", "0"),
    # gamma towards infinity
    ("100", "0.8", "0", "0.05"),
    ("10000", "1", "0", "0.3"),
    ("1e8", "1", "0", "0"),
    ("1e10", "2", "-0.4", "1.2"),
    ("1e12", "1", "0", "0"),
    ("1e12", "0.25", "0.1", "0.7"),
    ("1e12", "50", "0", "1"),
    # boxes
    ("inf", "50", "0", "0"),
    ("inf", "50", "0.5", "1.3"),
    ("1.7", "50", "-0.9", "0.4"),
    ("1.35", "12", "0.1", "0"),
    ("15", "7", "-0.25", "6"),
    # rings
    ("4", "50", "0.2", "1000"),
    ("1.6", "1", "0.5", "1000"),
    ("inf", "1", "-0.9", "1000"),
    ("2.2", "1.4", "0.6", "50"),
    ("inf", "2.5", "0.2", "120"),
]

PROFILE_X = [1e-8, 1e-3, 0.03, 0.3, 1.0, 2.5, 7.0, 40.0, 1e3, 1e6]
CDF_X = [1e-8, 1e-3, 0.1, 0.4, 0.9, 1.3, 2.2, 6.0, 50.0, 1e3]
LAMBDA_A = [1e-8, 1e-6, 1e-4, 0.01, 0.1, 0.4, 0.8, 1.1, 1.7, 3.0, 6.0, 20.0, 1e3]
AROUND_SHIFT = [0.5, 0.9, 0.999, 1.0, 1.001, 1.1]


# ------------------------------------------------------------------------------------------------------------------- #
# tanh-sinh on a finite piece


class Rule:
    """Nodes of the tanh-sinh rule on (0, 1): level k has step 2^-k and holds only the nodes that level k-1 lacks."""

    def __init__(self, first=2, last=7, smallest=mpf(10) ** -46):
        self.levels = []
        for level in range(first, last + 1):
            h = mpf(1) / 2**level
            nodes = []
            k = 0 if level == first else 1
            while True:
                t = k * h
                q = mp.exp(-mp.pi * mp.sinh(t))  # node at 1/(1+q) and mirrored at q/(1+q)
                x = q / (1 + q)
                w = mp.pi * mp.cosh(t) * q / (1 + q) ** 2 * h
                if w < smallest:
                    break
                nodes.append((x, w))
                k += 1 if level == first else 2
            self.levels.append(nodes)

    def integrate(self, g, a, b, depth=0):
        """Integral of g over [a, b]; halves the piece if the last level has not converged."""
        width = b - a
        total = mpf(0)
        for level, nodes in enumerate(self.levels):
            part = mpf(0)
            for x, w in nodes:
                d = x * width
                part += w * (g(a + d) + g(b - d) if x != mpf(0.5) else g(a + d))
            before, total = total, (total / 2 if level else total) + part
            # The rule converges quadratically: a difference of 1e-16 leaves an error of about 1e-32.
            if level and abs(total - before) * width <= max(mpf("1e-16") * abs(total) * width, NEGLIGIBLE):
                return total * width
        if depth == 30:
            raise ArithmeticError(f"no convergence on [{mp.nstr(a, 8)}, {mp.nstr(b, 8)}]")
        middle = (a + b) / 2
        return self.integrate(g, a, middle, depth + 1) + self.integrate(g, middle, b, depth + 1)


RULE = Rule()


# ------------------------------------------------------------------------------------------------------------------- #
# one shape


class Splitting:
    """Where pieces end. The two instances share no level, no R and no cut."""

    def __init__(self, levels, step, tail_start, tail_cuts, kernel_cuts):
        self.levels = [mpf(v) for v in levels]  # of -ln f, then by `step`
        self.step = mpf(step)
        self.tail_start = mpf(tail_start)  # R: where u > tail_start (gamma-1) and x > tail_start m
        self.tail_cuts = [mpf(v) for v in tail_cuts]  # x/R at which the tail is cut again
        self.kernel_cuts = [mpf(v) for v in kernel_cuts]  # t/a at which the masking kernel is cut


FIRST = Splitting([1e-30, 1e-12, 1e-5, 0.01, 0.2, 0.8, 2, 5, 10], 9, 6, [20, 1e3, 1e6], [1.4, 3, 10, 100, 1e4, 1e6])
SECOND = Splitting(
    [1e-22, 1e-9, 3e-4, 0.05, 0.4, 1.3, 3.4, 7], 7.3, 11, [11, 300, 7e4, 1e9], [1.2, 2.1, 6, 40, 2e3, 3e5]
)


def binary(text):
    """The binary64 number next to a decimal, exactly."""
    return mpf(float(text))


class Shape:
    def __init__(self, gamma, p, lam, shift, read=binary):
        self.gamma, self.p, self.lam, self.m = (read(v) for v in (gamma, p, lam, shift))
        self.normal = mp.isinf(self.gamma)
        self.right, self.left = 1 + self.lam, 1 - self.lam
        self.kappa = None if self.normal else self.gamma - 1
        self.two_p = 2 * self.p
        self.power = None if self.normal else 2 * self.p * self.gamma

    def minus_log_f(self, x):
        d = x - self.m
        if d == 0:
            return mpf(0)
        u = (d / self.right if d > 0 else -d / self.left) ** self.two_p
        return u if self.normal else self.gamma * mp.log1p(u / self.kappa)

    def f(self, x):
        return mp.exp(-self.minus_log_f(x))

    def offset(self, level):
        """|x-m|/c at which -ln f = level."""
        u = level if self.normal else self.kappa * mp.expm1(level / self.gamma)
        return u ** (1 / self.two_p)

    # -- pieces

    def pieces(self, split, lo, cuts, exponent):
        """Ends of the pieces from lo on, the further `cuts` among them, and R (None: the last end is where f is spent)."""
        last = max([lo, self.m] + cuts)
        spent = max(self.minus_log_f(last), 0) + DROP
        ends = [lo] + [c for c in cuts if c > lo]
        if self.m > lo:
            ends.append(self.m)
        tail = None
        k = 0
        level = split.levels[0]
        left_done = self.m == 0
        while True:
            w = self.offset(level)
            if not left_done:
                x = self.m - self.left * w
                if x <= lo or level > 1400:
                    left_done = True
                elif not cuts and level > 2 * DROP:  # masking: the kernel grows with t, what is left of here is nothing
                    ends = [t for t in ends if t > x] + [x]
                    lo, left_done = x, True
                else:
                    ends.append(x)
            x = self.m + self.right * w
            if tail is None:
                if x > lo:
                    ends.append(x)
                if (
                    exponent is not None
                    and w**self.two_p > split.tail_start * self.kappa
                    and x > split.tail_start * self.m
                    and x >= last
                ):
                    tail = x
                elif level > spent:
                    tail = False
            if tail is not None and left_done:
                break
            k += 1
            level = split.levels[k] if k < len(split.levels) else level + split.step
        end = max(ends) if tail is False else tail
        return thin([x for x in ends if x <= end], [lo, self.m, end] + cuts), (tail if tail is not False else None)

    def tail_integral(self, g, start, e, split):
        """Integral of g over [start, inf), in v with x = start v^(-1/e)."""
        inv = -1 / e

        def in_v(v):
            x = start * v**inv
            return g(x) * x / v

        cuts = [mpf(1)] + [c ** (-e) for c in split.tail_cuts] + [mpf(0)]
        return sum(RULE.integrate(in_v, lo, hi) for hi, lo in zip(cuts, cuts[1:])) / e

    # -- moments

    def distribution(self, split, arguments):
        """(int_0^inf t f, {x: int_0^x t f}, {x: int_x^inf t f}) for the given arguments."""
        e = None if self.normal else self.power - 2
        # so far out that sf is below SMALLEST and cdf is 1 to every digit
        far = [x for x in arguments if x > self.m and self.minus_log_f(x) > 900]
        ends, tail = self.pieces(split, mpf(0), [x for x in arguments if x not in far], e)
        g = lambda t: t * self.f(t)
        parts = [RULE.integrate(g, a, b) for a, b in zip(ends, ends[1:])]
        rest = self.tail_integral(g, tail, e, split) if tail is not None else mpf(0)
        below, above = {}, {}
        acc = mpf(0)
        for end, part in zip(ends, [mpf(0)] + parts):
            acc += part
            below[end] = acc
        acc = rest
        for i in range(len(ends) - 1, -1, -1):
            above[ends[i]] = acc
            if i:
                acc += parts[i - 1]
        whole = below[ends[-1]] + rest
        for x in far:
            below[x], above[x] = whole, mpf(0)
        return whole, below, above

    def masking(self, split, a):
        """int_a^inf f(t) t [sqrt(t^2-a^2) - a acos(a/t)] dt."""
        e = None if self.normal else self.power - 3
        ends, tail = self.pieces(split, a, [], e)
        end = ends[-1]
        ends = thin(ends + [a * c for c in split.kernel_cuts if ends[0] < a * c < end], [ends[0], self.m, end])

        def g(t):
            r = mp.sqrt((t - a) * (t + a))
            return self.f(t) * t * (r - a * mp.atan2(r, a))

        total = sum(RULE.integrate(g, lo, hi) for lo, hi in zip(ends, ends[1:]))
        if tail is not None:
            total += self.tail_integral(g, tail, e, split)
        return total

    # -- closed forms, for comparison only

    def moment(self, s, v, upper):
        """int w^(s-1) (1 + w/(gamma-1))^(-gamma) dw over [0, v] or [v, inf), by a series of positive terms."""
        if self.normal:
            return mp.gammainc(s, v) if upper else mp.gammainc(s, 0, v)
        b = self.gamma - s
        r = v / self.kappa
        z, zc = r / (1 + r), 1 / (1 + r)
        if not upper:
            return self.kappa**s * (series(s, b, z, zc) if z < 0.75 else mp.beta(s, b) - series(b, s, zc, z))
        if zc < 0.75:
            return self.kappa**s * series(b, s, zc, z)
        return self.kappa**s * (mp.beta(s, b) - series(s, b, z, zc))

    def closed_form(self, arguments):
        """(1/(2A), {x: int_0^x}, {x: int_x^inf}) with enough digits to survive the differences."""
        with mp.workdps(WORKING_DIGITS + 350):
            s1, s2 = 1 / self.two_p, 1 / self.p
            right = lambda w, up: (
                (self.m * self.right * self.moment(s1, w, up) + self.right**2 * self.moment(s2, w, up)) / self.two_p
            )
            left = lambda w: (
                (self.m * self.left * self.moment(s1, w, False) - self.left**2 * self.moment(s2, w, False)) / self.two_p
            )
            whole_left = left((self.m / self.left) ** self.two_p) if self.m > 0 else mpf(0)
            whole_right = right(mpf(0), True)
            below, above = {}, {}
            for x in arguments:
                if x > self.m and self.minus_log_f(x) > 900:
                    below[x], above[x] = whole_left + whole_right, mpf(0)
                elif x < self.m:
                    part = left(((self.m - x) / self.left) ** self.two_p)
                    below[x], above[x] = whole_left - part, part + whole_right
                else:
                    w = ((x - self.m) / self.right) ** self.two_p
                    below[x], above[x] = whole_left + right(w, False), right(w, True)
            return whole_left + whole_right, below, above

    def exact_lambda(self, a):
        """Lambda where it is elementary: zero shift and p = 1 (or p = 1/2 and gamma = inf); None elsewhere."""
        if self.m != 0:
            return None
        q = a / self.right
        with mp.workdps(WORKING_DIGITS + 60 + 2 * max(0, int(mp.log10(q)))):
            if self.p == 1 and self.normal:
                with mp.workdps(mp.dps + int(q * q)):
                    return mp.exp(-q * q) / (2 * q * mp.sqrt(mp.pi)) - mp.erfc(q) / 2
            if self.p == 1 and self.gamma < 1e6:
                with mp.workdps(mp.dps + min(600, int(self.gamma * mp.log1p(q * q / self.kappa)))):
                    k = self.kappa
                    front = mp.exp(k * mp.log(k) + mp.loggamma(self.gamma - mpf(1) / 2) - mp.loggamma(k)) / mp.sqrt(
                        mp.pi
                    )
                    y = k / (k + q * q)
                    return (
                        front * (k + q * q) ** (mpf(3) / 2 - self.gamma) / ((2 * self.gamma - 3) * q)
                        - mp.betainc(k, mpf(1) / 2, 0, y, regularized=True) / 2
                    )
            if self.p == mpf(1) / 2 and self.normal:
                if q > 50:
                    return None
                # P2(t) = t K1(t)/pi; the tail integral of (t-q) P2 is itself smooth
                g = lambda t: (t - q) * t * mp.besselk(1, t)
                with mp.workdps(40):
                    cuts = [q, q + mpf(1) / 2, q + 2, q + 6, q + 14, q + 30, q + 60, q + 120, q + 240]
                    return sum(RULE.integrate(g, lo, hi) for lo, hi in zip(cuts, cuts[1:])) / (mp.pi * q)
        return None


def thin(ends, needed):
    """Sorted ends without those that lie so close to a needed one that the piece between would drown in rounding."""
    needed = sorted(set(needed))
    keep = [x for x in ends if all(abs(x - n) > mpf("1e-14") * n for n in needed)]
    return sorted(set(keep + [n for n in needed if min(ends) <= n <= max(ends)]))


def series(a, b, z, zc):
    """Incomplete beta B(z; a, b) = z^a zc^b / a sum_n (a+b)_n/(a+1)_n z^n, zc = 1 - z."""
    if z == 0:
        return mpf(0)
    term = total = mpf(1)
    n = 0
    while True:
        term *= (a + b + n) / (a + 1 + n) * z
        total += term
        n += 1
        if term < total * mp.eps and (a + b + n) * z < (a + 1 + n):
            return z**a * zc**b / a * total
        if n > 200000:
            raise ArithmeticError("beta series")


# ------------------------------------------------------------------------------------------------------------------- #
# rows


def short(x):
    """A binary64 number near x with few decimal digits."""
    return float(mp.nstr(x, 6))


def arguments_of(shape):
    around = [float(shape.m * mpf(r)) for r in map(mpf, AROUND_SHIFT)] if shape.m > 0 else []
    offsets = [float(shape.m + shape.right * shape.offset(mpf(v))) for v in ("0.3", "1.5")]
    if shape.m > shape.left:
        offsets += [float(shape.m - shape.left * shape.offset(mpf(v))) for v in ("0.3", "1.5", "40")]
    deep = [shape.m + shape.right * shape.offset(mpf(v)) for v in (25, 200, 640)]
    near = [short(v) for v in around + offsets if v > 0]
    deep_x = [short(v) for v in deep if v < 1e12]
    deep_a = [short(v) for v in deep if v < 1e4]
    # one ulp on either side of the kink
    kink = [float(shape.m) * (1 + 2.0**-52), float(shape.m) * (1 - 2.0**-53)] if shape.m > 0 else []
    unique = lambda xs: sorted(set(xs))
    return unique(PROFILE_X + near + deep_x + kink), unique(CDF_X + near + deep_x), unique(LAMBDA_A + near + deep_a)


def relative(a, b):
    return mpf(0) if a == b else abs(a - b) / max(abs(a), abs(b))


class Record:
    def __init__(self):
        self.worst = {}

    def __call__(self, what, value, limit, where):
        if value > self.worst.get(what, (mpf(-1),))[0]:
            self.worst[what] = (value, where)
        if value > limit:
            raise ArithmeticError(f"{what}: {mp.nstr(value, 3)} > {mp.nstr(limit, 3)} at {where}")


def values_of(shape, name, profile_x, cdf_x, lambda_a, record, closed=True):
    """Rows (quantity, argument, value), each computed twice."""
    xs = [mpf(x) for x in cdf_x]
    (n1, below1, above1), (n2, below2, above2) = (shape.distribution(s, xs) for s in (FIRST, SECOND))
    record("A, two splittings", relative(n1, n2), AGREEMENT, name)
    if closed:
        cn, cbelow, cabove = shape.closed_form(xs)
        record("A, closed form", relative(n1, cn), CLOSED_FORM, name)
    normalization = 1 / (2 * n1)
    rows = [("A", None, normalization)]
    rows += [("Af", x, normalization * shape.f(mpf(x))) for x in profile_x]
    for x, arg in zip(xs, cdf_x):
        for quantity, first, second, form in (
            ("sf", above1, above2, cabove if closed else None),
            ("cdf", below1, below2, cbelow if closed else None),
        ):
            value = first[x] / n1
            if value < SMALLEST:
                continue
            record(f"{quantity}, two splittings", relative(value, second[x] / n2), AGREEMENT, (name, arg))
            if closed:
                record(f"{quantity}, closed form", relative(value, form[x] / cn), CLOSED_FORM, (name, arg))
            rows.append((quantity, arg, value))
    for arg in lambda_a:
        a = mpf(arg)
        if 2 * normalization * shape.f(max(a, shape.m)) < SMALLEST:
            continue
        value = 2 * normalization / mp.pi * shape.masking(FIRST, a) / a
        if value < SMALLEST:
            continue
        other = 1 / n2 / mp.pi * shape.masking(SECOND, a) / a
        record("Lambda, two splittings", relative(value, other), AGREEMENT, (name, arg))
        exact = shape.exact_lambda(a)
        if exact is not None:
            record("Lambda, exact", relative(value, exact), CLOSED_FORM, (name, arg))
        rows.append(("Lambda", arg, value))
    return [r for r in rows if r[2] >= SMALLEST]


def decimal(x):
    return "" if x is None else repr(x)


def generate(path, shapes):
    record = Record()
    rows = []
    started = time.time()
    for i, raw in enumerate(shapes):
        shape = Shape(*raw)
        if not shape.normal and shape.power <= 3:
            raise ValueError(f"{raw}: 2 p gamma must exceed 3")
        name = ",".join(raw)
        new = values_of(shape, name, *arguments_of(shape), record)
        rows += [(*raw, q, decimal(x), mp.nstr(v, PRINTED_DIGITS)) for q, x, v in new]
        bar = "#" * (30 * (i + 1) // len(shapes))
        print(
            f"[{bar:<30}] {i + 1}/{len(shapes)} {name}: {len(new)} rows, {time.time() - started:.0f} s",
            file=sys.stderr,
            flush=True,
        )
        # written after every shape: what is there can be used while the rest is computed
        with open(path, "w", newline="") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(["gamma", "p", "lambda", "shift", "quantity", "argument", "value"])
            writer.writerows(rows)
    for what, (value, where) in sorted(record.worst.items()):
        print(f"{what:28} largest relative difference {mp.nstr(value, 3):>10} at {where}", file=sys.stderr)


def verify(path, read):
    """Largest relative difference between the rows of a file and the same values computed here."""
    groups = {}
    with open(path) as f:
        for row in csv.DictReader(f):
            key = (row["gamma"], row["p"], row["lambda"], row["shift"])
            groups.setdefault(key, []).append((row["quantity"], row["argument"], mpf(row["value"])))
    worst = {}
    record = Record()
    for i, (key, rows) in enumerate(groups.items()):
        shape = Shape(*key, read)
        wanted = lambda *qs: sorted({read(x) for q, x, _ in rows if q in qs})
        new = {
            (q, x): v
            for q, x, v in values_of(
                shape, key, wanted("Af"), wanted("cdf", "sf"), wanted("Lambda"), record, closed=False
            )
        }
        for q, x, v in rows:
            found = new.get((q, read(x) if x else None))
            if found is None:
                print("not computed:", key, q, x, mp.nstr(v, 8))
                continue
            d = relative(v, found)
            if d > worst.get(q, (mpf(-1),))[0]:
                worst[q] = (d, key, x)
        print(
            f"{i + 1}/{len(groups)} {','.join(key)}",
            {q: mp.nstr(d[0], 3) for q, d in worst.items()},
            file=sys.stderr,
            flush=True,
        )
    for q, (d, key, x) in worst.items():
        print(f"{q:8} largest relative difference {mp.nstr(d, 3)} at {','.join(key)} {x}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--verify", metavar="FILE.csv", help="compute the rows of a file anew and compare")
    parser.add_argument("--decimal", action="store_true", help="with --verify: take the inputs as decimals")
    parser.add_argument("-o", "--output", default=str(Path(__file__).with_name("profile.csv")))
    options = parser.parse_args()
    if options.verify:
        verify(options.verify, mpf if options.decimal else binary)
    else:
        generate(options.output, SHAPES)


if __name__ == "__main__":
    main()
