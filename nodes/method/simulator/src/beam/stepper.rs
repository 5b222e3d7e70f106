//! Time step: Newton's method on the incremental potential.

use super::backward_difference::BackwardDifference;
use super::body::Beam;
use super::discretisation::Scheme;
use super::element;
use super::grip::{GripReaction, GripState};
use super::material;
use super::node::Node;
use super::potential::{CrossDrag, TermForce};
use super::terms::PointState;
use std::f64::consts::TAU;

/// Weight in m/rad of an angle against a position in the size of a Newton step.
// The order of an element's length: 0.2 m over 20 elements.
const ANGLE_WEIGHT_M: f64 = 0.01;
/// Largest movement of a node in one Newton step, as a share of an element's length.
// Below 1, so that a node does not reach its neighbour's place in one step.
const STEP_LIMIT: f64 = 0.7;
/// Largest number of halvings of one Newton step; afterwards it is accepted.
const MAX_HALVINGS: u32 = 8;
/// Growth of the potential at which a Newton step is still accepted: in J, and as a share of the potential.
const SLACK: [f64; 2] = [1e-13, 1e-10];
/// Growth accepted with friction between strands, close to rounding. A strand that changes between sticking and
/// slipping changes the potential by 1e-11 J; with more slack Newton's method would switch it back and forth for ever.
const STRANDS_SLACK: [f64; 2] = [1e-16, 1e-13];

impl Beam {
    /// Advances by one time step. The clamped node goes to `grip`.
    pub fn step(&mut self, grip: GripState) {
        let grip = self.begin_step(grip);
        if !self.minimise() {
            self.counters.unconverged_steps += 1;
        }
        self.end_step(grip);
    }

    /// Prepares the increment and the first guess of the positions. Returns the grip as changed by terms from outside.
    pub(super) fn begin_step(&mut self, grip: GripState) -> GripState {
        // The first step has one state behind it, and the second-order rule needs two.
        let scheme = if self.state.fresh { Scheme::ImplicitEuler } else { self.discretisation.scheme };
        let difference = BackwardDifference::new(scheme, self.discretisation.time_step_s);
        let grip = self.changed_grip(grip);
        if !self.terms.ageings.is_empty() {
            // After the grip's terms, which see the load at the end of the last step.
            self.age_to(self.time_s() + self.discretisation.time_step_s);
        }
        self.prepare(difference);
        self.predict(grip);
        if !self.terms.forces.is_empty() {
            self.add_forces();
        }
        if self.increment.section_moments.acts() {
            let time_step_s = self.discretisation.time_step_s;
            let time_s = (self.steps_since_start + 1) as f64 * time_step_s;
            self.increment.section_moments.begin_step(time_s, time_step_s);
        }
        grip
    }

    /// Sets the stiffness at `time_s`, as changed by terms from outside.
    pub(super) fn age_to(&mut self, time_s: f64) {
        let factor = self.terms.ageings.iter().map(|term| term.stiffness_factor(time_s)).product();
        self.mesh.scale_stiffness(factor);
    }

    /// Finishes the step with the present positions.
    pub(super) fn end_step(&mut self, grip: GripState) {
        self.finish();
        if self.parameters.grip_slip_m_s > 0.0 {
            self.slip(grip);
        }
        self.counters.steps += 1;
        self.steps_since_start += 1;
    }

    /// Returns the grip's state at the end of the next step as changed by terms from outside.
    pub(super) fn changed_grip(&self, grip: GripState) -> GripState {
        if self.terms.grips.is_empty() {
            return grip;
        }
        self.grip_at(self.time_s() + self.discretisation.time_step_s, grip, &self.grip_reaction())
    }

    /// Returns the grip's state at `time_s` as changed by terms from outside. `reaction` is the grip's load.
    pub(super) fn grip_at(&self, time_s: f64, mut grip: GripState, reaction: &GripReaction) -> GripState {
        self.terms.grips.iter().for_each(|term| term.change(time_s, reaction, &mut grip));
        grip
    }

    /// Adds the forces from outside, evaluated at the predicted positions at the step's end.
    pub(super) fn add_forces(&mut self) {
        let Beam { increment, state, mesh, terms, .. } = self;
        increment.has_stiff_forces = false;
        let time_s = (self.steps_since_start + 1) as f64 * self.discretisation.time_step_s;
        for (k, q) in state.position.iter().enumerate() {
            let velocity_m_s = [0, 1].map(|i| increment.rate * q[i] + increment.history[k][i]);
            let at = PointState {
                time_s,
                fraction: mesh.fraction(k),
                length_m: mesh.share[k],
                position_m: [q[0], q[1]],
                velocity_m_s,
                angle_rad: q[2],
            };
            let mut load = [0.0; 3];
            let mut stiffness = [0.0; 3];
            for term in &terms.forces {
                let [x, z] = term.force_n(&at);
                let more = [x, z, term.couple_n_m(&at)];
                load = [0, 1, 2].map(|i| load[i] + more[i]);
                let stiffer = term.stiffness_n_m(&at, increment.rate);
                stiffness = [0, 1, 2].map(|i| stiffness[i] + stiffer[i]);
            }
            for i in 0..2 {
                // A force that is constant within the step shifts the target, as gravity does.
                increment.target[k][i] += load[i] / (mesh.inertia[k][i] * increment.rate * increment.rate);
            }
            if load[2] != 0.0 {
                increment.target[k][2] += load[2] / (mesh.inertia[k][2] * increment.rate * increment.rate);
            }
            increment.has_stiff_forces |= stiffness != [0.0; 3];
            increment.term_force[k] = TermForce { load, place_m: at.position_m, stiffness };
        }
    }

    /// Lets the beam slip out of the grip, at a speed in proportion to the grip's pull.
    fn slip(&mut self, grip: GripState) {
        let reaction = self.grip_reaction();
        let (sin, cos) = grip.tangent_rad.sin_cos();
        let pull_n = -(reaction.force_x_n * cos + reaction.force_z_n * sin);
        let weight_n =
            self.parameters.mass_kg() * self.parameters.gravity_m_s2[0].hypot(self.parameters.gravity_m_s2[1]);
        if pull_n > 0.0 && weight_n > 0.0 {
            let speed_m_s = self.parameters.grip_slip_m_s * pull_n / weight_n;
            self.mesh.slip(speed_m_s * self.discretisation.time_step_s, &self.parameters);
        }
    }

    /// Shifts the history and computes all parts of the step that the past fixes.
    fn prepare(&mut self, difference: BackwardDifference) {
        let (increment, state) = (&mut self.increment, &mut self.state);
        state.begin_step();
        increment.rate = difference.c0;
        let [gx, gz] = self.parameters.gravity_m_s2;
        let (inverse, inverse_2) = (1.0 / difference.c0, 1.0 / (difference.c0 * difference.c0));
        let fall = [gx * inverse_2, gz * inverse_2, 0.0];
        let velocities = state.position_1.iter().zip(&state.position_2).zip(&mut increment.history);
        for ((one_ago, two_ago), history) in velocities {
            *history = difference.history(one_ago, two_ago);
        }
        let accelerations = state.velocity_1.iter().zip(&state.velocity);
        let decided = increment.history.iter().zip(&mut increment.target);
        for ((one_ago, two_ago), (velocity, target)) in accelerations.zip(decided) {
            let acceleration = difference.history(one_ago, two_ago);
            for i in 0..3 {
                target[i] = fall[i] - velocity[i] * inverse - acceleration[i] * inverse_2;
            }
        }
        if increment.load.acts() {
            let tip = state.position_1.len() - 1;
            increment.load.prepare(difference, &state.position_1[tip], &state.position_2[tip], [gx, gz]);
        }
        let (damping, creep) = (self.parameters.kelvin_voigt_time_s, self.parameters.creep_fraction);
        if damping > 0.0 {
            for k in 0..state.strain.len() {
                let rate = difference.history(&state.strain_1[k], &state.strain[k]);
                increment.stress_shift[k] = rate.map(|r| damping * r);
            }
        }
        if creep > 0.0 {
            // Exact relaxation over one step at constant strain: 1 - exp(-h / T).
            let share = -(-self.discretisation.time_step_s / self.parameters.creep_time_s).exp_m1();
            for k in 0..state.strain.len() {
                let from_damping = if damping > 0.0 { increment.stress_shift[k] } else { [0.0; 3] };
                let [strain, shear, curvature] = state.strain_1[k];
                let stretch = 1.0 + strain;
                let tension = material::axial(increment.mix, 1.0, stretch, 1.0 / stretch).force;
                let elastic = [tension, shear, curvature];
                for i in 0..3 {
                    state.relaxed[k][i] += share * (elastic[i] - state.relaxed[k][i]);
                    increment.stress_shift[k][i] = from_damping[i] - creep * state.relaxed[k][i];
                }
            }
        }
        if self.parameters.quadratic_drag_n_s2_m3 > 0.0 {
            for (k, drag) in increment.cross_drag.iter_mut().enumerate() {
                let (sin, cos) = state.position[k][2].sin_cos();
                // |speed| is taken at the step's start: quadratic drag then has a potential over the step.
                let cross_speed = cos * state.velocity_1[k][1] - sin * state.velocity_1[k][0];
                let coefficient = self.parameters.quadratic_drag_n_s2_m3 * self.mesh.share[k] * cross_speed.abs();
                *drag = CrossDrag { coefficient, normal: [-sin, cos] };
            }
        }
    }

    /// Predicts the new positions by linear extrapolation of the accelerations.
    fn predict(&mut self, grip: GripState) {
        let (state, increment) = (&mut self.state, &self.increment);
        let inverse_2 = 1.0 / (increment.rate * increment.rate);
        let [gx, gz] = self.parameters.gravity_m_s2;
        let gravity = [gx, gz, 0.0];
        // `State::begin_step` has swapped the buffers: `acceleration` now holds the values of two steps ago.
        let accelerations = state.acceleration_1.iter().zip(&state.acceleration);
        let guesses = state.position.iter_mut().zip(&increment.target);
        for ((position, target), (one_ago, two_ago)) in guesses.zip(accelerations) {
            for i in 0..3 {
                let acceleration = 2.0 * one_ago[i] - two_ago[i];
                position[i] = target[i] + inverse_2 * (acceleration - gravity[i]);
            }
        }
        self.hold(grip);
    }

    /// Moves the clamped node to the grip. A compliant grip leaves the node's angle free.
    pub(super) fn hold(&mut self, grip: GripState) {
        let Some(k) = self.mesh.clamped_node else { return };
        let [x, z, angle] = unwrapped(grip.node(), &self.state.position_1[k]);
        match &mut self.increment.grip_spring {
            Some(spring) => {
                spring.angle = angle;
                self.state.position[k] = [x, z, self.state.position[k][2]];
            }
            None => self.state.position[k] = [x, z, angle],
        }
    }

    /// Minimises the incremental potential from the present positions. Returns true if Newton's method converged.
    pub(super) fn minimise(&mut self) -> bool {
        let tolerance_m = self.discretisation.tolerance_m;
        let mut potential = self.evaluate();
        for iteration in 0..self.discretisation.max_newton_iterations {
            // The line search tests the step before, whose potential and derivatives the next step needs anyway.
            if iteration > 0 {
                potential = self.search_line(potential);
            }
            let size_m = self.newton_step();
            self.counters.newton_iterations += 1;
            if !size_m.is_finite() {
                return false;
            }
            if size_m < tolerance_m || size_m * size_m < tolerance_m * self.convergence_radius_m() {
                return true;
            }
        }
        false
    }

    /// Evaluates potential in J, gradient and Hessian at the present positions.
    pub(super) fn evaluate(&mut self) -> f64 {
        let Beam { increment, mesh, state, contact, system, .. } = self;
        increment.assemble::<true>(mesh, &state.position, &state.direction, contact, system)
    }

    /// Evaluates the last Newton step, and halves it while the potential exceeds `before`. Returns the potential in J.
    fn search_line(&mut self, before: f64) -> f64 {
        let is_hysteretic = self.increment.strand_friction.acts() || self.increment.hysteresis.acts();
        let [slack_j, slack_share] = if is_hysteretic { STRANDS_SLACK } else { SLACK };
        let slack = slack_j + slack_share * before.abs();
        let mut potential = self.evaluate();
        for _ in 0..MAX_HALVINGS {
            if potential <= before + slack {
                break;
            }
            self.counters.line_search_halvings += 1;
            for (position, base) in self.state.position.as_flattened_mut().iter_mut().zip(self.base.as_flattened()) {
                *position = 0.5 * (*position + base);
            }
            potential = self.evaluate();
        }
        potential
    }

    /// Moves the positions by one Newton step, cut to the step limit. Returns the size in m of the uncut step. A size
    /// that is not finite leaves the positions unchanged.
    fn newton_step(&mut self) -> f64 {
        self.fix_grip();
        self.system.matrix.factorise();
        let step = &mut self.system.gradient;
        self.system.matrix.solve(step);
        let size_m = step_size_m(step);
        if size_m.is_finite() {
            let limit_m = STEP_LIMIT * self.mesh.mean_length;
            let share = if size_m > limit_m { limit_m / size_m } else { 1.0 };
            self.base.copy_from_slice(&self.state.position);
            for (position, step) in self.state.position.as_flattened_mut().iter_mut().zip(step.as_flattened()) {
                *position -= share * step;
            }
        }
        size_m
    }

    /// Removes the unknowns that the grip prescribes from the system.
    pub(super) fn fix_grip(&mut self) {
        let Some(k) = self.mesh.clamped_node else { return };
        let gradient = &mut self.system.gradient;
        match self.increment.grip_spring {
            Some(_) => self.system.matrix.fix_place(k, gradient),
            None => self.system.matrix.fix_node(k, gradient),
        }
    }

    /// Convergence radius r in m: a Newton step of size s leaves an error of at most s^2 / r. It is the length over
    /// which the gradient bends.
    fn convergence_radius_m(&self) -> f64 {
        // Friction turns within a slip distance, the beam within a fraction of an element.
        let of_beam = 0.1 * self.mesh.mean_length;
        match &self.increment.table {
            Some(table) if self.contact.touching => of_beam.min(table.slip_speed_m_s / self.increment.rate),
            _ => of_beam,
        }
    }

    /// Computes velocities, accelerations, strains, slip and contact forces at the new positions.
    fn finish(&mut self) {
        let Beam { increment, mesh, state, .. } = self;
        let rate = increment.rate;
        let [gx, gz] = self.parameters.gravity_m_s2;
        let gravity = [gx, gz, 0.0];
        let decided = increment.history.iter().zip(&increment.target);
        let rates = state.velocity.iter_mut().zip(&mut state.acceleration);
        for ((position, (history, target)), (velocity, acceleration)) in state.position.iter().zip(decided).zip(rates) {
            for i in 0..3 {
                velocity[i] = rate * position[i] + history[i];
                acceleration[i] = rate * rate * (position[i] - target[i]) + gravity[i];
            }
        }
        if !self.terms.forces.is_empty() {
            // The target of a node holds the force at its predicted position, which is a part of the node's acceleration.
            let forced = state.acceleration.iter_mut().zip(increment.term_force.iter().zip(&mesh.inertia));
            for (acceleration, (force, inertia)) in forced {
                (0..2).for_each(|i| acceleration[i] += force.load[i] / inertia[i]);
                if force.load[2] != 0.0 {
                    acceleration[2] += force.load[2] / inertia[2];
                }
            }
        }
        if increment.load.acts() {
            increment.load.end_step(rate, state.tip());
        }
        let kept = state.direction.iter_mut().zip(&mut state.strain);
        for ((element, ends), (direction, strain)) in mesh.elements.iter().zip(state.position.windows(2)).zip(kept) {
            let at = element::kinematics(element, &ends[0], &ends[1], direction);
            (*direction, *strain) = (at.direction, at.strain);
        }
        if increment.strand_friction.acts() {
            for (neutral, strain) in increment.neutral_curvature.iter_mut().zip(&state.strain) {
                increment.strand_friction.slip(strain[2], neutral);
            }
        }
        if increment.hysteresis.acts() {
            increment.hysteresis.end_step(&state.strain);
        }
        if increment.section_moments.acts() {
            increment.section_moments.end_step(&state.strain);
        }
        let stiffening = rate * increment.kelvin_voigt_time_s;
        if stiffening > 0.0 || self.parameters.creep_fraction > 0.0 {
            for k in 0..state.strain.len() {
                for i in 0..3 {
                    state.extra_stress[k][i] = stiffening * state.strain[k][i] + increment.stress_shift[k][i];
                }
            }
        }
        if let Some(table) = &increment.table {
            self.contact.end_step(table, mesh, &state.position, increment.rates());
        }
        state.fresh = false;
    }
}

/// Size of a Newton step in m: largest movement of a node, angles weighted.
fn step_size_m(step: &[Node]) -> f64 {
    // A NaN in the system reaches every node when it is solved, and this comparison carries the last node's NaN on.
    let larger = |a: f64, b: f64| if a > b { a } else { b };
    let mut largest = [0.0; 3];
    for node in step {
        for i in 0..3 {
            largest[i] = larger(largest[i], node[i].abs());
        }
    }
    larger(larger(largest[0], largest[1]), ANGLE_WEIGHT_M * largest[2])
}

/// Adds whole turns to the angle of `target`, so that it is the nearest to the angle of `from`.
fn unwrapped(target: Node, from: &Node) -> Node {
    let turns = ((from[2] - target[2]) / TAU).round();
    [target[0], target[1], target[2] + turns * TAU]
}
