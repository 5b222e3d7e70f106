//! Agreement of the image pipeline with the simulator: segmentation and tracking of a rendered picture must find the
//! keypoints where the simulator predicts them. A systematic difference would look like another object.
#![allow(clippy::unwrap_used, reason = "a failure is a panic")]

use camera::{ColourParams, ColourSegmenter, Segmenter};
use catenary_core::camera::Pinhole;
use catenary_core::{Camera, Fidelity, GripPose, LabelMask, Model, RgbView, seed};
use catenary_simulator::episode::{Conditions, EpisodeSimulation};
use keypoint_tracker::{GeometricTracker, KeypointTracker, TrackerParams};
use rand::RngExt;
use simulated_cell::render::Renderer;
use simulated_cell::scene::Scene;
use std::f64::consts::TAU;

// 24 objects and 16 frames each give 384 distances per keypoint, 38 of them beyond the 90 % quantile.
const OBJECTS: u64 = 24;
const FRAMES: u64 = 16;
const FRAME_PERIOD_S: f64 = 0.25;
const TARGET_M: [f64; 2] = [0.5, 0.15];
const IMAGE_NOISE_LEVELS: f64 = 3.0;

/// Segmentation and tracking of the pictures of a simulated scene.
struct ImagePipeline {
    camera: Pinhole,
    segmenter: ColourSegmenter,
    tracker: GeometricTracker,
    mask: LabelMask,
}

impl ImagePipeline {
    fn new(model: &Model) -> Self {
        let Camera::Pinhole(camera) = model.camera.view else { panic!("the soft bar has a pinhole camera") };
        let fractions = model.object.keypoint_fractions;
        let tracker = GeometricTracker::new(TrackerParams { fractions, ..TrackerParams::default() }).unwrap();
        let segmenter = ColourSegmenter::new(ColourParams::default()).unwrap();
        Self { camera, segmenter, tracker, mask: LabelMask::new(1, 1) }
    }

    fn keypoints(&mut self, renderer: &Renderer) -> [[f64; 2]; 4] {
        let (width, height) = (renderer.image.width, renderer.image.height);
        let view = RgbView::new(width, height, 3 * width as usize, &renderer.image.data).unwrap();
        self.segmenter.segment(view, &mut self.mask).unwrap();
        let seen = self.tracker.track(&self.mask).unwrap();
        assert!(seen.dlo_seen());
        seen.dlo_scaled()
    }
}

/// Distances (u, v) in mask pixels from the simulated to the tracked keypoints, in the order that fits better.
fn misses_px(seen: [[f64; 2]; 4], simulated: [[f64; 2]; 4]) -> [[f64; 2]; 4] {
    let mut reversed = seen;
    reversed.reverse();
    let misses = |seen: [[f64; 2]; 4]| -> [[f64; 2]; 4] {
        std::array::from_fn(|k| [0, 1].map(|i| 128.0 * (seen[k][i] - simulated[k][i])))
    };
    let total = |m: &[[f64; 2]; 4]| m.iter().map(|[u, v]| u.hypot(*v)).sum::<f64>();
    let (forward, backward) = (misses(seen), misses(reversed));
    if total(&forward) <= total(&backward) { forward } else { backward }
}

#[test]
fn keypoints_of_pictures_lie_where_the_simulator_puts_them() {
    let model = Model::from_yaml(include_str!("../../../launch_configs/models/soft_bar.yaml")).unwrap();
    let start = model.arm.start;
    let mut pipeline = ImagePipeline::new(&model);
    let mut rng = seed::rng(3, 0);
    let mut all: Vec<[[f64; 2]; 4]> = Vec::new();
    for object in 0..OBJECTS {
        let theta = model.theta.sample_prior(&mut rng);
        let [along_hz, up_hz, phase] = [rng.random_range(0.3..1.0), rng.random_range(0.2..0.7), rng.random::<f64>()];
        let path = |t: f64| GripPose {
            x_m: start.x_m + 0.07 * ((TAU * (along_hz * t + phase)).sin() - (TAU * phase).sin()),
            z_m: start.z_m - 0.03 * (1.0 - (TAU * up_hz * t).cos()),
            pitch_rad: 0.0,
        };
        let mut simulation =
            EpisodeSimulation::new(&model, catenary_simulator::Registry::shipped(), Fidelity::Standard).unwrap();
        let conditions =
            Conditions { theta: &theta, effects: &[], seed: object, noise: false, target_m: Some(TARGET_M) };
        simulation.prepare(&conditions).unwrap();
        simulation.hang(path(0.0));
        let pieces = simulation.beam().discretisation().elements;
        let mut scene = Scene::new(Some(0.0), Some(TARGET_M), model.object.section, pieces);
        let mut renderer =
            Renderer::new(pipeline.camera.image_width_px, pipeline.camera.image_height_px, IMAGE_NOISE_LEVELS, object);
        for frame in 0..FRAMES {
            let time_s = frame as f64 * FRAME_PERIOD_S;
            simulation.advance(time_s, path);
            scene.update(path(time_s), simulation.beam().nodes());
            renderer.draw(&scene, &pipeline.camera, frame);
            all.push(misses_px(pipeline.keypoints(&renderer), simulation.keypoints(time_s)));
        }
    }
    for k in 0..4 {
        let mut distances: Vec<f64> = all.iter().map(|m| m[k][0].hypot(m[k][1])).collect();
        distances.sort_by(f64::total_cmp);
        let (median, most) = (distances[distances.len() / 2], distances[distances.len() * 9 / 10]);
        let along: Vec<f64> = all.iter().map(|m| m[k][1]).collect();
        let bias = along.iter().sum::<f64>() / along.len() as f64;
        println!("keypoint {k}: median {median:.2} px, 90 % within {most:.2} px, mean of v {bias:.2} px");
        // A pixel covers 3.5 mm. Fingers that hide 8 mm of the object would move the first keypoint by 2 px if they
        // were ignored.
        assert!(median < 0.7 && most < 1.5 && bias.abs() < 0.7, "keypoint {k}: {median} px, {most} px, {bias} px");
    }
}
