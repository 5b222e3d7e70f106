//! Where the centre line is.

use super::body::Beam;
use super::state::Node;

impl Beam {
    /// Points (x, z) in m at fractions of the rest length from the grip (0) to the tip (1).
    pub fn centre_line_at<const K: usize>(&self, fractions: [f64; K]) -> [[f64; 2]; K] {
        fractions.map(|fraction| {
            let elements = &self.mesh.elements[self.mesh.origin..];
            let total: f64 = elements.iter().map(|e| e.length).sum();
            let (k, share) = locate(elements.iter().map(|e| e.length), fraction * total);
            self.point_on(self.mesh.origin + k, share)
        })
    }

    /// Points (x, z) in m at fractions of the deformed length from the grip (0) to the tip (1).
    pub fn centre_line_at_deformed_fraction<const K: usize>(&self, fractions: [f64; K]) -> [[f64; 2]; K] {
        fractions.map(|fraction| {
            let (k, share) = self.place_on_mesh(&self.shown, fraction);
            self.point_on(k, share)
        })
    }

    /// (x, z) in m of the tip.
    pub fn tip(&self) -> [f64; 2] {
        let [x, z, _] = self.shown[self.shown.len() - 1];
        [x, z]
    }

    /// x in m, z in m and section angle in rad of every node, from the rear end to the tip.
    pub fn nodes(&self) -> &[[f64; 3]] {
        &self.shown
    }

    /// Length in m of the deformed centre line from the grip to the tip.
    pub fn deformed_length_m(&self) -> f64 {
        self.chords(&self.shown).sum()
    }

    /// Element and place on it, 0 to 1, at a fraction of the deformed length.
    pub(super) fn place_on_mesh(&self, nodes: &[Node], fraction: f64) -> (usize, f64) {
        let total: f64 = self.chords(nodes).sum();
        let (k, share) = locate(self.chords(nodes), fraction * total);
        (self.mesh.origin + k, share)
    }

    /// Lengths of the chords from the origin on.
    fn chords<'a>(&self, nodes: &'a [Node]) -> impl Iterator<Item = f64> + 'a {
        nodes[self.mesh.origin..].windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]))
    }

    /// A point of element `k`: on the arc, to second order, whose chord joins the nodes and whose ends have turned apart
    /// as the sections have.
    fn point_on(&self, k: usize, share: f64) -> [f64; 2] {
        let (from, to) = (&self.shown[k], &self.shown[k + 1]);
        let (dx, dz) = (to[0] - from[0], to[1] - from[1]);
        let bulge = 0.5 * (to[2] - from[2]) * share * (1.0 - share);
        [from[0] + share * dx + bulge * dz, from[1] + share * dz - bulge * dx]
    }
}

/// The piece, and the place on it from 0 to 1, at `distance` along successive pieces.
fn locate(lengths: impl Iterator<Item = f64>, distance: f64) -> (usize, f64) {
    let mut left = distance;
    let mut end = (0, 0.0);
    for (k, length) in lengths.enumerate() {
        if left <= length {
            return (k, (left / length).clamp(0.0, 1.0));
        }
        left -= length;
        end = (k, 1.0);
    }
    end
}
