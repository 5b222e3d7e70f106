//! Looping GIF of both episodes side by side, as the camera saw them.

use crate::simulate::GifFile;
use anyhow::{Context, Result};
use catenary_core::camera::Pinhole;
use catenary_core::task::{Judge, Moment, Phase};
use catenary_core::{Model, Observation};
use catenary_msgs::sensor_msgs::msg::Image;
use std::path::Path;

/// Frame rate of the GIF.
const RATE_HZ: f64 = 20.0;
/// Time shown before the first action, and duration of the last picture, s.
const LEAD_S: f64 = 0.3;
const STAND_S: f64 = 2.0;
/// Margin around start and target, m: left, right, below, above. The bar hangs below and in front of the hand.
const MARGIN_M: [f64; 4] = [0.12, 0.16, 0.12, 0.10];
/// Difference in grey levels above which a pixel counts as moving. The standard deviation of the image noise is 3.
const MOVES: u8 = 24;
/// Fewest pictures from which the quantile gives a background without traces of the moving parts.
const FEWEST_SHOTS: usize = 4;
/// Quantile of a pixel's values that shows the background. The simulated wall is brighter than hand, bar and shadow,
/// and each of them covers a pixel for less than this share of the episode. A median would show the hand at its waiting
/// position.
const SCENE_QUANTILE: f64 = 0.8;
/// Gap between the two halves, columns.
const GUTTER_PX: usize = 8;
const WHITE: [u8; 3] = [255; 3];
const YELLOW: [u8; 3] = [255, 215, 0];
const BLACK: [u8; 3] = [0; 3];

/// Part of the image that contains the motion, pixels.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Window {
    /// Window around the arm's start, the target and the table. Returns an error if the model has no task.
    pub fn of(model: &Model, camera: &Pinhole) -> Result<Self> {
        let task = model.task.context("the demo's model needs a task")?;
        let (start, target) = (model.arm.start, task.target_m);
        let [left, right, below, above] = MARGIN_M;
        // The window reaches down to the table, at z = 0.
        let low = [start.x_m.min(target[0]) - left, start.z_m.min(target[1]).min(0.1) - below];
        let high = [start.x_m.max(target[0]) + right, start.z_m.max(target[1]) + above];
        let view = model.camera.view;
        let px = |[x, z]: [f64; 2]| -> Result<[f64; 2]> {
            Ok(image_px(camera, view.scaled_from_world([x, 0.0, z]).context("the target is not before the camera")?))
        };
        let (a, b) = (px([low[0], high[1]])?, px([high[0], low[1]])?);
        let range = |from: f64, to: f64, size: u32| {
            let from = from.max(0.0) as usize;
            (from.min(size as usize - 1), (to.min(f64::from(size)) as usize).max(from + 1))
        };
        let (left, right) = range(a[0], b[0], camera.image_width_px);
        let (top, bottom) = range(a[1], b[1], camera.image_height_px);
        Ok(Self { left, top, width: right - left, height: bottom - top })
    }

    /// Pixels of the window from an RGB image; `None` if the image is too small.
    pub fn cut(&self, image: &Image) -> Option<Vec<u8>> {
        let stride = 3 * image.width as usize;
        let row = |v: usize| image.data.get(v * stride + 3 * self.left..v * stride + 3 * (self.left + self.width));
        let rows: Option<Vec<&[u8]>> = (self.top..self.top + self.height).map(row).collect();
        rows.map(|rows| rows.concat())
    }
}

/// Converts a point in scaled coordinates (-1 to 1 over the mask) to pixels of the image.
pub fn image_px(camera: &Pinhole, scaled: [f64; 2]) -> [f64; 2] {
    let (side, corner) = camera.crop();
    std::array::from_fn(|i| corner[i] + 0.5 * (scaled[i] + 1.0) * side)
}

/// Pixels of the window at one time.
pub struct Shot {
    /// Time on the observer's clock, s.
    pub time_s: f64,
    /// RGB bytes of the window.
    pub rgb: Vec<u8>,
}

/// Pictures and observations of one episode.
pub struct Film {
    /// Window that the pictures were cut with.
    pub window: Window,
    /// Pictures in order of time.
    pub shots: Vec<Shot>,
    /// Observations and their times on the observer's clock, s.
    pub observations: Vec<(f64, Observation)>,
}

impl Film {
    /// Time from the first observation to the last, s.
    fn duration_s(&self) -> f64 {
        let time = |o: Option<&(f64, Observation)>| o.map_or(0.0, |o| o.0);
        time(self.observations.last()) - time(self.observations.first())
    }

    /// Newest picture at `time_s` after the first observation.
    fn at(&self, time_s: f64) -> Option<&Shot> {
        let at = self.observations.first().map_or(0.0, |o| o.0) + time_s;
        self.shots.iter().rev().find(|s| s.time_s <= at).or(self.shots.first())
    }

    /// Pictures during the episode. Before and after it the object stands still and would look like background.
    fn during(&self) -> impl Iterator<Item = &Shot> {
        let time = |o: Option<&(f64, Observation)>| o.map_or(f64::NAN, |o| o.0);
        let episode = time(self.observations.first())..=time(self.observations.last());
        self.shots.iter().filter(move |s| episode.contains(&s.time_s))
    }

    /// Draws the keypoints, the tip and its distance from the target at the last observation.
    fn mark_end(&self, rgb: &mut [u8], camera: &Pinhole, judge: &Judge) {
        let Some((_, last)) = self.observations.last() else { return };
        let mut canvas = Canvas { rgb, width: self.window.width, height: self.window.height };
        let place = |p: [f64; 2]| {
            let [u, v] = image_px(camera, p);
            [u - self.window.left as f64, v - self.window.top as f64]
        };
        let tip = judge.tip(&Moment::of(last, false, Phase::Last));
        let (dlo, target) = (last.dlo(), place(last.target()));
        canvas.line(place(dlo[tip]), target, BLACK);
        dlo.iter().for_each(|p| canvas.ring(place(*p), 0.0, 3.0, YELLOW));
        canvas.ring(place(dlo[tip]), 5.0, 7.0, BLACK);
        canvas.ring(target, 10.0, 12.0, BLACK);
    }
}

/// Writes both films into one looping GIF, the first on the left.
pub fn write(path: &Path, films: [&Film; 2], camera: &Pinhole, judge: &Judge) -> Result<()> {
    let Window { width, height, .. } = films[0].window;
    let size = [2 * width + GUTTER_PX, height];
    let mut gif = GifFile::create(path, size.map(|v| v as u32), RATE_HZ)?;
    let background = background(films);
    let length_s = films.iter().map(|f| f.duration_s()).fold(0.0, f64::max);
    let pictures = ((LEAD_S + length_s) * RATE_HZ).ceil() as i64;
    for k in 0..=pictures + (STAND_S * RATE_HZ) as i64 {
        let time_s = k.min(pictures) as f64 / RATE_HZ - LEAD_S;
        let mut both = WHITE.repeat(size[0] * size[1]);
        for (half, film) in films.iter().enumerate() {
            // Motion after the end of the episode is not shown, because it was not judged.
            let Some(shot) = film.at(time_s.min(film.duration_s())) else { continue };
            let mut rgb = without_noise(&shot.rgb, &background);
            if time_s >= film.duration_s() {
                film.mark_end(&mut rgb, camera, judge);
            }
            let offset = half * (width + GUTTER_PX);
            for (v, row) in rgb.chunks_exact(3 * width).enumerate() {
                both[3 * (v * size[0] + offset)..][..3 * width].copy_from_slice(row);
            }
        }
        gif.push(&both)?;
    }
    gif.finish()
}

/// Background: the upper quantile of each byte over the pictures of both episodes, without hand, bar and noise.
fn background(films: [&Film; 2]) -> Vec<u8> {
    let mut shots: Vec<&Shot> = films.iter().flat_map(|f| f.during()).collect();
    if shots.len() < FEWEST_SHOTS {
        shots = films.iter().flat_map(|f| &f.shots).collect();
    }
    let bytes = shots.first().map_or(0, |s| s.rgb.len());
    let mut column = vec![0; shots.len()];
    let quantile = |i: usize| {
        column.iter_mut().zip(&shots).for_each(|(c, s)| *c = s.rgb[i]);
        let place = ((column.len() as f64 * SCENE_QUANTILE) as usize).min(column.len() - 1);
        *column.select_nth_unstable(place).1
    };
    (0..bytes).map(quantile).collect()
}

/// Replaces every pixel that does not stand out by the background. A GIF has few colours and compresses noise badly.
fn without_noise(rgb: &[u8], background: &[u8]) -> Vec<u8> {
    let mut out = background.to_vec();
    for (o, new) in out.chunks_exact_mut(3).zip(rgb.chunks_exact(3)) {
        if o.iter().zip(new).any(|(a, b)| a.abs_diff(*b) > MOVES) {
            // Sixteen levels per channel keep the palette small; 8 is the middle of a level.
            o.copy_from_slice(&[new[0] & 0xf0 | 8, new[1] & 0xf0 | 8, new[2] & 0xf0 | 8]);
        }
    }
    out
}

/// Image to draw on.
struct Canvas<'a> {
    rgb: &'a mut [u8],
    width: usize,
    height: usize,
}

impl Canvas<'_> {
    fn put(&mut self, u: i64, v: i64, colour: [u8; 3]) {
        if (0..self.width as i64).contains(&u) && (0..self.height as i64).contains(&v) {
            self.rgb[3 * (v as usize * self.width + u as usize)..][..3].copy_from_slice(&colour);
        }
    }

    /// Draws a ring between two radii in pixels, or a disc if the inner radius is 0.
    fn ring(&mut self, [u, v]: [f64; 2], inner: f64, outer: f64, colour: [u8; 3]) {
        let reach = outer.ceil() as i64;
        let (cu, cv) = (u.round() as i64, v.round() as i64);
        for dv in -reach..=reach {
            for du in -reach..=reach {
                let radius = (du as f64).hypot(dv as f64);
                if (inner..=outer).contains(&radius) {
                    self.put(cu + du, cv + dv, colour);
                }
            }
        }
    }

    fn line(&mut self, a: [f64; 2], b: [f64; 2], colour: [u8; 3]) {
        let steps = (b[0] - a[0]).abs().max((b[1] - a[1]).abs()).ceil().clamp(1.0, 4096.0) as i64;
        for i in 0..=steps {
            let t = i as f64 / steps as f64;
            let at: [i64; 2] = std::array::from_fn(|k| (a[k] + t * (b[k] - a[k])).round() as i64);
            self.put(at[0], at[1], colour);
            self.put(at[0] + 1, at[1], colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn film(shots: &[(f64, u8)]) -> Film {
        let window = Window { left: 0, top: 0, width: 6, height: 4 };
        let shot = |&(time_s, level): &(f64, u8)| Shot { time_s, rgb: vec![level; 3 * 6 * 4] };
        let observation = Observation([0.0; 12]);
        Film {
            window,
            shots: shots.iter().map(shot).collect(),
            observations: vec![(1.0, observation), (2.0, observation)],
        }
    }

    #[test]
    fn noise_goes_and_what_moves_stays() {
        let film =
            film(&[(0.1, 200), (0.2, 200), (0.3, 200), (1.0, 100), (1.5, 103), (1.7, 103), (2.0, 101), (2.1, 200)]);
        let background = background([&film, &film]);
        assert!(background.iter().all(|v| (101..=103).contains(v)), "{background:?}");
        assert_eq!(without_noise(&film.shots[3].rgb, &background), background);
        assert!(without_noise(&film.shots[7].rgb, &background).iter().all(|v| *v == 200));
    }

    #[test]
    fn the_newest_picture_of_a_time_is_shown() {
        let film = film(&[(0.9, 1), (1.5, 2), (1.9, 3)]);
        let level = |t: f64| film.at(t).unwrap().rgb[0];
        assert_eq!((level(-5.0), level(0.0), level(0.55), level(9.0)), (1, 1, 2, 3));
    }
}
