//! Solver for symmetric block-tridiagonal systems: a chain of nodes with three unknowns each.

/// Symmetric 3 x 3 block: xx, xz, zz, xt, zt, tt (t: angle).
pub(super) type Symmetric = [f64; 6];
/// Off-diagonal 3 x 3 block, by rows. The row belongs to the later node, the column to the earlier one.
pub(super) type Block = [[f64; 3]; 3];

/// Smallest pivot, as a share of its diagonal entry. A smaller pivot is replaced by that entry.
// Chosen well above rounding (1e-16), so that a pivot lost to cancellation is never divided by.
const PIVOT_FLOOR: f64 = 1e-6;

/// Factors L D L^T of one diagonal block: the strict lower triangle of L and the inverses of D.
#[derive(Debug, Clone, Copy, Default)]
struct Factor {
    l10: f64,
    l20: f64,
    l21: f64,
    inverse: [f64; 3],
}

/// Block-tridiagonal matrix of a chain of nodes, with the memory of its factors.
#[derive(Debug, Clone)]
pub(super) struct BlockTridiagonal {
    /// Diagonal blocks, one per node.
    pub diagonal: Vec<Symmetric>,
    /// Coupling blocks between node k + 1 and node k.
    pub coupling: Vec<Block>,
    factors: Vec<Factor>,
}

impl BlockTridiagonal {
    /// Allocates a chain of `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Self {
            diagonal: vec![[0.0; 6]; nodes],
            coupling: vec![[[0.0; 3]; 3]; nodes - 1],
            factors: vec![Factor::default(); nodes],
        }
    }

    /// Removes node `k` from the system: its unknowns become zero.
    pub fn fix_node(&mut self, k: usize, rhs: &mut [[f64; 3]]) {
        self.diagonal[k] = [1.0, 0.0, 1.0, 0.0, 0.0, 1.0];
        rhs[k] = [0.0; 3];
        if k > 0 {
            self.coupling[k - 1] = [[0.0; 3]; 3];
        }
        if k < self.coupling.len() {
            self.coupling[k] = [[0.0; 3]; 3];
        }
    }

    /// Removes x and z of node `k` from the system: both become zero. The angle stays an unknown.
    pub fn fix_place(&mut self, k: usize, rhs: &mut [[f64; 3]]) {
        let angle = self.diagonal[k][5];
        self.diagonal[k] = [1.0, 0.0, 1.0, 0.0, 0.0, angle];
        (rhs[k][0], rhs[k][1]) = (0.0, 0.0);
        if k > 0 {
            // Rows belong to the later node, which is this one.
            (self.coupling[k - 1][0], self.coupling[k - 1][1]) = ([0.0; 3], [0.0; 3]);
        }
        if k < self.coupling.len() {
            for row in &mut self.coupling[k] {
                (row[0], row[1]) = (0.0, 0.0);
            }
        }
    }

    /// Factorises the matrix in place, for [`Self::solve`].
    ///
    /// Negative and tiny pivots are raised. The matrix solved with is therefore positive definite, and the solution for
    /// a gradient is a descent direction even if the matrix itself is indefinite.
    pub fn factorise(&mut self) {
        let nodes = self.diagonal.len();
        assert!(self.coupling.len() + 1 == nodes && self.factors.len() == nodes);
        // Elimination runs from both ends to the middle at once: two short chains of dependent divisions, which the
        // processor overlaps, instead of one long chain.
        let middle = nodes / 2;
        for k in 0..middle {
            self.eliminate(k, k + 1);
            let mirrored = nodes - 1 - k;
            if mirrored > middle {
                // From the far end the earlier node is the neighbour: its rows become the block's rows.
                self.coupling[mirrored - 1] = transposed(&self.coupling[mirrored - 1]);
                self.eliminate(mirrored, mirrored - 1);
            }
        }
        self.factors[middle] = factorise(&self.diagonal[middle]);
    }

    /// Solves with the matrix of the last [`Self::factorise`], in place. `rhs` becomes the solution.
    pub fn solve(&self, rhs: &mut [[f64; 3]]) {
        let nodes = rhs.len();
        assert!(self.coupling.len() + 1 == nodes && self.factors.len() == nodes);
        let middle = nodes / 2;
        for k in 0..middle {
            self.carry(k, k + 1, rhs);
            let mirrored = nodes - 1 - k;
            if mirrored > middle {
                self.carry(mirrored, mirrored - 1, rhs);
            }
        }
        let factor = &self.factors[middle];
        let z = factor.forward(rhs[middle]);
        let i = factor.inverse;
        rhs[middle] = factor.backward([z[0] * i[0], z[1] * i[1], z[2] * i[2]]);
        for k in (0..middle).rev() {
            self.substitute(k, k + 1, rhs);
            let mirrored = nodes - 1 - k;
            if mirrored > middle {
                self.substitute(mirrored, mirrored - 1, rhs);
            }
        }
    }

    /// Eliminates node `k` from the row of its neighbour `next`: the coupling C between them (a row of `next` by a
    /// column of `k`) becomes G = C L^-T D^-1, and the neighbour's diagonal block loses G D G^T.
    #[inline(always)]
    fn eliminate(&mut self, k: usize, next: usize) {
        let factor = factorise(&self.diagonal[k]);
        let coupling = &mut self.coupling[k.min(next)];
        let mut w = [[0.0; 3]; 3];
        for i in 0..3 {
            w[i] = factor.forward(coupling[i]);
            for j in 0..3 {
                coupling[i][j] = w[i][j] * factor.inverse[j];
            }
        }
        let g = coupling;
        let product = |i: usize, j: usize| g[i][0] * w[j][0] + g[i][1] * w[j][1] + g[i][2] * w[j][2];
        let products = [product(0, 0), product(1, 0), product(1, 1), product(2, 0), product(2, 1), product(2, 2)];
        for (entry, product) in self.diagonal[next].iter_mut().zip(products) {
            *entry -= product;
        }
        self.factors[k] = factor;
    }

    /// Subtracts the eliminated node `k` from the right-hand side of its neighbour `next`.
    #[inline(always)]
    fn carry(&self, k: usize, next: usize, rhs: &mut [[f64; 3]]) {
        let (z, g) = (self.factors[k].forward(rhs[k]), &self.coupling[k.min(next)]);
        for i in 0..3 {
            rhs[next][i] -= g[i][0] * z[0] + g[i][1] * z[1] + g[i][2] * z[2];
        }
        rhs[k] = z;
    }

    /// Computes the unknowns of the eliminated node `k` from the known ones of its neighbour `next`.
    #[inline(always)]
    fn substitute(&self, k: usize, next: usize, rhs: &mut [[f64; 3]]) {
        let (factor, g) = (&self.factors[k], &self.coupling[k.min(next)]);
        let (z, known) = (rhs[k], rhs[next]);
        let mut y = [0.0; 3];
        for j in 0..3 {
            y[j] = z[j] * factor.inverse[j] - (g[0][j] * known[0] + g[1][j] * known[1] + g[2][j] * known[2]);
        }
        rhs[k] = factor.backward(y);
    }
}

fn transposed(block: &Block) -> Block {
    let [[a, b, c], [d, e, f], [g, h, i]] = *block;
    [[a, d, g], [b, e, h], [c, f, i]]
}

impl Factor {
    /// Forward substitution: L^-1 b.
    #[inline(always)]
    fn forward(&self, b: [f64; 3]) -> [f64; 3] {
        let y1 = b[1] - self.l10 * b[0];
        [b[0], y1, b[2] - self.l20 * b[0] - self.l21 * y1]
    }

    /// Backward substitution: L^-T b.
    #[inline(always)]
    fn backward(&self, b: [f64; 3]) -> [f64; 3] {
        let x1 = b[1] - self.l21 * b[2];
        [b[0] - self.l10 * x1 - self.l20 * b[2], x1, b[2]]
    }
}

/// Factorises a symmetric block as L D L^T, with raised pivots.
#[inline(always)]
fn factorise(block: &Symmetric) -> Factor {
    let [xx, xz, zz, xt, zt, tt] = *block;
    let i0 = 1.0 / raised(xx, xx);
    let (l10, l20) = (xz * i0, xt * i0);
    let i1 = 1.0 / raised(zz - l10 * xz, zz);
    let zt = zt - l20 * xz;
    let l21 = zt * i1;
    let i2 = 1.0 / raised(tt - l20 * xt - l21 * zt, tt);
    Factor { l10, l20, l21, inverse: [i0, i1, i2] }
}

#[inline(always)]
// The floor of the scale lets even a zero diagonal be divided by.
fn raised(pivot: f64, diagonal: f64) -> f64 {
    let scale = diagonal.abs();
    if pivot > PIVOT_FLOOR * scale { pivot } else { scale.max(f64::MIN_POSITIVE.sqrt()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catenary_core::seed;
    use rand::RngExt;

    #[test]
    fn solution_satisfies_random_positive_definite_systems() {
        for nodes in 2..9 {
            check_random_system(nodes);
        }
    }

    fn check_random_system(nodes: usize) {
        let mut rng = seed::rng(3, 0);
        let mut draw = || rng.random_range(-1.0..1.0);
        let mut matrix = BlockTridiagonal::new(nodes);
        for block in &mut matrix.diagonal {
            *block = [6.0 + draw(), draw(), 6.0 + draw(), draw(), draw(), 6.0 + draw()];
        }
        for row in matrix.coupling.iter_mut().flatten() {
            *row = [draw(), draw(), draw()];
        }
        let rhs: Vec<[f64; 3]> = (0..nodes).map(|_| [draw(), draw(), draw()]).collect();
        let kept = matrix.clone();
        let mut x = rhs.clone();
        matrix.factorise();
        matrix.solve(&mut x);
        for k in 0..nodes {
            let [xx, xz, zz, xt, zt, tt] = kept.diagonal[k];
            let rows = [[xx, xz, xt], [xz, zz, zt], [xt, zt, tt]];
            for i in 0..3 {
                let mut product: f64 = (0..3).map(|j| rows[i][j] * x[k][j]).sum();
                if k > 0 {
                    product += (0..3).map(|j| kept.coupling[k - 1][i][j] * x[k - 1][j]).sum::<f64>();
                }
                if k + 1 < nodes {
                    product += (0..3).map(|j| kept.coupling[k][j][i] * x[k + 1][j]).sum::<f64>();
                }
                assert!((product - rhs[k][i]).abs() < 1e-13, "row {i} of node {k}: {product}, not {}", rhs[k][i]);
            }
        }
    }

    #[test]
    fn solution_of_an_indefinite_system_is_a_descent_direction() {
        let mut matrix = BlockTridiagonal::new(2);
        matrix.diagonal = vec![[-1.0, 0.5, 2.0, 0.1, 0.0, -3.0], [1.0, 0.0, 1.0, 0.0, 0.0, 0.0]];
        matrix.coupling[0] = [[0.3, 0.1, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.7]];
        let gradient = [[1.0, -2.0, 0.5], [0.3, 0.4, -0.2]];
        let mut x = gradient;
        matrix.factorise();
        matrix.solve(&mut x);
        let slope: f64 = x.iter().flatten().zip(gradient.iter().flatten()).map(|(a, b)| a * b).sum();
        assert!(slope > 0.0, "{slope}");
    }

    #[test]
    fn fixed_node_does_not_move() {
        let mut matrix = BlockTridiagonal::new(3);
        matrix.diagonal.fill([2.0, 0.0, 2.0, 0.0, 0.0, 2.0]);
        matrix.coupling.fill([[0.5; 3]; 3]);
        let mut rhs = vec![[1.0; 3]; 3];
        matrix.fix_node(1, &mut rhs);
        matrix.factorise();
        matrix.solve(&mut rhs);
        assert_eq!(rhs, vec![[0.5; 3], [0.0; 3], [0.5; 3]]);
    }

    #[test]
    fn fixed_place_turns_as_if_its_neighbours_met_its_angle_alone() {
        let mut matrix = BlockTridiagonal::new(3);
        matrix.diagonal.fill([2.0, 0.0, 2.0, 0.0, 0.0, 2.0]);
        matrix.coupling.fill([[0.5, 0.25, 0.125]; 3]);
        let mut rhs = vec![[1.0; 3]; 3];
        matrix.fix_place(1, &mut rhs);
        matrix.factorise();
        matrix.solve(&mut rhs);
        assert_eq!([rhs[1][0], rhs[1][1]], [0.0; 2]);
        // The angle's row: 0.5 x + 0.25 z + 0.125 t of node 0, 2 t of its own, 0.125 (x + z + t) of node 2.
        let [a, t, b] = [rhs[0], [0.0, 0.0, rhs[1][2]], rhs[2]];
        let row = 0.5 * a[0] + 0.25 * a[1] + 0.125 * a[2] + 2.0 * t[2] + 0.125 * (b[0] + b[1] + b[2]);
        assert!((row - 1.0).abs() < 1e-14, "{row}");
    }
}
