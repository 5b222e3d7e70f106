//! Bar of tetrahedra in motion.

use super::mesh;
use crate::beam::{BeamError, BeamParameters, GripState, SectionProperties};
use catenary_core::Fidelity;
use catenary_core::model::{AxialLaw, Section};
use rapier3d_f64::prelude::{
    ColliderBuilder, PhysicsWorld, RigidBodyBuilder, SoftBodyCellModel, SoftBodyHandle, SoftBodyMaterial,
    SoftBodySolver, Vector,
};
use thiserror::Error;

/// Discretisation of time and of the bar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FemDiscretisation {
    /// Cubes along the bar, of five tetrahedra each.
    pub cells_along: usize,
    /// Cubes over its height and its width.
    pub cells_across: usize,
    /// Time step in s. Contacts are found and the matrix is factorised once per step.
    pub time_step_s: f64,
    /// Steps of implicit Euler within a time step.
    pub substeps: usize,
}

impl FemDiscretisation {
    /// Discretisation of a fidelity level: fast and standard 14 cubes in a row, fine mesh and reference 27 rows of 2 x
    /// 2.
    pub fn of(fidelity: Fidelity) -> Self {
        let (cells_along, cells_across, time_step_s, substeps) = match fidelity {
            Fidelity::Fast => (14, 1, 4e-3, 1),
            Fidelity::FineMesh => (27, 2, 4e-3, 1),
            Fidelity::Standard => (14, 1, 4e-3, 4),
            Fidelity::Reference => (27, 2, 2e-3, 4),
        };
        Self { cells_along, cells_across, time_step_s, substeps }
    }
}

/// Error of a bar that cannot be made.
#[derive(Debug, Error, PartialEq)]
pub enum FemError {
    /// Parameters that the beam refuses, too.
    #[error(transparent)]
    Beam(#[from] BeamError),
    /// Property that a solid bar of tetrahedra does not have.
    #[error("rapier_fem: expected a plain solid bar of square section, got {0}")]
    Unsupported(&'static str),
}

/// Contact skin in m, by which the bar hovers above the table.
const SKIN_M: f64 = 2.5e-4;
/// Half extents in m of the table. Its middle lies under the origin.
const TABLE_HALF_M: [f64; 3] = [3.0, 3.0, 0.1];
/// Length unit of rapier in m.
// Size of the object's section: with the default of 1 m contacts are found 20 mm ahead.
const LENGTH_UNIT_M: f64 = 0.02;
/// Largest number of iterations of the conjugate gradient.
// The default of 20 does not converge on stiff bars.
const MAX_LINEAR_ITERATIONS: usize = 1000;
/// Relative residual at which the conjugate gradient stops.
const LINEAR_TOLERANCE: f64 = 1e-7;
/// Pseudo time step in s of the descent to rest, number of steps of one length, and largest number of halvings.
// Larger steps diverge, because the matrix lacks the stiffness that tension gives across the bar. After this many steps
// without rest the next ones are half as long.
const REST_STEP_S: f64 = 0.015;
const REST_STEPS: usize = 1000;
const MAX_REST_HALVINGS: usize = 4;
/// Largest movement in m in the last pseudo step of a bar at rest.
const STILL_M: f64 = 1e-7;

/// Bar of tetrahedra, held at one end.
pub struct FemBar {
    world: PhysicsWorld,
    body: SoftBodyHandle,
    discretisation: FemDiscretisation,
    /// Places of the clamped particles on the straight bar.
    clamped: Vec<Vector>,
    steps: u64,
    /// Centres of the layers, (x, z) in m, from the grip to the tip: before the last step, after it, and interpolated.
    before: Vec<[f64; 2]>,
    after: Vec<[f64; 2]>,
    interpolated: Vec<[f64; 2]>,
}

impl FemBar {
    /// Makes a bar that lies straight and unloaded along the grip's tangent, at rest at time 0. Young's modulus,
    /// Poisson's ratio and density are computed from the beam's stiffnesses and mass.
    pub fn new(p: &BeamParameters, discretisation: FemDiscretisation, grip: GripState) -> Result<Self, FemError> {
        let side_m = check(p)?;
        let area = p.section.area_m2();
        let youngs_modulus_pa = p.axial_stiffness_n / area;
        let ratio = p.section.shear_coefficient() * p.axial_stiffness_n / (2.0 * p.shear_stiffness_n) - 1.0;
        // At 0.5 the bulk modulus is infinite.
        let poisson_ratio = ratio.clamp(0.0, 0.499);
        let mut bar = mesh::straight(p.length_m, side_m, discretisation.cells_along, discretisation.cells_across);
        let masses = mesh::lumped_masses(&bar, p.mass_per_length_kg_m / area);
        let layer = (discretisation.cells_across + 1).pow(2);
        let elastic_damping_ratio =
            mesh::damping_ratio(&bar, youngs_modulus_pa, poisson_ratio, &masses, layer, p.kelvin_voigt_time_s);
        let clamped = bar.positions[..layer].to_vec();
        bar.positions.iter_mut().for_each(|point| *point = mesh::placed(*point, grip));
        let friction = p.table.map_or(0.0, |t| t.friction_coefficient);
        let bar = bar
            .masses(masses)
            .pinned_particles(0..layer as u32)
            .cell_model(match p.axial_law {
                AxialLaw::Linear => SoftBodyCellModel::Corotational,
                AxialLaw::NeoHookean => SoftBodyCellModel::NeoHookean,
            })
            .material(SoftBodyMaterial {
                young_modulus: youngs_modulus_pa,
                poisson_ratio,
                elastic_damping_ratio,
                ..SoftBodyMaterial::default()
            })
            .solver(SoftBodySolver::Fem)
            .particle_radius(SKIN_M)
            .surface_collider(ColliderBuilder::ball(SKIN_M).friction(friction))
            .can_sleep(false);
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::new(p.gravity_m_s2[0], 0.0, p.gravity_m_s2[1]);
        if let Some(table) = p.table {
            let [x, y, z] = TABLE_HALF_M;
            let place = Vector::new(0.0, 0.0, table.height_m - z);
            world.insert(
                RigidBodyBuilder::fixed().translation(place),
                ColliderBuilder::cuboid(x, y, z).friction(friction),
            );
        }
        let settings = &mut world.integration_parameters;
        settings.length_unit = LENGTH_UNIT_M;
        settings.soft_bodies.max_extra_substeps = 0;
        settings.soft_bodies.fem.max_linear_iterations = MAX_LINEAR_ITERATIONS;
        settings.soft_bodies.fem.linear_tolerance = LINEAR_TOLERANCE;
        let body = world.insert_soft_body(bar);
        let mut bar = Self {
            world,
            body,
            discretisation,
            clamped,
            steps: 0,
            before: Vec::new(),
            after: Vec::new(),
            interpolated: Vec::new(),
        };
        bar.start_here();
        Ok(bar)
    }

    /// Lets the bar hang at rest, by repeated steps of implicit Euler from rest. Returns true if it came to rest.
    pub fn hang_at_rest(&mut self) -> bool {
        self.world.integration_parameters.num_solver_iterations = 1;
        let mut still = false;
        for k in 0..MAX_REST_HALVINGS * REST_STEPS {
            let from = self.centre();
            self.set_velocity([0.0; 2]);
            self.world.integration_parameters.dt = REST_STEP_S * 0.5_f64.powi((k / REST_STEPS) as i32);
            self.world.step();
            let moved =
                self.centre().iter().zip(&from).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
            still = moved < STILL_M;
            if still {
                break;
            }
        }
        self.set_velocity([0.0; 2]);
        self.start_here();
        still
    }

    /// Gives every free particle the velocity (x, z) in m/s.
    pub fn set_velocity(&mut self, velocity_m_s: [f64; 2]) {
        let Some(body) = self.world.soft_bodies.get_mut(self.body) else { return };
        for i in self.clamped.len()..body.num_particles() {
            body.set_particle_velocity(i, Vector::new(velocity_m_s[0], 0.0, velocity_m_s[1]));
        }
    }

    /// Advances to `time_s`, in s since the start. `grip` gives the grip at the end of each step. Between two steps the
    /// bar is interpolated linearly.
    pub fn advance_to(&mut self, time_s: f64, mut grip: impl FnMut(f64) -> GripState) {
        let step_s = self.discretisation.time_step_s;
        while self.time_s() < time_s - 1e-9 * step_s {
            self.step(grip((self.steps + 1) as f64 * step_s));
        }
        let share = ((time_s - self.time_s()) / step_s + 1.0).clamp(0.0, 1.0);
        let mix = |a: &[f64; 2], b: &[f64; 2]| [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];
        self.interpolated = self.before.iter().zip(&self.after).map(|(a, b)| mix(a, b)).collect();
    }

    /// Returns the centres of the layers of particles, (x, z) in m, from the grip to the tip.
    pub fn centre_line(&self) -> &[[f64; 2]] {
        &self.interpolated
    }

    /// Returns the centre of the tip, (x, z) in m.
    pub fn tip(&self) -> [f64; 2] {
        self.interpolated[self.interpolated.len() - 1]
    }

    /// Returns the length in m of the deformed centre line.
    pub fn deformed_length_m(&self) -> f64 {
        self.interpolated.windows(2).map(chord).sum()
    }

    /// Returns the point (x, z) in m at a fraction of the deformed length from the grip (0) to the tip (1).
    pub fn at_deformed_fraction(&self, fraction: f64) -> [f64; 2] {
        let mut left = fraction * self.deformed_length_m();
        for pair in self.interpolated.windows(2) {
            let length = chord(pair);
            if left <= length {
                let share = left / length;
                return [0, 1].map(|i| pair[0][i] + share * (pair[1][i] - pair[0][i]));
            }
            left -= length;
        }
        self.tip()
    }

    fn time_s(&self) -> f64 {
        self.steps as f64 * self.discretisation.time_step_s
    }

    fn step(&mut self, grip: GripState) {
        if let Some(body) = self.world.soft_bodies.get_mut(self.body) {
            for (i, place) in self.clamped.iter().enumerate() {
                body.set_particle_kinematic_target(i, mesh::placed(*place, grip));
            }
        }
        self.world.integration_parameters.dt = self.discretisation.time_step_s;
        self.world.integration_parameters.num_solver_iterations = self.discretisation.substeps;
        self.world.step();
        self.steps += 1;
        self.before = std::mem::take(&mut self.after);
        self.after = self.centre();
    }

    /// Takes the present state as the state at time 0.
    fn start_here(&mut self) {
        self.steps = 0;
        self.after = self.centre();
        self.before.clone_from(&self.after);
        self.interpolated.clone_from(&self.after);
    }

    fn centre(&self) -> Vec<[f64; 2]> {
        let Some(body) = self.world.soft_bodies.get(self.body) else { return Vec::new() };
        let size = self.clamped.len();
        let middle = |layer: &[_]| {
            let sum = layer.iter().fold([0.0; 2], |s, p: &rapier3d_f64::prelude::SoftBodyParticle| {
                [s[0] + p.position().x, s[1] + p.position().z]
            });
            sum.map(|v| v / size as f64)
        };
        body.particles().chunks_exact(size).map(middle).collect()
    }
}

fn chord(ends: &[[f64; 2]]) -> f64 {
    (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1])
}

/// Checks that the bar is solid and square, without anything else. Returns its side in m.
fn check(p: &BeamParameters) -> Result<f64, FemError> {
    p.check()?;
    let Section::Square { side_m } = p.section else { return Err(FemError::Unsupported("a round section")) };
    let solid = p.axial_stiffness_n * side_m * side_m / 12.0;
    if (p.bending_stiffness_n_m2 - solid).abs() > 1e-9 * solid {
        return Err(FemError::Unsupported("a bending stiffness that its axial stiffness and section do not give"));
    }
    // Everything that a plain bar has is copied. A difference left over is something that the tetrahedra do not have.
    let plain = BeamParameters {
        axial_law: p.axial_law,
        axial_stiffness_n: p.axial_stiffness_n,
        shear_stiffness_n: p.shear_stiffness_n,
        bending_stiffness_n_m2: p.bending_stiffness_n_m2,
        mass_per_length_kg_m: p.mass_per_length_kg_m,
        rotary_inertia_per_length_kg_m: p.rotary_inertia_per_length_kg_m,
        kelvin_voigt_time_s: p.kelvin_voigt_time_s,
        creep_time_s: p.creep_time_s,
        gravity_m_s2: p.gravity_m_s2,
        table: p.table,
        ..BeamParameters::from_youngs_modulus(p.length_m, p.section, 1.0, 1.0, 0.0)
    };
    if plain != *p {
        return Err(FemError::Unsupported(
            "drag, a tip mass, a rest curvature, a stiffness gradient, creep, sticking strands, a soft or slipping grip, an overhang or no grip",
        ));
    }
    Ok(side_m)
}
