"""How often keypoints are wrong on real pictures and their variants, and how often without a doubt, by segmenter and tracker.

    .venv/bin/python tests/bench/eyes/eyes.py --pictures DIR [--pair colour+geometric ...] [--whole] [--weights FILE] [--out DIR]

DIR holds NAME.jpg with NAME_mask.png (white where the object is) and NAME_centreline.json ([u, v] along the object). For each picture the
colours are fitted to its mask, and kept for all its variants. A picture fails if the object is not found, or if a keypoint is more than
5 % of the object's length from its place; a picture without fitted colours (a grey object, by thresholds) fails in all variants. It fails
silently if every score is at least --sure then. --whole leaves out pictures in which an end of the object lies at the border: a
camera is set up so that it sees the whole object. --out also keeps one line a picture and pair.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy
from PIL import Image, ImageDraw, ImageFilter

ROOT = pathlib.Path(__file__).resolve().parents[3]
PROGRAM = os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary")
FRACTIONS = (0.125, 0.375, 0.625, 0.875)
TOLERANCE = 0.05
SIDE_PX = 480
# Greatest distance from the border at which the line of a cut object ends, and difference of colours (of 255) of the same object.
CUT_PX, SAME_COLOUR = 45, 30
WHITE, GREY, BLACK, SKIN = (240, 240, 235), (128, 128, 130), (25, 25, 28), (224, 172, 145)


def inside(places):
    """Those of the places that lie in the picture."""
    return [p for p in places if 0 <= p[0] < SIDE_PX and 0 <= p[1] < SIDE_PX]


class Picture:
    """Square picture of SIDE_PX, its mask and its centre line."""

    def __init__(self, path):
        self.name = path.stem
        image = Image.open(path).convert("RGB")
        mask = Image.open(path.with_name(f"{path.stem}_mask.png")).convert("L")
        line = numpy.array(json.loads(path.with_name(f"{path.stem}_centreline.json").read_text()), float)
        side = max(image.size)
        # The margin repeats the picture's median colour: a border of another colour would be an object of its own.
        around = tuple(int(c) for c in numpy.median(numpy.asarray(image).reshape(-1, 3), axis=0))
        left, top = (side - image.width) // 2, (side - image.height) // 2
        square, labels = Image.new("RGB", (side, side), around), Image.new("L", (side, side))
        square.paste(image, (left, top))
        labels.paste(mask.resize(image.size), (left, top))
        scale = SIDE_PX / side
        self.image = square.resize((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS)
        self.mask = labels.resize((SIDE_PX, SIDE_PX), Image.Resampling.BILINEAR)
        self.line = self.continued((line + [left, top]) * scale)
        steps = numpy.linalg.norm(numpy.diff(self.line, axis=0), axis=1)
        self.arcs = numpy.concatenate([[0.0], numpy.cumsum(steps)])
        self.length = self.arcs[-1]
        self.width = max(3.0, numpy.count_nonzero(numpy.asarray(self.mask) > 127) / self.length)

    def continued(self, line):
        """The line, continued straight to the border of the picture where the object goes on: lines of cut objects end before."""
        arcs = numpy.concatenate([[0.0], numpy.cumsum(numpy.linalg.norm(numpy.diff(line, axis=0), axis=1))])
        line = numpy.stack([numpy.interp(numpy.arange(0.0, arcs[-1]), arcs, line[:, i]) for i in range(2)], axis=1)
        soft = numpy.asarray(self.image.filter(ImageFilter.GaussianBlur(1.5)), float)
        width = max(3.0, numpy.count_nonzero(numpy.asarray(self.mask) > 127) / len(line))
        for is_first in (True, False):
            points = line[::-1] if is_first else line
            direction = points[-1] - points[-1 - len(points) // 20]
            direction = direction / numpy.linalg.norm(direction)
            across = width * numpy.array([-direction[1], direction[0]])
            beyond = [points[-1]]
            while all(2 <= c < SIDE_PX - 2 for c in beyond[-1] + direction) and len(beyond) <= CUT_PX:
                beyond.append(beyond[-1] + direction)
            colours = numpy.array([soft[int(v), int(u)] for u, v in points[-len(points) // 8 : -len(points) // 20]])
            # Nearer than a width, the blur of the object's own end counts.
            places = [[p + s * across for s in numpy.linspace(-0.8, 0.8, 9)] for p in beyond[int(0.8 * width) :]]
            unlike = [min(numpy.linalg.norm(colours - soft[int(v), int(u)], axis=1).min() for u, v in inside(row)) for row in places]
            if len(beyond) <= CUT_PX and max(unlike, default=0.0) < SAME_COLOUR:
                longer = numpy.concatenate([points, beyond[1:]])
                line = longer[::-1] if is_first else longer
        return line

    def is_whole(self):
        """True if both ends are seen away from the border."""
        margin = max(0.02 * SIDE_PX, 0.7 * self.width)
        return all((margin < end).all() and (end < SIDE_PX - margin).all() for end in (self.line[0], self.line[-1]))

    def at(self, fraction):
        arc = fraction * self.length
        return numpy.array([numpy.interp(arc, self.arcs, self.line[:, i]) for i in range(2)])

    def along(self, fraction):
        step = self.at(min(fraction + 0.02, 1.0)) - self.at(max(fraction - 0.02, 0.0))
        return step / numpy.linalg.norm(step)

    def error(self, keypoints):
        """Greatest distance of a keypoint from its place, in lengths, in the better of the two orders."""
        truth = numpy.array([self.at(f) for f in FRACTIONS])
        found = numpy.array(keypoints)
        return min(numpy.linalg.norm(found - t, axis=1).max() for t in (truth, truth[::-1])) / self.length


def curved(gamma):
    return lambda p, rng: Image.fromarray((255 * (numpy.asarray(p.image, float) / 255) ** gamma).astype("uint8"))


def defocused(deviation_px):
    return lambda p, rng: p.image.filter(ImageFilter.GaussianBlur(deviation_px))


def coarse(p, rng):
    """The picture of a camera with half of the pixels along each side."""
    half = p.image.resize((SIDE_PX // 2, SIDE_PX // 2), Image.Resampling.BILINEAR)
    return half.resize((SIDE_PX, SIDE_PX), Image.Resampling.BILINEAR)


def shadowed(p, rng):
    """A shadow with a soft edge over half of the object."""
    middle, along = p.at(0.5), p.along(0.5)
    v, u = numpy.mgrid[0:SIDE_PX, 0:SIDE_PX]
    side = (u - middle[0]) * along[0] + (v - middle[1]) * along[1]
    light = 0.45 + 0.55 / (1 + numpy.exp(-side / 4))
    return Image.fromarray((numpy.asarray(p.image, float) * light[..., None]).astype("uint8"))


def exposed(factor):
    return lambda p, rng: Image.fromarray((numpy.asarray(p.image, float) * factor).clip(0, 255).astype("uint8"))


def balanced(red, green, blue):
    return lambda p, rng: Image.fromarray((numpy.asarray(p.image, float) * [red, green, blue]).clip(0, 255).astype("uint8"))


def noisy(levels):
    def change(p, rng):
        pixels = numpy.asarray(p.image, float)
        return Image.fromarray((pixels + rng.normal(0, levels, pixels.shape)).clip(0, 255).astype("uint8"))

    return change


def jpeg(quality):
    def change(p, rng):
        with tempfile.NamedTemporaryFile(suffix=".jpg") as file:
            p.image.save(file.name, quality=quality)
            return Image.open(file.name).convert("RGB").copy()

    return change


def moved(length_px):
    """Motion blur along a random direction."""

    def change(p, rng):
        angle = rng.uniform(0, numpy.pi)
        pixels, total = numpy.asarray(p.image, float), 0.0
        shifts = numpy.linspace(-0.5, 0.5, length_px) * length_px
        for shift in shifts:
            offset = [round(shift * numpy.sin(angle)), round(shift * numpy.cos(angle)), 0]
            total = total + numpy.roll(pixels, offset[:2], axis=(0, 1))
        return Image.fromarray((total / length_px).clip(0, 255).astype("uint8"))

    return change


def across(colour, share, widths):
    """Something in front of the object: a strip across it, `share` of its length wide, `widths` of its widths long at least."""

    def change(p, rng):
        image = p.image.copy()
        place = rng.uniform(0.3, 0.7)
        middle, along = p.at(place), p.along(place)
        half = 0.5 * share * p.length
        reach = max(widths * p.width, half)
        normal = numpy.array([-along[1], along[0]])
        corners = [middle + a * half * along + b * reach * normal for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        ImageDraw.Draw(image).polygon([tuple(c) for c in corners], fill=colour)
        return image.filter(ImageFilter.GaussianBlur(0.6))

    return change


def glints(number):
    def change(p, rng):
        image, radius = p.image.copy(), 0.75 * p.width
        for _ in range(number):
            middle = p.at(rng.uniform(0.3, 0.7) if number == 1 else rng.uniform(0.05, 0.95))
            ImageDraw.Draw(image).ellipse([*(middle - radius), *(middle + radius)], fill=(255, 255, 255))
        return image.filter(ImageFilter.GaussianBlur(0.6))

    return change


def patched(p, rng):
    """A patch of the object's own colour beside it, larger than a piece and smaller than the object."""
    image = p.image.copy()
    colour = tuple(int(c) for c in numpy.median(numpy.asarray(p.image)[numpy.asarray(p.mask) > 127], axis=0))
    radius = 1.5 * p.width
    for _ in range(200):
        middle = rng.uniform(radius, SIDE_PX - radius, 2)
        if numpy.linalg.norm(p.line - middle, axis=1).min() > 4 * p.width:
            break
    ImageDraw.Draw(image).ellipse([*(middle - radius), *(middle + radius)], fill=colour)
    return image


def doubled(p, rng):
    """The object once more, mirrored."""
    flipped = p.image.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    mask = p.mask.transpose(Image.Transpose.FLIP_LEFT_RIGHT).point(lambda v: 255 * (v > 127))
    return Image.composite(flipped, p.image, mask)


VARIANTS = {
    "clean": lambda p, rng: p.image,
    "exposure x0.25": exposed(0.25),
    "exposure x0.5": exposed(0.5),
    "exposure x2": exposed(2),
    "exposure x4": exposed(4),
    "gamma 0.6": curved(0.6),
    "gamma 1.6": curved(1.6),
    "warm": balanced(1.25, 1.0, 0.75),
    "cool": balanced(0.75, 1.0, 1.25),
    "green light": balanced(0.85, 1.15, 0.85),
    "noise 10": noisy(10),
    "noise 20": noisy(20),
    "JPEG 30": jpeg(30),
    "JPEG 10": jpeg(10),
    "blur 9 px": moved(9),
    "blur 21 px": moved(21),
    "defocus 2 px": defocused(2),
    "defocus 4 px": defocused(4),
    "half the pixels": coarse,
    "shadow": shadowed,
    "white gripper": across(WHITE, 0.08, 4),
    "grey gripper": across(GREY, 0.08, 4),
    "black gripper": across(BLACK, 0.08, 4),
    "hand across": across(SKIN, 0.10, 12),
    "glint": glints(1),
    "three glints": glints(3),
    "patch of its colour": patched,
    "second object": doubled,
}


def seen(arguments):
    done = subprocess.run([PROGRAM, "mask", *map(str, arguments), "--json"], capture_output=True, text=True, check=False)
    # An object that was not seen, code 3, is a result.
    return json.loads(done.stdout) if done.returncode in (0, 3) else done.stderr.strip().splitlines()[-1]


def rows_of(picture, pair, weights, folder):
    """Error, in lengths, and least score of each variant of a picture; both None if nothing is found."""
    segmenter, tracker = pair.split("+")
    clean, labels = folder / "clean.png", folder / "labels.png"
    picture.image.save(clean)
    picture.mask.save(labels)
    own = [f"    weights: {weights.resolve()}\n"] if weights and segmenter == "learned" else []
    (folder / "base.yaml").write_text("camera:\n  ros__parameters:\n" + f"    segmenter: {segmenter}\n" + "".join(own))
    fitted = seen([clean, "--labels", labels, "--params", folder / "base.yaml", "--out", folder / "out"])
    if isinstance(fitted, str):
        return {variant: {"error": None, "score": None, "certainty": None} for variant in VARIANTS}
    paths = []
    for number, change in enumerate(VARIANTS.values()):
        rng = numpy.random.default_rng([number, *picture.name.encode()])
        paths.append(folder / f"variant_{number}.png")
        change(picture, rng).save(paths[-1])
    answer = seen([*paths, "--params", folder / "out/params.yaml", "--tracker", tracker])
    assert not isinstance(answer, str), answer
    rows = {}
    for name, image in zip(VARIANTS, answer["images"], strict=True):
        found = image["keypoints_px"]
        rows[name] = {"error": None, "score": None, "certainty": image["certainty"]}
        if found:
            rows[name] |= {"error": picture.error(found), "score": min(image["scores"])}
    return rows


def is_failure(row, tolerance=TOLERANCE):
    return row["error"] is None or row["error"] > tolerance


def is_silent(row, sure):
    return row["error"] is not None and is_failure(row) and row["score"] >= sure


def table(every, sure):
    """Failures, and silent ones in brackets, by variant and segmenter. `every` holds the rows of all pictures by segmenter."""
    print("| variant | " + " | ".join(every) + " |\n|---" + "|---" * len(every) + "|")
    shares = {name: [] for name in every}
    for variant in VARIANTS:
        cells = []
        for name, pictures in every.items():
            rows = [rows[variant] for rows in pictures]
            share = [numpy.mean([is_failure(r) for r in rows]), numpy.mean([is_silent(r, sure) for r in rows])]
            shares[name].append(share)
            cells.append(f"{share[0]:.2f} ({share[1]:.2f})")
        print(f"| {variant} | {' | '.join(cells)} |")
    means = [numpy.mean(shares[name], axis=0) for name in every]
    print("| mean | " + " | ".join(f"{a:.2f} ({b:.2f})" for a, b in means) + " |")


def calibration(every):
    """Share of the found ones that are within the tolerance, by score."""
    print(f"\n| score | {' | '.join(every)} |\n|---" + "|---" * len(every) + "|")
    for low in numpy.arange(0.0, 1.0, 0.1):
        cells = []
        for pictures in every.values():
            found = [row for rows in pictures for row in rows.values() if row["error"] is not None]
            of = [not is_failure(row) for row in found if low <= row["score"] < low + 0.1 + 1e-6 * (low > 0.85)]
            cells.append(f"{numpy.mean(of):.2f} of {len(of)}" if of else "-")
        print(f"| {low:.1f} to {low + 0.1:.1f} | {' | '.join(cells)} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=pathlib.Path, required=True)
    parser.add_argument("--pair", nargs="+", default=["colour+geometric", "learned+geometric"])
    parser.add_argument("--whole", action="store_true", help="only pictures of whole objects")
    parser.add_argument("--number", type=int, default=1000, help="first pictures to try")
    parser.add_argument("--sure", type=float, default=0.5, help="score from which keypoints count as sure")
    parser.add_argument("--weights", type=pathlib.Path, help="of the learned segmenter; default: those that are shipped")
    parser.add_argument("--out", type=pathlib.Path)
    arguments = parser.parse_args()
    if any(pair.endswith("+transporter") for pair in arguments.pair):
        sys.exit("--pair: transporter's keypoints have no places of their own on these objects: see episodes.py")
    lines = sorted(arguments.pictures.glob("*_centreline.json"))[: arguments.number]
    if not lines:
        sys.exit(f"--pictures {arguments.pictures}: expected NAME.jpg with NAME_mask.png and NAME_centreline.json, found none")
    every = {name: [] for name in arguments.pair}
    for number, line in enumerate(lines):
        path = line.with_name(line.name.replace("_centreline.json", ".jpg"))
        print(f"picture {number + 1} of {len(lines)}", file=sys.stderr)
        picture = Picture(path)
        if arguments.whole and not picture.is_whole():
            continue
        for name in arguments.pair:
            with tempfile.TemporaryDirectory() as folder:
                rows = rows_of(picture, name, arguments.weights, pathlib.Path(folder))
            every[name].append(rows)
            if arguments.out:
                arguments.out.mkdir(parents=True, exist_ok=True)
                with (arguments.out / "eyes.jsonl").open("a") as file:
                    file.write(json.dumps({"picture": path.stem, "pair": name, "rows": rows}) + "\n")
    print(f"{len(every[arguments.pair[0]])} pictures: failures, and silent ones in brackets\n")
    table(every, arguments.sure)
    calibration(every)
    near = {name: numpy.mean([not is_failure(rows["clean"], 0.1) for rows in pictures]) for name, pictures in every.items()}
    print("\nclean, within 10 % of the length: " + ", ".join(f"{name} {share:.2f}" for name, share in near.items()))


if __name__ == "__main__":
    main()
