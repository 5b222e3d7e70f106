//! Load at the tip: a rigid body fixed to the last section, whose centre of mass lies on the tangent beyond the tip.
//!
//! Its centre r(q) = (x, z) + offset (cos angle, sin angle) moves with the last node q. Velocities and accelerations of r follow
//! the same backward differences as those of the nodes, so that a step adds m a0^2 |r(q) - target|^2 / 2 to the incremental
//! potential. The turning inertia about the centre adds to that of the last node.

use super::backward_difference::BackwardDifference;
use super::node::Node;

/// Rigid load at the tip.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TipLoad {
    /// Mass in kg; 0: no load.
    pub mass_kg: f64,
    /// Distance in m of the centre of mass from the tip, along the tangent. A negative one lies before the tip.
    pub offset_m: f64,
    /// Radius of gyration in m about the centre of mass.
    pub gyration_radius_m: f64,
}

impl TipLoad {
    /// Returns the turning inertia in kg m^2 about the centre of mass.
    pub fn inertia_kg_m2(&self) -> f64 {
        self.mass_kg * self.gyration_radius_m * self.gyration_radius_m
    }

    /// Returns the centre of mass (x, z) in m if the last node is at `tip`.
    fn centre(&self, tip: &Node) -> [f64; 2] {
        let (sin, cos) = tip[2].sin_cos();
        [tip[0] + self.offset_m * cos, tip[1] + self.offset_m * sin]
    }

    /// Returns the centre's velocity (x, z) in m/s if the last node has the velocity `rate`.
    fn velocity(&self, tip: &Node, rate: &Node) -> [f64; 2] {
        let (sin, cos) = tip[2].sin_cos();
        [rate[0] - self.offset_m * rate[2] * sin, rate[1] + self.offset_m * rate[2] * cos]
    }
}

/// Potential of a load in J, with gradient and Hessian by x, z and angle of the last node. The Hessian holds xx, xz, zz, x angle, z
/// angle and angle angle.
#[derive(Debug, Clone, Copy)]
pub(super) struct LoadResponse {
    pub potential: f64,
    pub gradient: [f64; 3],
    pub hessian: [f64; 6],
}

/// Motion of the load's centre of mass.
#[derive(Debug, Clone, Default)]
pub(super) struct LoadMotion {
    load: TipLoad,
    /// Velocities (x, z) in m/s now and one step ago.
    velocity: [f64; 2],
    velocity_1: [f64; 2],
    /// Velocity at the centre's position zero in the step, as that of the nodes.
    history: [f64; 2],
    /// Position in m of a centre on which only gravity acts, as that of the nodes.
    target: [f64; 2],
}

impl LoadMotion {
    /// Starts at the last node's position and velocity.
    pub fn restart(&mut self, load: TipLoad, tip: &Node, rate: &Node) {
        let velocity = load.velocity(tip, rate);
        *self = Self { load, velocity, velocity_1: velocity, ..Self::default() };
    }

    /// Returns true if there is a load.
    #[inline(always)]
    pub fn acts(&self) -> bool {
        self.load.mass_kg > 0.0
    }

    /// Computes the parts of a step that the past fixes, from the last node one step and two steps ago.
    pub fn prepare(&mut self, difference: BackwardDifference, one_ago: &Node, two_ago: &Node, gravity_m_s2: [f64; 2]) {
        let inverse = 1.0 / difference.c0;
        let (from, before) = (self.load.centre(one_ago), self.load.centre(two_ago));
        self.history = difference.history(&from, &before);
        let acceleration = difference.history(&self.velocity, &self.velocity_1);
        for i in 0..2 {
            let fall = (gravity_m_s2[i] - acceleration[i]) * inverse;
            self.target[i] = (fall - self.history[i]) * inverse;
        }
    }

    /// Prepares a step of implicit Euler of `step_s` from rest at `tip`.
    pub fn prepare_from_rest(&mut self, step_s: f64, tip: &Node, gravity_m_s2: [f64; 2]) {
        let centre = self.load.centre(tip);
        self.target = [0, 1].map(|i| centre[i] + gravity_m_s2[i] * step_s * step_s);
    }

    /// Returns potential, gradient and Hessian of the load with the last node at `tip`.
    #[inline(always)]
    pub fn respond(&self, rate: f64, tip: &Node) -> LoadResponse {
        let stiffness = self.load.mass_kg * rate * rate;
        let (sin, cos) = tip[2].sin_cos();
        let (along, across) = (self.load.offset_m * cos, self.load.offset_m * sin);
        let [gap_x, gap_z] = [tip[0] + along - self.target[0], tip[1] + across - self.target[1]];
        // The centre moves on a circle about the tip, which turns the force's lever.
        let turn = self.load.offset_m * self.load.offset_m - along * gap_x - across * gap_z;
        LoadResponse {
            potential: 0.5 * stiffness * (gap_x * gap_x + gap_z * gap_z),
            gradient: [gap_x, gap_z, along * gap_z - across * gap_x].map(|g| stiffness * g),
            hessian: [1.0, 0.0, 1.0, -across, along, turn].map(|h| stiffness * h),
        }
    }

    /// Ends a step with the last node at `tip`.
    pub fn end_step(&mut self, rate: f64, tip: &Node) {
        let centre = self.load.centre(tip);
        self.velocity_1 = self.velocity;
        self.velocity = [0, 1].map(|i| rate * centre[i] + self.history[i]);
    }

    /// Returns kinetic energy and potential energy in gravity, in J, with the last node at `tip`.
    pub fn energy_j(&self, tip: &Node, gravity_m_s2: [f64; 2]) -> [f64; 2] {
        let (mass, [vx, vz], [x, z]) = (self.load.mass_kg, self.velocity, self.load.centre(tip));
        [0.5 * mass * (vx * vx + vz * vz), -mass * (gravity_m_s2[0] * x + gravity_m_s2[1] * z)]
    }

    /// Returns the momentum (x, z) in kg m/s.
    pub fn momentum_kg_m_s(&self) -> [f64; 2] {
        self.velocity.map(|v| self.load.mass_kg * v)
    }

    /// Returns the angular momentum about the frame's origin in kg m^2/s, counter-clockwise, without the body's own rotation.
    pub fn angular_momentum_kg_m2_s(&self, tip: &Node) -> f64 {
        let [x, z] = self.load.centre(tip);
        self.load.mass_kg * (x * self.velocity[1] - z * self.velocity[0])
    }
}
