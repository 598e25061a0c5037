#!/usr/bin/env python3
"""Makes the volume of the sample scenes. Run it in this folder; it needs Python 3 alone."""
import gzip
import math
import struct

SIDE, SPACING = 46, 1.0  # samples, mm
RADIUS, PERIOD, WALL = 19.0, 19.0, 1.9  # mm: of the ball, of the pores, half of a wall


def smooth_max(a, b, width):
    """The larger of two distances, with a rounded edge."""
    h = max(width - abs(a - b), 0.0) / width
    return max(a, b) + 0.25 * width * h * h


def distance(x, y, z):
    """About the distance from a ball of spongy bone [mm]: a gyroid's walls inside a sphere."""
    w = 2 * math.pi / PERIOD
    gyroid = (math.sin(w * x) * math.cos(w * y) + math.sin(w * y) * math.cos(w * z) + math.sin(w * z) * math.cos(w * x))
    walls = abs(gyroid) / (w * 1.4) - WALL
    return smooth_max(walls, math.sqrt(x * x + y * y + z * z) - RADIUS, 3.0)


values = []
middle = 0.5 * (SIDE - 1)
for k in range(SIDE):
    for j in range(SIDE):
        for i in range(SIDE):
            d = distance(*(SPACING * (c - middle) for c in (i, j, k)))
            # As in a scan: 700 inside, -1000 in air, 300 at the surface.
            values.append(round(max(-1000.0, min(700.0, 300.0 - 300.0 * d))))
header = """NRRD0004
# made by make_volumes.py: a ball of spongy bone
type: int16
dimension: 3
sizes: {0} {0} {0}
encoding: gzip
endian: little
space: right-anterior-superior
space directions: ({1},0,0) (0,{1},0) (0,0,{1})
space origin: ({2},{2},{2})
space units: "mm" "mm" "mm"

""".format(SIDE, SPACING, -middle * SPACING)
with open("bone.nrrd", "wb") as out:
    out.write(header.encode())
    out.write(gzip.compress(struct.pack("<%dh" % len(values), *values), 9, mtime=0))
