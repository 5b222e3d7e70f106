//! Centre line of one piece of the object, with sub-pixel accuracy.

use super::graph::{Graph, Skeleton};
use super::pieces::{Piece, Pieces};
use super::polyline::{direction, distance, length, resample, smooth};
use super::trail::{Step, TrailSearch};
use catenary_core::statistics::median_high;

/// Step of the walk from the centre line to the border, in pixels.
const MARCH_PX: f64 = 0.25;
/// Rounds of moving the line to the middle between the borders and smoothing it.
const CENTRINGS: usize = 2;

/// Centre line of a piece from border to border.
#[derive(Debug, Clone, Default)]
pub(crate) struct Strand {
    pub(crate) points: Vec<[f64; 2]>,
    /// Median width across the line.
    pub(crate) width_px: f64,
    pub(crate) piece: u8,
    /// True if the line is longer than 1.5 times its width: the direction of a shorter one is arbitrary.
    pub(crate) is_long: bool,
}

/// Conversion of trails into centre lines. Reuses its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct StrandTracer {
    raw: Vec<[f64; 2]>,
    scratch: Vec<[f64; 2]>,
    widths: Vec<f64>,
}

impl StrandTracer {
    /// Writes the centre line of `piece` to `out`; `trail` is the best trail through its skeleton.
    ///
    /// A skeleton stops half a width short of a bar's end or bends into one of its corners. Half a width is therefore cut
    /// off each end of the smoothed trail, the rest moves to the middle between the borders, and its ends are extended
    /// straight to the border. The centre line of a piece too short for that is its main axis.
    pub(crate) fn trace(
        &mut self,
        skeleton: Skeleton<'_>,
        graph: &Graph,
        trail: &[Step],
        piece: &Piece,
        smoothing_px: f64,
        out: &mut Strand,
    ) {
        out.piece = piece.id;
        TrailSearch::points(trail, graph, skeleton.pieces, &mut self.raw);
        let half_width_px = self.half_width_px(skeleton, graph, trail);
        let total = if self.raw.is_empty() { 0.0 } else { length(&self.raw) };
        if total - 2.0 * half_width_px < half_width_px.max(2.0) {
            return along_axis(piece, out);
        }
        let points = &mut out.points;
        resample(&self.raw, 0.0, total, total.round() as usize + 1, points);
        smooth(points, smoothing_px, &mut self.scratch);
        self.trim(points, half_width_px);
        for _ in 0..CENTRINGS {
            self.centre(skeleton.pieces, piece.id, half_width_px, points);
            smooth(points, smoothing_px, &mut self.scratch);
            self.trim(points, 0.0);
        }
        out.width_px = median_high(&mut self.widths).unwrap_or(2.0 * half_width_px);
        // Each pass extends the other end; two reversals restore the order.
        for _ in 0..2 {
            points.reverse();
            extend(skeleton.pieces, piece.id, half_width_px, points);
        }
        out.is_long = length(points) > 1.5 * out.width_px;
    }

    /// Median half width along the trail in pixels, at least one half.
    fn half_width_px(&mut self, skeleton: Skeleton<'_>, graph: &Graph, trail: &[Step]) -> f64 {
        self.widths.clear();
        for step in trail {
            let cells = &graph.cells[graph.edges[step.edge].cells.clone()];
            self.widths.extend(cells.iter().map(|&c| skeleton.distance.half_width_px(c)));
        }
        median_high(&mut self.widths).unwrap_or(0.0).max(0.5)
    }

    /// Cuts `end_px` off each end and resamples the rest at steps of about a pixel.
    fn trim(&mut self, points: &mut Vec<[f64; 2]>, end_px: f64) {
        let total = length(points);
        let count = ((total - 2.0 * end_px).round() as usize + 1).max(3);
        resample(points, end_px, total - end_px, count, &mut self.scratch);
        std::mem::swap(points, &mut self.scratch);
    }

    /// Moves each point to the middle between the borders to its left and right, if both are near. Collects the widths.
    fn centre(&mut self, pieces: &Pieces, id: u8, half_width_px: f64, points: &mut [[f64; 2]]) {
        self.widths.clear();
        self.scratch.clear();
        self.scratch.extend_from_slice(points);
        let last = points.len() - 1;
        for (i, point) in points.iter_mut().enumerate() {
            let along = direction(self.scratch[i.saturating_sub(1)], self.scratch[(i + 1).min(last)]);
            if let Some([left, right]) = borders(pieces, id, *point, along, 2.0 * half_width_px + 1.0) {
                // At a crossing a border may be far to one side: a point moves by half a width at most.
                let shift = (0.5 * (left - right)).clamp(-half_width_px, half_width_px);
                *point = [point[0] + shift * along[1], point[1] - shift * along[0]];
                self.widths.push(left + right);
            }
        }
    }
}

/// Distances from `point` to the borders of piece `id` to the left and to the right of the direction `along`. As v points
/// down, left of rightwards is up. None if the point is outside or a border is farther than `reach_px`.
pub(crate) fn borders(pieces: &Pieces, id: u8, point: [f64; 2], along: [f64; 2], reach_px: f64) -> Option<[f64; 2]> {
    let left = march(pieces, id, point, [along[1], -along[0]], reach_px)?;
    let right = march(pieces, id, point, [-along[1], along[0]], reach_px)?;
    Some([left, right])
}

/// Distance from `point` to the border of piece `id` in `direction`; none if the point is outside or the border is farther
/// than `reach_px`.
pub(crate) fn march(pieces: &Pieces, id: u8, point: [f64; 2], direction: [f64; 2], reach_px: f64) -> Option<f64> {
    let inside = |s: f64| pieces.at([point[0] + s * direction[0], point[1] + s * direction[1]]) == id;
    if !inside(0.0) {
        return None;
    }
    let steps = (reach_px / MARCH_PX) as usize;
    // The border lies between the last step inside and the first outside.
    (1..=steps).find(|&k| !inside(k as f64 * MARCH_PX)).map(|k| (k as f64 - 0.5) * MARCH_PX)
}

/// Extends the line straight to the border by the mean length of three parallel rays, as a border of pixels is rough.
fn extend(pieces: &Pieces, id: u8, half_width_px: f64, points: &mut Vec<[f64; 2]>) {
    let last = points.len() - 1;
    let end = points[last];
    // Points are about a pixel apart: the direction is taken over a width and two pixels more.
    let back = ((2.0 * half_width_px).ceil() as usize + 2).min(last);
    let along = direction(points[last - back], end);
    let reach_px = 3.5 * half_width_px + 2.0;
    let (mut sum, mut rays) = (0.0, 0.0);
    for side in [-0.4, 0.0, 0.4] {
        let offset = side * half_width_px;
        let start = [end[0] - offset * along[1], end[1] + offset * along[0]];
        if let Some(ahead) = march(pieces, id, start, along, reach_px) {
            sum += ahead;
            rays += 1.0;
        }
    }
    if rays > 0.0 {
        points.push([end[0] + sum / rays * along[0], end[1] + sum / rays * along[1]]);
    }
}

/// Writes the main axis of a piece that is hardly longer than wide as its centre line.
fn along_axis(piece: &Piece, out: &mut Strand) {
    let point = |along: f64| [0, 1].map(|i| piece.centroid_px[i] + along * piece.axis[i]);
    out.points.clear();
    out.points.extend(piece.reach_px.map(point));
    let total = distance(out.points[0], out.points[1]);
    out.width_px = piece.area_px / total;
    out.is_long = total > 1.5 * out.width_px;
}
