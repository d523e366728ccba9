"""An independent evaluator of models: writes trees at random as TOML, and what they are at points, by definition.

python3 models.py FOLDER COUNT   writes FOLDER/0.toml, 0.txt, …: lines `x y z value`. No packages are needed.
"""

import math
import random
import sys

ISO = 0.5


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def length(a):
    return math.sqrt(dot(a, a))


def falls(name, sharpness):
    def soft(r):
        return 1 - 4 / 9 * r**6 + 17 / 9 * r**4 - 22 / 9 * r**2 if r < 1 else 0

    def metaball(r):
        return 1 - 3 * r * r if r <= 1 / 3 else 1.5 * (1 - r) ** 2 if r < 1 else 0

    def wyvill(r):
        return (1 - r * r) ** 3 if r < 1 else 0

    def gaussian(r):
        return math.exp(-sharpness * r * r) if sharpness * r * r < 20.7 else 0

    return dict(soft=soft, metaball=metaball, wyvill=wyvill, gaussian=gaussian)[name]


def to_segment(p, a, b):
    ab = minus(b, a)
    t = min(1, max(0, dot(minus(p, a), ab) / dot(ab, ab)))
    return length(minus(p, [x + t * d for x, d in zip(a, ab)])), t


def cylindrical(p, centre, normal):
    n = [x / length(normal) for x in normal]
    e = dot(minus(p, centre), n)
    return e, length(minus(minus(p, centre), [e * x for x in n]))


def beyond(p, centre, size):
    return [abs(x - c) - s / 2 for x, c, s in zip(p, centre, size)]


def convolve(p, a, b, reach, steps=2000):
    """Simpson's rule over the part of the segment within the reach."""
    ab = minus(b, a)
    size = length(ab)
    at = dot(minus(p, a), ab) / size
    d2 = max(0, dot(minus(p, a), minus(p, a)) - at * at)
    half = reach * reach - d2
    if half <= 0:
        return 0
    half = math.sqrt(half)
    low, high = max(0, at - half), min(size, at + half)
    if high <= low:
        return 0

    def kernel(s):
        return max(0, 1 - (d2 + (s - at) ** 2) / reach**2) ** 3

    h = (high - low) / steps
    total = kernel(low) + kernel(high)
    total += sum((4 if i % 2 else 2) * kernel(low + i * h) for i in range(1, steps))
    return 35 / (32 * reach) * total * h / 3


def smooth(a, b, union, m=0.7, k=0.3):
    """The level whose rounded corner passes through (a, b), by bisection."""

    def centre(c):
        if c <= 0:
            return c
        if c <= ISO:
            return c * (1 - m * (1 - c / ISO)) if union else c * (1 + m * (1 - c / ISO))
        return ISO + (k if union else 1 + k) * (c - ISO)

    if union:
        most, least = max(a, b), min(a, b)
        if least <= centre(most):
            return most
        low, high = most, most + least - centre(most)

        def is_below(c):
            q = centre(c)
            return math.hypot(max(0, a - q), max(0, b - q)) > c - q

    else:
        most, least = max(a, b), min(a, b)
        if most >= centre(least):
            return least
        low, high = least + most - centre(least), least

        def is_below(c):
            q = centre(c)
            return math.hypot(max(0, q - a), max(0, q - b)) < q - c

    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return (low + high) / 2


class Model:
    def __init__(self, seed):
        self.random = random.Random(seed)
        self.lines = []
        self.count = 0

    def number(self, low, high):
        return round(self.random.uniform(low, high), 3)

    def place(self, size=0.8):
        return [self.number(-size, size) for _ in range(3)]

    def write(self, kind, **keys):
        self.count += 1
        name = f"n{self.count}"
        self.lines.append(f"[model.{kind}.{name}]")
        for key, value in keys.items():
            if isinstance(value, bool):
                value = str(value).lower()
            elif isinstance(value, str):
                value = f'"{value}"'
            elif isinstance(value, list):
                value = str(value).replace("'", '"')
            self.lines.append(f"{key} = {value}")
        return name

    def leaf(self):
        r = self.random
        name = r.choice(["soft", "metaball", "wyvill", "gaussian"])
        sharpness = self.number(2, 5)
        keys = dict(falloff=name, radius=self.number(0.4, 1.2))
        if name == "gaussian":
            keys["sharpness"] = sharpness
        if r.random() < 0.2:
            keys["weight"] = self.number(-1.5, -0.2)
        g, reach, weight = falls(name, sharpness), keys["radius"], keys.get("weight", 1)
        centre, normal = self.place(), [self.number(0.1, 1), self.number(-1, 1), self.number(-1, 1)]
        kind = r.choice(["point", "segment", "cone", "disc", "torus", "box", "plane", "formula", "convolution", "points", "distance"])
        if kind == "point":
            return self.write("point", centre=centre, **keys), lambda p: weight * g(length(minus(p, centre)) / reach)
        if kind in ("segment", "cone"):
            a, b = centre, [x + d for x, d in zip(centre, normal)]
            b = [round(x, 3) for x in b]
            last = reach
            if kind == "cone":
                last = round(0.6 * reach, 3)
                keys["radius"] = [reach, last]

            def segment(p):
                d, t = to_segment(p, a, b)
                return weight * g(d / (reach + t * (last - reach)))

            return self.write("segment", **{"from": a, "to": b}, **keys), segment
        if kind in ("disc", "torus"):
            radius = self.number(0.1, 0.5)

            def round_one(p):
                e, w = cylindrical(p, centre, normal)
                d = math.hypot(e, max(0, w - radius) if kind == "disc" else w - radius)
                return weight * g(d / reach)

            own = {("disc_radius" if kind == "disc" else "ring_radius"): radius}
            return self.write(kind, centre=centre, normal=normal, **own, **keys), round_one
        if kind == "box":
            size = [self.number(0.1, 0.7) for _ in range(3)]
            return (
                self.write("box", centre=centre, size=size, **keys),
                lambda p: weight * g(length([max(0, v) for v in beyond(p, centre, size)]) / reach),
            )
        if kind == "plane":
            return (
                self.write("plane", point=centre, normal=normal, radius=reach),
                lambda p: min(1, max(0, 0.5 - dot(minus(p, centre), normal) / length(normal) / (2 * reach))),
            )
        if kind == "distance":
            size = [self.number(0.1, 0.7) for _ in range(3)]

            def distance(p):
                v = beyond(p, centre, size)
                return reach - (length([max(0, x) for x in v]) + min(0, max(v)))

            return self.write("box", centre=centre, size=size, falloff="distance", radius=reach), distance
        if kind == "formula":
            q = self.number(0.5, 2)
            self.count += 1
            name = f"n{self.count}"
            text = "0.4*sin(q*x + 1)*cos(2*y) - z^2/3 + max(x, -abs(y))^3*0.1 + atan2(y, 2 + x)*sqrt(z^2 + 0.1)"
            self.lines += [f"[model.formula.{name}]", f'f = "{text}"', f"parameters = {{ q = {q} }}"]
            return name, lambda p: (
                0.4 * math.sin(q * p[0] + 1) * math.cos(2 * p[1])
                - p[2] ** 2 / 3
                + max(p[0], -abs(p[1])) ** 3 * 0.1
                + math.atan2(p[1], 2 + p[0]) * math.sqrt(p[2] ** 2 + 0.1)
            )
        if kind == "points":
            all_points = [self.place() for _ in range(4)]
            keys.pop("weight", None)
            return (
                self.write("points", at=all_points, **keys),
                lambda p: sum(g(length(minus(p, q)) / reach) for q in all_points),
            )
        points = [self.place() for _ in range(3)]
        pieces = list(zip(points, points[1:]))
        return (
            self.write("convolution", points=points, radius=reach),
            lambda p: sum(convolve(p, a, b, reach) for a, b in pieces),
        )

    def node(self, depth):
        r = self.random
        if depth == 0 or r.random() < 0.15:
            return self.leaf()
        kind = r.choice(
            ["sum", "ricci", "union", "intersection", "difference", "pasko", "smooth", "twist", "taper", "bend", "affine", "offset", "shell"]
        )
        if kind in ("sum", "ricci", "union", "intersection", "difference"):
            parts = [self.node(depth - 1) for _ in range(r.randint(2, 3))]
            names, fs = [n for n, _ in parts], [f for _, f in parts]
            if kind == "sum":
                return self.write("blend", of=names), lambda p: sum(f(p) for f in fs)
            if kind == "ricci":
                n = r.choice([2, 3, 4, 2.5])
                name = self.write("blend", of=names, ricci=n)
                return name, lambda p: sum(max(0, f(p)) ** n for f in fs) ** (1 / n)
            if kind == "union":
                return self.write("union", of=names), lambda p: max(f(p) for f in fs)
            if kind == "intersection":
                return self.write("intersection", of=names), lambda p: min(f(p) for f in fs)
            name = self.write("difference", of=names)
            return name, lambda p: min([fs[0](p)] + [2 * ISO - f(p) for f in fs[1:]])
        if kind in ("pasko", "smooth"):
            (a, f), (b, g) = self.node(depth - 1), self.node(depth - 1)
            which = r.choice(["union", "intersection"])
            if kind == "smooth":
                return self.write(which, of=[a, b], smooth=True), lambda p: smooth(f(p), g(p), which == "union")
            sign = 1 if which == "union" else -1

            def pasko(p):
                u, v = f(p) - ISO, g(p) - ISO
                return ISO + u + v + sign * math.hypot(u, v) + 0.1 / (1 + (u / 0.3) ** 2 + (v / 0.4) ** 2)

            return self.write("pasko", of=[a, b], operation=which, displacement=[0.1, 0.3, 0.4]), pasko
        child, f = self.node(depth - 1)
        if kind == "twist":
            axis = r.choice([0, 1, 2])
            rate = self.number(-2, 2)

            def twist(p):
                # What is seen at p comes from where it was before the turn.
                i, j = (axis + 1) % 3, (axis + 2) % 3
                c, s = math.cos(-rate * p[axis]), math.sin(-rate * p[axis])
                q = list(p)
                q[i], q[j] = c * p[i] - s * p[j], s * p[i] + c * p[j]
                return f(q)

            return self.write("twist", of=child, axis="xyz"[axis], per_unit=rate), twist
        if kind == "taper":
            axis = r.choice([0, 1, 2])
            low, high, scale = self.number(-0.8, -0.2), self.number(0.1, 0.7), self.number(0.4, 1.7)

            def taper(p):
                s = 1 + (scale - 1) * min(1, max(0, (p[axis] - low) / (high - low)))
                return f([x if i == axis else x / s for i, x in enumerate(p)])

            return self.write("taper", of=child, axis="xyz"[axis], **{"from": low, "to": high}, scale=scale), taper
        if kind == "bend":
            rate = self.number(0.05, 0.2) * r.choice([-1, 1])
            low, high = self.number(-0.9, -0.3), self.number(0.3, 0.9)

            def bend(p):
                # In polar coordinates about the axis at y = 1/rate; the middle of the range points at the body.
                x0 = (low + high) / 2
                dx, dy = p[0] - x0, p[1] - 1 / rate
                radius, turn = math.hypot(dx, dy), math.atan2(dx * rate, -dy * rate)
                x = x0 + turn / rate
                if low <= x <= high:
                    return f([x, 1 / rate - math.copysign(radius, rate), p[2]])
                end = low if x < low else high
                turn = rate * (end - x0)
                c, s = math.cos(turn), math.sin(turn)
                return f([end + dx * c + dy * s, 1 / rate - dx * s + dy * c, p[2]])

            keys = {"from": low, "to": high, "per_unit": rate}
            return self.write("bend", of=child, **keys), bend
        if kind == "affine":
            scale, turn, move = [self.number(0.6, 1.5) for _ in range(3)], self.number(-180, 180), self.place(0.3)

            def affine(p):
                x, y, z = minus(p, move)
                c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
                return f([(c * x + s * y) / scale[0], (-s * x + c * y) / scale[1], z / scale[2]])

            return self.write("affine", of=child, scale=scale, rotate=[0, 0, 1, turn], translate=move), affine
        by = self.number(0.05, 0.3)
        if kind == "offset":
            return self.write("offset", of=child, by=by), lambda p: f(p) + by
        return self.write("shell", of=child, thickness=by), lambda p: ISO + by / 2 - abs(f(p) - ISO)


def main():
    folder, count = sys.argv[1], int(sys.argv[2])
    for seed in range(count):
        model = Model(seed)
        root, f = model.node(3)
        head = ["[model]", "bounds = [[-1, -1, -1], [1, 1, 1]]", f'root = "{root}"']
        with open(f"{folder}/{seed}.toml", "w") as file:
            file.write("\n".join(head + model.lines) + "\n")
        with open(f"{folder}/{seed}.txt", "w") as file:
            for _ in range(40):
                p = [model.random.uniform(-1, 1) for _ in range(3)]
                file.write(" ".join(repr(v) for v in p + [float(f(p))]) + "\n")


main()
