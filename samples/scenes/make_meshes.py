#!/usr/bin/env python3
"""Makes the meshes, patches and images of the sample scenes. Run it in this folder; it needs Python 3 alone."""
import math
import random
import struct
import zlib


def write_obj(name, vertices, faces):
    with open(name, "w") as out:
        out.write("# made by make_meshes.py, in millimetres\n")
        for v in vertices:
            out.write("v {:.4f} {:.4f} {:.4f}\n".format(*v))
        for f in faces:
            out.write("f {} {} {}\n".format(*(i + 1 for i in f)))


def relief_ball(name, radius, relief, turns):
    """A closed ball with a relief of waves: no vertex is there twice, not even at the poles."""
    rows = turns // 2
    vertices, faces = [], []

    def place(row, column):
        up = math.pi * (row / rows - 0.5)
        along = 2 * math.pi * column / turns
        x, y, z = math.cos(up) * math.cos(along), math.cos(up) * math.sin(along), math.sin(up)
        height = math.sin(9 * x) * math.sin(9 * y + 1) * math.cos(9 * z)
        return tuple((radius + relief * height) * c for c in (x, y, z))

    bottom = 0
    vertices.append(place(0, 0))
    for row in range(1, rows):
        for column in range(turns):
            vertices.append(place(row, column))
    top = len(vertices)
    vertices.append(place(rows, 0))

    def index(row, column):
        if row == 0:
            return bottom
        if row == rows:
            return top
        return 1 + (row - 1) * turns + column % turns

    for row in range(rows):
        for column in range(turns):
            a, b = index(row, column), index(row, column + 1)
            c, d = index(row + 1, column + 1), index(row + 1, column)
            if a != b:
                faces.append((a, b, c))
            if c != d:
                faces.append((a, c, d))
    write_obj(name, vertices, faces)


def relief_plate(name, size, thickness, height, cells):
    """A closed plate whose upper side is a field of smooth hills."""
    vertices, faces = [], []
    side = cells + 1

    def hill(u, v):
        edge = min(1.0, 8 * min(u, 1 - u, v, 1 - v))
        return height * edge * 0.25 * (1 - math.cos(6 * math.pi * u)) * (1 - math.cos(6 * math.pi * v))

    for layer in range(2):
        for j in range(side):
            for i in range(side):
                u, v = i / cells, j / cells
                z = -thickness if layer == 0 else hill(u, v)
                vertices.append((size * (u - 0.5), size * (v - 0.5), z))

    def index(layer, i, j):
        return layer * side * side + j * side + i

    def quad(a, b, c, d):
        faces.append((a, b, c))
        faces.append((a, c, d))

    for j in range(cells):
        for i in range(cells):
            quad(index(1, i, j), index(1, i + 1, j), index(1, i + 1, j + 1), index(1, i, j + 1))
            quad(index(0, i, j), index(0, i, j + 1), index(0, i + 1, j + 1), index(0, i + 1, j))
    for i in range(cells):
        quad(index(0, i, 0), index(0, i + 1, 0), index(1, i + 1, 0), index(1, i, 0))
        quad(index(0, i + 1, cells), index(0, i, cells), index(1, i, cells), index(1, i + 1, cells))
        quad(index(0, 0, i + 1), index(0, 0, i), index(1, 0, i), index(1, 0, i + 1))
        quad(index(0, cells, i), index(0, cells, i + 1), index(1, cells, i + 1), index(1, cells, i))
    write_obj(name, vertices, faces)


def bowl(name, profile):
    """A bowl whose wall a cubic B-spline sweeps round z, from the axis below to the axis above; in millimetres."""
    half = math.sqrt(0.5)
    round_z = [(1, 0, 1), (1, 1, half), (0, 1, 1), (-1, 1, half), (-1, 0, 1), (-1, -1, half), (0, -1, 1), (1, -1, half),
               (1, 0, 1)]
    rows = ["[" + ", ".join("[{:g}, {:g}, {:g}, {:.16g}]".format(x * rho, y * rho, z, w) for rho, z in profile) + "]"
            for x, y, w in round_z]
    inner = len(profile) - 4
    knots = [0] * 4 + list(range(1, inner + 1)) + [inner + 1] * 4
    with open(name, "w") as out:
        out.write("""{{
  // A bowl of rational B-splines, round to the last digit. Made by make_meshes.py, in millimetres.
  "tool": {{"radius": 0.002}},
  "objects": [
    {{
      "name": "bowl",
      "shape": {{
        "kind": "nurbs",
        "unit": "mm",
        "patches": [
          {{
            "degree": [2, 3],
            "knots_u": [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4],
            "knots_v": {},
            "points": [
              {}
            ]
          }}
        ]
      }},
      "surface": {{"stiffness": 800, "friction": {{"static": 0.2, "dynamic": 0.15, "damping": 2}}}}
    }}
  ]
}}
""".format(knots, ",\n              ".join(rows)))


def write_png(name, columns, rows, value):
    """A grey image of 16 bits; value(u, v) from 0 to 1."""
    def chunk(tag, data):
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))

    lines = b""
    for j in range(rows):
        lines += b"\0" + b"".join(
            struct.pack(">H", round(65535 * value(i / columns, j / rows))) for i in range(columns))
    with open(name, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 16, 0, 0, 0, 0))
                  + chunk(b"IDAT", zlib.compress(lines, 9)) + chunk(b"IEND", b""))


def weave(u, v):
    """Threads over and under each other."""
    a, b = math.sin(2 * math.pi * 8 * u), math.sin(2 * math.pi * 8 * v)
    return 0.5 + 0.25 * (a * a - b * b) * (1 if (int(8 * u) + int(8 * v)) % 2 == 0 else -1)


random.seed(1)
relief_ball("relief_ball.obj", 30, 1.5, 96)
relief_plate("hills.obj", 80, 5, 6, 48)
write_png("weave.png", 128, 128, weave)
bowl("bowl.json", [(0, -24), (20, -24), (40, -16), (45, 8), (42, 14), (38, 8), (34, -12), (18, -18), (0, -18)])
