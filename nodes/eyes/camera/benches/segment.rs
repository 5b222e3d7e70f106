//! Segmentation of one image of 640 x 480 into a mask of 256 x 256.

use std::hint::black_box;

use camera::{Backend, SegmenterParams};
use catenary_core::{LabelMask, RgbImage, seed};
use criterion::{Criterion, criterion_group, criterion_main};
use rand::RngExt;

#[path = "../src/scene.rs"]
mod scene;

fn segment(c: &mut Criterion) {
    let mut mask = LabelMask::new(256, 256);
    let hanging = scene::Scene::hanging().image(1);
    // Every pixel has its own colour: no block is skipped, and regions are many.
    let mut noise = RgbImage::new(scene::IMAGE_PX[0], scene::IMAGE_PX[1]);
    let mut rng = seed::rng(1, 0);
    noise.data.iter_mut().for_each(|byte| *byte = rng.random());
    for backend in [Backend::Colour, Backend::Learned] {
        let params = SegmenterParams { backend, ..SegmenterParams::default() };
        let mut segmenter =
            params.build::<camera::Error>(|_| unreachable!("no network is loaded")).expect("the defaults are in range");
        for (name, image) in [("hanging", &hanging), ("noise (worst case)", &noise)] {
            c.bench_function(&format!("{}/{name}", backend.name()), |b| {
                b.iter(|| segmenter.segment(black_box(image.view()), &mut mask).expect("the crop lies in the image"))
            });
        }
    }
}

criterion_group!(benches, segment);
criterion_main!(benches);
