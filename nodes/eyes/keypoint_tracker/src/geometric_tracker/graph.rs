//! Graph of a skeleton: lines of cells between ends and junctions.

use std::ops::Range;

use super::distance::Distance;
use super::pieces::Pieces;
use super::thinning::{Thinning, bits, neighbours};

/// Maximum number of lines. The longest lines are kept. A mask with more lines is noise.
const MAX_EDGES: usize = 48;
/// Maximum length of a spur, in half widths at its junction. A spur is a short line from the skeleton to a bump of the
/// outline.
const SPUR_HALF_WIDTHS: f64 = 1.5;

/// Node of the graph: a junction, an end, or the cell at which a ring is cut open.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    pub(crate) position: [f64; 2],
    /// Half the object's width at the node.
    pub(crate) half_width_px: f64,
    /// True for a junction, at which lines meet. False for an end of a line, and for the cell at which a ring is cut.
    pub(crate) is_junction: bool,
}

/// Edge of the graph: a line of cells from one node to another, or back to the same one.
#[derive(Debug, Clone)]
pub(crate) struct Edge {
    pub(crate) nodes: [usize; 2],
    pub(crate) cells: Range<usize>,
    pub(crate) length_px: f64,
    pub(crate) piece: u8,
}

/// Skeleton of a mask, from which the graph is read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Skeleton<'a> {
    pub(crate) pieces: &'a Pieces,
    pub(crate) distance: &'a Distance,
    pub(crate) thinning: &'a Thinning,
}

/// Graph of a skeleton. Reuses its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Graph {
    pub(crate) nodes: Vec<Node>,
    pub(crate) edges: Vec<Edge>,
    /// Cells of the edges, one edge after the other.
    pub(crate) cells: Vec<usize>,
    /// State of each cell of the grid: `FREE`, `TAKEN` by an edge, or `JUNCTION` plus the index of its junction's node.
    owner: Vec<u32>,
    /// Number of neighbours in the skeleton of each cell of the grid.
    degree: Vec<u8>,
    /// Cells of the junction under construction.
    cluster: Vec<usize>,
}

const FREE: u32 = 0;
const TAKEN: u32 = 1;
const JUNCTION: u32 = 2;

impl Graph {
    /// Builds the graph of the skeleton, without spurs.
    pub(crate) fn build(&mut self, skeleton: Skeleton<'_>) {
        let cells = &skeleton.thinning.cells;
        self.nodes.clear();
        self.edges.clear();
        self.cells.clear();
        self.owner.clear();
        self.owner.resize(skeleton.pieces.cells.len(), FREE);
        self.degree.clear();
        self.degree.resize(skeleton.pieces.cells.len(), 0);
        let around = neighbours(skeleton.pieces.stride);
        for &cell in cells {
            self.degree[cell] = bits(&skeleton.thinning.left, cell, &around).count_ones() as u8;
        }
        // Junctions first: lines end at them.
        for &cell in cells {
            if self.degree[cell] > 2 && self.owner[cell] == FREE {
                self.add_junction(cell, skeleton, &around);
            }
        }
        for &cell in cells {
            if self.degree[cell] == 1 && self.owner[cell] == FREE {
                let end = self.add_end(cell, skeleton);
                self.trace(end, None, cell, skeleton, &around);
            }
        }
        // Lines between two junctions touch no end and are still free.
        for &cell in cells {
            if let Some(node) = self.owner[cell].checked_sub(JUNCTION) {
                for near in around.map(|d| cell.wrapping_add_signed(d)) {
                    if skeleton.thinning.left[near] && self.owner[near] == FREE {
                        self.trace(node as usize, Some(cell), near, skeleton, &around);
                    }
                }
            }
        }
        // Cells that are still free belong to rings without a junction. Each ring is cut open at its first cell.
        for &cell in cells {
            if self.degree[cell] == 2 && self.owner[cell] == FREE {
                let cut = self.add_end(cell, skeleton);
                self.trace(cut, None, cell, skeleton, &around);
            }
        }
        self.prune();
    }

    /// Joins the connected cells around `start` that have more than two neighbours into one node, at their mean position.
    fn add_junction(&mut self, start: usize, skeleton: Skeleton<'_>, around: &[isize; 8]) {
        let owner = self.nodes.len() as u32 + JUNCTION;
        self.cluster.clear();
        self.cluster.push(start);
        self.owner[start] = owner;
        let mut next = 0;
        while let Some(&cell) = self.cluster.get(next) {
            next += 1;
            for near in around.map(|d| cell.wrapping_add_signed(d)) {
                if self.degree[near] > 2 && self.owner[near] == FREE {
                    self.owner[near] = owner;
                    self.cluster.push(near);
                }
            }
        }
        let count = self.cluster.len() as f64;
        let centres = self.cluster.iter().map(|&c| skeleton.pieces.centre(c));
        let sum = centres.fold([0.0; 2], |sum, c| [sum[0] + c[0], sum[1] + c[1]]);
        let half_width_px = self.cluster.iter().map(|&c| skeleton.distance.half_width_px(c)).fold(0.0, f64::max);
        self.nodes.push(Node { position: sum.map(|s| s / count), half_width_px, is_junction: true });
    }

    /// Adds a node for an end of a line, or for the cell at which a ring is cut. Returns its index.
    fn add_end(&mut self, cell: usize, skeleton: Skeleton<'_>) -> usize {
        let half_width_px = skeleton.distance.half_width_px(cell);
        self.nodes.push(Node { position: skeleton.pieces.centre(cell), half_width_px, is_junction: false });
        self.nodes.len() - 1
    }

    /// Adds the line that leaves node `from` at the cell `start`. `previous` is the junction's cell before `start`.
    fn trace(
        &mut self,
        from: usize,
        mut previous: Option<usize>,
        start: usize,
        skeleton: Skeleton<'_>,
        around: &[isize; 8],
    ) {
        let first = self.cells.len();
        let mut cell = start;
        let to = loop {
            self.cells.push(cell);
            self.owner[cell] = TAKEN;
            let left = &skeleton.thinning.left;
            let onward = |near: &usize| left[*near] && previous != Some(*near) && self.owner[*near] != TAKEN;
            match around.map(|d| cell.wrapping_add_signed(d)).into_iter().find(onward) {
                Some(next) if self.owner[next] == FREE => (previous, cell) = (Some(cell), next),
                Some(junction) => break (self.owner[junction] - JUNCTION) as usize,
                None if self.degree[cell] == 1 => break self.add_end(cell, skeleton),
                None => break from,
            }
        };
        let nodes = [from, to];
        let length_px = self.length(nodes, first, skeleton);
        // A few cells that lead back to their own junction are an artefact of thinning and no loop of the object.
        let is_knot = from == to && self.cells.len() - first < 5;
        if is_knot {
            self.cells.truncate(first);
        } else {
            let piece = skeleton.pieces.cells[start];
            self.edges.push(Edge { nodes, cells: first..self.cells.len(), length_px, piece });
        }
    }

    /// Length in pixels of the line from node to node through the cells from `first` on.
    fn length(&self, nodes: [usize; 2], first: usize, skeleton: Skeleton<'_>) -> f64 {
        let mut last = self.nodes[nodes[0]].position;
        let mut length = 0.0;
        let through = self.cells[first..].iter().map(|&c| skeleton.pieces.centre(c));
        for p in through.chain([self.nodes[nodes[1]].position]) {
            length += (p[0] - last[0]).hypot(p[1] - last[1]);
            last = p;
        }
        length
    }

    /// Removes spurs. If more than [`MAX_EDGES`] lines remain, only the longest [`MAX_EDGES`] are kept.
    fn prune(&mut self) {
        let nodes = &self.nodes;
        self.edges.retain(|edge| {
            let [a, b] = edge.nodes.map(|n| nodes[n]);
            let root = if a.is_junction { a } else { b };
            // Only a line from a junction to an end can be a spur.
            a.is_junction == b.is_junction || edge.length_px > SPUR_HALF_WIDTHS * root.half_width_px
        });
        if self.edges.len() > MAX_EDGES {
            self.edges
                .sort_unstable_by(|a, b| b.length_px.total_cmp(&a.length_px).then(a.cells.start.cmp(&b.cells.start)));
            self.edges.truncate(MAX_EDGES);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TrackerParams;
    use catenary_core::LabelMask;
    use catenary_core::regions::Regions;

    /// Number of junctions, number of ends, and the sorted lengths of the edges.
    fn graph(rows: &[&str]) -> (usize, usize, Vec<f64>) {
        let data = rows.concat().bytes().map(|b| u8::from(b == b'#')).collect();
        let mask = LabelMask::from_data(rows[0].len() as u32, rows.len() as u32, data).unwrap();
        let params = TrackerParams { min_area_px: 1, max_hole_px: 0, ..TrackerParams::default() };
        let (mut pieces, mut distance, mut thinning) = (Pieces::default(), Distance::default(), Thinning::default());
        pieces.load(&mask, &mut Regions::default(), &params);
        distance.measure(&pieces);
        thinning.thin(&pieces, |_| true);
        let mut graph = Graph::default();
        graph.build(Skeleton { pieces: &pieces, distance: &distance, thinning: &thinning });
        let junctions = graph.nodes.iter().filter(|n| n.is_junction).count();
        let mut lengths: Vec<f64> = graph.edges.iter().map(|e| (10.0 * e.length_px).round() / 10.0).collect();
        lengths.sort_by(f64::total_cmp);
        (junctions, graph.nodes.len() - junctions, lengths)
    }

    #[test]
    fn a_line_is_one_edge() {
        assert_eq!(graph(&["........", ".######.", "........"]), (0, 2, vec![5.0]));
    }

    #[test]
    fn three_arms_meet_at_one_junction_and_a_spur_is_dropped() {
        let (junctions, ends, lengths) = graph(&["....#....", "....#....", "....#....", "....#....", "#########"]);
        assert_eq!((junctions, ends, lengths.len()), (1, 3, 3), "{lengths:?}");
        let (_, _, lengths) = graph(&["..........", "....#.....", "##########"]);
        assert_eq!(lengths.len(), 1, "{lengths:?}");
    }

    #[test]
    fn a_ring_is_one_edge_and_a_lasso_two() {
        let ring = [".####.", "#....#", "#....#", "#....#", ".####."];
        let (junctions, _, lengths) = graph(&ring);
        assert_eq!((junctions, lengths.len()), (0, 1));
        assert!((lengths[0] - (10.0 + 4.0 * 2f64.sqrt())).abs() < 0.1, "{lengths:?}");
        let (junctions, _, lengths) =
            graph(&[".####......", "#....#.....", "#....######", "#....#.....", ".####......"]);
        assert_eq!((junctions, lengths.len()), (1, 2), "{lengths:?}");
    }
}
