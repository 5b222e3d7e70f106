//! Static shapes: hanging from the grip, or through measured points.

use super::body::Beam;
use super::grip::{GripReaction, GripState};
use super::node::Node;
use super::potential::Spring;

/// Result of a search for a shape at rest. [`super::Counters`] counts searches that did not converge.
#[must_use]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Equilibrium {
    /// True if the shape stood still within the tolerance.
    pub converged: bool,
    /// Largest movement of a node in m in the last round.
    pub last_move_m: f64,
    /// Newton iterations over all rounds.
    pub newton_iterations: u64,
}

/// Measured point of the centre line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredPoint {
    /// Place on the beam, as a fraction of the deformed length from the grip (0) to the tip (1).
    pub fraction: f64,
    /// (x, z) in m.
    pub position_m: [f64; 2],
    /// (x, z) in m/s; zero for a shape at rest.
    pub velocity_m_s: [f64; 2],
}

/// First and last step of the descent in s, and growth of the step from round to round.
// The first step is short against the swing of a soft bar (about 1 s); in the last, 100 s, inertia no longer counts.
const FIRST_STEP_S: f64 = 0.02;
const LAST_STEP_S: f64 = 100.0;
const STEP_GROWTH: f64 = 2.0;
const MAX_ROUNDS: usize = 100;
/// Largest movement of a node in m in the last round.
const STILL_M: f64 = 1e-9;
/// Bend in rad, towards gravity, of the straight beam from which the descent starts. Without it a beam that points
/// straight up would stay there.
const TILT_RAD: f64 = 1e-3;
/// Distance in m by which the beam's weight would move one measured point from its place.
const FIT_SLACK_M: f64 = 1e-3;
/// Passes over the measured points' material places. The places depend on the stretch, so that each pass corrects them.
const FIT_PASSES: usize = 4;
/// Time in s between the two shapes whose difference gives the velocity.
const VELOCITY_BASE_S: f64 = 0.01;

impl Beam {
    /// Lays the beam at rest in static equilibrium, clamped at `grip`. A beam that reaches the table lies on it without
    /// friction.
    ///
    /// The descent starts from the straight beam along the grip's tangent and is overdamped, so that among several
    /// equilibria it finds the one into which that beam sinks. A free beam without a table has no equilibrium, and the
    /// search does not converge. Terms from outside act as they do at time 0.
    pub fn hang_at_rest(&mut self, grip: GripState) -> Equilibrium {
        let equilibrium = self.descend_to_rest(self.grip_at_start(0.0, grip));
        self.count(equilibrium)
    }

    /// Grip about the start as changed by terms from outside, which see no load yet.
    fn grip_at_start(&self, time_s: f64, grip: GripState) -> GripState {
        self.grip_at(time_s, grip, &GripReaction::default())
    }

    fn descend_to_rest(&mut self, grip: GripState) -> Equilibrium {
        self.lay_straight(grip);
        self.tilt_towards_gravity();
        self.enable_rest();
        self.hold(grip);
        let equilibrium = self.settle();
        self.state.velocity.fill([0.0; 3]);
        self.start_here();
        equilibrium
    }

    fn count(&mut self, equilibrium: Equilibrium) -> Equilibrium {
        self.counters.unconverged_equilibria += u64::from(!equilibrium.converged);
        equilibrium
    }

    /// Lays the beam through measured points of its centre line, clamped at `grip`, in motion with the points'
    /// velocities. `grip_velocity` is the grip's velocity: x, z in m/s and angle in rad/s. At most 64 points are used.
    ///
    /// The shape is the equilibrium under weight and under springs at the points. A spring's stiffness is the beam's
    /// weight per 1 mm. The beam's own stiffness thus smooths noise, and fills in between and beyond the points. The
    /// velocity is the difference of two such shapes.
    pub fn set_shape(&mut self, grip: GripState, grip_velocity: [f64; 3], points: &[MeasuredPoint]) -> Equilibrium {
        let shape_at = |beam: &Self, time_s: f64| {
            let moved = GripState {
                x_m: grip.x_m + time_s * grip_velocity[0],
                z_m: grip.z_m + time_s * grip_velocity[1],
                tangent_rad: grip.tangent_rad + time_s * grip_velocity[2],
            };
            beam.grip_at_start(time_s, moved)
        };
        let start = shape_at(self, 0.0);
        // Starting point of the fit only, so that its convergence does not matter.
        let _start = self.descend_to_rest(start);
        let mut equilibrium = self.fit(start, points, 0.0);
        // A grip that terms change may have a velocity of its own.
        let is_changed = !self.terms.grips.is_empty();
        let moving = is_changed || grip_velocity != [0.0; 3] || points.iter().any(|p| p.velocity_m_s != [0.0; 2]);
        if moving {
            let half_s = 0.5 * VELOCITY_BASE_S;
            let before = self.fit(shape_at(self, -half_s), points, -half_s);
            self.state.velocity.copy_from_slice(&self.state.position);
            let after = self.fit(shape_at(self, half_s), points, half_s);
            for (velocity, position) in self.state.velocity.iter_mut().zip(&self.state.position) {
                *velocity = [0, 1, 2].map(|i| (position[i] - velocity[i]) / VELOCITY_BASE_S);
            }
            let now = self.fit(start, points, 0.0);
            equilibrium.converged &= before.converged && after.converged && now.converged;
            equilibrium.last_move_m = now.last_move_m;
            equilibrium.newton_iterations += before.newton_iterations + after.newton_iterations + now.newton_iterations;
        }
        self.start_here();
        self.count(equilibrium)
    }

    fn enable_rest(&mut self) {
        self.increment.enable_rest(&self.parameters, self.mesh.clamped_node);
    }

    /// Brings the beam to rest under springs to the points' places `time_s` after the measurement.
    fn fit(&mut self, grip: GripState, points: &[MeasuredPoint], time_s: f64) -> Equilibrium {
        let [gx, gz] = self.parameters.gravity_m_s2;
        // A weightless beam still needs springs: a thousandth of 1 m/s^2 stands in for gravity.
        let weight_n = (self.parameters.mass_kg() * gx.hypot(gz)).max(1e-3 * self.parameters.mass_kg());
        let stiffness = weight_n / FIT_SLACK_M;
        let mut equilibrium = Equilibrium { converged: false, last_move_m: f64::INFINITY, newton_iterations: 0 };
        for _ in 0..FIT_PASSES {
            self.enable_rest();
            for point in points.iter().take(self.increment.springs.capacity()) {
                let (element, share) = self.place_on_mesh(&self.state.position, point.fraction);
                let place = [0, 1].map(|i| point.position_m[i] + time_s * point.velocity_m_s[i]);
                self.increment.springs.push(Spring { element, share, place, stiffness });
            }
            self.hold(grip);
            let iterations = equilibrium.newton_iterations;
            equilibrium = self.settle();
            equilibrium.newton_iterations += iterations;
        }
        equilibrium
    }

    /// Turns the nodes of the straight beam about the origin towards gravity, by an angle in proportion to their
    /// distance.
    fn tilt_towards_gravity(&mut self) {
        let origin = self.state.position[self.mesh.origin];
        let (sin, cos) = origin[2].sin_cos();
        let [gx, gz] = self.parameters.gravity_m_s2;
        let towards = if cos * gz - sin * gx > 0.0 { TILT_RAD } else { -TILT_RAD };
        let last = self.state.position.len() - 1;
        for k in self.mesh.origin + 1..=last {
            let share = (k - self.mesh.origin) as f64 / (last - self.mesh.origin) as f64;
            let arc = (self.state.position[k][0] - origin[0]).hypot(self.state.position[k][1] - origin[1]);
            let (bend, lift) = (2.0 * towards * share, towards * share * arc);
            self.state.position[k][0] -= lift * sin;
            self.state.position[k][1] += lift * cos;
            self.state.position[k][2] += bend;
        }
        self.state.restart(&self.mesh);
    }

    /// Descends to a minimum of the potential energy: repeated steps of implicit Euler from rest, with growing step
    /// length.
    fn settle(&mut self) -> Equilibrium {
        let iterations_before = self.counters;
        let mut last_move_m = f64::INFINITY;
        let mut step_s = FIRST_STEP_S;
        let mut converged = false;
        for _ in 0..MAX_ROUNDS {
            let solved = self.descend_one_step(step_s);
            last_move_m = self.distance_moved_m();
            if solved && step_s >= LAST_STEP_S && last_move_m < STILL_M {
                converged = true;
                break;
            }
            step_s = (STEP_GROWTH * step_s).min(LAST_STEP_S);
        }
        let newton_iterations = self.counters.newton_iterations - iterations_before.newton_iterations;
        // The descent's iterations are reported in the result and are no part of the motion's counters.
        self.counters = iterations_before;
        Equilibrium { converged, last_move_m, newton_iterations }
    }

    /// Makes one step of implicit Euler from rest. Returns true if Newton's method converged.
    fn descend_one_step(&mut self, step_s: f64) -> bool {
        let rate = 1.0 / step_s;
        let [gx, gz] = self.parameters.gravity_m_s2;
        let fall = [gx * step_s * step_s, gz * step_s * step_s, 0.0];
        self.state.restart(&self.mesh);
        self.increment.rate = rate;
        for (k, position) in self.state.position.iter().enumerate() {
            self.increment.target[k] = [0, 1, 2].map(|i| position[i] + fall[i]);
            self.increment.history[k] = position.map(|q| -rate * q);
        }
        self.increment.load.prepare_from_rest(step_s, self.state.tip(), self.parameters.gravity_m_s2);
        if !self.terms.forces.is_empty() {
            self.add_forces();
        }
        self.minimise()
    }

    fn distance_moved_m(&self) -> f64 {
        let moved = |a: &Node, b: &Node| (a[0] - b[0]).hypot(a[1] - b[1]);
        self.state.position.iter().zip(&self.state.position_1).map(|(a, b)| moved(a, b)).fold(0.0, f64::max)
    }
}
