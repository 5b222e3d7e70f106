//! Centre of the target.

use catenary_core::LabelMask;
use catenary_core::image::label;
use catenary_core::regions::{Region, Regions};

/// Share of the outline that must be hidden before a circle is fitted. Below it the mean of the pixels is as good, for a
/// target of any shape.
const HIDDEN_SHARE: f64 = 0.1;

/// Search for the target. Reuses its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct TargetFinder {
    regions: Regions,
    /// Visible pixels of the outline.
    outline: Vec<[f64; 2]>,
}

impl TargetFinder {
    /// Centre and confidence of the largest region of at least `min_area_px`.
    ///
    /// The centre is the mean of the pixels. If the object or the image's edge hides a part of a disc, it is the centre of
    /// the circle through the visible outline. Confidence is the visible share of the outline times the share of the
    /// target's pixels that lie in the region.
    pub(crate) fn find(&mut self, mask: &LabelMask, min_area_px: usize) -> Option<([f64; 2], f32)> {
        self.regions.find(mask, label::TARGET);
        let total: usize = self.regions.found().iter().map(|r| r.area_px).sum();
        let region = *self.regions.largest().map(|(_, r)| r).filter(|r| r.area_px >= min_area_px)?;
        let hidden = self.trace_outline(mask, &region);
        let hidden_share = hidden as f64 / (hidden + self.outline.len()).max(1) as f64;
        let circle = (hidden_share >= HIDDEN_SHARE).then(|| fit_circle(&self.outline)).flatten();
        let centre = circle.filter(|c| c.is_plausible(&region)).map_or(region.centroid_px, |c| c.centre);
        let share = region.area_px as f64 / total as f64;
        Some((centre, (share * (1.0 - hidden_share)).max(0.01) as f32))
    }

    /// Collects the pixels of the outline that border on the background. Returns the number of hidden ones, which border on
    /// the object or the image's edge.
    fn trace_outline(&mut self, mask: &LabelMask, region: &Region) -> usize {
        let (width, height) = (mask.width as usize, mask.height as usize);
        self.outline.clear();
        let mut hidden = 0;
        for &pixel in self.regions.pixels(region) {
            let (u, v) = (pixel as usize % width, pixel as usize / width);
            let at_edge = u == 0 || v == 0 || u + 1 == width || v + 1 == height;
            let near = (v.saturating_sub(1)..(v + 2).min(height))
                .flat_map(|y| (u.saturating_sub(1)..(u + 2).min(width)).map(move |x| mask.data[y * width + x]));
            let (mut borders, mut covered) = (at_edge, at_edge);
            for label in near {
                borders |= label != label::TARGET;
                covered |= label == label::DLO;
            }
            if covered {
                hidden += 1;
            } else if borders {
                self.outline.push([u as f64 + 0.5, v as f64 + 0.5]);
            }
        }
        hidden
    }
}

/// Circle fitted to an outline.
#[derive(Debug, Clone, Copy)]
struct Circle {
    centre: [f64; 2],
    radius: f64,
    /// Root mean square distance of the outline from the circle.
    residual: f64,
}

impl Circle {
    /// Returns true if the region can be a part of a disc with this outline.
    fn is_plausible(&self, region: &Region) -> bool {
        let of_area = (region.area_px as f64 / std::f64::consts::PI).sqrt();
        let d = [self.centre[0] - region.centroid_px[0], self.centre[1] - region.centroid_px[1]];
        // The pixels of a border scatter by about 0.3 px about their circle; the bound is twice that. A disc of which a sixth
        // is seen has 2.5 times the radius that its area suggests.
        self.residual < 0.7 && (0.8..2.5).contains(&(self.radius / of_area)) && d[0].hypot(d[1]) < self.radius
    }
}

/// Algebraic least-squares circle (Kåsa, 1976); none for fewer than eight points or points on a line.
fn fit_circle(points: &[[f64; 2]]) -> Option<Circle> {
    if points.len() < 8 {
        return None;
    }
    let n = points.len() as f64;
    let mean = [0, 1].map(|i| points.iter().map(|p| p[i]).sum::<f64>() / n);
    let [mut uu, mut uv, mut vv, mut ur, mut vr] = [0.0; 5];
    for p in points {
        let (u, v) = (p[0] - mean[0], p[1] - mean[1]);
        let square = u * u + v * v;
        (uu, uv, vv) = (uu + u * u, uv + u * v, vv + v * v);
        (ur, vr) = (ur + 0.5 * u * square, vr + 0.5 * v * square);
    }
    let determinant = uu * vv - uv * uv;
    if determinant < 1e-6 * (uu + vv).powi(2) {
        return None;
    }
    let c = [(ur * vv - vr * uv) / determinant, (vr * uu - ur * uv) / determinant];
    let radius = (c[0] * c[0] + c[1] * c[1] + (uu + vv) / n).sqrt();
    let centre = [mean[0] + c[0], mean[1] + c[1]];
    let off = |p: &[f64; 2]| ((p[0] - centre[0]).hypot(p[1] - centre[1]) - radius).powi(2);
    Some(Circle { centre, radius, residual: (points.iter().map(off).sum::<f64>() / n).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mask of a disc of radius 9 at `centre`, behind a bar over the columns `bar`.
    fn mask(centre: [f64; 2], bar: std::ops::Range<usize>) -> LabelMask {
        let mut mask = LabelMask::new(64, 64);
        for (i, label) in mask.data.iter_mut().enumerate() {
            let (u, v) = (i % 64, i / 64);
            let d = [u as f64 + 0.5 - centre[0], v as f64 + 0.5 - centre[1]];
            *label = if bar.contains(&u) { label::DLO } else { 2 * u8::from(d[0].hypot(d[1]) < 9.0) };
        }
        mask
    }

    /// Distance of the found centre from the true one, and the confidence.
    fn error(centre: [f64; 2], bar: std::ops::Range<usize>) -> (f64, f32) {
        let (found, score) = TargetFinder::default().find(&mask(centre, bar), 8).unwrap();
        ((found[0] - centre[0]).hypot(found[1] - centre[1]), score)
    }

    #[test]
    fn the_centre_of_a_disc_is_found_behind_a_bar_and_at_the_edge() {
        let centre = [30.3, 28.8];
        let (off, score) = error(centre, 0..1);
        assert!(off < 0.1 && score == 1.0, "{off} {score}");
        for bar in [34..40, 32..38, 30..36, 20..26] {
            let (off, score) = error(centre, bar.clone());
            assert!(off < 0.7, "bar {bar:?}: off by {off:.2} px");
            assert!((0.2..0.95).contains(&score), "bar {bar:?}: {score}");
        }
        let (off, score) = error([5.0, 30.0], 60..62);
        assert!(off < 0.7 && score < 0.95, "{off} {score}");
    }

    #[test]
    fn a_target_that_is_too_small_is_not_seen() {
        let mut speck = LabelMask::new(16, 16);
        speck.data[100..103].fill(label::TARGET);
        assert_eq!(TargetFinder::default().find(&speck, 8), None);
        assert!(TargetFinder::default().find(&speck, 3).is_some());
    }

    #[test]
    fn points_on_a_line_have_no_circle() {
        let points: Vec<[f64; 2]> = (0..20).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        assert!(fit_circle(&points).is_none());
    }
}
