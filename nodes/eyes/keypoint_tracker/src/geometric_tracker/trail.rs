//! Trail of the object's centre line through the graph of its skeleton.
//!
//! A bar that touches or crosses itself has a skeleton with junctions and loops. The longest shortest path would take a
//! short cut there. The search maximises the covered length minus a cost for bends at junctions, as a bar goes straight on
//! through a crossing. Each line is walked once. One exception: two strands that cross at an acute angle share a short
//! line, which may be walked twice and counts once.

use super::graph::{Edge, Graph};
use super::pieces::Pieces;

/// Cost of turning back at a junction, in half widths of the junction. A bend by an angle a costs ((1 − cos a) / 2)² of it.
/// The square is lenient with small bends: strands that cross at an acute angle seem to bend where their skeletons merge.
const REVERSAL_HALF_WIDTHS: f64 = 12.0;
/// Longest line between two junctions that may be walked twice, in half widths.
const SHARED_HALF_WIDTHS: f64 = 6.0;
/// Most steps of the search. The graph of a bar needs a few hundred; that of noise grows exponentially.
const MAX_STEPS: usize = 4000;

/// Edge walked from its first node to its second, or back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Step {
    pub(crate) edge: usize,
    pub(crate) is_back: bool,
}

/// Depth-first search for the best trail. Reuses its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct TrailSearch {
    /// Unit directions in which each edge leaves its first and its second node.
    leaving: Vec<[[f64; 2]; 2]>,
    /// Number of times that the current trail walks each edge.
    walked: Vec<u8>,
    trail: Vec<Step>,
    best: Vec<Step>,
    best_gain: f64,
    steps: usize,
}

impl TrailSearch {
    /// Best trail through the lines of `piece`, the first one of equals; empty if the piece has no line.
    pub(crate) fn best(&mut self, graph: &Graph, pieces: &Pieces, piece: u8) -> &[Step] {
        self.leaving.clear();
        self.leaving.extend(graph.edges.iter().map(|e| [leaving(graph, pieces, e, 0), leaving(graph, pieces, e, 1)]));
        self.walked.clear();
        self.walked.resize(graph.edges.len(), 0);
        self.trail.clear();
        self.best.clear();
        (self.best_gain, self.steps) = (0.0, 0);
        for (i, edge) in graph.edges.iter().enumerate().filter(|(_, e)| e.piece == piece) {
            for is_back in [false, true] {
                // A trail that begins at a junction can often be extended, and is then found from the end. Small graphs are
                // searched from junctions as well.
                let node = graph.nodes[edge.nodes[usize::from(is_back)]];
                if !node.is_junction || graph.edges.len() < 8 {
                    self.walk(graph, Step { edge: i, is_back }, 0.0);
                }
            }
        }
        &self.best
    }

    /// Walks `step` and every continuation of it. `gain` is the covered length minus the costs so far.
    fn walk(&mut self, graph: &Graph, step: Step, gain: f64) {
        self.steps += 1;
        if self.steps > MAX_STEPS {
            return;
        }
        let edge = &graph.edges[step.edge];
        let gain = gain + if self.walked[step.edge] == 0 { edge.length_px } else { 0.0 };
        self.walked[step.edge] += 1;
        self.trail.push(step);
        if gain > self.best_gain {
            self.best_gain = gain;
            self.best.clone_from(&self.trail);
        }
        let node = edge.nodes[usize::from(!step.is_back)];
        let back = self.leaving[step.edge][usize::from(!step.is_back)];
        for (i, next) in graph.edges.iter().enumerate() {
            for is_back in [false, true] {
                if next.nodes[usize::from(is_back)] == node && self.walked[i] < most_walks(graph, next) {
                    let onward = self.leaving[i][usize::from(is_back)];
                    // Both directions point away from the node: straight on they are opposite, and `turned` is 0.
                    let turned = 0.5 * (1.0 + back[0] * onward[0] + back[1] * onward[1]);
                    let cost = REVERSAL_HALF_WIDTHS * graph.nodes[node].half_width_px * turned * turned;
                    self.walk(graph, Step { edge: i, is_back }, gain - cost);
                }
            }
        }
        self.trail.pop();
        self.walked[step.edge] -= 1;
    }

    /// Writes the centres of the cells along `trail`, and the junctions between them, to `points`.
    pub(crate) fn points(trail: &[Step], graph: &Graph, pieces: &Pieces, points: &mut Vec<[f64; 2]>) {
        points.clear();
        for (k, step) in trail.iter().enumerate() {
            let edge = &graph.edges[step.edge];
            let node = graph.nodes[edge.nodes[usize::from(step.is_back)]];
            if k > 0 || node.is_junction {
                points.push(node.position);
            }
            let cells = graph.cells[edge.cells.clone()].iter().map(|&c| pieces.centre(c));
            if step.is_back { points.extend(cells.rev()) } else { points.extend(cells) }
        }
        if let Some(last) = trail.last() {
            let node = graph.nodes[graph.edges[last.edge].nodes[usize::from(!last.is_back)]];
            if node.is_junction {
                points.push(node.position);
            }
        }
    }
}

/// Number of times that a trail may walk `edge`.
fn most_walks(graph: &Graph, edge: &Edge) -> u8 {
    let [a, b] = edge.nodes.map(|n| graph.nodes[n]);
    let width = 0.5 * (a.half_width_px + b.half_width_px);
    if a.is_junction && b.is_junction && edge.length_px <= SHARED_HALF_WIDTHS * width { 2 } else { 1 }
}

/// Unit direction in which `edge` leaves its first (`end` 0) or second node, taken over three half widths.
fn leaving(graph: &Graph, pieces: &Pieces, edge: &Edge, end: usize) -> [f64; 2] {
    let node = graph.nodes[edge.nodes[end]];
    let cells = &graph.cells[edge.cells.clone()];
    let reach = ((3.0 * node.half_width_px) as usize + 2).min(cells.len() - 1);
    let p = pieces.centre(if end == 0 { cells[reach] } else { cells[cells.len() - 1 - reach] });
    let d = [p[0] - node.position[0], p[1] - node.position[1]];
    let norm = d[0].hypot(d[1]).max(1e-9);
    d.map(|c| c / norm)
}
