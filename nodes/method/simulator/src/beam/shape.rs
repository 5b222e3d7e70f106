//! Centre line of a beam: places and lengths.

use super::body::Beam;
use super::node::Node;

impl Beam {
    /// Returns points (x, z) in m at fractions of the rest length from the grip (0) to the tip (1).
    pub fn centre_line_at<const K: usize>(&self, fractions: [f64; K]) -> [[f64; 2]; K] {
        fractions.map(|fraction| {
            let elements = &self.mesh.elements[self.mesh.origin..];
            let total: f64 = elements.iter().map(|e| e.length).sum();
            let (k, share) = locate(elements.iter().map(|e| e.length), fraction * total);
            self.point_on(self.mesh.origin + k, share)
        })
    }

    /// Returns points (x, z) in m at fractions of the deformed length from the grip (0) to the tip (1).
    pub fn centre_line_at_deformed_fraction<const K: usize>(&self, fractions: [f64; K]) -> [[f64; 2]; K] {
        fractions.map(|fraction| {
            let (k, share) = self.place_on_mesh(&self.interpolated, fraction);
            self.point_on(k, share)
        })
    }

    /// Returns the tip (x, z) in m.
    pub fn tip(&self) -> [f64; 2] {
        let [x, z, _] = self.interpolated[self.interpolated.len() - 1];
        [x, z]
    }

    /// Returns x in m, z in m and section angle in rad of every node, from the rear end to the tip.
    pub fn nodes(&self) -> &[[f64; 3]] {
        &self.interpolated
    }

    /// Returns the length in m of the deformed centre line from the grip to the tip.
    pub fn deformed_length_m(&self) -> f64 {
        self.chords(&self.interpolated).sum()
    }

    /// Returns the element and the place on it, 0 to 1, at a fraction of the deformed length.
    pub(super) fn place_on_mesh(&self, nodes: &[Node], fraction: f64) -> (usize, f64) {
        let total: f64 = self.chords(nodes).sum();
        let (k, share) = locate(self.chords(nodes), fraction * total);
        (self.mesh.origin + k, share)
    }

    /// Lengths in m of the chords from the origin to the tip.
    fn chords<'a>(&self, nodes: &'a [Node]) -> impl Iterator<Item = f64> + 'a {
        nodes[self.mesh.origin..].windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]))
    }

    /// Returns a point (x, z) in m of element `k`, at `share` (0 to 1) of its length. The point lies, to second order,
    /// on the arc through both nodes whose ends differ in angle as the sections do.
    fn point_on(&self, k: usize, share: f64) -> [f64; 2] {
        let (from, to) = (&self.interpolated[k], &self.interpolated[k + 1]);
        let (dx, dz) = (to[0] - from[0], to[1] - from[1]);
        let bulge = 0.5 * (to[2] - from[2]) * share * (1.0 - share);
        [from[0] + share * dx + bulge * dz, from[1] + share * dz - bulge * dx]
    }
}

/// Returns the piece, and the place on it from 0 to 1, at `distance` along successive pieces.
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
