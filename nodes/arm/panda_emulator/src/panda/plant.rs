//! Simulated arm: rigid bodies, friction, rotors and end stops, which no client of the FCI sees directly.

use super::chain::{Chain, JointMatrix, Joints, Six};
use super::rigid_body::{RigidBody, Terms};
use super::settings::Settings;
use crate::fci::{CYCLE_S, Generation};
use franka::model::FR3_URDF;
use friction::Friction;

pub mod friction;
pub mod sensors;

/// Panda with the inertias of Gaz et al.
pub const PANDA_URDF: &str = include_str!("plant/panda.urdf");

/// Rotor inertias of the joints seen through their gears, kg m^2: rotor times gear ratio squared (franka-rs 0.4.0, which
/// attributes them to Franka's description of the robot).
const ROTOR_KG_M2: [f64; 7] = [0.6057, 0.6057, 0.4625, 0.4625, 0.2055, 0.2055, 0.2055];
/// Distance of the mechanical end stops beyond the joint limits, rad. Guess.
const STOP_MARGIN_RAD: f64 = 0.05;
/// Stiffness of the mechanical end stops, N m/rad. Chosen: 0.1 rad deep at 500 N m.
const STOP_STIFFNESS_N_M: f64 = 5000.0;
/// Damping of the mechanical end stops, N m s/rad. Chosen: about critical for the heaviest joint.
const STOP_DAMPING_N_M_S: f64 = 100.0;

/// Joint speed beyond which the simulation has diverged, rad/s. Chosen: twenty times what a joint may have.
const DIVERGED_RAD_S: f64 = 50.0;

/// Step that ended with numbers that no arm has. The arm rests where it was before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Diverged;

/// Torque of the motors during one cycle: linear in angles and speeds, so that stiff controllers act on every substep.
///
/// `torque + stiffness (q_d - q) + damping (dq_d - dq)`, with `q_d` moving by `dq_d` and reaching `q_d` at the end of the cycle.
#[derive(Debug, Clone, Copy)]
pub struct MotorLaw {
    /// Constant part, N m.
    pub torque: Joints,
    /// Stiffness, N m/rad.
    pub stiffness: JointMatrix,
    /// Damping, N m s/rad.
    pub damping: JointMatrix,
    /// Desired angles at the end of the cycle, rad.
    pub q_d: Joints,
    /// Desired speeds, rad/s.
    pub dq_d: Joints,
}

impl MotorLaw {
    /// Constant torque.
    pub fn constant(torque: Joints) -> Self {
        Self {
            torque,
            stiffness: JointMatrix::zeros(),
            damping: JointMatrix::zeros(),
            q_d: Joints::zeros(),
            dq_d: Joints::zeros(),
        }
    }

    /// Torque at angles and speeds, `left_s` before the end of the cycle.
    pub fn torque_at(&self, q: &Joints, dq: &Joints, left_s: f64) -> Joints {
        self.torque + self.stiffness * (self.q_d - self.dq_d * left_s - q) + self.damping * (self.dq_d - dq)
    }
}

/// Simulated arm.
#[derive(Debug, Clone)]
pub struct Plant {
    body: RigidBody,
    friction: Friction,
    rotors: Joints,
    lowest: Joints,
    highest: Joints,
    substeps: usize,
    q: Joints,
    dq: Joints,
    /// Torque between gear and link, which the sensors measure, N m.
    link_torque: Joints,
}

impl Plant {
    /// Arm at rest at the start angles. `range`: joint limits, rad.
    ///
    /// A Franka Research 3 has the inertias of its own URDF, thus arm and control box agree about it.
    ///
    /// # Errors
    /// The message of the parser, if the URDF describes no arm with seven joints.
    pub fn new(settings: &Settings, range: (&[f64; 7], &[f64; 7])) -> Result<Self, String> {
        let urdf = match settings.generation {
            Generation::Panda => PANDA_URDF,
            Generation::Fr3 => FR3_URDF,
        };
        let mut body = RigidBody::from_urdf(urdf)?;
        body.carry(&[settings.end_effector.load(), settings.true_load]);
        let mut plant = Self {
            body,
            friction: Friction::new(settings.friction_ratio, settings.stiction_n_m),
            rotors: Joints::from(ROTOR_KG_M2) * settings.rotor_inertia_ratio,
            lowest: Joints::from(*range.0).add_scalar(-STOP_MARGIN_RAD),
            highest: Joints::from(*range.1).add_scalar(STOP_MARGIN_RAD),
            substeps: settings.substeps,
            q: Joints::from(settings.start_joints_rad),
            dq: Joints::zeros(),
            link_torque: Joints::zeros(),
        };
        plant.rest_on_brakes(&Six::zeros(), &Chain::at(&plant.q), &Chain::at(&plant.q).flange.origin);
        Ok(plant)
    }

    /// Joint angles, rad.
    pub fn q(&self) -> &Joints {
        &self.q
    }

    /// Joint speeds, rad/s.
    pub fn dq(&self) -> &Joints {
        &self.dq
    }

    /// Rotor inertias as far as the torque control shows them, kg m^2.
    pub fn rotors(&self) -> &Joints {
        &self.rotors
    }

    /// Torque between gear and link, N m.
    pub fn link_torque(&self) -> &Joints {
        &self.link_torque
    }

    /// Holds the arm on its brakes for a cycle, under a wrench at `point` (O).
    pub fn rest_on_brakes(&mut self, wrench: &Six, chain: &Chain, point: &nalgebra::Vector3<f64>) {
        self.dq = Joints::zeros();
        let pushed = chain.jacobian(point).tr_mul(wrench);
        self.link_torque = self.body.terms(&self.q, &self.dq).gravity - pushed;
    }

    /// Puts the arm at rest where it is.
    pub fn rest(&mut self) {
        self.dq = Joints::zeros();
        self.link_torque = self.body.terms(&self.q, &self.dq).gravity;
    }

    /// Advances by a cycle. `law` and `gravity`: torques of the motors, N m. `pushed`: joint torques of the world, N m.
    ///
    /// Mass matrix, Coriolis and gravity torques hold for the cycle, in which a joint turns by at most 3 mrad. Friction, end stops
    /// and the motors' law follow every substep.
    ///
    /// # Errors
    /// [`Diverged`] if an angle, a speed or a torque is not finite or a speed is out of all bounds: the arm then rests where it was.
    pub fn step(&mut self, law: &MotorLaw, gravity: &Joints, pushed: &Joints) -> Result<(), Diverged> {
        let before = self.q;
        let terms = self.body.terms(&self.q, &self.dq);
        self.integrate(&terms, law, gravity, pushed);
        let numbers = self.q.iter().chain(&self.dq).chain(&self.link_torque);
        let is_sane = numbers.into_iter().all(|v| v.is_finite()) && self.dq.amax() <= DIVERGED_RAD_S;
        if is_sane {
            return Ok(());
        }
        self.q = before;
        self.rest();
        Err(Diverged)
    }

    fn integrate(&mut self, terms: &Terms, law: &MotorLaw, gravity: &Joints, pushed: &Joints) {
        let inertia = terms.mass + JointMatrix::from_diagonal(&self.rotors);
        let Some(cholesky) = inertia.cholesky() else {
            // Unreachable with physical inertias: a test checks the smallest eigenvalue.
            self.dq = Joints::repeat(f64::NAN);
            return;
        };
        let inverse = cholesky.inverse();
        let constant = gravity + pushed - terms.coriolis - terms.gravity;
        let step_s = CYCLE_S / self.substeps as f64;
        let before = self.dq;
        let mut motor = Joints::zeros();
        for k in 0..self.substeps {
            let left_s = CYCLE_S - k as f64 * step_s;
            let driven = law.torque_at(&self.q, &self.dq, left_s);
            let torque = driven + constant + self.end_stops() - self.friction.viscous(&self.dq);
            let free = self.dq + inverse * torque * step_s;
            self.dq = self.friction.stick(&self.dq, free, &inverse, step_s);
            self.q += self.dq * step_s;
            motor += driven;
        }
        let acceleration = (self.dq - before) / CYCLE_S;
        self.link_torque = motor / self.substeps as f64 + gravity - self.rotors.component_mul(&acceleration);
    }

    fn end_stops(&self) -> Joints {
        Joints::from_fn(|i, _| {
            let beyond = (self.q[i] - self.highest[i]).max(0.0) + (self.q[i] - self.lowest[i]).min(0.0);
            if beyond == 0.0 { 0.0 } else { -STOP_STIFFNESS_N_M * beyond - STOP_DAMPING_N_M_S * self.dq[i] }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: ([f64; 7], [f64; 7]) = ([-10.0; 7], [10.0; 7]);

    fn frictionless() -> Settings {
        Settings { friction_ratio: 0.0, stiction_n_m: [0.0; 7], rotor_inertia_ratio: 0.0, ..Settings::default() }
    }

    #[test]
    fn free_fall_keeps_the_energy() {
        let mut plant = Plant::new(&frictionless(), (&RANGE.0, &RANGE.1)).unwrap();
        let height = |q: &Joints| Chain::at(q).joints[3].origin.z;
        let kinetic = |p: &Plant| 0.5 * p.dq.dot(&(p.body.terms(&p.q, &p.dq).mass * p.dq));
        let (start_m, mut work) = (height(&plant.q), 0.0);
        let law = MotorLaw::constant(Joints::zeros());
        for _ in 0..300 {
            let (gravity, before) = (plant.body.terms(&plant.q, &plant.dq).gravity, plant.dq);
            plant.step(&law, &Joints::zeros(), &Joints::zeros()).unwrap();
            work -= gravity.dot(&(plant.dq + before)) * 0.5 * CYCLE_S;
        }
        assert!(height(&plant.q) < start_m - 0.02, "the arm falls");
        let energy = kinetic(&plant);
        assert!((energy - work).abs() < 0.01 * work, "kinetic energy {energy} J, work of gravity {work} J");
    }

    #[test]
    fn stiction_holds_a_push_below_it_for_ever_and_not_one_above() {
        let settings = Settings { friction_ratio: 1.0, stiction_n_m: [0.2; 7], ..frictionless() };
        for (push, moves) in [(0.19, false), (0.25, true)] {
            let mut plant = Plant::new(&settings, (&RANGE.0, &RANGE.1)).unwrap();
            let mut pushed = Joints::zeros();
            pushed[6] = push;
            let start = plant.q;
            for _ in 0..500 {
                let gravity = plant.body.terms(&plant.q, &plant.dq).gravity;
                plant.step(&MotorLaw::constant(Joints::zeros()), &gravity, &pushed).unwrap();
            }
            let moved_rad = (plant.q - start).amax();
            assert_eq!(moved_rad > 1e-3, moves, "{push} N m moves by {moved_rad} rad");
            assert!(moves || moved_rad < 1e-9, "creep of {moved_rad} rad");
        }
    }

    #[test]
    fn sensors_see_the_torque_of_the_link_without_that_of_the_rotor() {
        let settings = Settings { rotor_inertia_ratio: 1.0, ..frictionless() };
        let mut plant = Plant::new(&settings, (&RANGE.0, &RANGE.1)).unwrap();
        let terms = plant.body.terms(&plant.q, &plant.dq);
        let mut law = MotorLaw::constant(Joints::zeros());
        law.torque[6] = 1.0;
        plant.step(&law, &terms.gravity, &Joints::zeros()).unwrap();
        let link = terms.mass * plant.dq / CYCLE_S + terms.gravity;
        assert!((plant.link_torque - link).amax() < 1e-9, "{}", plant.link_torque - link);
    }

    #[test]
    fn step_that_diverges_leaves_the_arm_at_rest_where_it_was() {
        let mut plant = Plant::new(&frictionless(), (&RANGE.0, &RANGE.1)).unwrap();
        let start = plant.q;
        for torque in [1e9, 1e300, f64::MAX, f64::INFINITY, f64::NAN] {
            let law = MotorLaw::constant(Joints::repeat(torque));
            assert_eq!(plant.step(&law, &Joints::zeros(), &Joints::zeros()), Err(Diverged), "{torque} N m");
            assert_eq!((plant.q, plant.dq), (start, Joints::zeros()));
            assert!(plant.link_torque.iter().all(|v| v.abs() < 100.0), "{}", plant.link_torque);
        }
    }
}
