//! Synthetic episode: a rigid pendulum hangs from a grip that makes eight steps to and fro. It contains no measurement
//! and describes no real object; its topics, types, rates and stamps are those of a real recording.

use catenary_bag::{BagError, BagSummary, BagWriter, TopicId, WriterOptions};
use catenary_core::camera::MASK_SIZE_PX;
use catenary_core::{GripPose, Keypoints, Model, Observation};
use catenary_msgs::Interface;
use catenary_msgs::geometry_msgs::msg::{PoseStamped, Vector3, Wrench, WrenchStamped};
use catenary_msgs::msg::{ArmState, EefDelta, EpisodeEvent, Keypoints as KeypointsMsg, Observation as ObservationMsg};
use catenary_msgs::std_msgs::msg::Header;
use catenary_shell::convert::{anchor_to_msg, grip_pose_to_msg, keypoints_to_msg};
use catenary_shell::{Time, contract, stamp};
use serde::Serialize;
use std::path::Path;

/// Number of the episode.
pub const EPISODE: u32 = 7;
/// Steps of its policy.
pub const STEPS: u32 = 8;
/// Time between two steps in s.
pub const STEP_PERIOD_S: f64 = 0.5;
/// Stamp of the start in ns.
pub const START_NS: i64 = 100_000_000_000;
/// Time step of the pendulum's integration in ns.
const TURN_NS: i64 = 1_000_000;

/// Model whose camera observes the episode.
pub fn model() -> Model {
    Model::from_yaml(include_str!("../../../../../launch_configs/models/soft_bar.yaml"))
        .expect("the shipped model is valid")
}

/// Simulated scene: grip, pendulum and camera.
struct Scene {
    model: Model,
    grip: GripPose,
    speed_m_s: f64,
    target_x_m: f64,
    angle_rad: f64,
    rate_rad_s: f64,
}

impl Scene {
    const LENGTH_M: f64 = 0.2;

    fn new() -> Self {
        let model = model();
        let grip = model.arm.start;
        Self { target_x_m: grip.x_m, model, grip, speed_m_s: 0.0, angle_rad: 0.1, rate_rad_s: 0.0 }
    }

    /// Advances the scene by one time step: the grip follows its target with a lag, the pendulum follows the grip.
    fn turn(&mut self) {
        let dt = TURN_NS as f64 * 1e-9;
        // Stiffness and damping of an almost critically damped grip (6.3 rad/s, damping ratio 0.95).
        let acceleration = 40.0 * (self.target_x_m - self.grip.x_m) - 12.0 * self.speed_m_s;
        self.speed_m_s += acceleration * dt;
        self.grip.x_m += self.speed_m_s * dt;
        let pull = -9.81 * self.angle_rad.sin() - acceleration * self.angle_rad.cos();
        // A uniform rod about its end: 1.5 / length. The damping of 1/s is arbitrary.
        self.rate_rad_s += (1.5 * pull / Self::LENGTH_M - 1.0 * self.rate_rad_s) * dt;
        self.angle_rad += self.rate_rad_s * dt;
    }

    fn keypoints(&self) -> Keypoints {
        let camera = &self.model.camera.view;
        let seen = |x: f64, z: f64| camera.mask_from_world([x, 0.0, z]).expect("the scene lies before the camera");
        let point = |fraction: f64| {
            let along_m = fraction * Self::LENGTH_M;
            seen(self.grip.x_m + along_m * self.angle_rad.sin(), self.grip.z_m - along_m * self.angle_rad.cos())
        };
        let [target_x, target_z] = self.model.task.map_or([0.4, 0.2], |t| t.target_m);
        Keypoints {
            dlo_px: self.model.object.keypoint_fractions.map(point),
            target_px: Some(seen(target_x, target_z)),
            scores: [1.0; 4],
            target_score: 1.0,
            image_width_px: MASK_SIZE_PX,
            image_height_px: MASK_SIZE_PX,
        }
    }

    fn observation(&self) -> Observation {
        let seen = self.keypoints();
        let target = seen.target_scaled().unwrap_or_default();
        Observation::new([self.grip.x_m, self.grip.z_m], &seen.dlo_scaled(), target)
    }

    fn wrench(&self) -> Wrench {
        let force = 1.2 + 0.1 * self.rate_rad_s.powi(2);
        let (s, c) = self.angle_rad.sin_cos();
        Wrench { force: Vector3 { x: force * s, y: 0.0, z: -force * c }, torque: Vector3::default() }
    }
}

struct Topics {
    keypoints: TopicId,
    pose: TopicId,
    wrench: TopicId,
    arm: TopicId,
    target: TopicId,
    action: TopicId,
    observation: TopicId,
    event: TopicId,
}

impl Topics {
    fn add(bag: &mut BagWriter) -> Result<Self, BagError> {
        fn add<T: Interface>(bag: &mut BagWriter, topic: contract::Topic) -> Result<TopicId, BagError> {
            bag.add_topic_of::<T>(&format!("/{}", topic.name), topic.qos)
        }
        Ok(Self {
            keypoints: add::<KeypointsMsg>(bag, contract::KEYPOINTS)?,
            pose: add::<PoseStamped>(bag, contract::CURRENT_POSE)?,
            wrench: add::<WrenchStamped>(bag, contract::EXTERNAL_WRENCH)?,
            arm: add::<ArmState>(bag, contract::ARM_STATE)?,
            target: add::<PoseStamped>(bag, contract::TARGET_POSE)?,
            action: add::<EefDelta>(bag, contract::ACTION)?,
            observation: add::<ObservationMsg>(bag, contract::OBSERVATION)?,
            event: add::<EpisodeEvent>(bag, contract::EPISODE_EVENT)?,
        })
    }
}

/// Writes the episode as a bag. Every call gives equal messages.
pub fn write_bag(folder: &Path) -> Result<BagSummary, BagError> {
    let mut bag = BagWriter::create(folder, &WriterOptions::default())?;
    let topics = Topics::add(&mut bag)?;
    let mut scene = Scene::new();
    let step_ns = (STEP_PERIOD_S * 1e9) as i64;
    let end_ns = START_NS + i64::from(STEPS) * step_ns;
    let mut now_ns = START_NS - 100_000_000;
    while now_ns <= end_ns {
        let since_ns = now_ns - START_NS;
        let mut recorder = Recorder { bag: &mut bag, now_ns };
        if since_ns % 200_000_000 == 0 {
            let state =
                ArmState { mode: ArmState::MODE_TRACKING, success_rate: 1.0, is_sim: true, ..ArmState::default() };
            recorder.message(topics.arm, &ArmState { header: recorder.header(""), ..state })?;
        }
        if since_ns % 20_000_000 == 0 {
            let pose = grip_pose_to_msg(&scene.grip);
            recorder.message(topics.pose, &PoseStamped { header: recorder.header("panda_link0"), pose })?;
            recorder.message(
                topics.wrench,
                &WrenchStamped { header: recorder.header("panda_link0"), wrench: scene.wrench() },
            )?;
        }
        if since_ns % 50_000_000 == 0 {
            let header = recorder.header("camera_color_optical_frame");
            recorder.message(topics.keypoints, &KeypointsMsg { header, ..keypoints_to_msg(&scene.keypoints()) })?;
        }
        if since_ns >= 0 && since_ns % step_ns == 0 {
            step(&mut recorder, &topics, &mut scene, (since_ns / step_ns) as u32)?;
        }
        scene.turn();
        now_ns += TURN_NS;
    }
    bag.finish()
}

struct Recorder<'a> {
    bag: &'a mut BagWriter,
    now_ns: i64,
}

impl Recorder<'_> {
    fn header(&self, frame: &str) -> Header {
        stamp::header(Time::from_nanos(self.now_ns), frame)
    }

    fn message<T: Serialize>(&mut self, topic: TopicId, message: &T) -> Result<(), BagError> {
        // A recorder receives a message about half a millisecond after it was sent.
        self.bag.write(topic, self.now_ns + 500_000, self.now_ns, message)
    }
}

/// Writes one step of the policy, or the end after the last step.
fn step(recorder: &mut Recorder<'_>, topics: &Topics, scene: &mut Scene, index: u32) -> Result<(), BagError> {
    let stamp = recorder.header("").stamp;
    let anchor = anchor_to_msg(scene.model.delta_anchor());
    let event = EpisodeEvent {
        header: recorder.header(""),
        episode: EPISODE,
        policy: "to and fro".to_owned(),
        seed: 1,
        step_period: STEP_PERIOD_S,
        anchor,
        ..EpisodeEvent::default()
    };
    if index == 0 {
        recorder.message(topics.event, &event)?;
    }
    let observation = ObservationMsg {
        header: recorder.header("panda_link0"),
        episode: EPISODE,
        step: index,
        values: scene.observation().0,
        keypoints_stamp: stamp.clone(),
        pose_stamp: stamp,
    };
    recorder.message(topics.observation, &observation)?;
    if index == STEPS {
        let reason = "step_limit".to_owned();
        let ended = EpisodeEvent { event: EpisodeEvent::ENDED, reason, steps: STEPS, ..event };
        return recorder.message(topics.event, &ended);
    }
    // Within the action limit of 0.06 m.
    let dx = if index.is_multiple_of(2) { 0.05 } else { -0.04 };
    scene.target_x_m += dx;
    let header = recorder.header("panda_link0");
    recorder.message(topics.action, &EefDelta { header, episode: EPISODE, step: index, dx, dz: 0.0, anchor })?;
    let pose = grip_pose_to_msg(&GripPose { x_m: scene.target_x_m, ..scene.grip });
    recorder.message(topics.target, &PoseStamped { header: recorder.header("panda_link0"), pose })
}
