//! Energies, momenta and forces of a beam at the newest step.

use super::body::Beam;
use super::element::{self, Memory};
use super::grip::GripReaction;
use super::material::{self, AxialMix};

/// Energy of a beam in J, by kind.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Energy {
    /// Elastic energy of stretch, shear and bending.
    pub elastic_j: f64,
    /// Energy stored in sticking strands. The rest of their moment's work is lost in slip.
    pub strands_j: f64,
    /// Kinetic energy of translation and rotation.
    pub kinetic_j: f64,
    /// Potential energy in gravity, relative to the frame's origin.
    pub potential_j: f64,
    /// Elastic energy of the contact with the table.
    pub contact_j: f64,
}

impl Energy {
    /// Sum of all kinds.
    pub fn total_j(&self) -> f64 {
        self.elastic_j + self.strands_j + self.kinetic_j + self.potential_j + self.contact_j
    }
}

/// Force of the table on the beam.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TableForce {
    /// Friction along x in N.
    pub friction_n: f64,
    /// Normal force along z in N.
    pub normal_n: f64,
}

impl Beam {
    /// Force and moment of the gripper on the beam. Zero for a free beam.
    pub fn grip_reaction(&self) -> GripReaction {
        let Some(c) = self.mesh.clamped_node else { return GripReaction::default() };
        let state = &self.state;
        let [gx, gz] = self.parameters.gravity_m_s2;
        let gravity = [gx, gz, 0.0];
        let inertia = &self.mesh.inertia[c];
        // Balance of the clamped node: inertia, neighbouring elements, table, drag and the forces of additional terms.
        let mut held = [0, 1, 2].map(|i| inertia[i] * (state.acceleration[c][i] - gravity[i]));
        for k in c.saturating_sub(1)..(c + 1).min(self.mesh.elements.len()) {
            let on_node = self.element_force(k, c);
            held = [0, 1, 2].map(|i| held[i] + on_node[i]);
        }
        let edges = &self.contact.edges[c];
        for side in 0..2 {
            held[0] -= edges.friction[side];
            held[1] -= edges.normal[side];
        }
        let drag = self.increment.drag_on(&self.mesh, c, [state.velocity[c][0], state.velocity[c][1]]);
        let of_terms = self.increment.term_force[c].at(&state.position[c]);
        for i in 0..2 {
            held[i] += drag[i] - of_terms[i];
        }
        held[2] -= of_terms[2];
        GripReaction { force_x_n: held[0], force_z_n: held[1], moment_n_m: held[2] }
    }

    /// Wrench of the beam on the hand at the clamped node and at the newest step, in the order of [`catenary_core::Frame::wrench`]: force along x
    /// and z in N, torque about +y in N m. It is minus the [grip's reaction](Self::grip_reaction); counter-clockwise in x-z is about -y, so that
    /// the torque keeps its sign.
    pub fn wrench_on_hand(&self) -> [f64; 3] {
        let held = self.grip_reaction();
        [-held.force_x_n, -held.force_z_n, held.moment_n_m]
    }

    /// Internal force of element `k` at its node `c`, with the sign of the derivative of the energy with respect to the
    /// position. Damping and creep are included.
    fn element_force(&self, k: usize, c: usize) -> [f64; 3] {
        let state = &self.state;
        let element = &self.mesh.elements[k];
        let at = element::kinematics(element, &state.position[k], &state.position[k + 1], &state.direction[k]);
        // `extra_stress` holds the damping stress of the newest step in full, so the rate part must not be added again.
        let memory = Memory { stiffening: 0.0, shift: state.extra_stress[k] };
        let mut r = element::respond(element, AxialMix::of(&self.parameters), &memory, &at);
        let friction = &self.increment.strand_friction;
        if friction.acts() {
            friction.add(element, at.strain[2], &self.increment.neutral_curvature[k], &mut r);
        }
        if self.increment.hysteresis.acts() {
            self.increment.hysteresis.add(k, element, at.strain[2], &mut r);
        }
        if self.increment.section_moments.acts() {
            self.increment.section_moments.add(k, element, at.strain[2], &mut r);
        }
        let sign = if k == c { -1.0 } else { 1.0 };
        [sign * r.force[0], sign * r.force[1], 0.5 * r.shear_moment + sign * r.bending_moment]
    }

    /// Elastic, strand, kinetic, potential and contact energy at the newest step.
    pub fn energy(&self) -> Energy {
        let (state, mesh) = (&self.state, &self.mesh);
        let [gx, gz] = self.parameters.gravity_m_s2;
        let mut energy = Energy::default();
        for (element, strain) in mesh.elements.iter().zip(&state.strain) {
            let [ea, ga, ei] = element.stiffness;
            let stretch = 1.0 + strain[0];
            let axial = material::axial(AxialMix::of(&self.parameters), ea, stretch, 1.0 / stretch).energy;
            let rest = 0.5 * (ga * strain[1] * strain[1] + ei * strain[2] * strain[2]);
            energy.elastic_j += element.length * (axial + rest);
        }
        let friction = &self.increment.strand_friction;
        if friction.acts() {
            for ((element, strain), neutral) in
                mesh.elements.iter().zip(&state.strain).zip(&self.increment.neutral_curvature)
            {
                energy.strands_j += element.length * friction.stored(strain[2], neutral);
            }
        }
        for (inertia, (q, v)) in mesh.inertia.iter().zip(state.position.iter().zip(&state.velocity)) {
            energy.kinetic_j += 0.5 * (inertia[0] * (v[0] * v[0] + v[1] * v[1]) + inertia[2] * v[2] * v[2]);
            energy.potential_j -= inertia[0] * (gx * q[0] + gz * q[1]);
        }
        if self.increment.load.acts() {
            let [kinetic_j, potential_j] = self.increment.load.energy_j(self.state.tip(), self.parameters.gravity_m_s2);
            energy.kinetic_j += kinetic_j;
            energy.potential_j += potential_j;
        }
        if let Some(table) = &self.parameters.table {
            energy.contact_j = self.contact.energy(table, mesh, &state.position);
        }
        energy
    }

    /// Force of the table on the whole beam.
    pub fn table_force(&self) -> TableForce {
        let mut force = TableForce::default();
        for edges in &self.contact.edges {
            force.friction_n += edges.friction[0] + edges.friction[1];
            force.normal_n += edges.normal[0] + edges.normal[1];
        }
        force
    }

    /// Linear momentum (x, z) in kg m/s.
    pub fn momentum_kg_m_s(&self) -> [f64; 2] {
        let mut momentum = self.increment.load.momentum_kg_m_s();
        for (inertia, v) in self.mesh.inertia.iter().zip(&self.state.velocity) {
            momentum = [momentum[0] + inertia[0] * v[0], momentum[1] + inertia[1] * v[1]];
        }
        momentum
    }

    /// Angular momentum about the frame's origin in kg m^2/s, counter-clockwise, with the sections' own rotation.
    pub fn angular_momentum_kg_m2_s(&self) -> f64 {
        let motion = self.state.position.iter().zip(&self.state.velocity);
        let of_node =
            |(m, (q, v)): (&[f64; 3], (&[f64; 3], &[f64; 3]))| m[0] * (q[0] * v[1] - q[1] * v[0]) + m[2] * v[2];
        let of_nodes: f64 = self.mesh.inertia.iter().zip(motion).map(of_node).sum();
        of_nodes + self.increment.load.angular_momentum_kg_m2_s(self.state.tip())
    }
}
