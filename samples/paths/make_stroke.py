#!/usr/bin/env python3
"""Writes stroke.csv, a looping pen stroke as a hand might have made it, and stroke.json, which says what is in it.

The pen runs along a prolate cycloid on a table, progress s following one minimum-jerk movement over T:

    s(t) = 10 u^3 - 15 u^4 + 6 u^5,  u = t / T                       (Flash and Hogan 1985)
    x = WIDTH (s - 1/2) - A sin(2 pi LOOPS s)                        [m]
    y = -B cos(2 pi LOOPS s)                                          [m]
    z = -DEPTH sin(pi s)^2                                           [m]  the table gives way a little

The force on the hand is that of the table: it carries the pen and rubs against its movement,

    f_z = CARRIED sin(pi s)^2,   f_xy = -FRICTION f_z v_xy / (|v_xy| + V0)      [N]

Like a real log, it is uneven: a clock of 1 ms of which the logger dropped every fourth row or so, and once a dozen.
"""

import csv
import json
import math
import pathlib
import random

T = 3.6  # s
WIDTH, A, B, DEPTH, LOOPS = 0.06, 0.011, 0.0125, 0.0004, 4  # m
CARRIED, FRICTION, V0 = 1.4, 0.25, 0.005  # N, 1, m/s


def row(t):
    u = t / T
    s = 10 * u**3 - 15 * u**4 + 6 * u**5
    ds = (30 * u**2 - 60 * u**3 + 30 * u**4) / T
    angle, rate = 2 * math.pi * LOOPS * s, 2 * math.pi * LOOPS * ds
    p = (WIDTH * (s - 0.5) - A * math.sin(angle), -B * math.cos(angle), -DEPTH * math.sin(math.pi * s) ** 2)
    v = (WIDTH * ds - A * rate * math.cos(angle), B * rate * math.sin(angle),
         -DEPTH * math.pi * ds * math.sin(2 * math.pi * s))
    carried = CARRIED * math.sin(math.pi * s) ** 2
    rubbed = -FRICTION * carried / (math.hypot(v[0], v[1]) + V0)
    return p, v, (rubbed * v[0], rubbed * v[1], carried)


def written(value, digits):
    return f"{round(value, digits) + 0.0:.{digits}f}"  # + 0.0: no negative zero


def stamps():
    """Milliseconds of the rows that the logger kept."""
    random.seed(17)
    kept = [0]
    while kept[-1] < 1000 * T:
        dropped = 11 if len(kept) == 1500 else random.choices((0, 1, 2), (75, 23, 2))[0]
        kept.append(min(kept[-1] + 1 + dropped, round(1000 * T)))
    return kept


def main():
    folder = pathlib.Path(__file__).parent
    rows = []
    for ms in stamps():
        p, v, f = row(ms / 1000)
        columns = [([ms / 1000], 3), (p, 8), (v, 6), (f, 4)]
        rows.append([written(a, digits) for values, digits in columns for a in values])
    with open(folder / "stroke.csv", "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow("t x y z vx vy vz fx fy fz".split())
        writer.writerows(rows)

    columns = list(zip(*[[float(a) for a in r] for r in rows]))
    duration = columns[0][-1] - columns[0][0]
    contents = {
        "rows": len(rows),
        "duration_s": duration,
        "mean_rate_hz": (len(rows) - 1) / duration,
        "longest_gap_s": max(round(b - a, 6) for a, b in zip(columns[0], columns[0][1:])),
        "bounds_m": {"min": [min(c) for c in columns[1:4]], "max": [max(c) for c in columns[1:4]]},
        "max_speed_m_s": max(math.hypot(*v) for v in zip(*columns[4:7])),
        "max_force_n": max(math.hypot(*f) for f in zip(*columns[7:10])),
    }
    (folder / "stroke.json").write_text(json.dumps(contents, indent=2) + "\n")


if __name__ == "__main__":
    main()
