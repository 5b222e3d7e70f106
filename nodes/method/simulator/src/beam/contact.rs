//! Contact with the table: normal force, friction, damping and adhesion at the sections' upper and lower edges.

use super::block_tridiagonal::Symmetric;
use super::mesh::Mesh;
use super::node::Node;
use super::parameters::Table;

/// Signs of a section's two edges: against its normal, and along it.
const SIDES: [f64; 2] = [-1.0, 1.0];

/// Contact state of one section's edges at the end of the last step. Edge 0 lies against the section's normal, edge 1
/// along it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Edges {
    /// Normal force in N. The next step's friction limit is proportional to it.
    pub normal: [f64; 2],
    /// Friction force along x in N.
    pub friction: [f64; 2],
    /// Contact stiffness as a share of its full value.
    pub engagement: [f64; 2],
    /// Lever of edge 1 in m: d(edge x) / d(section angle).
    pub lever: f64,
}

/// Contact of all sections with the table over one step.
#[derive(Debug, Clone)]
pub(super) struct Contact {
    pub edges: Vec<Edges>,
    /// True if any edge touches, or touched at the end of the last step.
    pub touching: bool,
}

/// Velocities as a function of positions within a step: v = `rate` q + history.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates<'a> {
    pub rate: f64,
    pub history: &'a [Node],
}

/// Gap in m over which adhesion fades to zero.
// At 0.1 m/s a step of 2 ms covers 0.2 mm: letting go spans several steps and stays smooth for Newton's method.
const ADHESION_REACH_M: f64 = 1e-3;

/// Adhesion of an edge at depth `d` in m (negative: a gap): pull towards the table in N, derivative of the pull by z,
/// and energy in J. `full` is the pull in touch in N; it falls linearly over [`ADHESION_REACH_M`].
#[inline(always)]
fn adhesion(d: f64, full: f64) -> (f64, f64, f64) {
    if d >= 0.0 {
        return (full, 0.0, -full * (d + 0.5 * ADHESION_REACH_M));
    }
    let left = (1.0 + d / ADHESION_REACH_M).max(0.0);
    let slope = if left > 0.0 { -full / ADHESION_REACH_M } else { 0.0 };
    (full * left, slope, -0.5 * full * ADHESION_REACH_M * left * left)
}

/// Normal force in N, stiffness in N/m and energy in J of an edge at depth `d` > 0, for full stiffness `k` in N/m. The
/// stiffness rises linearly over the depth `softening`, so that the Hessian is continuous at first touch.
#[inline(always)]
fn normal(d: f64, k: f64, softening: f64) -> (f64, f64, f64) {
    if d < softening {
        let slope = k * d / softening;
        (0.5 * slope * d, slope, slope * d * d / 6.0)
    } else {
        let beyond = d - softening;
        let force = k * (0.5 * softening + beyond);
        (force, k, k * (softening * softening / 6.0 + 0.5 * beyond * (softening + beyond)))
    }
}

impl Contact {
    /// Allocates contact state for `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Self { edges: vec![Edges::default(); nodes], touching: false }
    }

    /// Restarts at `position`: normal forces follow from the depth, friction is zero.
    pub fn restart(&mut self, table: Option<&Table>, mesh: &Mesh, position: &[Node]) {
        self.edges.fill(Edges::default());
        self.touching = false;
        if let Some(table) = table {
            self.press(table, mesh, position);
        }
    }

    /// Adds potential, gradient and Hessian of the contact at `position`. Returns the potential in J.
    pub fn add(
        &mut self,
        table: &Table,
        mesh: &Mesh,
        position: &[Node],
        rates: Rates<'_>,
        gradient: &mut [Node],
        diagonal: &mut [Symmetric],
    ) -> f64 {
        let mut potential = 0.0;
        self.touching = false;
        // Without adhesion an edge in the air needs no evaluation at all.
        let reach = if table.adhesion_n_m > 0.0 { ADHESION_REACH_M } else { 0.0 };
        for (k, edges) in self.edges.iter().enumerate() {
            let above = position[k][1] - table.height_m;
            // An edge that touched in the last step still has damping and friction, even if it has left the table now.
            let idle = edges.normal == [0.0; 2] && edges.engagement == [0.0; 2];
            if above >= mesh.half_height + reach && idle {
                continue;
            }
            let mut at = Section {
                table,
                position: &position[k],
                rate: rates.rate,
                history: &rates.history[k],
                stiffness: table.stiffness_n_m2 * mesh.share[k],
                gradient: &mut gradient[k],
                diagonal: &mut diagonal[k],
            };
            let (sin, cos) = position[k][2].sin_cos();
            for side in 0..2 {
                let arm = SIDES[side] * mesh.half_height;
                let depth = -(above + arm * cos);
                let limit = table.friction_coefficient * edges.normal[side];
                if depth > 0.0 {
                    potential += at.add_normal(depth, arm * sin, arm * cos);
                }
                if reach > 0.0 && depth > -reach {
                    potential += at.add_adhesion(depth, table.adhesion_n_m * mesh.share[k], arm * sin, arm * cos);
                }
                if edges.engagement[side] > 0.0 && table.damping_time_s > 0.0 {
                    potential += at.add_damping(edges.engagement[side]);
                }
                if limit > 0.0 {
                    potential += at.add_friction(limit, SIDES[side] * edges.lever);
                }
                self.touching |= depth > 0.0 || limit > 0.0;
            }
        }
        potential
    }

    /// Stores the forces at the end of a step, for the next step's friction and for reports.
    pub fn end_step(&mut self, table: &Table, mesh: &Mesh, position: &[Node], rates: Rates<'_>) {
        for (k, edges) in self.edges.iter_mut().enumerate() {
            for side in 0..2 {
                let limit = table.friction_coefficient * edges.normal[side];
                if limit > 0.0 {
                    let speed = edge_speed(rates.rate, &position[k], &rates.history[k], SIDES[side] * edges.lever);
                    edges.friction[side] = -limit * speed / (speed * speed + table.slip_speed_m_s.powi(2)).sqrt();
                } else {
                    edges.friction[side] = 0.0;
                }
            }
        }
        self.press(table, mesh, position);
    }

    /// Stores the normal forces at `position`.
    fn press(&mut self, table: &Table, mesh: &Mesh, position: &[Node]) {
        for (k, edges) in self.edges.iter_mut().enumerate() {
            let above = position[k][1] - table.height_m;
            (edges.normal, edges.engagement) = ([0.0; 2], [0.0; 2]);
            if above >= mesh.half_height {
                continue;
            }
            let stiffness = table.stiffness_n_m2 * mesh.share[k];
            let cos = position[k][2].cos();
            for side in 0..2 {
                let depth = -(above + SIDES[side] * mesh.half_height * cos);
                if depth > 0.0 {
                    let (force, slope, _) = normal(depth, stiffness, table.softening_depth_m);
                    edges.normal[side] = force;
                    edges.engagement[side] = slope / stiffness;
                }
            }
            edges.lever = -mesh.half_height * cos;
        }
    }

    /// Elastic energy in J of the contact at `position`.
    pub fn energy(&self, table: &Table, mesh: &Mesh, position: &[Node]) -> f64 {
        let mut energy = 0.0;
        for (k, node) in position.iter().enumerate() {
            for side in SIDES {
                let depth = table.height_m - node[1] - side * mesh.half_height * node[2].cos();
                if depth > 0.0 {
                    energy += normal(depth, table.stiffness_n_m2 * mesh.share[k], table.softening_depth_m).2;
                }
            }
        }
        energy
    }
}

/// One section near the table, with its entries in the system.
struct Section<'a> {
    table: &'a Table,
    position: &'a Node,
    rate: f64,
    history: &'a Node,
    /// Full contact stiffness of an edge in N/m.
    stiffness: f64,
    gradient: &'a mut Node,
    diagonal: &'a mut Symmetric,
}

impl Section<'_> {
    /// Adds the normal force of an edge at `depth`. `sinking` = -d(edge z) / d(angle); `arm_z` is the edge's height in
    /// m above the centre.
    #[inline(always)]
    fn add_normal(&mut self, depth: f64, sinking: f64, arm_z: f64) -> f64 {
        let (force, slope, energy) = normal(depth, self.stiffness, self.table.softening_depth_m);
        self.add_scalar([0.0, 1.0, -sinking], -force, slope);
        self.diagonal[5] += force * arm_z;
        energy
    }

    /// Adds the adhesion of an edge at `depth`. `full` is its pull in touch in N; `sinking` and `arm_z` are as in
    /// [`Self::add_normal`].
    #[inline(always)]
    fn add_adhesion(&mut self, depth: f64, full: f64, sinking: f64, arm_z: f64) -> f64 {
        let (pull, slope, energy) = adhesion(depth, full);
        self.add_scalar([0.0, 1.0, -sinking], pull, slope);
        self.diagonal[5] -= pull * arm_z;
        energy
    }

    /// Adds damping of the normal motion, scaled by the last step's engagement.
    #[inline(always)]
    fn add_damping(&mut self, engagement: f64) -> f64 {
        let damping = self.table.damping_time_s * self.stiffness * engagement;
        let speed = self.rate * self.position[1] + self.history[1];
        self.add_scalar([0.0, 1.0, 0.0], damping * speed, damping * self.rate);
        0.5 * damping * speed * speed / self.rate
    }

    /// Adds Coulomb friction of at most `limit` in N, smoothed as v / sqrt(v^2 + vs^2) with slip speed vs.
    #[inline(always)]
    fn add_friction(&mut self, limit: f64, lever: f64) -> f64 {
        // Limit and lever are the last step's. With both fixed, friction has a potential over the step and the Hessian
        // stays symmetric.
        let speed = edge_speed(self.rate, self.position, self.history, lever);
        let slip = self.table.slip_speed_m_s;
        let smooth = (speed * speed + slip * slip).sqrt();
        let share = slip / smooth;
        self.add_scalar([1.0, 0.0, lever], limit * speed / smooth, limit * share * share / smooth * self.rate);
        limit * (smooth - slip) / self.rate
    }

    /// Adds a term that depends on one scalar with gradient `direction`, given its first and second derivative by the
    /// scalar.
    #[inline(always)]
    fn add_scalar(&mut self, direction: Node, first: f64, second: f64) {
        let [x, z, t] = direction;
        for (entry, by) in self.gradient.iter_mut().zip(direction) {
            *entry += first * by;
        }
        for (entry, product) in self.diagonal.iter_mut().zip([x * x, x * z, z * z, x * t, z * t, t * t]) {
            *entry += second * product;
        }
    }
}

/// Speed in m/s along x of an edge whose lever is d(edge x) / d(section angle) in m.
#[inline(always)]
fn edge_speed(rate: f64, position: &Node, history: &Node, lever: f64) -> f64 {
    rate * (position[0] + lever * position[2]) + history[0] + lever * history[2]
}
