"""`catenary mask` shows what camera and tracker see and fits colours; `label` and `train-segmenter` teach the learned segmenter."""

import json

import numpy
import pytest
import yaml
from PIL import Image, ImageDraw

BLUE, GREY, GREEN, WALL = (48, 92, 200), (120, 118, 121), (40, 160, 70), (214, 208, 200)
LINE = [(320 + 110 * t, 130 + 190 * t - 60 * t * t) for t in numpy.linspace(0, 1, 30)]


# Exit code of pictures without an object, and of colours that are hardly those of one.
UNSEEN = 3


def draw(path, colour=BLUE, size=(640, 480), width=11, wall=WALL):
    """A picture with a bar and a target, with the noise of a camera."""
    image = Image.new("RGB", size, wall)
    pen = ImageDraw.Draw(image)
    pen.line(LINE, fill=colour, width=width, joint="curve")
    pen.ellipse((455, 355, 485, 385), fill=GREEN)
    noise = numpy.random.default_rng(1).normal(0, 4, (*size[::-1], 3))
    Image.fromarray((numpy.asarray(image) + noise).clip(0, 255).astype("uint8")).save(path)
    return path


@pytest.fixture
def picture(tmp_path):
    return draw(tmp_path / "bar.png")


@pytest.fixture
def refused(program, tmp_path):
    """Runs a command that has to be refused with one line that holds all of `says`."""

    def run(*arguments, says):
        done = program(*arguments, folder=tmp_path)
        lines = done.stderr.splitlines()
        assert done.returncode in (1, 2) and done.stdout == "" and len(lines) == 1, done.stderr
        for part in says:
            assert part in lines[0], done.stderr

    return run


def unseen(program, *arguments, folder):
    """Document that `--json` prints in a run that has to end with the exit code of an object that was not seen."""
    done = program(*arguments, "--json", folder=folder)
    assert done.returncode == UNSEEN, (done.returncode, done.stderr)
    return json.loads(done.stdout)


def farthest(image):
    """Greatest distance of a keypoint from its place, px."""
    line = numpy.array(LINE)
    arc = numpy.concatenate([[0], numpy.cumsum(numpy.linalg.norm(numpy.diff(line, axis=0), axis=1))])
    places = [[numpy.interp(f * arc[-1], arc, line[:, i]) for i in range(2)] for f in (0.125, 0.375, 0.625, 0.875)]
    return numpy.linalg.norm(numpy.array(image["keypoints_px"]) - places, axis=1).max()


@pytest.mark.parametrize("segmenter", ["colour", "learned"])
def test_the_object_is_seen_and_drawn_over_the_picture(program, picture, tmp_path, segmenter):
    said = program.json("mask", picture, "--segmenter", segmenter, "--out", "seen", folder=tmp_path)
    (image,) = said["images"]
    assert image["object_found"] and image["target_found"] and image["pieces"] == 1
    assert min(image["scores"]) > 0.5 and farthest(image) < 12, image
    assert Image.open(tmp_path / image["picture"]).size == (640, 480)
    assert said["fits"] == [] and said["params"] is None


@pytest.mark.parametrize("segmenter", ["colour", "learned"])
def test_a_click_gives_parameters_that_find_another_object(program, tmp_path, segmenter):
    red = draw(tmp_path / "red.png", (200, 60, 50))
    click = "{:.0f},{:.0f}".format(*LINE[14])
    blind = unseen(program, "mask", red, "--segmenter", "colour", folder=tmp_path)
    assert not blind["images"][0]["object_found"] and "nothing has its colours" in blind["images"][0]["reason"]
    fitted = program.json("mask", red, "--segmenter", segmenter, "--click", click, "--out", "fit", folder=tmp_path)
    assert [fit["label"] for fit in fitted["fits"]] == ["dlo"]
    file = yaml.safe_load((tmp_path / fitted["params"]).read_text())
    assert file["camera"]["ros__parameters"]["segmenter"] == segmenter
    seen = program.json("mask", red, "--params", fitted["params"], folder=tmp_path)
    assert farthest(seen["images"][0]) < 12, seen


@pytest.mark.parametrize("segmenter", ["colour", "learned"])
def test_fitted_colours_hold_in_other_light(program, tmp_path, segmenter):
    red = draw(tmp_path / "red.png", (200, 60, 50))
    click = "{:.0f},{:.0f}".format(*LINE[14])
    base = tmp_path / "base.yaml"
    base.write_text(f"camera: {{ros__parameters: {{segmenter: {segmenter}, max_occlusion_px: 25, min_probability: 0.4}}}}")
    fit = program.json("mask", red, "--params", base, "--click", click, "--out", "fit", folder=tmp_path)
    file = yaml.safe_load((tmp_path / fit["params"]).read_text())["camera"]["ros__parameters"]
    # What the first file gives stays.
    assert (file["max_occlusion_px"], file["min_probability"], len(file["light_reference"])) == (25, 0.4, 21)
    lamp = numpy.asarray(Image.open(red), float) * [0.55, 0.4, 0.25]
    Image.fromarray(lamp.clip(0, 255).astype("uint8")).save(tmp_path / "lamp.png")
    seen = program.json("mask", "lamp.png", "--params", fit["params"], folder=tmp_path)
    assert farthest(seen["images"][0]) < 12, seen


def test_a_setting_that_finds_a_thin_cable_is_tried_and_written(program, tmp_path):
    thin = [draw(tmp_path / f"thin_{width}.png", width=width) for width in (2,)]
    said = unseen(program, "mask", *thin, "--out", "seen", folder=tmp_path)
    for image in said["images"]:
        assert not image["object_found"] and "open_radius_px: 1" in image["reason"], image
    other = said["other"]
    assert other["parameters"] == ["open_radius_px: 0"] and other["images"] == [str(p) for p in thin] and other["tried"] == 1
    seen = program.json("mask", *thin, "--params", said["params"], folder=tmp_path)
    assert all(farthest(image) < 12 for image in seen["images"]) and seen["other"] is None, seen
    words = program("mask", *thin, folder=tmp_path)
    assert words.returncode == UNSEEN and "open_radius_px: 0" in words.stdout, words
    assert words.stderr == "catenary: no object in 1 of 1 images\n"


@pytest.mark.parametrize("segmenter", ["colour", "learned"])
def test_a_click_on_a_wall_is_doubted(program, tmp_path, segmenter):
    walled = draw(tmp_path / "wall.png", wall=(206, 150, 120))
    for click in ("150,60", "560,440"):
        said = unseen(program, "mask", walled, "--segmenter", segmenter, "--click", click, "--out", "fit", folder=tmp_path)
        doubts = "; ".join(said["fits"][0]["doubts"])
        assert "of the mask" in doubts or not said["images"][0]["object_found"], said
        if segmenter == "colour":
            assert "covers" in doubts and "borders" in doubts, said
    words = program("mask", walled, "--click", "150,60", folder=tmp_path)
    assert words.returncode == UNSEEN and "DOUBTFUL" in words.stdout and "hardly it" in words.stderr, words


def test_a_grey_object_needs_the_learned_segmenter(program, refused, tmp_path):
    grey = draw(tmp_path / "grey.png", GREY)
    click = "{:.0f},{:.0f}".format(*LINE[14])
    refused("mask", grey, "--click", click, says=["--click", "grey.png", "grey", "learned"])
    seen = program.json("mask", grey, "--segmenter", "learned", "--click", click, folder=tmp_path)
    assert farthest(seen["images"][0]) < 12, seen


def test_bad_input_is_named(refused, picture, tmp_path):
    (tmp_path / "text.png").write_text("no picture")
    draw(tmp_path / "small.png", size=(320, 240))
    (tmp_path / "short.bin").write_bytes(b"1234")
    (tmp_path / "weights.yaml").write_text("camera: {ros__parameters: {segmenter: learned, weights: short.bin}}")
    (tmp_path / "wrong.yaml").write_text("camera: {ros__parameters: {dlo.clicked_rgb: [1.0, 2.0]}}")
    refused("mask", says=["PICTURE"])
    refused("mask", "text.png", says=["text.png", "PNG or JPEG"])
    refused("mask", picture, "--click", "640,1", says=["--click", "640 x 480", "640,1"])
    refused("mask", picture, "--click", "here", says=["--click", "U,V"])
    refused("mask", picture, "--labels", "small.png", says=["--labels", "640 x 480", "320 x 240"])
    refused("mask", picture, "--params", "weights.yaml", says=["short.bin", "expected", "4 bytes"])
    refused("mask", picture, "--params", "wrong.yaml", says=["dlo.clicked_rgb", "red, green and blue"])
    (tmp_path / "light.yaml").write_text("camera: {ros__parameters: {light_reference: [1.0, 2.0]}}")
    refused("mask", picture, "--params", "light.yaml", says=["light_reference", "7 rising levels", "[1.0, 2.0]"])
    refused("mask", "--bag", tmp_path / "absent", says=["absent"])
    refused("mask", picture, "--segmenter", "yolo", says=["yolo.network", "ONNX file", "none"])
    (tmp_path / "yolo.yaml").write_text("camera: {ros__parameters: {segmenter: yolo, yolo.network: short.bin, yolo.runtime: absent.so}}")
    refused("mask", picture, "--params", "yolo.yaml", says=["yolo.runtime", "shared library", "absent.so"])


def test_labels_are_written_once_and_train_weights_that_the_camera_takes(program, refused, picture, tmp_path):
    said = program.json("label", picture, "--out", "frames", folder=tmp_path)
    assert said["frames"] == 1 and said["empty"] == 0
    levels = numpy.asarray(Image.open(tmp_path / "frames/000_mask.png"))
    assert levels.shape == (480, 480) and set(numpy.unique(levels)) == {0, 128, 255}
    refused("label", picture, "--out", "frames", says=["--out frames", "without labels"])
    trained = program.json("train-segmenter", "--frames", "frames", "--steps", 2, "--out", "weights.bin", folder=tmp_path, seconds=300)
    assert trained["steps"] == 2 and trained["frames"] == 1 and trained["loss"] > 0
    (tmp_path / "own.yaml").write_text("camera: {ros__parameters: {segmenter: learned, weights: weights.bin}}")
    seen = program.json("mask", picture, "--params", "own.yaml", folder=tmp_path)
    assert farthest(seen["images"][0]) < 12, seen
    refused("train-segmenter", "--frames", tmp_path, "--out", "other.bin", says=["--frames", "_mask.png", "found none"])


def test_a_data_set_for_yolo_has_polygons_of_object_and_target(program, refused, picture, tmp_path):
    said = program.json("label", *[picture] * 5, "--yolo", "--out", "set", folder=tmp_path)
    assert said["frames"] == 5 and said["empty"] == 0
    assert yaml.safe_load((tmp_path / "set/data.yaml").read_text())["names"] == {0: "object", 1: "target"}
    assert len(list((tmp_path / "set/images/train").iterdir())) == 12 and len(list((tmp_path / "set/images/val").iterdir())) == 1
    label = (tmp_path / "set/labels/val/004_0.txt").read_text().splitlines()
    assert [line[0] for line in label] == ["0", "1"]
    # The outline of the target's disc, in shares of the square in the middle.
    corners = numpy.array(label[1].split()[1:], float).reshape(-1, 2) * 480 + [80, 0]
    assert abs(corners.mean(axis=0) - [470, 370]).max() < 4
    assert Image.open(tmp_path / "set/images/val/004_0.png").size == (256, 256)
    refused("label", picture, "--yolo", "--out", "set", says=["--out set", "data.yaml"])
