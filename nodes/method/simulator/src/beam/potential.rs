//! Incremental potential of one time step: value, gradient and Hessian.
//!
//! A step of length h has velocities v = a0 q + (history) and accelerations a = a0 v + (history). Its potential is
//!
//! sum over nodes of  m a0^2 (q - target)^2 / 2  +  sum over elements of their energy and damping  +  drag  +  contact
//!
//! and is stationary in the new positions q. `target` is the position of a node on which only gravity acts.

use super::block_tridiagonal::BlockTridiagonal;
use super::contact::{Contact, Rates};
use super::element::{self, Direction, Kinematics, Memory, Response, Strain};
use super::hysteresis::Hysteresis;
use super::material::AxialMix;
use super::mesh::Mesh;
use super::node::Node;
use super::parameters::{BeamParameters, Table};
use super::section_moment::SectionMoments;
use super::strand_friction::{LAYERS, Neutral, StrandFriction};
use super::tip_load::LoadMotion;

/// Quadratic drag at one node, linearised over the step: coefficient in N s/m, and the unit normal of the centre line.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CrossDrag {
    pub coefficient: f64,
    pub normal: [f64; 2],
}

/// Torsion spring between the clamped section and the grip's angle.
#[derive(Debug, Clone, Copy)]
pub(super) struct GripSpring {
    pub node: usize,
    /// Angle in rad at which the moment is zero.
    pub angle: f64,
    /// Stiffness in N m/rad.
    pub stiffness: f64,
}

/// Spring between a point of the centre line and a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spring {
    /// Element that carries the point, and the point's place on this element, 0 to 1.
    pub element: usize,
    pub share: f64,
    /// Place of the fixed end, (x, z) in m.
    pub place: [f64; 2],
    /// Stiffness in N/m.
    pub stiffness: f64,
}

/// Force of terms from outside on one node, linearised over the step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TermForce {
    /// Force (x, z) in N and couple in N m at the predicted position.
    pub load: [f64; 3],
    /// Predicted position (x, z) in m.
    pub place_m: [f64; 2],
    /// Stiffness (xx, xz, zz) in N/m.
    pub stiffness: [f64; 3],
}

impl TermForce {
    /// Returns minus the change of the force (x, z) in N from the predicted position to `position`.
    #[inline(always)]
    pub fn resistance(&self, position: &Node) -> [f64; 2] {
        let [xx, xz, zz] = self.stiffness;
        let gap = [0, 1].map(|i| position[i] - self.place_m[i]);
        [xx * gap[0] + xz * gap[1], xz * gap[0] + zz * gap[1]]
    }

    /// Returns the force (x, z) in N and the couple in N m at a position.
    pub fn at(&self, position: &Node) -> [f64; 3] {
        let [x, z] = self.resistance(position);
        [self.load[0] - x, self.load[1] - z, self.load[2]]
    }
}

/// Data of one step that do not depend on the new positions.
#[derive(Debug, Clone)]
pub(super) struct Increment {
    pub mix: AxialMix,
    /// Coefficient a0 in 1/s: d(velocity) / d(position).
    pub rate: f64,
    /// Positions of nodes on which only gravity acts.
    pub target: Vec<Node>,
    /// Velocities at position zero.
    pub history: Vec<Node>,
    /// Stresses per stiffness that the past fixes.
    pub stress_shift: Vec<Strain>,
    pub kelvin_voigt_time_s: f64,
    /// Torsion spring of a compliant grip; none if the grip is firm.
    pub grip_spring: Option<GripSpring>,
    /// Forces of terms from outside on the nodes.
    pub term_force: Vec<TermForce>,
    /// True if one of these forces has a stiffness.
    pub has_stiff_forces: bool,
    pub strand_friction: StrandFriction,
    /// State of the strands of each element.
    pub neutral_curvature: Vec<Neutral>,
    pub hysteresis: Hysteresis,
    pub section_moments: SectionMoments,
    pub load: LoadMotion,
    /// True if there is any drag.
    pub drag: bool,
    pub linear_drag: f64,
    pub cross_drag: Vec<CrossDrag>,
    pub table: Option<Table>,
    /// Springs of a fit to measured points; empty in motion.
    pub springs: Vec<Spring>,
}

/// Gradient and Hessian of the potential.
#[derive(Debug, Clone)]
pub(super) struct System {
    pub gradient: Vec<Node>,
    pub matrix: BlockTridiagonal,
    kinematics: Vec<Kinematics>,
}

impl System {
    /// Allocates a system of `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Self {
            gradient: vec![[0.0; 3]; nodes],
            matrix: BlockTridiagonal::new(nodes),
            kinematics: vec![Kinematics::default(); nodes - 1],
        }
    }

    /// Adds an element's gradient at its two nodes.
    #[inline(always)]
    fn add_gradient(&mut self, k: usize, r: &Response) {
        let [fx, fz] = r.force;
        let half = 0.5 * r.shear_moment;
        let (head, tail) = self.gradient.split_at_mut(k + 1);
        let (from, to) = (&mut head[k], &mut tail[0]);
        *from = [from[0] - fx, from[1] - fz, from[2] + half - r.bending_moment];
        *to = [to[0] + fx, to[1] + fz, to[2] + half + r.bending_moment];
    }

    /// Adds an element's Hessian at its two nodes.
    #[inline(always)]
    fn add_hessian(&mut self, k: usize, r: &Response) {
        let [xx, xz, zz] = r.chord;
        let [xt, zt] = [0.5 * r.chord_angle[0], 0.5 * r.chord_angle[1]];
        let tt = 0.25 * r.angle;
        let (same, cross) = (tt + r.bending, tt - r.bending);
        let at_from = [xx, xz, zz, -xt, -zt, same];
        let at_to = [xx, xz, zz, xt, zt, same];
        let (head, tail) = self.matrix.diagonal.split_at_mut(k + 1);
        for i in 0..6 {
            head[k][i] += at_from[i];
            tail[0][i] += at_to[i];
        }
        self.matrix.coupling[k] = [[-xx, -xz, xt], [-xz, -zz, zt], [-xt, -zt, cross]];
    }

    fn add_spring(&mut self, spring: &Spring, position: &[Node]) -> f64 {
        let (k, w) = (spring.element, spring.share);
        let mut potential = 0.0;
        for axis in 0..2 {
            let gap = (1.0 - w) * position[k][axis] + w * position[k + 1][axis] - spring.place[axis];
            potential += 0.5 * spring.stiffness * gap * gap;
            self.gradient[k][axis] += spring.stiffness * gap * (1.0 - w);
            self.gradient[k + 1][axis] += spring.stiffness * gap * w;
            let entry = if axis == 0 { 0 } else { 2 };
            self.matrix.diagonal[k][entry] += spring.stiffness * (1.0 - w) * (1.0 - w);
            self.matrix.diagonal[k + 1][entry] += spring.stiffness * w * w;
            self.matrix.coupling[k][axis][axis] += spring.stiffness * w * (1.0 - w);
        }
        potential
    }
}

impl Increment {
    /// Allocates `elements` elements and up to `springs` springs.
    pub fn new(elements: usize, springs: usize) -> Self {
        Self {
            mix: AxialMix::default(),
            rate: 0.0,
            target: vec![[0.0; 3]; elements + 1],
            history: vec![[0.0; 3]; elements + 1],
            stress_shift: vec![[0.0; 3]; elements],
            kelvin_voigt_time_s: 0.0,
            grip_spring: None,
            term_force: vec![TermForce::default(); elements + 1],
            has_stiff_forces: false,
            strand_friction: StrandFriction::default(),
            neutral_curvature: vec![[0.0; LAYERS]; elements],
            hysteresis: Hysteresis::default(),
            section_moments: SectionMoments::default(),
            load: LoadMotion::default(),
            drag: false,
            linear_drag: 0.0,
            cross_drag: vec![CrossDrag::default(); elements + 1],
            table: None,
            springs: Vec::with_capacity(springs),
        }
    }

    /// Sets the terms that act in motion, and clears the history.
    pub fn enable_motion(&mut self, p: &BeamParameters, clamped_node: Option<usize>) {
        self.mix = AxialMix::of(p);
        self.kelvin_voigt_time_s = p.kelvin_voigt_time_s;
        self.strand_friction = StrandFriction::of(p);
        self.hysteresis.set_on(true);
        self.section_moments.set_in_motion(true);
        self.drag = p.linear_drag_n_s_m2 > 0.0 || p.quadratic_drag_n_s2_m3 > 0.0;
        self.linear_drag = p.linear_drag_n_s_m2;
        self.table = p.table;
        self.springs.clear();
        let compliance = p.grip_compliance_rad_n_m;
        let spring = |node| GripSpring { node, angle: 0.0, stiffness: 1.0 / compliance };
        self.grip_spring = if compliance > 0.0 { clamped_node.map(spring) } else { None };
        self.stress_shift.fill([0.0; 3]);
        self.cross_drag.fill(CrossDrag::default());
    }

    /// Sets the terms that act at rest: no damping, no drag, no friction on the table or between strands.
    pub fn enable_rest(&mut self, p: &BeamParameters, clamped_node: Option<usize>) {
        self.enable_motion(p, clamped_node);
        self.kelvin_voigt_time_s = 0.0;
        self.strand_friction = StrandFriction::default();
        self.hysteresis.set_on(false);
        self.section_moments.set_in_motion(false);
        self.drag = false;
        self.table = p.table.map(|table| Table { friction_coefficient: 0.0, damping_time_s: 0.0, ..table });
    }

    /// Returns velocities as a function of positions.
    pub fn rates(&self) -> Rates<'_> {
        Rates { rate: self.rate, history: &self.history }
    }

    /// Assembles gradient and Hessian at `position`. Returns the potential in J. `reference` holds the chords at the
    /// step's start. Without `HESSIAN` the elements' part of the Hessian is left out.
    pub fn assemble<const HESSIAN: bool>(
        &self,
        mesh: &Mesh,
        position: &[Node],
        reference: &[Direction],
        contact: &mut Contact,
        system: &mut System,
    ) -> f64 {
        let mut potential = self.add_nodes(mesh, position, system);
        let stiffening = self.kelvin_voigt_time_s * self.rate;
        let ends = position.windows(2).zip(reference);
        for ((at, element), (ends, reference)) in system.kinematics.iter_mut().zip(&mesh.elements).zip(ends) {
            *at = element::kinematics(element, &ends[0], &ends[1], reference);
        }
        for (k, element) in mesh.elements.iter().enumerate() {
            let at = system.kinematics[k];
            let memory = Memory { stiffening, shift: self.stress_shift[k] };
            let mut response = element::respond(element, self.mix, &memory, &at);
            if self.strand_friction.acts() {
                self.strand_friction.add(element, at.strain[2], &self.neutral_curvature[k], &mut response);
            }
            if self.hysteresis.acts() {
                self.hysteresis.add(k, element, at.strain[2], &mut response);
            }
            if self.section_moments.acts() {
                self.section_moments.add(k, element, at.strain[2], &mut response);
            }
            potential += response.energy;
            system.add_gradient(k, &response);
            if HESSIAN {
                system.add_hessian(k, &response);
            }
        }
        if let Some(grip) = &self.grip_spring {
            let turn = position[grip.node][2] - grip.angle;
            potential += 0.5 * grip.stiffness * turn * turn;
            system.gradient[grip.node][2] += grip.stiffness * turn;
            system.matrix.diagonal[grip.node][5] += grip.stiffness;
        }
        for spring in &self.springs {
            potential += system.add_spring(spring, position);
        }
        if let Some(table) = &self.table {
            let System { gradient, matrix, .. } = system;
            potential += contact.add(table, mesh, position, self.rates(), gradient, &mut matrix.diagonal);
        }
        potential
    }

    /// Starts the assembly with inertia, gravity and drag: overwrites gradient and diagonal. Returns the potential in
    /// J.
    fn add_nodes(&self, mesh: &Mesh, position: &[Node], system: &mut System) -> f64 {
        let rate_2 = self.rate * self.rate;
        let mut potential = 0.0;
        let nodes = mesh.inertia.iter().zip(position.iter().zip(&self.target));
        let sums = system.gradient.iter_mut().zip(&mut system.matrix.diagonal);
        for ((inertia, (position, target)), (gradient, diagonal)) in nodes.zip(sums) {
            let stiffness = inertia.map(|m| m * rate_2);
            for i in 0..3 {
                let gap = position[i] - target[i];
                gradient[i] = stiffness[i] * gap;
                potential += 0.5 * stiffness[i] * gap * gap;
            }
            *diagonal = [stiffness[0], 0.0, stiffness[1], 0.0, 0.0, stiffness[2]];
        }
        if self.load.acts() {
            let last = position.len() - 1;
            let response = self.load.respond(self.rate, &position[last]);
            potential += response.potential;
            (0..3).for_each(|i| system.gradient[last][i] += response.gradient[i]);
            (0..6).for_each(|i| system.matrix.diagonal[last][i] += response.hessian[i]);
        }
        if self.drag {
            potential += self.add_drag(mesh, position, system);
        }
        if self.has_stiff_forces {
            potential += self.add_stiff_forces(position, system);
        }
        potential
    }

    fn add_stiff_forces(&self, position: &[Node], system: &mut System) -> f64 {
        let mut potential = 0.0;
        for (k, (force, q)) in self.term_force.iter().zip(position).enumerate() {
            let resistance = force.resistance(q);
            let diagonal = &mut system.matrix.diagonal[k];
            for i in 0..2 {
                potential += 0.5 * resistance[i] * (q[i] - force.place_m[i]);
                system.gradient[k][i] += resistance[i];
            }
            (0..3).for_each(|i| diagonal[i] += force.stiffness[i]);
        }
        potential
    }

    /// Returns the reversed drag (x, z) in N on node `k` at a velocity (x, z) in m/s: it points along the motion.
    pub fn drag_on(&self, mesh: &Mesh, k: usize, velocity: [f64; 2]) -> [f64; 2] {
        let linear = self.linear_drag * mesh.share[k];
        let CrossDrag { coefficient, normal: [nx, nz] } = self.cross_drag[k];
        let cross_speed = velocity[0] * nx + velocity[1] * nz;
        [linear * velocity[0] + coefficient * cross_speed * nx, linear * velocity[1] + coefficient * cross_speed * nz]
    }

    fn add_drag(&self, mesh: &Mesh, position: &[Node], system: &mut System) -> f64 {
        let mut potential = 0.0;
        for (k, share) in mesh.share.iter().enumerate() {
            let velocity = [0, 1].map(|i| self.rate * position[k][i] + self.history[k][i]);
            let drag = self.drag_on(mesh, k, velocity);
            let linear = self.linear_drag * share;
            let CrossDrag { coefficient, normal: [nx, nz] } = self.cross_drag[k];
            potential += 0.5 * (drag[0] * velocity[0] + drag[1] * velocity[1]) / self.rate;
            system.gradient[k][0] += drag[0];
            system.gradient[k][1] += drag[1];
            let diagonal = &mut system.matrix.diagonal[k];
            diagonal[0] += self.rate * (linear + coefficient * nx * nx);
            diagonal[1] += self.rate * coefficient * nx * nz;
            diagonal[2] += self.rate * (linear + coefficient * nz * nz);
        }
        potential
    }
}
