//! Renderer of the scene: RGB and exact labels, by a z-buffer.
//!
//! Lambert shading from one lamp above, a shadow on the table, sensor noise from a table of draws. The colours match
//! the default settings of the colour segmentation.

use crate::look::Look;
use crate::scene::{Part, Scene, Solid};
use catenary_core::camera::Pinhole;
use catenary_core::image::label;
use catenary_core::{LabelMask, RgbImage, seed};
use nalgebra::{Matrix3, Vector3};
use rand::RngExt;
use rand_distr::StandardNormal;

/// Smallest relative difference of inverse depth at which a shadow is drawn.
// A shadow lies above the table by a share of 1e-4 or more, and above another shadow by rounding only: overlapping
// shadows thus darken once.
const NEARER: f32 = 1e-5;
/// Size in pixels of the pieces of a face that a lens distorts, and largest number of pieces along an edge.
const PIECE_PX: f64 = 16.0;
const MOST_PIECES: f64 = 64.0;
/// Length of the table of noise draws.
// Prime, so that the noise of successive rows does not repeat.
const NOISE_TABLE: usize = 65_521;
/// Faces of a box as corner indices, counter-clockwise as seen from outside.
const FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Colours of object and target in levels.
const OBJECT: [f64; 3] = [40.0, 90.0, 200.0];
const TARGET: [f64; 3] = [50.0, 160.0, 70.0];

fn albedo(part: Part, look: &Look) -> [f64; 3] {
    match part {
        Part::Object => OBJECT,
        Part::Target => TARGET,
        Part::Table => look.table,
        // The hand of a Panda is white.
        Part::Gripper => [235.0, 235.0, 230.0],
    }
}

/// Surface of a solid as it is drawn.
#[derive(Debug, Clone, Copy)]
struct Surface {
    colour: [f64; 3],
    label: u8,
    /// True if it reflects the lamp.
    glossy: bool,
    /// True if it has the look's texture.
    textured: bool,
}

impl Surface {
    fn of(part: Part, look: &Look) -> Self {
        let glossy = matches!(part, Part::Object | Part::Target);
        Self { colour: albedo(part, look), label: label_of(part), glossy, textured: part == Part::Table }
    }
}

fn label_of(part: Part) -> u8 {
    match part {
        Part::Object => label::DLO,
        Part::Target => label::TARGET,
        Part::Table | Part::Gripper => label::BACKGROUND,
    }
}

/// Renderer that reuses its buffers from scene to scene.
pub struct Renderer {
    /// Last picture.
    pub image: RgbImage,
    /// Labels of the pixels, of the picture's size.
    pub labels: LabelMask,
    /// Inverse depth of each pixel in 1/m. Larger is nearer; 0 is the background.
    inverse_depth: Vec<f32>,
    noise: Vec<i8>,
    look: Look,
    /// Brightness of textured surfaces by pixel; empty without texture.
    texture: Vec<f32>,
    /// Gains of red, green and blue by pixel; empty for gains of one.
    gains: Vec<[f32; 3]>,
}

/// Point on the screen: u, v in pixels and inverse depth in 1/m.
type ScreenPoint = [f64; 3];

/// Camera with its rotation matrix.
struct PosedCamera<'a> {
    camera: &'a Pinhole,
    rotation: Matrix3<f64>,
}

impl PosedCamera<'_> {
    fn project(&self, point_m: [f64; 3]) -> Option<ScreenPoint> {
        let p = self.rotation * (Vector3::from(point_m) - Vector3::from(self.camera.position_m));
        // Points nearer than 5 cm or behind the camera have no useful projection.
        (p.z > 0.05).then(|| {
            let [u, v] = self.camera.image_from_optical([p.x, p.y, p.z]);
            [u, v, 1.0 / p.z]
        })
    }
}

impl Renderer {
    /// Makes a renderer for pictures of `width` x `height` px, with sensor noise of standard deviation `noise_levels`
    /// in grey levels.
    pub fn new(width: u32, height: u32, noise_levels: f64, noise_seed: u64) -> Self {
        let mut rng = seed::rng(noise_seed, 0);
        let mut draw = || (noise_levels * rng.sample::<f64, _>(StandardNormal)).round().clamp(-127.0, 127.0) as i8;
        let noise = if noise_levels > 0.0 { (0..NOISE_TABLE).map(|_| draw()).collect() } else { Vec::new() };
        Self {
            image: RgbImage::new(width, height),
            labels: LabelMask::new(width, height),
            inverse_depth: vec![0.0; width as usize * height as usize],
            noise,
            look: Look::plain(),
            texture: Vec::new(),
            gains: Vec::new(),
        }
    }

    /// Renderer that draws the laboratory of a seed; with none it draws the plain look.
    #[must_use]
    pub fn in_laboratory(self, seed: Option<u64>) -> Self {
        let (width, height) = (self.image.width, self.image.height);
        let look = seed.map_or_else(Look::plain, |seed| Look::of_laboratory(seed, &[OBJECT, TARGET]));
        Self { texture: look.texture(width, height), gains: look.gains(width, height), look, ..self }
    }

    /// Draws `scene` as `camera` sees it. `frame` selects the noise.
    pub fn draw(&mut self, scene: &Scene, camera: &Pinhole, frame: u64) {
        let wall = self.look.wall;
        for pixel in 0..self.labels.data.len() {
            let colour = self.textured(wall, pixel);
            self.image.data[3 * pixel..3 * pixel + 3].copy_from_slice(&colour);
        }
        self.labels.data.fill(label::BACKGROUND);
        self.inverse_depth.fill(0.0);
        let view = PosedCamera { camera, rotation: camera.optical_from_world() };
        for (part, solid) in scene.solids() {
            let surface = Surface::of(part, &self.look);
            match solid {
                Solid::Cuboid(corners) => self.cuboid(&view, surface, &corners),
                Solid::Ball { centre_m, radius_m } => self.ball(&view, surface, centre_m, radius_m),
            }
        }
        let table_m = table_height(scene).unwrap_or_default();
        let clutter = std::mem::take(&mut self.look.clutter);
        for (solid, colour) in &clutter {
            if let Solid::Cuboid(corners) = solid {
                let corners = &corners.map(|[x, y, z]| [x, y, z + table_m]);
                let surface = Surface { colour: *colour, label: label::BACKGROUND, glossy: false, textured: true };
                self.cuboid(&view, surface, corners);
            }
        }
        self.look.clutter = clutter;
        self.shadows(&view, scene);
        self.expose();
        self.add_noise(frame);
    }

    fn cuboid(&mut self, view: &PosedCamera<'_>, surface: Surface, corners: &[[f64; 3]; 8]) {
        for face in FACES {
            let p = face.map(|i| Vector3::from(corners[i]));
            let normal = (p[1] - p[0]).cross(&(p[3] - p[0]));
            // A face turned away is hidden by the faces in front of it.
            let to_camera = Vector3::from(view.camera.position_m) - p[0];
            if normal.dot(&to_camera) <= 0.0 {
                continue;
            }
            let colour = self.lit(surface, &normal.normalize(), &to_camera, &Vector3::from(self.look.lamp));
            self.fill_parallelogram(view, &p.map(Into::into), |this, pixel, depth| {
                let colour = if surface.textured { this.textured(colour, pixel) } else { colour.map(|c| c as u8) };
                this.set_pixel(pixel, depth, colour, surface.label)
            });
        }
    }

    fn ball(&mut self, view: &PosedCamera<'_>, surface: Surface, centre_m: [f64; 3], radius_m: f64) {
        let Some([u, v, inverse]) = view.project(centre_m) else { return };
        let radius_px = radius_m * view.camera.focal_px * inverse;
        let lamp = view.rotation * Vector3::from(self.look.lamp);
        let (width, height) = (self.image.width as i64, self.image.height as i64);
        let bounds =
            |c: f64, limit: i64| ((c - radius_px).floor() as i64).max(0)..((c + radius_px).ceil() as i64).min(limit);
        for row in bounds(v, height) {
            for column in bounds(u, width) {
                let (x, y) = ((column as f64 + 0.5 - u) / radius_px, (row as f64 + 0.5 - v) / radius_px);
                let rest = 1.0 - x * x - y * y;
                if rest < 0.0 {
                    continue;
                }
                let normal = Vector3::new(x, y, -rest.sqrt());
                let colour = self.lit(surface, &normal, &-Vector3::z(), &lamp).map(|c| c as u8);
                let depth = 1.0 / (1.0 / inverse - radius_m * rest.sqrt());
                let pixel = (row * width + column) as usize;
                self.set_pixel(pixel, depth as f32, colour, surface.label);
            }
        }
    }

    /// Colour of a surface in the light of the lamp: Lambert's diffuse light, and the reflection of Blinn and Phong (1977).
    fn lit(&self, surface: Surface, normal: &Vector3<f64>, to_camera: &Vector3<f64>, lamp: &Vector3<f64>) -> [f64; 3] {
        let light = self.look.ambient + (1.0 - self.look.ambient) * normal.dot(lamp).max(0.0);
        let diffuse = surface.colour.map(|c| c * light);
        if !surface.glossy || self.look.gloss == 0.0 {
            return diffuse;
        }
        let half = (lamp + to_camera.normalize()).normalize();
        let reflected = 255.0 * self.look.gloss * normal.dot(&half).max(0.0).powi(24);
        diffuse.map(|c| (c + reflected).min(255.0))
    }

    /// Levels of a textured surface at a pixel.
    fn textured(&self, colour: [f64; 3], pixel: usize) -> [u8; 3] {
        let brightness = self.texture.get(pixel).map_or(1.0, |b| f64::from(*b));
        colour.map(|c| (c * brightness) as u8)
    }

    /// Multiplies the picture by the gains of exposure, white balance and lens.
    fn expose(&mut self) {
        for (pixel, gains) in self.image.data.chunks_exact_mut(3).zip(&self.gains) {
            pixel.iter_mut().zip(gains).for_each(|(c, gain)| *c = (f32::from(*c) * gain) as u8);
        }
    }

    /// Darkens the table below the object's boxes and the target. A laboratory's shadows are moved along the light by the height of each
    /// middle.
    fn shadows(&mut self, view: &PosedCamera<'_>, scene: &Scene) {
        let Some(height_m) = table_height(scene) else { return };
        // Half a millimetre above the surface, so that the surface does not hide the shadow.
        let level = height_m + 5e-4;
        for (part, solid) in scene.solids() {
            let outline = match (part, solid) {
                (Part::Object, Solid::Cuboid(c)) => outline(&c, level),
                (Part::Target, Solid::Ball { centre_m: [x, y, _], radius_m: r }) => {
                    [[x - r, y - r, level], [x + r, y - r, level], [x + r, y + r, level], [x - r, y + r, level]]
                }
                _ => continue,
            };
            let slant = self.look.slant;
            let above_m = middle_height(&solid) - level;
            let outline = outline.map(|[x, y, z]| [x + slant[0] * above_m, y + slant[1] * above_m, z]);
            let shadow = self.look.shadow;
            self.fill_parallelogram(view, &outline, |this, pixel, depth| {
                let below = this.inverse_depth[pixel];
                let on_table = this.labels.data[pixel] == label::BACKGROUND && below > 0.0;
                if on_table && depth > below * (1.0 + NEARER) {
                    this.inverse_depth[pixel] = depth;
                    for c in &mut this.image.data[3 * pixel..3 * pixel + 3] {
                        *c = (f64::from(*c) * shadow) as u8;
                    }
                }
            });
        }
    }

    /// Calls `paint` with index and inverse depth of every pixel whose centre lies in a parallelogram. The parallelogram is
    /// divided into pieces if the camera has lens distortion, because its edges are then curved.
    fn fill_parallelogram(
        &mut self,
        view: &PosedCamera<'_>,
        corners_m: &[[f64; 3]; 4],
        mut paint: impl FnMut(&mut Self, usize, f32),
    ) {
        let [a, b, c, d] = corners_m.map(|corner| view.project(corner));
        let (Some(a), Some(b), Some(c), Some(d)) = (a, b, c, d) else { return };
        if view.camera.distortion_k1 == 0.0 {
            return self.fill_quadrilateral(&[a, b, c, d], &mut paint);
        }
        let pieces = |edges: [(ScreenPoint, ScreenPoint); 2]| {
            let longest = edges.map(|(p, q)| (q[0] - p[0]).hypot(q[1] - p[1])).into_iter().fold(0.0, f64::max);
            (longest / PIECE_PX).ceil().clamp(1.0, MOST_PIECES)
        };
        let (along, across) = (pieces([(a, b), (d, c)]), pieces([(b, c), (a, d)]));
        let [corner, b, _, d] = corners_m;
        let at = |i: f64, j: f64| {
            let place = |k: usize| corner[k] + i / along * (b[k] - corner[k]) + j / across * (d[k] - corner[k]);
            view.project([0, 1, 2].map(place))
        };
        for i in 0..along as usize {
            for j in 0..across as usize {
                let (i, j) = (i as f64, j as f64);
                let piece = [at(i, j), at(i + 1.0, j), at(i + 1.0, j + 1.0), at(i, j + 1.0)];
                if let [Some(a), Some(b), Some(c), Some(d)] = piece {
                    self.fill_quadrilateral(&[a, b, c, d], &mut paint);
                }
            }
        }
    }

    /// Calls `paint` with index and inverse depth of every pixel whose centre lies in a convex quadrilateral on the
    /// screen.
    fn fill_quadrilateral(&mut self, seen: &[ScreenPoint; 4], paint: &mut impl FnMut(&mut Self, usize, f32)) {
        let (width, height) = (self.image.width as usize, f64::from(self.image.height));
        let top = seen.iter().map(|s| s[1]).fold(f64::MAX, f64::min).max(0.0);
        let bottom = seen.iter().map(|s| s[1]).fold(f64::MIN, f64::max).min(height);
        for row in (top - 0.5).ceil().max(0.0) as usize..(bottom + 0.5).floor().max(0.0) as usize {
            let Some((left, right)) = span(seen, row as f64 + 0.5) else { continue };
            // Inverse depth is linear on the screen, for a plane seen through a pinhole.
            let slope = if right[0] > left[0] { (right[2] - left[2]) / (right[0] - left[0]) } else { 0.0 };
            let first = (left[0] - 0.5).ceil().max(0.0) as usize;
            let end = ((right[0] + 0.5).floor().max(0.0) as usize).min(width);
            for column in first..end {
                let depth = left[2] + slope * (column as f64 + 0.5 - left[0]);
                paint(self, row * width + column, depth as f32);
            }
        }
    }

    fn set_pixel(&mut self, pixel: usize, depth: f32, colour: [u8; 3], label: u8) {
        if depth > self.inverse_depth[pixel] {
            self.inverse_depth[pixel] = depth;
            self.image.data[3 * pixel..3 * pixel + 3].copy_from_slice(&colour);
            self.labels.data[pixel] = label;
        }
    }

    fn add_noise(&mut self, frame: u64) {
        if self.noise.is_empty() {
            return;
        }
        let mut place = (seed::derive(frame, 0) % NOISE_TABLE as u64) as usize;
        for value in &mut self.image.data {
            *value = value.saturating_add_signed(self.noise[place]);
            place += 1;
            if place == NOISE_TABLE {
                place = 0;
            }
        }
    }
}

/// Returns the height of the table's surface in m, if there is a table.
fn table_height(scene: &Scene) -> Option<f64> {
    scene.solids().find_map(|(part, solid)| match (part, solid) {
        (Part::Table, Solid::Cuboid(corners)) => Some(corners[7][2]),
        _ => None,
    })
}

/// Returns the height of the middle of a solid in m.
fn middle_height(solid: &Solid) -> f64 {
    match solid {
        Solid::Cuboid(corners) => corners.iter().map(|c| c[2]).sum::<f64>() / 8.0,
        Solid::Ball { centre_m, .. } => centre_m[2],
    }
}

/// Returns the rectangle that covers a box seen from above, at height `level` in m.
fn outline(corners: &[[f64; 3]; 8], level: f64) -> [[f64; 3]; 4] {
    let least = |i: usize| corners.iter().map(|c| c[i]).fold(f64::MAX, f64::min);
    let most = |i: usize| corners.iter().map(|c| c[i]).fold(f64::MIN, f64::max);
    let (x0, x1, y0, y1) = (least(0), most(0), least(1), most(1));
    [[x0, y0, level], [x1, y0, level], [x1, y1, level], [x0, y1, level]]
}

/// Returns the left and right end of a convex quadrilateral on the row `v` in px.
fn span(corners: &[ScreenPoint; 4], v: f64) -> Option<(ScreenPoint, ScreenPoint)> {
    let mut ends: Option<(ScreenPoint, ScreenPoint)> = None;
    for i in 0..4 {
        let (a, b) = (corners[i], corners[(i + 1) % 4]);
        if (a[1] <= v) == (b[1] <= v) {
            continue;
        }
        let share = (v - a[1]) / (b[1] - a[1]);
        let point: ScreenPoint = std::array::from_fn(|k| a[k] + share * (b[k] - a[k]));
        ends = Some(match ends {
            None => (point, point),
            Some((left, right)) if point[0] < left[0] => (point, right),
            Some((left, right)) if point[0] > right[0] => (left, point),
            Some(both) => both,
        });
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::{Camera, GripPose, Model};

    fn soft_bar() -> Model {
        Model::from_yaml(include_str!("../../../../launch_configs/models/soft_bar.yaml")).unwrap()
    }

    fn camera() -> Pinhole {
        let Camera::Pinhole(p) = soft_bar().camera.view else { panic!("the soft bar has a pinhole camera") };
        p
    }

    fn drawn(target_m: [f64; 2], noise: f64) -> Renderer {
        drawn_as_frame(3, target_m, noise)
    }

    fn drawn_as_frame(frame: u64, target_m: [f64; 2], noise: f64) -> Renderer {
        let mut scene = Scene::new(Some(0.0), Some(target_m), soft_bar().object.section, 20);
        let nodes: Vec<[f64; 3]> = (0..=20).map(|k| [0.4, 0.4 - 0.01 * f64::from(k), -1.57]).collect();
        scene.update(GripPose { x_m: 0.4, z_m: 0.4, pitch_rad: 0.0 }, &nodes);
        let mut renderer = Renderer::new(640, 480, noise, 1);
        renderer.draw(&scene, &camera(), frame);
        renderer
    }

    fn at(renderer: &Renderer, point_m: [f64; 3]) -> u8 {
        let [u, v] = camera().image_from_world(point_m).unwrap();
        renderer.labels.at(u as u32, v as u32)
    }

    #[test]
    fn labels_lie_where_the_camera_projects_the_object() {
        let r = drawn([0.55, 0.15], 0.0);
        for k in 2..20 {
            assert_eq!(at(&r, [0.4, 0.0, 0.4 - 0.01 * f64::from(k) - 0.005]), label::DLO, "piece {k}");
        }
        assert_eq!(at(&r, [0.425, 0.0, 0.3]), label::BACKGROUND);
        assert_eq!(at(&r, [0.55, 0.05, 0.15]), label::TARGET);
    }

    #[test]
    fn the_outline_agrees_with_the_projection_within_a_pixel() {
        let r = drawn([0.55, 0.15], 0.0);
        let [_, v] = camera().image_from_world([0.4, 0.0, 0.3]).unwrap();
        let row = v as u32;
        let columns: Vec<u32> = (0..640).filter(|&u| r.labels.at(u, row) == label::DLO).collect();
        // The bar's near face lies 7.5 mm in front of the plane of motion.
        let edge = |x: f64| camera().image_from_world([x, -0.0075, 0.3]).unwrap()[0];
        assert!((f64::from(columns[0]) - edge(0.3925)).abs() <= 1.0, "{columns:?}");
        assert!((f64::from(*columns.last().unwrap()) - edge(0.4075)).abs() <= 1.0, "{columns:?}");
    }

    #[test]
    fn nearer_solids_hide_farther_ones() {
        let r = drawn([0.4, 0.3], 0.0);
        assert_eq!(at(&r, [0.4, 0.0, 0.3]), label::DLO, "the bar hangs in front of the target");
        assert_eq!(at(&r, [0.418, 0.05, 0.3]), label::TARGET);
    }

    #[test]
    fn colours_agree_with_labels() {
        let r = drawn([0.55, 0.15], 2.0);
        for (pixel, l) in r.image.data.chunks_exact(3).zip(&r.labels.data) {
            let [red, green, blue] = [0, 1, 2].map(|c| i32::from(pixel[c]));
            match *l {
                label::DLO => assert!(blue > red + 40, "{pixel:?}"),
                label::TARGET => assert!(green > red.max(blue) + 40, "{pixel:?}"),
                _ => assert!((red - blue).abs() < 40, "{pixel:?}"),
            }
        }
    }

    #[test]
    fn shadows_that_overlap_are_one_shadow() {
        let r = drawn([0.55, 0.15], 0.0);
        // Each of the bar's pieces hangs above the same piece of the table.
        let [u, v] = camera().image_from_world([0.4, 0.006, 0.0]).unwrap();
        let pixel = 3 * (v as usize * 640 + u as usize);
        let lit = &r.image.data[pixel..pixel + 3];
        let look = Look::plain();
        let table = look.table[0];
        assert!(
            f64::from(lit[0]) > 0.9 * table * look.shadow * look.ambient && f64::from(lit[0]) < table * look.shadow,
            "{lit:?}"
        );
    }

    #[test]
    fn a_lens_bends_straight_edges() {
        let camera = Pinhole { distortion_k1: -0.2, ..camera() };
        let mut r = Renderer::new(640, 480, 0.0, 1);
        r.draw(&Scene::new(None, None, soft_bar().object.section, 20), &camera, 0);
        let view = PosedCamera { camera: &camera, rotation: camera.optical_from_world() };
        // A plank across the picture, high up.
        let (x, y, z) = ([0.0, 0.8], [-0.001, 0.001], [0.55, 0.58]);
        let corners: [[f64; 3]; 8] = std::array::from_fn(|i| [x[i & 1], y[(i >> 1) & 1], z[i >> 2]]);
        r.cuboid(&view, Surface::of(Part::Object, &Look::plain()), &corners);
        for share in [0.35, 0.5, 0.65] {
            let at = |z: f64| {
                let [u, v] = camera.image_from_world([0.8 * share, -0.001, z]).unwrap();
                r.labels.at(u as u32, v as u32)
            };
            // A straight line between the plank's ends lies three pixels, 6 mm, lower.
            assert_eq!((at(0.577), at(0.583)), (label::DLO, label::BACKGROUND), "upper edge at {share}");
            assert_eq!((at(0.553), at(0.547)), (label::DLO, label::BACKGROUND), "lower edge at {share}");
        }
    }

    #[test]
    fn a_laboratory_changes_the_picture_and_no_label() {
        let plain = drawn([0.55, 0.15], 0.0);
        let mut scene = Scene::new(Some(0.0), Some([0.55, 0.15]), soft_bar().object.section, 20);
        let nodes: Vec<[f64; 3]> = (0..=20).map(|k| [0.4, 0.4 - 0.01 * f64::from(k), -1.57]).collect();
        scene.update(GripPose { x_m: 0.4, z_m: 0.4, pitch_rad: 0.0 }, &nodes);
        for seed in 0..20 {
            let mut renderer = Renderer::new(640, 480, 0.0, 1).in_laboratory(Some(seed));
            renderer.draw(&scene, &camera(), 3);
            let first = renderer.image.clone();
            // Clutter stands behind object and target.
            assert_eq!(renderer.labels, plain.labels, "laboratory {seed}");
            assert_ne!(first, plain.image, "laboratory {seed}");
            renderer.draw(&scene, &camera(), 3);
            assert_eq!(renderer.image, first, "laboratory {seed}");
        }
    }

    #[test]
    fn noise_repeats_with_its_frame_and_differs_between_frames() {
        let (a, b) = (drawn([0.5, 0.1], 3.0), drawn([0.5, 0.1], 3.0));
        assert_eq!(a.image, b.image);
        assert_ne!(a.image, drawn_as_frame(4, [0.5, 0.1], 3.0).image);
        assert_ne!(a.image, drawn([0.5, 0.1], 0.0).image);
    }
}
