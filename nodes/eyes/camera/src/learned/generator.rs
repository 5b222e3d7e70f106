//! Synthetic pictures of a line-like object, for the training of the learned segmenter.
//!
//! A picture is drawn as a camera in a laboratory might see it, and worse: any colours, light, white balance, blur and noise; grippers,
//! hands and reflections in front of the object; shadows, and other lines beside it. Nothing of a real picture is in it.

mod colours;
mod curve;
mod light;
mod paint;

use catenary_core::image::label;
use rand::{Rng, RngExt};

use super::size::SIDE;

use self::colours::{any_colour, distance};
use self::curve::{Curve, Strip};
use self::light::Light;
use self::paint::{Canvas, Fill};

/// Picture with its labels, and the colours that a user clicked on, perhaps in other light.
#[derive(Debug, Clone)]
pub struct Picture {
    /// RGB, 0 to 1, row by row.
    pub pixels: Vec<[f32; 3]>,
    /// Labels, row by row.
    pub labels: Vec<u8>,
    /// Colour of the object, and of the target, at a click.
    pub clicked: [[f32; 3]; 2],
}

impl Picture {
    /// Draws a picture from a stream of random numbers.
    pub fn draw(rng: &mut impl Rng) -> Self {
        let mut canvas = Canvas::background(rng);
        let object = any_colour(rng);
        let target = loop {
            let colour = any_colour(rng);
            if distance(colour, object) > 0.35 {
                break colour;
            }
        };
        clutter(&mut canvas, object, target, rng);
        let has_object = rng.random_bool(0.95);
        let line = Curve::draw(rng);
        let half_width = rng.random_range(1.2_f32..7.0);
        if has_object {
            if rng.random_bool(0.5) {
                let offset = [rng.random_range(-12.0..12.0), rng.random_range(2.0..14.0)];
                canvas.shadow(&Strip::of(&line.moved(offset), half_width), rng.random_range(0.4..0.9));
            }
            let look = Fill::of_line(object, rng);
            canvas.strip(&Strip::of(&line, half_width), &look, Some(label::DLO), rng);
            if rng.random_bool(0.35) {
                plugs(&mut canvas, &line, half_width, rng);
            }
            // Another object of the same kind: which one is meant cannot be seen, so that it has the label, too.
            if rng.random_bool(0.08) {
                canvas.strip(&Strip::of(&Curve::draw(rng), half_width), &look, Some(label::DLO), rng);
            }
        }
        if rng.random_bool(0.7) {
            let centre = [0, 1].map(|_| rng.random_range(20.0..SIDE as f32 - 20.0));
            canvas.ball(centre, rng.random_range(4.0..14.0), target, Some(label::TARGET));
        }
        in_front(&mut canvas, &line, half_width, object, rng);
        if rng.random_bool(0.2) {
            canvas.shade(line.at(rng.random_range(0.0..1.0)), rng);
        }
        let light = Light::draw(rng);
        let pixels = light.seen(&canvas.pixels, rng);
        // Most clicks are known in the light of the picture, up to the error of [`crate::LightReference`]; others were made in other,
        // milder light.
        let then = if rng.random_bool(0.7) { light.nearly(rng) } else { Light::draw_mild(rng) };
        let clicked = [object, target].map(|colour| then.of_colour(colour, rng));
        Self { pixels, labels: canvas.labels, clicked }
    }
}

/// Picture of what a camera saw, as it might see it in slightly other light.
pub(super) fn seen_in_other_light(
    pixels: &[[f32; 3]],
    labels: Vec<u8>,
    clicked: [[f32; 3]; 2],
    rng: &mut impl Rng,
) -> Picture {
    let pixels = Light::draw_mild(rng).seen(pixels, rng);
    let clicked = clicked.map(|colour| Light::draw_mild(rng).of_colour(colour, rng));
    Picture { pixels, labels, clicked }
}

/// Colour that differs from the object's.
fn other_colour(object: [f32; 3], rng: &mut impl Rng) -> [f32; 3] {
    loop {
        let colour = any_colour(rng);
        if distance(colour, object) > 0.2 {
            return colour;
        }
    }
}

/// Line of another colour, perhaps with plugs at its ends.
fn other_line(canvas: &mut Canvas, object: [f32; 3], label: Option<u8>, rng: &mut impl Rng) {
    let (line, half_width) = (Curve::draw(rng), rng.random_range(0.8..6.0));
    let look = Fill::of_line(other_colour(object, rng), rng);
    canvas.strip(&Strip::of(&line, half_width), &look, label, rng);
    if rng.random_bool(0.3) {
        plugs(canvas, &line, half_width, rng);
    }
}

/// Plugs or bare strands beyond one or both ends of a line.
fn plugs(canvas: &mut Canvas, line: &Curve, half_width: f32, rng: &mut impl Rng) {
    let colour = any_colour(rng);
    for end in 0..2 {
        if rng.random_bool(0.8) {
            let plug = line.beyond(end == 1, rng.random_range(1.0..5.0) * half_width);
            let width = half_width * rng.random_range(0.6..1.3);
            canvas.strip(&Strip::of(&plug, width), &Fill::of_line(colour, rng), Some(label::BACKGROUND), rng);
        }
    }
}

/// Things behind the object: boards, strokes, holes, other lines, and patches of the object's own colour.
fn clutter(canvas: &mut Canvas, object: [f32; 3], target: [f32; 3], rng: &mut impl Rng) {
    for _ in 0..rng.random_range(0..4) {
        canvas.polygon(&polygon(rng), any_colour(rng), None);
    }
    if rng.random_bool(0.08) {
        canvas.holes(any_colour(rng), rng);
    }
    if rng.random_bool(0.06) {
        // A picture of strokes below the object.
        let palette: [[f32; 3]; 4] = std::array::from_fn(|_| other_colour(object, rng));
        for k in 0..30 {
            let strip = Strip::of(&Curve::draw(rng), rng.random_range(0.5..2.5));
            canvas.strip(&strip, &Fill::of_line(palette[k % 4], rng), None, rng);
        }
    }
    for _ in 0..rng.random_range(0..6) {
        other_line(canvas, object, None, rng);
    }
    for colour in [object, target] {
        if rng.random_bool(0.15) {
            let shape = if colour == object { blob(rng) } else { polygon(rng) };
            canvas.polygon(&shape, colour, None);
        }
    }
}

/// Things in front of the object: gripper, hand, boards and reflections.
fn in_front(canvas: &mut Canvas, line: &Curve, half_width: f32, object: [f32; 3], rng: &mut impl Rng) {
    if rng.random_bool(0.5) {
        let at = if rng.random_bool(0.6) { 0.0 } else { rng.random_range(0.1..0.9) };
        gripper(canvas, line, at, half_width, rng);
    }
    if rng.random_bool(0.25) {
        other_line(canvas, object, Some(label::BACKGROUND), rng);
    }
    if rng.random_bool(0.15) {
        let skin = [rng.random_range(0.55..0.95), rng.random_range(0.38..0.75), rng.random_range(0.28..0.65)];
        let arm = Curve::through(line.at(rng.random_range(0.1..0.9)), rng);
        canvas.strip(
            &Strip::of(&arm, rng.random_range(7.0..22.0)),
            &Fill::of_line(skin, rng),
            Some(label::BACKGROUND),
            rng,
        );
    }
    if rng.random_bool(0.1) {
        let middle = line.at(rng.random_range(0.0..1.0));
        let near = blob(rng).map(|p| [p[0] - 128.0 + middle[0], p[1] - 128.0 + middle[1]]);
        canvas.polygon(&near, any_colour(rng), Some(label::BACKGROUND));
    }
    for _ in 0..rng.random_range(0..4) {
        if rng.random_bool(0.4) {
            // A reflection is still the object.
            canvas.glint(line.at(rng.random_range(0.0..1.0)), half_width * rng.random_range(0.5..1.6));
        }
    }
}

/// Hand and two fingers of a gripper at a fraction of the line, white, grey or black.
fn gripper(canvas: &mut Canvas, line: &Curve, at: f32, half_width: f32, rng: &mut impl Rng) {
    let grey = if rng.random_bool(0.5) { rng.random_range(0.8..1.0) } else { rng.random_range(0.05..0.8) };
    let colour = [0, 1, 2].map(|_| (grey + rng.random_range(-0.03_f32..0.03)).clamp(0.0, 1.0));
    let (middle, angle) = (line.at(at), rng.random_range(0.0..std::f32::consts::TAU));
    let (sin, cos) = angle.sin_cos();
    let place =
        |along: f32, across: f32| [middle[0] + along * cos - across * sin, middle[1] + along * sin + across * cos];
    let (reach, hand) = (rng.random_range(4.0..20.0_f32), rng.random_range(10.0..45.0_f32));
    let thick = half_width + rng.random_range(1.0..9.0_f32);
    canvas.polygon(
        &[place(-reach, -thick), place(reach, -thick), place(reach, thick), place(-reach, thick)],
        colour,
        Some(label::BACKGROUND),
    );
    let far = reach + 2.0 * hand;
    canvas.polygon(
        &[place(reach, -hand), place(far, -hand), place(far, hand), place(reach, hand)],
        colour,
        Some(label::BACKGROUND),
    );
}

fn polygon(rng: &mut impl Rng) -> [[f32; 2]; 4] {
    let (middle, half) =
        ([0, 1].map(|_| rng.random_range(0.0..256.0_f32)), [0, 1].map(|_| rng.random_range(6.0..110.0_f32)));
    let (sin, cos) = rng.random_range(0.0..std::f32::consts::TAU).sin_cos();
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[a, b]: [f32; 2]| {
        let (x, y) = (a * half[0], b * half[1]);
        [middle[0] + x * cos - y * sin, middle[1] + x * sin + y * cos]
    })
}

/// Patch about as wide as long, in the middle of the picture.
fn blob(rng: &mut impl Rng) -> [[f32; 2]; 4] {
    let half = rng.random_range(4.0..26.0_f32);
    let (sin, cos) = rng.random_range(0.0..std::f32::consts::TAU).sin_cos();
    let shift = [0, 1].map(|_| rng.random_range(40.0..216.0_f32));
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[a, b]: [f32; 2]| {
        let (x, y) = (a * half * rng.random_range(0.7..1.3), b * half * rng.random_range(0.7..1.3));
        [shift[0] + x * cos - y * sin, shift[1] + x * sin + y * cos]
    })
}
