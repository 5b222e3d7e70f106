"""The segmenter `yolo` beside `ultralytics` itself, on a network of its architecture that is trained here for a few minutes.

    python3 -m venv ENV && ENV/bin/pip install ultralytics onnx onnxruntime      # an environment to be thrown away
    ENV/bin/python tests/bench/eyes/yolo.py [--out DIR] [--pictures 24] [--epochs 25]

`ultralytics` is under the AGPL: nothing of the project depends on it, and no weights of it are shipped. Pictures of a blue bar and a green
ball are drawn; `catenary label --yolo` labels them by colour; yolov8n-seg is trained from random weights and exported to ONNX. Then the
masks of new pictures by `catenary mask --segmenter yolo` are compared with those of `ultralytics`, and both with the truth.
"""

import argparse
import json
import os
import pathlib
import subprocess
import tempfile

import numpy
import onnxruntime
from PIL import Image, ImageDraw
from ultralytics import YOLO

ROOT = pathlib.Path(__file__).resolve().parents[3]
PROGRAM = os.environ.get("CATENARY_PROGRAM", ROOT / "target/release/catenary")
SIDE = 480
BAR, BALL = (48, 92, 200), (40, 160, 70)


def draw(rng):
    """Picture of a bar and a ball, with the true masks of both."""
    wall = tuple(int(c) for c in rng.integers(130, 235) + rng.integers(-12, 12, 3))
    image, masks = Image.new("RGB", (SIDE, SIDE), wall), [Image.new("L", (SIDE, SIDE)) for _ in range(2)]
    start, heading, turn = rng.uniform(120, 360, 2), rng.uniform(0, 2 * numpy.pi), rng.uniform(-0.09, 0.09)
    angles = heading + turn * numpy.arange(40)
    line = [tuple(p) for p in start + 5.5 * numpy.cumsum(numpy.column_stack([numpy.cos(angles), numpy.sin(angles)]), axis=0)]
    centre = rng.uniform(60, SIDE - 60, 2)
    disc = [*(centre - 16), *(centre + 16)]
    for target, colour in ((image, BAR), (masks[0], 255)):
        ImageDraw.Draw(target).line(line, fill=colour, width=13, joint="curve")
    for target, colour in ((image, BALL), (masks[0], 0), (masks[1], 255)):
        ImageDraw.Draw(target).ellipse(disc, fill=colour)
    noise = rng.normal(0, 5, (SIDE, SIDE, 3))
    return Image.fromarray((numpy.asarray(image) + noise).clip(0, 255).astype("uint8")), [numpy.asarray(m) > 127 for m in masks]


def catenary(*arguments):
    done = subprocess.run([PROGRAM, *map(str, arguments), "--json"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def runtime():
    """Shared library of the ONNX Runtime in its Python package."""
    return next(pathlib.Path(onnxruntime.__file__).parent.glob("capi/libonnxruntime.so*"))


def iou(a, b):
    return numpy.count_nonzero(a & b) / max(1, numpy.count_nonzero(a | b))


def union(result, number):
    """Mask of all detections of a class, in the size of the picture."""
    mask = numpy.zeros((SIDE, SIDE), bool)
    if result.masks is not None:
        for plane, kind in zip(result.masks.data.numpy(), result.boxes.cls.numpy(), strict=True):
            if int(kind) == number:
                mask |= numpy.asarray(Image.fromarray(plane.astype("uint8") * 255).resize((SIDE, SIDE))) > 127
    return mask


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=int, default=24)
    parser.add_argument("--epochs", type=int, default=25)
    parser.add_argument("--out", type=pathlib.Path)
    arguments = parser.parse_args()
    folder = (arguments.out or pathlib.Path(tempfile.mkdtemp())).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    rng = numpy.random.default_rng(1)
    paths = []
    for number in range(arguments.pictures):
        paths.append(folder / f"frame_{number:03}.png")
        draw(rng)[0].save(paths[-1])
    catenary("label", *paths, "--yolo", "--out", folder / "set")
    # Relative paths of the description begin at its folder.
    network = YOLO("yolov8n-seg.yaml")
    network.train(
        data=folder / "set/data.yaml", epochs=arguments.epochs, imgsz=256, batch=8, workers=0, device="cpu", project=str(folder), name="run"
    )
    best = YOLO(folder / "run/weights/best.pt")
    file = best.export(format="onnx", imgsz=256)
    parameters = {"segmenter": "yolo", "yolo.network": str(file), "yolo.runtime": str(runtime())}
    text = "".join(f"    {name}: {value}\n" for name, value in parameters.items())
    (folder / "yolo.yaml").write_text(f"camera:\n  ros__parameters:\n{text}")
    rows = []
    for number in range(20):
        picture, truth = draw(rng)
        path = folder / f"new_{number:03}.png"
        picture.save(path)
        catenary("label", path, "--params", folder / "yolo.yaml", "--out", folder / f"labels_{number:03}")
        ours = numpy.asarray(Image.open(folder / f"labels_{number:03}/000_mask.png"))
        (theirs,) = best.predict(picture.resize((256, 256), Image.Resampling.BILINEAR), imgsz=256, conf=0.25, iou=0.7, verbose=False)
        masks = [(ours == 255, union(theirs, 0)), (ours == 128, union(theirs, 1))]
        rows.append([[iou(a, b), iou(a, t), iou(b, t)] for (a, b), t in zip(masks, truth, strict=True)])
    means = numpy.mean(rows, axis=0)
    print("| class | IoU of catenary and ultralytics | of catenary and the truth | of ultralytics and the truth |\n|---|---|---|---|")
    for name, values in zip(("object", "target"), means, strict=True):
        print(f"| {name} | " + " | ".join(f"{value:.3f}" for value in values) + " |")


if __name__ == "__main__":
    main()
