//! Tracking by the geometry of the mask.

use catenary_core::image::label;
use catenary_core::regions::Regions;
use catenary_core::{Keypoints, LabelMask};

use crate::chain;
use crate::distance::Distance;
use crate::graph::{Graph, Skeleton};
use crate::pieces::Pieces;
use crate::polyline::{at, length};
use crate::strand::{Strand, StrandTracer, borders};
use crate::target::TargetFinder;
use crate::thinning::Thinning;
use crate::trail::TrailSearch;
use crate::{Error, KeypointTracker, PathStart, TrackerParams};

/// Finds the keypoints on the centre line of the mask's object.
///
/// 1. The largest regions of the object are its pieces; small holes are filled.
/// 2. Each piece is thinned to a skeleton one pixel wide, and that becomes a graph of lines between ends and junctions.
/// 3. The best trail through the graph covers the most length and goes straight on at junctions: it survives a bar that
///    touches or crosses itself.
/// 4. The trail is smoothed, its ends, which a skeleton bends or loses, are cut, and each point moves to the middle
///    between the borders beside it: sub-pixel accuracy. The ends are led straight on to the border.
/// 5. Pieces that follow one another across a gap, as behind the gripper, are joined.
/// 6. The keypoints lie at the given fractions of the line's length.
///
/// The line is what is seen: where an end is hidden or cut off by the image's edge, the keypoints lie on the rest.
/// A bar folded flat onto itself looks like a shorter, thicker one, and is taken for one.
/// Which end is the first is [`PathStart`]'s to say; it changes when the ends pass one another in height.
///
/// A keypoint's confidence is the product of: its width over the median width, or the inverse; 1/2 where it lies in a gap;
/// how far the object is from round (0 at length = width, 1 from 4 times the width on); the part of the object's area that
/// the line accounts for; 1/2 for each end at the image's edge. It is at least 0.01 where the object is seen.
///
/// The same mask gives the same keypoints, whatever came before.
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
    /// A tracker. Rejects parameters out of range.
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

    /// The parameters in use.
    pub fn params(&self) -> &TrackerParams {
        &self.params
    }

    /// The centre line of the last mask's object, (u, v) in pixels, from the end that the fractions are counted from;
    /// empty where it was not seen.
    pub fn centre_line_px(&self) -> &[[f64; 2]] {
        &self.line
    }

    /// Fills `line`; gives the visible length and the median width of the object, or none where it is not seen.
    fn trace_line(&mut self, mask: &LabelMask) -> Option<(f64, f64)> {
        self.line.clear();
        self.pieces.load(mask, &mut self.regions, &self.params);
        if self.pieces.list.is_empty() {
            return None;
        }
        self.distance.measure(&self.pieces);
        let thickest = self.distance.thickest_px(&self.pieces);
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

    /// Confidence in the line as a whole.
    fn confidence(&self, mask: &LabelMask, visible_px: f64, width_px: f64) -> f64 {
        let elongation = ((length(&self.line) / width_px - 1.0) / 3.0).clamp(0.0, 1.0);
        let accounted = (visible_px * width_px / self.pieces.labelled_px as f64).min(1.0);
        let size = [f64::from(mask.width), f64::from(mask.height)];
        let at_edge = |p: [f64; 2]| (0..2).any(|i| p[i] < 1.5 || p[i] > size[i] - 1.5);
        let cut = [self.line[0], self.line[self.line.len() - 1]].map(|p| if at_edge(p) { 0.5 } else { 1.0 });
        elongation * accounted * cut[0] * cut[1]
    }

    /// Confidence in the point at arc length `arc` alone.
    fn local_confidence(&self, arc: f64, width_px: f64) -> f64 {
        let total = length(&self.line);
        // Beside an end there is no width to measure.
        let (point, along) = at(&self.line, arc.clamp(width_px.min(0.5 * total), (total - width_px).max(0.5 * total)));
        match borders(&self.pieces, self.pieces.at(point), point, along, 4.0 * width_px) {
            _ if self.pieces.at(point) == 0 => 0.5,
            Some([left, right]) => ((left + right) / width_px).min(width_px / (left + right)),
            None => 0.25,
        }
    }
}

impl KeypointTracker for GeometricTracker {
    fn track(&mut self, mask: &LabelMask) -> Result<Keypoints, Error> {
        check(mask)?;
        let target = self.target.find(mask, self.params.min_target_area_px);
        let middle = [0.5 * f64::from(mask.width), 0.5 * f64::from(mask.height)];
        let mut keypoints = Keypoints {
            dlo_px: [middle; 4],
            target_px: target.map(|(centre, _)| centre),
            scores: [0.0; 4],
            target_score: target.map_or(0.0, |(_, score)| score),
            image_width_px: mask.width,
            image_height_px: mask.height,
        };
        if let Some((visible_px, width_px)) = self.trace_line(mask) {
            let total = length(&self.line);
            let confidence = self.confidence(mask, visible_px, width_px);
            for (k, fraction) in self.params.fractions.into_iter().enumerate() {
                keypoints.dlo_px[k] = at(&self.line, fraction * total).0;
                let local = self.local_confidence(fraction * total, width_px);
                keypoints.scores[k] = (confidence * local).clamp(0.01, 1.0) as f32;
            }
        }
        Ok(keypoints)
    }
}

fn check(mask: &LabelMask) -> Result<(), Error> {
    let (width, height) = (mask.width, mask.height);
    if mask.data.is_empty() || mask.data.len() != width as usize * height as usize {
        return Err(Error::Size { width, height, got: mask.data.len() });
    }
    match mask.data.iter().position(|&l| l > label::TARGET) {
        None => Ok(()),
        Some(i) => {
            let (u, v) = (i % width as usize, i / width as usize);
            Err(Error::UnknownLabel { label: mask.data[i], u, v })
        }
    }
}

#[cfg(test)]
mod tests;
