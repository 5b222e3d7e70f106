//! Beam: memory, start and motion.

use super::contact::Contact;
use super::discretisation::Discretisation;
use super::error::BeamError;
use super::grip::GripState;
use super::mesh::Mesh;
use super::node::Node;
use super::parameters::BeamParameters;
use super::potential::{Increment, System, TermForce};
use super::state::State;
use super::terms::Terms;

/// Counters of the stepper since the last reset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Time steps.
    pub steps: u64,
    /// Newton iterations in these steps.
    pub newton_iterations: u64,
    /// Steps accepted without convergence of Newton's method.
    pub unconverged_steps: u64,
    /// Shapes at rest, or through measured points, accepted although they still moved.
    pub unconverged_equilibria: u64,
    /// Halvings of Newton steps that had raised the potential.
    pub line_search_halvings: u64,
}

/// Beam in motion. [`Beam::new`] allocates all memory; [`Beam::reset`] changes the parameters without allocating.
///
/// ```
/// use catenary_core::{Fidelity, model::Section};
/// use catenary_simulator::beam::{Beam, BeamParameters, Discretisation, GripState};
///
/// let bar = BeamParameters::from_youngs_modulus(0.2, Section::Square { side_m: 0.015 }, 1055.0, 2e4, 0.45);
/// let grip = GripState { x_m: 0.4, z_m: 0.5, tangent_rad: 0.0 };
/// let mut beam = Beam::new(bar, Discretisation::of(Fidelity::Fast), grip)?;
/// assert!(beam.hang_at_rest(grip).converged);
/// beam.advance_to(0.5, |time_s| GripState { x_m: 0.4 + 0.1 * time_s, ..grip });
/// assert!(beam.tip()[1] < 0.4);
/// # Ok::<(), catenary_simulator::beam::BeamError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Beam {
    pub(super) parameters: BeamParameters,
    pub(super) terms: Terms,
    pub(super) discretisation: Discretisation,
    pub(super) mesh: Mesh,
    pub(super) state: State,
    pub(super) contact: Contact,
    pub(super) increment: Increment,
    pub(super) system: System,
    /// Positions before the last Newton step.
    pub(super) base: Vec<Node>,
    /// First guess of the positions at a step's end. Kept for [`Beam::advance_with`].
    pub(super) guess: Vec<Node>,
    /// Positions at the time last asked for, interpolated between two steps.
    pub(super) interpolated: Vec<Node>,
    pub(super) steps_since_start: u64,
    pub(super) counters: Counters,
}

/// Largest number of points that a shape is fitted to.
// Four keypoints are the usual case; the memory is allocated once, so it needs a bound.
const MAX_SPRINGS: usize = 64;

impl Beam {
    /// Makes a beam that lies straight and unloaded along the grip's tangent, at rest at time 0.
    pub fn new(parameters: BeamParameters, discretisation: Discretisation, grip: GripState) -> Result<Self, BeamError> {
        discretisation.check()?;
        let elements = discretisation.elements;
        let mut beam = Self {
            parameters,
            terms: Terms::default(),
            discretisation,
            mesh: Mesh::new(elements),
            state: State::new(elements),
            contact: Contact::new(elements + 1),
            increment: Increment::new(elements, MAX_SPRINGS),
            system: System::new(elements + 1),
            base: vec![[0.0; 3]; elements + 1],
            guess: vec![[0.0; 3]; elements + 1],
            interpolated: vec![[0.0; 3]; elements + 1],
            steps_since_start: 0,
            counters: Counters::default(),
        };
        beam.reset(parameters, grip)?;
        Ok(beam)
    }

    /// Reuses the memory for another beam: straight, unloaded, at rest at time 0, counters at zero, without terms from
    /// outside. The motion that follows does not depend on the beam before.
    pub fn reset(&mut self, parameters: BeamParameters, grip: GripState) -> Result<(), BeamError> {
        self.reset_to(parameters, &Terms::default(), grip)
    }

    /// Resets as [`Self::reset`] does, with terms from outside.
    pub fn reset_to(&mut self, parameters: BeamParameters, terms: &Terms, grip: GripState) -> Result<(), BeamError> {
        parameters.check()?;
        self.parameters = parameters;
        self.terms.clone_from(terms);
        self.mesh.fill(&parameters, terms);
        self.increment.hysteresis.reset(&terms.hystereses);
        self.increment.section_moments.reset(&terms.moments);
        self.increment.term_force.fill(TermForce::default());
        self.counters = Counters::default();
        self.lay_straight(grip);
        Ok(())
    }

    /// Resets as [`Self::reset`] does, with another discretisation. The number of elements must stay.
    pub fn reset_with(
        &mut self,
        parameters: BeamParameters,
        discretisation: Discretisation,
        grip: GripState,
    ) -> Result<(), BeamError> {
        discretisation.check()?;
        let (expected, got) = (self.discretisation.elements, discretisation.elements);
        if expected != got {
            return Err(BeamError::Elements { expected, got });
        }
        self.discretisation = discretisation;
        self.reset(parameters, grip)
    }

    /// Lays the beam straight and unloaded along the grip's tangent, at rest at time 0.
    pub fn lay_straight(&mut self, grip: GripState) {
        let [x, z, angle] = grip.node();
        let (sin, cos) = angle.sin_cos();
        let mut arc = 0.0;
        for k in self.mesh.origin..self.state.position.len() {
            self.state.position[k] = [x + arc * cos, z + arc * sin, angle];
            arc += self.mesh.elements.get(k).map_or(0.0, |e| e.length);
        }
        arc = 0.0;
        // The overhang is laid backwards from the grip.
        for k in (0..self.mesh.origin).rev() {
            arc -= self.mesh.elements[k].length;
            self.state.position[k] = [x + arc * cos, z + arc * sin, angle];
        }
        self.state.velocity.fill([0.0; 3]);
        self.start_here();
    }

    /// Takes the present positions and velocities as the state at time 0.
    pub(super) fn start_here(&mut self) {
        self.state.restart(&self.mesh);
        self.contact.restart(self.parameters.table.as_ref(), &self.mesh, &self.state.position);
        self.increment.enable_motion(&self.parameters, self.mesh.clamped_node);
        self.increment.hysteresis.restart(&self.state.strain);
        self.increment.section_moments.restart(&self.mesh, &self.state.strain);
        let tip = self.state.position.len() - 1;
        self.increment.load.restart(self.parameters.tip_load, &self.state.position[tip], &self.state.velocity[tip]);
        if !self.terms.ageings.is_empty() {
            self.age_to(0.0);
        }
        // A new start has no friction between strands: every motion starts from the middle of its hysteresis loop.
        for (neutral, strain) in self.increment.neutral_curvature.iter_mut().zip(&self.state.strain) {
            neutral.fill(strain[2]);
        }
        self.interpolated.copy_from_slice(&self.state.position);
        self.steps_since_start = 0;
    }

    /// Gives every point the velocity (x, z) in m/s; the clamped node still follows the grip.
    pub fn set_velocity(&mut self, velocity_m_s: [f64; 2]) {
        self.state.velocity.fill([velocity_m_s[0], velocity_m_s[1], 0.0]);
        self.start_here();
    }

    /// Starts at time 0 from the given nodes, ordered from the rear end to the tip: x and z in m and section angle in
    /// rad, with their rates. The clamped node still follows the grip.
    pub fn start_from(&mut self, nodes: &[[f64; 3]], velocities: &[[f64; 3]]) -> Result<(), BeamError> {
        for got in [nodes.len(), velocities.len()] {
            if got != self.state.position.len() {
                return Err(BeamError::Elements { expected: self.discretisation.elements, got: got.saturating_sub(1) });
            }
        }
        self.state.position.copy_from_slice(nodes);
        self.state.velocity.copy_from_slice(velocities);
        self.start_here();
        Ok(())
    }

    /// Time in s of the newest step.
    pub fn time_s(&self) -> f64 {
        self.steps_since_start as f64 * self.discretisation.time_step_s
    }

    /// Steps until the newest step is at or after `time_s`. `grip` gives the clamped end's state at each step's end.
    ///
    /// Afterwards the shape ([`Self::centre_line_at`] and its like) is interpolated to `time_s` within the last step.
    /// Energies and forces stay at the newest step. The motion does not depend on the times asked for, if they do not
    /// run backwards.
    pub fn advance_to(&mut self, time_s: f64, mut grip: impl FnMut(f64) -> GripState) {
        while let Some(next_s) = self.next_step_before(time_s) {
            self.step(grip(next_s));
        }
        self.interpolate_at(time_s);
    }

    /// Returns the end in s of the next time step if the newest step ends before `time_s`.
    pub(super) fn next_step_before(&self, time_s: f64) -> Option<f64> {
        let step_s = self.discretisation.time_step_s;
        // A time that is a multiple of the step up to rounding needs no further step.
        (self.time_s() < time_s - 1e-9 * step_s).then(|| (self.steps_since_start + 1) as f64 * step_s)
    }

    /// Interpolates the shape to `time_s`, within the last step.
    pub(super) fn interpolate_at(&mut self, time_s: f64) {
        self.interpolate(((time_s - self.time_s()) / self.discretisation.time_step_s + 1.0).clamp(0.0, 1.0));
    }

    /// Interpolates the shape at `share` (0 to 1) of the last step: cubic Hermite, from positions and velocities at
    /// both ends.
    fn interpolate(&mut self, share: f64) {
        if self.state.fresh || share >= 1.0 - 1e-9 {
            self.interpolated.copy_from_slice(&self.state.position);
            return;
        }
        let (s, step_s) = (share, self.discretisation.time_step_s);
        let newer = s * s * (3.0 - 2.0 * s);
        let [slope_old, slope_new] = [s * (1.0 - s) * (1.0 - s) * step_s, -s * s * (1.0 - s) * step_s];
        let state = &self.state;
        for (k, interpolated) in self.interpolated.iter_mut().enumerate() {
            for i in 0..3 {
                interpolated[i] = (1.0 - newer) * state.position_1[k][i]
                    + newer * state.position[k][i]
                    + slope_old * state.velocity_1[k][i]
                    + slope_new * state.velocity[k][i];
            }
        }
    }

    /// Returns the parameters.
    pub fn parameters(&self) -> &BeamParameters {
        &self.parameters
    }

    /// Returns the discretisation.
    pub fn discretisation(&self) -> &Discretisation {
        &self.discretisation
    }

    /// Returns the counters since the last reset.
    pub fn counters(&self) -> Counters {
        self.counters
    }
}
