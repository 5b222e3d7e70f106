//! Bag of a simulated episode with the topics of the contract, in the form of the recorder's bags.

use super::player::{Player, side_view};
use anyhow::Result;
use catenary_bag::{BagSummary, BagWriter, TopicId, WriterOptions};
use catenary_core::camera::Pinhole;
use catenary_core::grip::POSE_LEVER_M;
use catenary_core::model::DriveKind;
use catenary_core::task::DeltaAnchor;
use catenary_core::{GripPose, Keypoints, Model, Observation, RgbImage, seed};
use catenary_msgs::Interface;
use catenary_msgs::geometry_msgs::msg::{PoseStamped, TwistStamped, WrenchStamped};
use catenary_msgs::msg::{
    AcceptedTarget, ArmState, EefDelta, EpisodeEvent, Keypoints as KeypointsMsg, Observation as ObservationMsg,
};
use catenary_msgs::sensor_msgs::msg::{CameraInfo, Image, JointState};
use catenary_msgs::std_msgs::msg::Header;
use catenary_msgs::tf2_msgs::msg::TFMessage;
use catenary_shell::convert::{anchor_to_msg, grip_pose_to_msg, keypoints_to_msg};
use catenary_shell::{Time, contract, stamp};
use panda_bridge::convert::hand_transform;
use panda_bridge::{ArmPose, kinematics};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;
use simulated_cell::convert;
use std::path::Path;

/// Time stamp of the start of the episode, ns. A stamp of zero means "no time" in ROS.
const EPOCH_NS: i64 = 1_000_000_000;
/// Frame of poses and wrenches.
const BASE_FRAME: &str = "panda_link0";
/// Frame of pictures and keypoints.
const CAMERA_FRAME: &str = "camera_color_optical_frame";
/// Random stream of the pose noise.
const NOISE_STREAM: u64 = 0x9053;
/// Number of the only episode.
const EPISODE: u32 = 1;

/// Constant facts of the episode.
pub struct Facts {
    /// Name of the policy in events: `actions` or `recorded`.
    pub policy: &'static str,
    /// Seed of the episode.
    pub seed: u64,
    /// Time between two actions, s.
    pub step_period_s: f64,
    /// Pose that an action's delta is added to.
    pub anchor: DeltaAnchor,
    /// Nominal camera, as published in camera_info and tf.
    pub camera: Pinhole,
    /// Standard deviation of the noise of measured poses, m; 0 without noise.
    pub pose_noise_m: f64,
    /// Source of the keypoints, which a reader of the bag cannot see.
    pub keypoints: &'static str,
}

/// Sources of keypoints.
const EXACT: &str = "those of the simulated object: this bag does not show what camera and tracker find";
const OF_PICTURES: &str = "by camera and tracker from simulated pictures";

impl Facts {
    /// Facts of an episode: `acts` for actions, else for a measured motion. `noise` enables the model's pose noise, `by_eyes`
    /// says that keypoints come from pictures.
    pub fn of(model: &Model, acts: bool, seed: u64, noise: bool, by_eyes: bool) -> Self {
        // The model has pose noise only where it predicts the pose: a drive by grip takes the recorded pose as exact.
        let is_predicted = acts && model.observation.drive != DriveKind::Grip;
        let period_s = model.task.filter(|_| acts).map(|t| t.step_period_s);
        Self {
            policy: if acts { "actions" } else { "recorded" },
            seed,
            step_period_s: period_s.unwrap_or(model.observation.frame_period_s),
            anchor: model.delta_anchor(),
            camera: side_view(&model.camera.view),
            keypoints: if by_eyes { OF_PICTURES } else { EXACT },
            pose_noise_m: if noise && is_predicted { model.arm.pose_noise_m } else { 0.0 },
        }
    }
}

struct Topics {
    keypoints: TopicId,
    pose: TopicId,
    twist: TopicId,
    wrench: TopicId,
    joints: TopicId,
    arm: TopicId,
    tf: TopicId,
    tf_static: TopicId,
    target: TopicId,
    accepted: TopicId,
    action: TopicId,
    observation: TopicId,
    event: TopicId,
    picture: Option<(TopicId, TopicId)>,
}

/// Bag that is being written.
pub struct Recording {
    bag: BagWriter,
    topics: Topics,
    facts: Facts,
    angles_rad: [f64; kinematics::JOINTS],
    noise: ChaCha8Rng,
    /// Last measured pose.
    grip: GripPose,
    now_ns: i64,
    keypoints_ns: i64,
    actions: u32,
    episode_return: f64,
}

impl Recording {
    /// Creates the bag in `folder`, which must not exist, and starts the episode. `pictures` adds the topics of the
    /// camera.
    pub fn create(folder: &Path, facts: Facts, pictures: bool) -> Result<Self> {
        let mut bag = BagWriter::create(folder, &WriterOptions::default())?;
        bag.describe("keypoints", facts.keypoints);
        fn add<T: Interface>(bag: &mut BagWriter, topic: contract::Topic) -> Result<TopicId> {
            Ok(bag.add_topic_of::<T>(&format!("/{}", topic.name.trim_start_matches('/')), topic.qos)?)
        }
        let picture = match pictures {
            true => {
                Some((add::<Image>(&mut bag, contract::IMAGE)?, add::<CameraInfo>(&mut bag, contract::CAMERA_INFO)?))
            }
            false => None,
        };
        let topics = Topics {
            keypoints: add::<KeypointsMsg>(&mut bag, contract::KEYPOINTS)?,
            pose: add::<PoseStamped>(&mut bag, contract::CURRENT_POSE)?,
            twist: add::<TwistStamped>(&mut bag, contract::CURRENT_TWIST)?,
            wrench: add::<WrenchStamped>(&mut bag, contract::EXTERNAL_WRENCH)?,
            joints: add::<JointState>(&mut bag, contract::JOINT_STATES)?,
            arm: add::<ArmState>(&mut bag, contract::ARM_STATE)?,
            tf: add::<TFMessage>(&mut bag, contract::TF)?,
            tf_static: add::<TFMessage>(&mut bag, contract::TF_STATIC)?,
            target: add::<PoseStamped>(&mut bag, contract::TARGET_POSE)?,
            accepted: add::<AcceptedTarget>(&mut bag, contract::ACCEPTED_TARGET)?,
            action: add::<EefDelta>(&mut bag, contract::ACTION)?,
            observation: add::<ObservationMsg>(&mut bag, contract::OBSERVATION)?,
            event: add::<EpisodeEvent>(&mut bag, contract::EPISODE_EVENT)?,
            picture,
        };
        let angles_rad = kinematics::READY_RAD;
        let (now_ns, keypoints_ns, actions, episode_return) = (0, 0, 0, 0.0);
        let noise = seed::rng(seed::derive(facts.seed, NOISE_STREAM), 0);
        let mut recording = Self {
            bag,
            topics,
            facts,
            angles_rad,
            noise,
            grip: GripPose::default(),
            now_ns,
            keypoints_ns,
            actions,
            episode_return,
        };
        // One message is enough: the simulated arm never changes its state.
        let state = ArmState { mode: ArmState::MODE_TRACKING, success_rate: 1.0, is_sim: true, ..ArmState::default() };
        let state = ArmState { header: recording.header(""), ..state };
        recording.put(recording.topics.arm, &state)?;
        let camera = convert::camera_transform(&recording.facts.camera, recording.header(BASE_FRAME), CAMERA_FRAME);
        recording.put(recording.topics.tf_static, &TFMessage { transforms: vec![camera] })?;
        recording.event(EpisodeEvent::STARTED, "")?;
        Ok(recording)
    }

    /// Sets the time since the start of the episode.
    pub fn set_time(&mut self, time_ns: i64) {
        self.now_ns = time_ns;
    }

    fn header(&self, frame: &str) -> Header {
        stamp::header(Time::from_nanos(EPOCH_NS + self.now_ns), frame)
    }

    fn put<T: Serialize>(&mut self, topic: TopicId, message: &T) -> Result<()> {
        let at_ns = EPOCH_NS + self.now_ns;
        Ok(self.bag.write(topic, at_ns, at_ns, message)?)
    }

    fn event(&mut self, event: u8, reason: &str) -> Result<()> {
        let message = EpisodeEvent {
            header: self.header(""),
            episode: EPISODE,
            event,
            reason: reason.to_owned(),
            policy: self.facts.policy.to_owned(),
            seed: self.facts.seed,
            step_period: self.facts.step_period_s,
            anchor: anchor_to_msg(self.facts.anchor),
            steps: self.actions,
            episode_return: self.episode_return,
        };
        self.put(self.topics.event, &message)
    }

    /// Writes the measurements of the arm.
    pub fn arm(&mut self, player: &mut Player<'_>) -> Result<()> {
        let mut noise = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, &mut self.noise);
        let sd_m = self.facts.pose_noise_m;
        let exact = player.grip();
        let grip = GripPose {
            x_m: exact.x_m + noise(sd_m),
            z_m: exact.z_m + noise(sd_m),
            pitch_rad: exact.pitch_rad + noise(sd_m / POSE_LEVER_M),
        };
        self.grip = grip;
        let header = self.header(BASE_FRAME);
        let measured = ArmPose { position_m: [grip.x_m, 0.0, grip.z_m], quaternion_xyzw: grip.quaternion_xyzw() };
        // Without a solution, the joints keep their angles: the pose of the hand is what inference reads.
        if let Some(angles) = kinematics::inverse(&measured, &self.angles_rad) {
            self.angles_rad = angles;
        }
        let pose = PoseStamped { header: header.clone(), pose: grip_pose_to_msg(&grip) };
        let twist = TwistStamped { header: header.clone(), twist: convert::twist(player.velocity_m_s()) };
        let wrench = WrenchStamped { header: header.clone(), wrench: convert::wrench(&player.wrench()) };
        let hand = TFMessage { transforms: vec![hand_transform(&measured, header.clone())] };
        let joints = JointState {
            header,
            name: (1..=kinematics::JOINTS).map(|i| format!("panda_joint{i}")).collect(),
            position: self.angles_rad.to_vec(),
            ..JointState::default()
        };
        self.put(self.topics.pose, &pose)?;
        self.put(self.topics.twist, &twist)?;
        self.put(self.topics.wrench, &wrench)?;
        self.put(self.topics.joints, &joints)?;
        self.put(self.topics.tf, &hand)
    }

    /// Writes the keypoints of the tracker.
    pub fn keypoints(&mut self, keypoints: &Keypoints) -> Result<()> {
        self.keypoints_ns = self.now_ns;
        let message = KeypointsMsg { header: self.header(CAMERA_FRAME), ..keypoints_to_msg(keypoints) };
        self.put(self.topics.keypoints, &message)
    }

    /// Writes a picture of the camera, if the bag has its topic.
    pub fn picture(&mut self, picture: &RgbImage) -> Result<()> {
        let Some((image, info)) = self.topics.picture else { return Ok(()) };
        self.put(info, &convert::camera_info(&self.facts.camera, self.header(CAMERA_FRAME)))?;
        self.put(image, &convert::image(picture, self.header(CAMERA_FRAME)))
    }

    /// Writes observation `step`, with the last measured pose of the hand, and adds its reward to the return.
    pub fn observation(&mut self, step: usize, seen: Observation, reward: Option<f64>) -> Result<()> {
        let values = Observation::new([self.grip.x_m, self.grip.z_m], &seen.dlo(), seen.target()).0;
        self.episode_return += reward.unwrap_or_default();
        let message = ObservationMsg {
            header: self.header(BASE_FRAME),
            episode: EPISODE,
            step: step as u32,
            values,
            keypoints_stamp: stamp::to_msg(Time::from_nanos(EPOCH_NS + self.keypoints_ns)),
            pose_stamp: self.header("").stamp,
        };
        self.put(self.topics.observation, &message)
    }

    /// Writes action `step`, its target pose, and the acceptance of the target: the simulated arm refuses and clips
    /// nothing.
    pub fn action(&mut self, step: usize, [dx, dz]: [f64; 2], [x_m, z_m]: [f64; 2], grip: GripPose) -> Result<()> {
        self.actions += 1;
        let (header, anchor) = (self.header(BASE_FRAME), anchor_to_msg(self.facts.anchor));
        self.put(self.topics.action, &EefDelta { header, episode: EPISODE, step: step as u32, dx, dz, anchor })?;
        let target = GripPose { x_m, z_m, ..grip };
        let (header, pose) = (self.header(BASE_FRAME), grip_pose_to_msg(&target));
        let accepted_count = u64::from(self.actions);
        let answer = AcceptedTarget {
            header: header.clone(),
            accepted: true,
            pose: pose.clone(),
            accepted_count,
            ..AcceptedTarget::default()
        };
        self.put(self.topics.target, &PoseStamped { header, pose })?;
        self.put(self.topics.accepted, &answer)
    }

    /// Ends the episode and the bag.
    pub fn finish(mut self, reason: &str) -> Result<BagSummary> {
        self.event(EpisodeEvent::ENDED, reason)?;
        Ok(self.bag.finish()?)
    }
}
