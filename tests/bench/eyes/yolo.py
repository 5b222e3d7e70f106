"""The segmenter `yolo` beside `ultralytics` itself, on a network of its architecture that is trained here for a few minutes.

    python3 -m venv ENV && ENV/bin/pip install ultralytics onnx onnxruntime      # an environment to be thrown away
    ENV/bin/python tests/bench/eyes/yolo.py [--out DIR] [--pictures 24] [--epochs 25]

`ultralytics` is under the AGPL: nothing of the project depends on it, and no weights of it are shipped. Pictures of a blue bar and a green
ball are drawn; `catenary label --yolo` labels them by colour; yolov8n-seg is trained from random weights and exported to ONNX. Then the
masks of new pictures by the segmenter are compared with those of `ultralytics`, from the same pixels. The network has seen too little to be
good: detections from a confidence of 0.02 on count, and what is compared is the reading of its numbers.
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
SIDE = 256
CONFIDENCE, OVERLAP = 0.02, 0.7
BAR, BALL = (48, 92, 200), (40, 160, 70)


def draw(rng):
    """Picture of a bar and a ball."""
    wall = tuple(int(c) for c in rng.integers(130, 235) + rng.integers(-12, 12, 3))
    image = Image.new("RGB", (SIDE, SIDE), wall)
    start, heading, turn = rng.uniform(64, 192, 2), rng.uniform(0, 2 * numpy.pi), rng.uniform(-0.09, 0.09)
    angles = heading + turn * numpy.arange(40)
    line = [tuple(p) for p in start + 3 * numpy.cumsum(numpy.column_stack([numpy.cos(angles), numpy.sin(angles)]), axis=0)]
    centre = rng.uniform(32, SIDE - 32, 2)
    disc = [*(centre - 9), *(centre + 9)]
    ImageDraw.Draw(image).line(line, fill=BAR, width=7, joint="curve")
    ImageDraw.Draw(image).ellipse(disc, fill=BALL)
    noise = rng.normal(0, 5, (SIDE, SIDE, 3))
    return Image.fromarray((numpy.asarray(image) + noise).clip(0, 255).astype("uint8"))


def catenary(*arguments):
    done = subprocess.run([PROGRAM, *map(str, arguments), "--json"], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def runtime():
    """Shared library of the ONNX Runtime in its Python package."""
    return next(pathlib.Path(onnxruntime.__file__).parent.glob("capi/libonnxruntime.so*"))


def iou(a, b):
    either = numpy.count_nonzero(a | b)
    return numpy.count_nonzero(a & b) / either if either else 1.0


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
        draw(rng).save(paths[-1])
    catenary("label", *paths, "--yolo", "--out", folder / "set")
    # Relative paths of the description begin at its folder.
    network = YOLO("yolov8n-seg.yaml")
    sizes = {"epochs": arguments.epochs, "imgsz": SIDE, "batch": 8, "workers": 0, "device": "cpu"}
    network.train(data=folder / "set/data.yaml", project=str(folder), name="run", **sizes)
    file = YOLO(folder / "run/weights/best.pt").export(format="onnx", imgsz=SIDE)
    best = YOLO(file, task="segment")
    rows = []
    for number in range(20):
        path = folder / f"new_{number:03}.png"
        draw(rng).save(path)
        (theirs,) = best.predict(Image.open(path), imgsz=SIDE, conf=CONFIDENCE, iou=OVERLAP, verbose=False)
        rows.append([iou(ours(folder, file, path, kind), union(theirs, kind)) for kind in (0, 1)])
    print("| class | mean overlap of the masks by catenary and by ultralytics (IoU) | least |\n|---|---|---|")
    for name, values in zip(("object", "target"), numpy.transpose(rows), strict=True):
        print(f"| {name} | {values.mean():.3f} | {values.min():.3f} |")


def ours(folder, network, picture, kind):
    """Mask of all detections of a class, by the segmenter."""
    parameters = {
        "segmenter": "yolo",
        "yolo.network": network,
        "yolo.runtime": runtime(),
        "yolo.min_confidence": CONFIDENCE,
        "yolo.max_overlap": OVERLAP,
        "yolo.object_class": kind,
        "yolo.target_class": -1,
        # All pieces count, whatever lies between.
        "max_occlusion_px": 255,
        "min_piece_area_px": 1,
        "min_area_px": 1,
    }
    text = "".join(f"    {name}: {value}\n" for name, value in parameters.items())
    (folder / "yolo.yaml").write_text(f"camera:\n  ros__parameters:\n{text}")
    out = folder / f"labels_{picture.stem}_{kind}"
    catenary("label", picture, "--params", folder / "yolo.yaml", "--out", out)
    return numpy.asarray(Image.open(out / "000_mask.png")) == 255


if __name__ == "__main__":
    main()
