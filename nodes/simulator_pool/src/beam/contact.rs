//! The table: normal contact and friction of the sections' upper and lower edges.

use super::block_tridiagonal::Symmetric;
use super::mesh::Mesh;
use super::parameters::Table;
use super::state::Node;

/// The two ends of a section: along its normal and against it.
const SIDES: [f64; 2] = [-1.0, 1.0];

/// What one section's edges did at the end of the last step. Edge 0 lies against the section's normal, edge 1 along it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Edges {
    /// Normal force in N; the next step's friction is in proportion to it.
    pub normal: [f64; 2],
    /// Friction force along x in N.
    pub friction: [f64; 2],
    /// Share of the full contact stiffness in action.
    pub engagement: [f64; 2],
    /// d(edge x) / d(section angle) in m for edge 1.
    pub lever: f64,
}

/// Contact with the table over one step.
#[derive(Debug, Clone)]
pub(super) struct Contact {
    pub edges: Vec<Edges>,
    /// Whether any edge touches, or touched at the end of the last step.
    pub touching: bool,
}

/// How positions become velocities within a step: v = `rate` q + history.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates<'a> {
    pub rate: f64,
    pub history: &'a [Node],
}

/// Normal force, stiffness and energy of an edge at depth `d` > 0, for full stiffness `k` in N/m.
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
    /// Memory for `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Self { edges: vec![Edges::default(); nodes], touching: false }
    }

    /// Starts afresh at `position`: pressed as the depth says, and not yet rubbed.
    pub fn restart(&mut self, table: Option<&Table>, mesh: &Mesh, position: &[Node]) {
        self.edges.fill(Edges::default());
        self.touching = false;
        if let Some(table) = table {
            self.press(table, mesh, position);
        }
    }

    /// Adds potential, gradient and Hessian of the contact at `position`. Returns the potential in J.
    ///
    /// Friction is Coulomb's law with the last step's normal force and lever, smoothed as v / sqrt(v^2 + vs^2): so it has
    /// a potential over the step, and the Hessian stays symmetric.
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
        for (k, edges) in self.edges.iter().enumerate() {
            let above = position[k][1] - table.height_m;
            let idle = edges.normal == [0.0; 2] && edges.engagement == [0.0; 2];
            if above >= mesh.half_height && idle {
                continue;
            }
            let stiffness = table.stiffness_n_m2 * mesh.share[k];
            let (sin, cos) = position[k][2].sin_cos();
            let (g, h) = (&mut gradient[k], &mut diagonal[k]);
            for side in 0..2 {
                let arm = SIDES[side] * mesh.half_height;
                let depth = -(above + arm * cos);
                let sinking = arm * sin;
                if depth > 0.0 {
                    let (force, slope, energy) = normal(depth, stiffness, table.softening_depth_m);
                    potential += energy;
                    add_scalar(g, h, [0.0, 1.0, -sinking], -force, slope);
                    h[5] += force * arm * cos;
                    self.touching = true;
                }
                if edges.engagement[side] > 0.0 && table.damping_time_s > 0.0 {
                    let damping = table.damping_time_s * stiffness * edges.engagement[side];
                    let speed = rates.rate * position[k][1] + rates.history[k][1];
                    potential += 0.5 * damping * speed * speed / rates.rate;
                    add_scalar(g, h, [0.0, 1.0, 0.0], damping * speed, damping * rates.rate);
                }
                let limit = table.friction_coefficient * edges.normal[side];
                if limit > 0.0 {
                    let lever = SIDES[side] * edges.lever;
                    let speed = edge_speed(rates, k, &position[k], lever);
                    let smooth = (speed * speed + table.slip_speed_m_s * table.slip_speed_m_s).sqrt();
                    let share = table.slip_speed_m_s / smooth;
                    potential += limit * (smooth - table.slip_speed_m_s) / rates.rate;
                    add_scalar(
                        g,
                        h,
                        [1.0, 0.0, lever],
                        limit * speed / smooth,
                        limit * share * share / smooth * rates.rate,
                    );
                    self.touching = true;
                }
            }
        }
        potential
    }

    /// Takes note of the forces at the end of a step, for the next step's friction and for reports.
    pub fn end_step(&mut self, table: &Table, mesh: &Mesh, position: &[Node], rates: Rates<'_>) {
        for (k, edges) in self.edges.iter_mut().enumerate() {
            for side in 0..2 {
                let limit = table.friction_coefficient * edges.normal[side];
                if limit > 0.0 {
                    let speed = edge_speed(rates, k, &position[k], SIDES[side] * edges.lever);
                    edges.friction[side] = -limit * speed / (speed * speed + table.slip_speed_m_s.powi(2)).sqrt();
                } else {
                    edges.friction[side] = 0.0;
                }
            }
        }
        self.press(table, mesh, position);
    }

    /// Takes note of the normal forces at `position`.
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

    /// Energy in J stored in the contact at `position`.
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

/// Speed in m/s along x of an edge with that lever.
#[inline(always)]
fn edge_speed(rates: Rates<'_>, k: usize, node: &Node, lever: f64) -> f64 {
    rates.rate * (node[0] + lever * node[2]) + rates.history[k][0] + lever * rates.history[k][2]
}

/// Adds a term that depends on one scalar with gradient `direction`: its first and second derivative by that scalar.
#[inline(always)]
fn add_scalar(gradient: &mut Node, diagonal: &mut Symmetric, direction: Node, first: f64, second: f64) {
    let [x, z, t] = direction;
    for (entry, by) in gradient.iter_mut().zip(direction) {
        *entry += first * by;
    }
    for (entry, product) in diagonal.iter_mut().zip([x * x, x * z, z * z, x * t, z * t, t * t]) {
        *entry += second * product;
    }
}
