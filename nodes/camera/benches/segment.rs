//! Segmentation of one image of 640 x 480 into a mask of 256 x 256.

use std::hint::black_box;

use camera::{ColourParams, ColourSegmenter, Segmenter};
use catenary_core::{LabelMask, RgbImage, seed};
use criterion::{Criterion, criterion_group, criterion_main};
use rand::RngExt;

#[path = "../src/scene.rs"]
mod scene;

fn segment(c: &mut Criterion) {
    let mut mask = LabelMask::new(256, 256);
    let mut segmenter = ColourSegmenter::new(ColourParams::default()).expect("the defaults are in range");
    let mut bench = |name: &str, image: &RgbImage| {
        c.bench_function(name, |b| {
            b.iter(|| segmenter.segment(black_box(image.view()), &mut mask).expect("the crop lies in the image"))
        });
    };
    bench("segment/hanging", &scene::Scene::hanging().image(1));
    // Every pixel has its own colour: no block is skipped, and regions are many.
    let mut noise = RgbImage::new(scene::IMAGE_PX[0], scene::IMAGE_PX[1]);
    let mut rng = seed::rng(1, 0);
    noise.data.iter_mut().for_each(|byte| *byte = rng.random());
    bench("segment/noise (worst case)", &noise);
}

criterion_group!(benches, segment);
criterion_main!(benches);
