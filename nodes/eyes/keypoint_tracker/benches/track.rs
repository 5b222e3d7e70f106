//! Tracking of one mask of 256 x 256.

use std::hint::black_box;

use catenary_core::image::label;
use catenary_core::{LabelMask, seed};
use criterion::{Criterion, criterion_group, criterion_main};
use keypoint_tracker::{Backend, TrackingParams};
use rand::RngExt;

#[path = "../src/drawing.rs"]
mod drawing;

fn track(c: &mut Criterion) {
    let mut bench = |name: &str, mask: &LabelMask| {
        for backend in Backend::ALL {
            let mut tracker =
                TrackingParams { backend, ..TrackingParams::default() }.build().expect("the defaults are in range");
            let name = format!("track/{}/{name}", backend.name());
            c.bench_function(&name, |b| b.iter(|| tracker.track(black_box(mask)).expect("the mask holds labels")));
        }
    };
    let line = drawing::curved([60.0, 100.0], -0.8, 140.0, |s| if s < 70.0 { 0.03 } else { -0.03 });
    let mut mask = drawing::mask_of(&line, 2.15);
    drawing::draw_disc(&mut mask, [200.0, 60.0], 8.0, label::TARGET);
    bench("S of 140 px", &mask);
    let long = drawing::curved([20.0, 60.0], 0.5, 260.0, |s| -0.012 * (s / 40.0).cos());
    let mut mask = drawing::mask_of(&long, 4.0);
    drawing::draw_disc(&mut mask, [200.0, 60.0], 8.0, label::TARGET);
    bench("long and thick", &mask);
    let mut rng = seed::rng(1, 0);
    let mut noise = LabelMask::new(256, 256);
    noise.data.iter_mut().for_each(|label| *label = rng.random_range(0..=2));
    bench("noise (worst case)", &noise);
}

criterion_group!(benches, track);
criterion_main!(benches);
