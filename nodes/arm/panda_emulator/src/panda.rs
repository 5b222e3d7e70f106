//! Franka Panda and its control box, as a pure function of requests and commands: one call advances by one cycle of 1 ms.

use crate::fci::{
    Answer, CYCLE_S, ControllerMode, ErrorKind, Errors, Generation, RecoveryStatus, RobotCommand, RobotState,
};
use chain::{Chain, Frame, Jacobian, Joints, Six};
use checks::contact::Contact;
use checks::limits::Limits;
use checks::self_collision::SelfCollision;
use checks::standing::Standing;
use configuration::Configuration;
use control::Hold;
use control::external_forces::ExternalForces;
use franka::model::{FER_URDF, FR3_URDF};
use motion::{Ending, Motion};
use plant::sensors::{Readings, Sensors};
use plant::{Diverged, MotorLaw, Plant};
use rigid_body::{RigidBody, Terms};

mod chain;
mod checks;
mod configuration;
mod control;
mod course;
mod motion;
mod plant;
mod report;
mod requests;
mod rigid_body;
mod settings;
#[cfg(test)]
mod tests;

pub use plant::PANDA_URDF;
pub use settings::{EndEffector, READY_RAD, Settings, SettingsError};

/// Cut-off frequency of `dtau_J`, Hz. Chosen: the steps of the torque sensors would drown an unfiltered difference.
const TORQUE_RATE_CUTOFF_HZ: f64 = 50.0;

/// Recovery under way.
#[derive(Debug, Clone, Copy)]
struct Recovery {
    /// Identifier of the request; `None` if its client has left.
    id: Option<u32>,
    cycles_left: u32,
}

/// Measured and estimated state of the arm after a cycle, as the control box knows it.
#[derive(Debug, Clone)]
struct Measured {
    readings: Readings,
    chain: Chain,
    terms: Terms,
    hand: Frame,
    jacobian: Jacobian,
    /// Stiffness frame in O.
    k: Frame,
    jacobian_k: Jacobian,
    torque_rate: Joints,
}

/// Elastic wall in the way of the hand: it pushes back along x where the hand is beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// Place of its surface in O, m.
    pub x_m: f64,
    /// Stiffness, N/m.
    pub stiffness_n_m: f64,
}

/// Franka Panda with its control box.
#[derive(Debug, Clone)]
pub struct Panda {
    settings: Settings,
    limits: Limits,
    configuration: Configuration,
    plant: Plant,
    sensors: Sensors,
    control_body: RigidBody,
    external: ExternalForces,
    contact: Contact,
    self_collision: SelfCollision,
    standing: Standing,
    measured: Measured,
    hold: Hold,
    motion: Option<Motion>,
    recovery: Option<Recovery>,
    brakes_open: bool,
    user_stop: bool,
    guiding: bool,
    /// A reflex waits for its recovery.
    reflex: bool,
    /// The user stop was released and waits for a recovery.
    recovery_due: bool,
    reflex_reason: Errors,
    errors: Errors,
    /// The last cycle ended with numbers that no arm has, and the arm was put back.
    was_restored: bool,
    answers: Vec<(u32, Answer)>,
    /// Wrench of the world on the hand, N and N m.
    pushed: Six,
    wall: Option<Wall>,
    /// Torque of the internal controller at the end of the cycle, N m.
    internal_torque: Joints,
    state: RobotState,
}

impl Panda {
    /// Creates a robot at rest with open brakes. The same seed and the same calls give the same states, bit for bit.
    ///
    /// # Errors
    /// [`SettingsError`] if a setting is out of range.
    pub fn new(settings: Settings, seed: u64) -> Result<Self, SettingsError> {
        settings.check()?;
        let limits = Limits::of(&settings);
        for i in 0..7 {
            if !(limits.lowest[i]..=limits.highest[i]).contains(&settings.start_joints_rad[i]) {
                let value = format!("{:?}", settings.start_joints_rad);
                return Err(SettingsError {
                    field: "start_joints_rad",
                    value,
                    expected: "angles within the joint limits",
                });
            }
        }
        let urdf =
            |e: String| SettingsError { field: "generation", value: e, expected: "a generation with a valid URDF" };
        let plant = Plant::new(&settings, (&limits.lowest, &limits.highest)).map_err(urdf)?;
        let control_urdf = match settings.generation {
            Generation::Panda => FER_URDF,
            Generation::Fr3 => FR3_URDF,
        };
        let mut control_body = RigidBody::from_urdf(control_urdf).map_err(urdf)?;
        control_body.carry(&[settings.end_effector.load()]);
        let configuration = Configuration::new(&settings);
        let mut sensors = Sensors::new(&settings, seed);
        let readings = sensors.read(plant.q(), plant.dq(), plant.link_torque());
        let measured = Measured::new(readings, &control_body, &configuration);
        let q = *plant.q();
        let mut panda = Self {
            limits,
            configuration,
            plant,
            sensors,
            control_body,
            external: ExternalForces::new(settings.external_torque_cutoff_hz, settings.inertial_torque_ratio),
            contact: Contact::default(),
            self_collision: SelfCollision::new(settings.end_effector.is_hand),
            standing: Standing::default(),
            measured,
            hold: Hold::at_rest(q),
            motion: None,
            recovery: None,
            brakes_open: true,
            user_stop: false,
            guiding: false,
            wall: None,
            reflex: false,
            recovery_due: false,
            reflex_reason: Errors::default(),
            errors: Errors::default(),
            was_restored: false,
            answers: Vec::new(),
            pushed: Six::zeros(),
            internal_torque: Joints::zeros(),
            state: RobotState::default(),
            settings,
        };
        panda.report();
        Ok(panda)
    }

    /// Settings.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// State of the last cycle.
    #[must_use]
    pub fn state(&self) -> &RobotState {
        &self.state
    }

    /// Takes the answers that wait for the client, with the identifiers of its requests.
    #[must_use]
    pub fn take_answers(&mut self) -> Vec<(u32, Answer)> {
        std::mem::take(&mut self.answers)
    }

    /// Sets the force (N) and moment (N m) that the world exerts on the hand, in the axes of O at the nominal end effector of the
    /// settings. They hold until the next call. A wrench with a number that is not finite is ignored.
    pub fn push(&mut self, wrench: [f64; 6]) {
        if wrench.iter().all(|v| v.is_finite()) {
            self.pushed = Six::from(wrench);
        }
    }

    /// Puts a wall in the way of the hand, or takes it away. A wall with a number that is not finite is ignored.
    pub fn set_wall(&mut self, wall: Option<Wall>) {
        if wall.is_none_or(|wall| wall.x_m.is_finite() && wall.stiffness_n_m.is_finite()) {
            self.wall = wall;
        }
    }

    /// Returns true if the simulation of the last cycle diverged. The arm was then put at rest where it was before, its motion ended
    /// with `instability_detected`, and it waits for a recovery.
    #[must_use]
    pub fn was_restored(&self) -> bool {
        self.was_restored
    }

    /// True pose (column-major, in O) and twist of the nominal end effector of the settings, which no client of the FCI sees.
    #[must_use]
    pub fn true_hand(&self) -> ([f64; 16], [f64; 6]) {
        let chain = Chain::at(self.plant.q());
        let hand = chain.flange.then(&self.true_tool());
        let twist = chain.jacobian(&hand.origin) * self.plant.dq();
        (hand.to_array(), twist.into())
    }

    /// True joint angles (rad) and speeds (rad/s).
    #[must_use]
    pub fn true_joints(&self) -> (&[f64; 7], &[f64; 7]) {
        (&self.plant.q().data.0[0], &self.plant.dq().data.0[0])
    }

    /// Advances by one cycle of 1 ms. `command`: the command that answers the newest state, or `None` if none came in time. A command
    /// that answers another state counts as lost.
    pub fn cycle(&mut self, command: Option<&RobotCommand>) -> &RobotState {
        let answers_newest = |c: &&RobotCommand| c.message_id == self.state.message_id;
        let command = command.filter(answers_newest);
        self.state.message_id += 1;
        if self.hold.is_at_rest() {
            // Only position limits and self-collision stay until the recovery.
            self.errors = self.errors.lasting();
        }
        self.advance_recovery();
        if let Some(ending) = self.follow(command) {
            self.end_motion(ending);
        }
        let moved = self.move_arm();
        self.measure();
        self.was_restored = moved.is_err();
        if self.was_restored {
            self.rest_after_divergence();
        } else {
            self.check_arm();
        }
        self.report();
        if !self.state.is_finite() {
            // No state with such a number leaves the control box, wherever it came from.
            self.was_restored = true;
            self.rest_after_divergence();
            self.report();
        }
        &self.state
    }

    /// Ends the motion of an arm whose simulation has diverged. The arm holds where the plant has put it.
    fn rest_after_divergence(&mut self) {
        // A load on closed brakes may be out of all bounds, too.
        self.plant.rest();
        let readings = self.sensors.read(self.plant.q(), self.plant.dq(), self.plant.link_torque());
        self.measured = Measured::new(readings, &self.control_body, &self.configuration);
        self.external.reset();
        self.end_motion(Ending::Reflex(Errors::of(ErrorKind::InstabilityDetected)));
        self.hold = Hold::at_rest(*self.plant.q());
        self.internal_torque = Joints::zeros();
    }

    fn true_tool(&self) -> Frame {
        Frame::from_array(&self.settings.end_effector.pose_in_flange)
    }

    fn advance_recovery(&mut self) {
        let Some(recovery) = &mut self.recovery else { return };
        recovery.cycles_left = recovery.cycles_left.saturating_sub(1);
        if recovery.cycles_left == 0 {
            let id = recovery.id;
            self.recovery = None;
            self.clear_reflex();
            self.answers.extend(id.map(|id| (id, Answer::Recovery(RecoveryStatus::Success))));
        }
    }

    fn clear_reflex(&mut self) {
        (self.reflex, self.recovery_due) = (false, false);
        self.errors = Errors::default();
        self.contact.release();
        self.standing.recovered();
    }

    /// Torques of the motors for this cycle.
    fn motor_law(&mut self) -> MotorLaw {
        let measured = &self.measured;
        if self.guiding {
            self.hold = Hold::at_rest(measured.readings.q);
            return control::guided(&self.configuration.free_axes, &measured.jacobian_k, &measured.k);
        }
        let Some(motion) = self.motion.as_mut().filter(|m| m.losses.has_begun()) else {
            let ddq = self.hold.advance();
            let stiffness = &self.settings.joint_impedance_n_m_per_rad;
            return control::joint_impedance(
                stiffness,
                (&self.hold.q, &self.hold.dq, &ddq),
                &measured.terms,
                self.plant.rotors(),
            );
        };
        let path = *motion.generator.joints();
        match motion.request.controller {
            ControllerMode::External => MotorLaw::constant(motion.torque_at_motors(self.settings.command_delay_cycles)),
            ControllerMode::JointImpedance => {
                let desired = motion.filtered(&self.configuration);
                control::joint_impedance(
                    &self.configuration.joint_impedance,
                    (&desired.q, &desired.dq, &desired.ddq),
                    &measured.terms,
                    self.plant.rotors(),
                )
            }
            ControllerMode::CartesianImpedance => {
                let desired = motion.filtered(&self.configuration);
                let pose = match motion.generator.cartesian() {
                    Some(cartesian) if desired == path => cartesian.pose,
                    _ => control::hand_at(&desired.q, &self.configuration.tool()),
                };
                control::cartesian_impedance(
                    &self.configuration.cartesian_impedance,
                    (&pose, &desired.q, &desired.dq),
                    (&measured.readings.q, &measured.hand, &measured.jacobian),
                    &measured.k,
                    &measured.terms,
                )
            }
        }
    }

    fn move_arm(&mut self) -> Result<(), Diverged> {
        let law = self.motor_law();
        let chain = Chain::at(self.plant.q());
        let point = chain.flange.then(&self.true_tool()).origin;
        let mut world = self.pushed;
        if let Some(Wall { x_m, stiffness_n_m }) = self.wall {
            world[0] -= stiffness_n_m * (point.x - x_m).max(0.0);
        }
        if !self.brakes_open {
            self.plant.rest_on_brakes(&world, &chain, &point);
            return Ok(());
        }
        let pushed = chain.jacobian(&point).tr_mul(&world);
        let moved = self.plant.step(&law, &self.measured.terms.gravity, &pushed);
        self.internal_torque = law.torque_at(self.plant.q(), self.plant.dq(), 0.0);
        moved
    }

    fn measure(&mut self) {
        let readings = self.sensors.read(self.plant.q(), self.plant.dq(), self.plant.link_torque());
        let change = (readings.tau - self.measured.readings.tau) / CYCLE_S;
        let gain = configuration::gain(TORQUE_RATE_CUTOFF_HZ);
        let torque_rate = self.measured.torque_rate + (change - self.measured.torque_rate) * gain;
        self.measured = Measured { torque_rate, ..Measured::new(readings, &self.control_body, &self.configuration) };
        let Measured { terms, jacobian_k, k, .. } = &self.measured;
        self.external.update(&readings, terms, jacobian_k, k);
    }

    /// Checks the measured arm. A violation ends the motion, or stops an idle arm.
    fn check_arm(&mut self) {
        let Measured { readings, chain, hand, jacobian, .. } = &self.measured;
        let hand_speed_m_s = control::speed_m_s(&(jacobian * readings.dq));
        let mut errors = checks::arm::errors(readings, hand, hand_speed_m_s, &self.limits, &self.settings);
        if self.self_collision.closes(chain) {
            errors.insert(ErrorKind::SelfCollisionAvoidanceViolation);
        }
        if self.motion.as_ref().is_some_and(|m| self.deviates(&m.request.path_deviation)) {
            errors.insert(ErrorKind::MaxPathPoseDeviationViolation);
        }
        let accelerating = self.is_accelerating();
        let thresholds = &self.configuration.collision;
        let collisions = self.contact.update(thresholds, accelerating, &self.external.torques, &self.external.wrench_k);
        errors = errors.union(collisions);
        let begun = self.standing.begun(errors);
        let idle = self.brakes_open && !self.user_stop && !self.reflex && self.recovery.is_none();
        if self.motion.is_none() {
            errors = if idle && self.hold.is_at_rest() { begun } else { Errors::default() };
        }
        if !errors.is_empty() {
            self.hold = self.stop_here();
            self.end_motion(Ending::Reflex(errors));
        }
    }

    fn is_accelerating(&self) -> bool {
        let Some(motion) = &self.motion else { return false };
        motion.generator.joints().ddq.amax() > self.settings.acceleration_phase_rad_s2
            || motion.torque_change.amax() / CYCLE_S > self.settings.acceleration_phase_n_m_s
    }
}

impl Measured {
    fn new(readings: Readings, body: &RigidBody, configuration: &Configuration) -> Self {
        let chain = Chain::at(&readings.q);
        let hand = chain.flange.then(&configuration.tool());
        let k = hand.then(&Frame::from_array(&configuration.ee_t_k));
        Self {
            readings,
            chain,
            terms: body.terms(&readings.q, &readings.dq),
            jacobian: chain.jacobian(&hand.origin),
            jacobian_k: chain.jacobian(&k.origin),
            hand,
            k,
            torque_rate: Joints::zeros(),
        }
    }
}
