//! Morphology, connected regions and distance transform: the code of `camera`, `core` and `keypoint_tracker` against
//! imageproc, on one mask.
//!
//!     MASK=PATH.png cargo bench --manifest-path tests/bench/imageproc/Cargo.toml
//!
//! Without `MASK`, a drawn bar of 640 x 480. Before it measures, it checks in which pixels the results differ.

use std::hint::black_box;

use catenary_core::LabelMask;
use catenary_core::regions::Regions;
use criterion::{Criterion, criterion_group, criterion_main};
use image::{GrayImage, Luma};
use imageproc::distance_transform::{Norm, distance_transform};
use imageproc::morphology::{close_mut, open_mut};
use imageproc::region_labelling::{Connectivity, connected_components};
use keypoint_tracker::TrackerParams;

#[path = "../../../../nodes/eyes/keypoint_tracker/src/geometric_tracker/distance.rs"]
#[allow(dead_code, unused_imports, reason = "the tracker uses the rest")]
mod distance;
#[path = "../../../../nodes/eyes/camera/src/colour_segmenter/morphology.rs"]
#[allow(dead_code, reason = "the segmenter uses the rest")]
mod morphology;
#[path = "../../../../nodes/eyes/keypoint_tracker/src/geometric_tracker/pieces.rs"]
#[allow(dead_code, unused_imports, reason = "the tracker uses the rest")]
mod pieces;

/// Mask from the file `MASK`, or a drawn one, as 0 and 1.
fn mask() -> LabelMask {
    if let Some(path) = std::env::var_os("MASK") {
        let image = image::open(&path).expect("MASK is an image").into_luma8();
        let data = image.pixels().map(|p| u8::from(p.0[0] > 127)).collect();
        return LabelMask::from_data(image.width(), image.height(), data).expect("an image has its size");
    }
    let mut mask = LabelMask::new(640, 480);
    for (i, label) in mask.data.iter_mut().enumerate() {
        let (u, v) = ((i % 640) as f64, (i / 640) as f64);
        // An arc of half width 5 px, and specks.
        let apart = (u - 320.0).hypot(v - 40.0) - 300.0;
        *label = u8::from((apart.abs() < 5.0 && v > 150.0) || (i * 7919) % 1009 == 0);
    }
    mask
}

/// The mask as an image of 0 and 255.
fn gray(mask: &LabelMask) -> GrayImage {
    GrayImage::from_fn(mask.width, mask.height, |u, v| Luma([255 * mask.at(u, v)]))
}

/// Number of pixels that differ between closing and opening here and in imageproc, also without the image's border.
fn differing(mask: &LabelMask) -> (usize, usize) {
    let (mut plane, mut image) = (morphology::Plane::default(), gray(mask));
    plane.load(mask, 1, |class| class == 1);
    plane.close(1);
    plane.open(1);
    close_mut(&mut image, Norm::L1, 1);
    open_mut(&mut image, Norm::L1, 1);
    let (width, height) = (mask.width, mask.height);
    let differs = |u: u32, v: u32| (plane.row(v as usize)[u as usize] == 1) != (image.get_pixel(u, v).0[0] == 255);
    let count = |margin: u32| {
        let rows = margin..height - margin;
        rows.map(|v| (margin..width - margin).filter(|&u| differs(u, v)).count()).sum()
    };
    (count(0), count(3))
}

fn masks(c: &mut Criterion) {
    let mask = mask();
    let (all, inner) = differing(&mask);
    println!("{} x {}: {all} pixels differ, {inner} of them 3 px or more from the border", mask.width, mask.height);
    let image = gray(&mask);
    let background = GrayImage::from_fn(mask.width, mask.height, |u, v| Luma([255 * (1 - mask.at(u, v))]));

    let mut group = c.benchmark_group("closing and opening");
    let mut plane = morphology::Plane::default();
    group.bench_function("ours", |b| {
        b.iter(|| {
            plane.load(black_box(&mask), 1, |class| class == 1);
            plane.close(1);
            plane.open(1);
        });
    });
    group.bench_function("imageproc", |b| {
        b.iter(|| {
            let mut image = black_box(&image).clone();
            close_mut(&mut image, Norm::L1, 1);
            open_mut(&mut image, Norm::L1, 1);
            image
        });
    });
    group.finish();

    let mut group = c.benchmark_group("regions");
    let mut regions = Regions::default();
    group.bench_function("ours", |b| b.iter(|| regions.find(black_box(&mask), 1).len()));
    // Areas, centroids, bounding boxes and lists of pixels, which ours returns, would cost another pass.
    group.bench_function("imageproc", |b| {
        b.iter(|| connected_components(black_box(&image), Connectivity::Eight, Luma([0])));
    });
    group.finish();

    let mut group = c.benchmark_group("distance");
    let (mut pieces, mut distance) = (pieces::Pieces::default(), distance::Distance::default());
    pieces.load(&mask, &mut regions, &TrackerParams::default());
    group.bench_function("ours", |b| b.iter(|| distance.measure(black_box(&pieces))));
    group.bench_function("imageproc", |b| b.iter(|| distance_transform(black_box(&background), Norm::L2)));
    group.finish();
}

criterion_group!(benches, masks);
criterion_main!(benches);
