//! Segmentation of drawn scenes whose masks are known.

use super::*;
use crate::scene::{IMAGE_PX, Scene};
use catenary_core::{RgbImage, seed};
use rand::RngExt;

fn segment(scene: &Scene, seed: u64) -> (LabelMask, SegmentationReport) {
    let mut mask = LabelMask::new(1, 1);
    let mut segmenter = ColourSegmenter::new(ColourParams::default()).unwrap();
    let report = segmenter.segment(scene.image(seed).view(), &mut mask).unwrap();
    (mask, report)
}

/// Intersection over union of one label in two masks.
fn iou(a: &LabelMask, b: &LabelMask, label: u8) -> f64 {
    let count = |test: fn(bool, bool) -> bool| {
        a.data.iter().zip(&b.data).filter(|&(&x, &y)| test(x == label, y == label)).count() as f64
    };
    count(|x, y| x && y) / count(|x, y| x || y)
}

/// Arc of random curvature under random light. In the darkest spot 0.7 · 0.4 = 28 % of the light is left.
fn random_scene(seed: u64) -> Scene {
    let mut rng = seed::rng(seed, 1);
    let mut scene = Scene::hanging();
    let (start, turn) = (rng.random_range(-0.5..1.5), rng.random_range(-0.025..0.025));
    let mut p = [rng.random_range(200.0..300.0), rng.random_range(120.0..200.0)];
    scene.bar = (0..=60)
        .map(|i| {
            let angle: f64 = start + turn * f64::from(i);
            p = [p[0] + 2.5 * angle.cos(), p[1] + 2.5 * angle.sin()];
            p
        })
        .collect();
    scene.gripper = None;
    scene.target = Some(([rng.random_range(440.0..500.0), rng.random_range(200.0..340.0)], 14.0));
    scene.shadow = ([rng.random_range(200.0..440.0), rng.random_range(150.0..350.0)], 90.0, rng.random_range(0.4..1.0));
    scene.gain = rng.random_range(0.7..1.1);
    scene.hue_shift_deg = rng.random_range(-12.0..12.0);
    scene.noise = rng.random_range(1.0..6.0);
    scene
}

#[test]
fn masks_agree_with_the_scene_under_shading_shadow_noise_and_hue_jitter() {
    let (mut worst, mut sum) = ([1.0f64; 2], [0.0; 2]);
    for seed in 0..24 {
        let scene = random_scene(seed);
        let (mask, report) = segment(&scene, seed);
        let truth = scene.truth();
        for (k, label) in [label::DLO, label::TARGET].into_iter().enumerate() {
            let iou = iou(&mask, &truth, label);
            worst[k] = worst[k].min(iou);
            sum[k] += iou / 24.0;
            assert!(iou > 0.9, "seed {seed}: label {label}: IoU {iou:.3}; {report:?}");
        }
        // The crop of 640 x 480 is its centred square, whose left edge is image column 80.
        let (centre, _) = scene.target.unwrap();
        let found = report.target_centroid_px.unwrap();
        let off = [found[0] - (centre[0] - 80.0) * 256.0 / 480.0, found[1] - centre[1] * 256.0 / 480.0];
        assert!(off[0].hypot(off[1]) < 0.3, "seed {seed}: centroid off by {off:?} px");
    }
    println!("IoU of object and target: mean {sum:.3?}, worst {worst:.3?}");
}

#[test]
fn pieces_on_both_sides_of_the_gripper_are_kept_and_the_gripper_is_not_labelled() {
    // The gripper of this scene covers a part of the bar.
    let scene = Scene::hanging();
    let (mask, report) = segment(&scene, 5);
    let iou = iou(&mask, &scene.truth(), label::DLO);
    assert_eq!(report.dlo_pieces, 2, "{report:?}");
    assert!(iou > 0.9, "IoU {iou:.3}");
    let params = ColourParams { max_occlusion_px: 0, ..ColourParams::default() };
    let mut alone = LabelMask::new(1, 1);
    let report = ColourSegmenter::new(params).unwrap().segment(scene.image(5).view(), &mut alone).unwrap();
    assert_eq!(report.dlo_pieces, 1);
}

#[test]
fn a_patch_of_the_objects_colour_that_lies_apart_is_dropped() {
    let scene = Scene::hanging();
    let mut image = scene.image(3);
    // 30 x 30 image pixels are 16 x 16 = 256 mask pixels.
    for v in 400..430 {
        for u in 300..330 {
            let i = 3 * (v * IMAGE_PX[0] as usize + u);
            image.data[i..i + 3].copy_from_slice(&[40, 90, 200]);
        }
    }
    let mut mask = LabelMask::new(1, 1);
    let mut segmenter = ColourSegmenter::new(ColourParams::default()).unwrap();
    let report = segmenter.segment(image.view(), &mut mask).unwrap();
    assert_eq!(report.dlo_pieces, 2);
    assert!(report.dropped_px > 200, "{report:?}");
    assert!(iou(&mask, &scene.truth(), label::DLO) > 0.9);
}

#[test]
fn an_empty_scene_gives_an_empty_mask() {
    let scene = Scene { bar: vec![], target: None, ..Scene::hanging() };
    let (mask, report) = segment(&scene, 9);
    assert!(mask.data.iter().all(|&l| l == label::BACKGROUND), "{report:?}");
    assert_eq!((report.dlo_area_px, report.target_centroid_px), (0, None));
}

#[test]
fn a_mask_does_not_depend_on_earlier_images() {
    let mut used = ColourSegmenter::new(ColourParams::default()).unwrap();
    let mut mask = LabelMask::new(1, 1);
    for seed in 0..4 {
        let scene = random_scene(seed);
        let report = used.segment(scene.image(seed).view(), &mut mask).unwrap();
        assert_eq!((&mask, &report), (&segment(&scene, seed).0, &segment(&scene, seed).1));
    }
}

#[test]
fn any_image_gives_a_mask_of_labels() {
    let mut segmenter = ColourSegmenter::new(ColourParams::default()).unwrap();
    let mut mask = LabelMask::new(1, 1);
    let mut rng = seed::rng(1, 2);
    for (width, height) in [(640, 480), (1, 1), (3, 500), (97, 41)] {
        for fill in [None, Some([0; 3]), Some([255; 3]), Some([40, 90, 200]), Some([50, 160, 70])] {
            let mut image = RgbImage::new(width, height);
            for pixel in image.data.chunks_exact_mut(3) {
                pixel.copy_from_slice(&fill.unwrap_or_else(|| rng.random()));
            }
            let report = segmenter.segment(image.view(), &mut mask).unwrap();
            let count = |label| mask.data.iter().filter(|&&l| l == label).count();
            assert_eq!(count(label::DLO), report.dlo_area_px);
            assert_eq!(count(label::TARGET), report.target_area_px);
            assert_eq!(count(0) + count(1) + count(2), 256 * 256);
        }
    }
}
