//! Tracker that uses the geometry of the mask.

mod chain;
mod distance;
mod graph;
mod pieces;
mod polyline;
mod strand;
#[cfg(test)]
mod tests;
mod thinning;
mod trail;

use catenary_core::regions::Regions;
use catenary_core::{Keypoints, LabelMask};

use self::distance::Distance;
use self::graph::{Graph, Skeleton};
use self::pieces::Pieces;
use self::polyline::{at, length};
use self::strand::{Strand, StrandTracer, borders};
use self::thinning::Thinning;
use self::trail::TrailSearch;
use crate::target::TargetFinder;
use crate::{Error, KeypointTracker, PathStart, TrackerParams, check};

/// Tracker of keypoints on the centre line of the mask's object.
///
/// 1. The largest regions of the object are its pieces. Small holes are filled.
/// 2. Each piece is thinned to a skeleton one pixel wide. The skeleton becomes a graph of lines between ends and junctions.
/// 3. The best trail through the graph covers the most length and goes straight on at junctions. It also follows a bar that
///    touches or crosses itself.
/// 4. The trail is smoothed. Its ends, which a skeleton bends or loses, are cut off. Each point moves to the middle between
///    the borders beside it, which gives sub-pixel accuracy. The ends are extended straight to the border.
/// 5. Pieces that follow one another across a gap, such as the gripper, are joined.
/// 6. The keypoints lie at the given fractions of the line's length.
///
/// The line covers the visible part: if an end is hidden or cut off by the image's edge, the keypoints lie on the rest. A
/// bar folded flat onto itself looks like a shorter, thicker bar and is tracked as one. [`PathStart`] defines the first
/// end. The order of the keypoints flips when the two ends pass one another in height (`Upper`) or sideways (`Left`).
///
/// The confidence of a keypoint is a product of five factors:
///
/// - the ratio of the local width to the median width, or its inverse if that is smaller; 1/2 in a gap;
/// - elongation: 0 if the object is as long as wide, 1 from four times the width on;
/// - the share of the object's area that the line accounts for;
/// - 1/2 for each of the two ends that lies at the image's edge.
///
/// It is at least 0.01 if the object is seen. All four are 0 if one of them is below the parameter `min_score`.
///
/// Keypoints depend on their mask alone, not on earlier masks.
#[derive(Debug, Clone)]
pub struct GeometricTracker {
    params: TrackerParams,
    regions: Regions,
    pieces: Pieces,
    distance: Distance,
    thinning: Thinning,
    graph: Graph,
    search: TrailSearch,
    tracer: StrandTracer,
    strands: Vec<Strand>,
    line: Vec<[f64; 2]>,
    target: TargetFinder,
}

impl GeometricTracker {
    /// Builds a tracker.
    ///
    /// # Errors
    /// [`Error::Parameter`] if a parameter is out of range.
    pub fn new(params: TrackerParams) -> Result<Self, Error> {
        params.check()?;
        Ok(Self {
            params,
            regions: Regions::default(),
            pieces: Pieces::default(),
            distance: Distance::default(),
            thinning: Thinning::default(),
            graph: Graph::default(),
            search: TrailSearch::default(),
            tracer: StrandTracer::default(),
            strands: vec![],
            line: vec![],
            target: TargetFinder::default(),
        })
    }

    /// Parameters in use.
    pub fn params(&self) -> &TrackerParams {
        &self.params
    }

    /// Centre line of the object in the last mask, (u, v) in pixels, from the end at which the fractions begin. Empty if the
    /// object was not seen.
    pub fn centre_line_px(&self) -> &[[f64; 2]] {
        &self.line
    }

    /// Fills `line`. Returns the visible length and the median width of the object in pixels, or none if it is not seen.
    fn trace_line(&mut self, mask: &LabelMask) -> Option<(f64, f64)> {
        self.line.clear();
        self.pieces.load(mask, &mut self.regions, &self.params);
        if self.pieces.list.is_empty() {
            return None;
        }
        self.distance.measure(&self.pieces);
        let thickest = self.distance.thickest_px(&self.pieces);
        // A blob has no skeleton worth tracing: without one, its main axis becomes the centre line.
        self.thinning.thin(&self.pieces, |id| thickest[usize::from(id)] <= self.params.max_half_width_px);
        let skeleton = Skeleton { pieces: &self.pieces, distance: &self.distance, thinning: &self.thinning };
        self.graph.build(skeleton);
        let count = self.pieces.list.len();
        if self.strands.len() < count {
            self.strands.resize_with(count, Strand::default);
        }
        for (piece, strand) in self.pieces.list.iter().zip(&mut self.strands) {
            let trail = self.search.best(&self.graph, &self.pieces, piece.id);
            self.tracer.trace(skeleton, &self.graph, trail, piece, self.params.smoothing_px, strand);
        }
        let strands = &mut self.strands[..count];
        let (_, visible_px) = chain::join(&self.pieces, strands, self.params.max_gap_px, &mut self.line);
        let width_px = strands[0].width_px;
        let (first, last) = (self.line[0], self.line[self.line.len() - 1]);
        // The other coordinate decides between ends of equal height, so that the order is defined for every mask.
        let is_first = |a: f64, b: f64, c: f64, d: f64| a < b || (a == b && c <= d);
        let in_order = match self.params.start {
            PathStart::Upper => is_first(first[1], last[1], first[0], last[0]),
            PathStart::Left => is_first(first[0], last[0], first[1], last[1]),
        };
        if !in_order {
            self.line.reverse();
        }
        Some((visible_px, width_px))
    }

    /// Confidence in the line as a whole: elongation, accounted area and ends at the image's edge.
    fn confidence(&self, mask: &LabelMask, visible_px: f64, width_px: f64) -> f64 {
        let elongation = ((length(&self.line) / width_px - 1.0) / 3.0).clamp(0.0, 1.0);
        let accounted = (visible_px * width_px / self.pieces.labelled_px as f64).min(1.0);
        let size = [f64::from(mask.width), f64::from(mask.height)];
        // 1.5 px: the last pixel's centre and one pixel of tolerance.
        let at_edge = |p: [f64; 2]| (0..2).any(|i| p[i] < 1.5 || p[i] > size[i] - 1.5);
        let cut = [self.line[0], self.line[self.line.len() - 1]].map(|p| if at_edge(p) { 0.5 } else { 1.0 });
        elongation * accounted * cut[0] * cut[1]
    }

    /// Confidence in the point at arc length `arc` from the width there.
    fn local_confidence(&self, arc: f64, width_px: f64) -> f64 {
        let total = length(&self.line);
        // Within a width of an end the rays to the sides leave through the end cap.
        let (point, along) = at(&self.line, arc.clamp(width_px.min(0.5 * total), (total - width_px).max(0.5 * total)));
        match borders(&self.pieces, self.pieces.at(point), point, along, 4.0 * width_px) {
            _ if self.pieces.at(point) == 0 => 0.5,
            // Inverted if it is larger than 1: a width too large is as doubtful as one too small.
            Some([left, right]) => ((left + right) / width_px).min(width_px / (left + right)),
            // A border farther than four widths away: the point lies where strands merge.
            None => 0.25,
        }
    }
}

impl KeypointTracker for GeometricTracker {
    fn track(&mut self, mask: &LabelMask) -> Result<Keypoints, Error> {
        check(mask)?;
        let target = self.target.find(mask, self.params.min_target_area_px);
        let mut keypoints = Keypoints::unseen(mask, target);
        if let Some((visible_px, width_px)) = self.trace_line(mask) {
            let total = length(&self.line);
            let confidence = self.confidence(mask, visible_px, width_px);
            for (k, fraction) in self.params.fractions.into_iter().enumerate() {
                keypoints.dlo_px[k] = at(&self.line, fraction * total).0;
                let local = self.local_confidence(fraction * total, width_px);
                keypoints.scores[k] = (confidence * local).clamp(0.01, 1.0) as f32;
            }
            if keypoints.scores.iter().any(|&score| f64::from(score) < self.params.min_score) {
                keypoints.scores = [0.0; 4];
            }
        }
        Ok(keypoints)
    }
}
