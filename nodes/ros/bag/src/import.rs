//! Import of a measured track in CSV into a bag.

mod doubts;
mod table;
mod zeros;

use crate::error::BagError;
use crate::writer::{BagSummary, BagWriter, WriterOptions};
use catenary_core::camera::MASK_SIZE_PX;
use catenary_core::episode::view_of;
use catenary_core::{Camera, Keypoints, Model};
use catenary_msgs::geometry_msgs::msg::{PoseStamped, Vector3, Wrench, WrenchStamped};
use catenary_msgs::msg::{EpisodeEvent, Keypoints as KeypointsMsg};
use catenary_msgs::std_msgs::msg::Header;
use catenary_shell::convert::{anchor_to_msg, grip_pose_to_msg, keypoints_to_msg};
use catenary_shell::{Time, contract, stamp};
use std::path::Path;
use table::{Row, read_rows};

/// Stamp in ns of the track's time 0: a stamp of zero means "no time" in ROS.
const EPOCH_NS: i64 = 1_000_000_000;
/// Frame of poses and wrenches.
const BASE_FRAME: &str = "panda_link0";
/// Frame of keypoints.
const CAMERA_FRAME: &str = "camera_color_optical_frame";
/// Number of the only episode.
const EPISODE: u32 = 1;

/// Bag of an imported track.
#[derive(Debug, Clone)]
pub struct Imported {
    /// Size of the bag.
    pub bag: BagSummary,
    /// Doubts about the track, one sentence each, with file, line, column and value.
    pub warnings: Vec<String>,
}

/// Writes a track as a bag with one episode, whose policy has the name `recorded`. The points of the track are projected
/// into the model's camera. Every row is written, doubtful ones, too: the reader of the bag decides what it uses. A point
/// at exactly (0, 0) m, or with a coordinate of 0 far from the rows around it, counts as missing: its keypoint has the score 0.
///
/// `csv` has a header line and the columns `t_s` (increasing), `grip_x_m`, `grip_z_m`, `grip_pitch_rad`, `p1_x_m`,
/// `p1_z_m` to `p4_x_m`, `p4_z_m`, and optionally `grip_fx_n`, `grip_fz_n`, `grip_ty_nm`, in any order. Units are s, m,
/// rad, N and N m; the frame is panda_link0, in the plane y = 0. `source` is the name of the track in messages. The bag
/// has the topics `/dlo/keypoints` without a target, `/panda/current_pose`, `/panda/external_wrench` if the track has a
/// wrench, and `/episode/event`. The stamp of a row is its `t_s` plus 1 s.
///
/// # Errors
/// [`BagError::Csv`] with line and column, also for times in another unit and for a point that is missing in all rows;
/// [`BagError::OutOfView`] if no point is in the image; those of [`BagWriter`].
pub fn import_track(source: &str, csv: &str, model: &Model, out: &Path) -> Result<Imported, BagError> {
    let rows = read_rows(source, csv)?;
    doubts::check_interval(source, &rows, model)?;
    let zeros::Zeros { missing, mut warnings } = zeros::zeros(source, &rows, model)?;
    let camera = &model.camera.view;
    let keypoints = rows
        .iter()
        .zip(&missing)
        .map(|(row, missing)| keypoints(source, camera, row, missing))
        .collect::<Result<Vec<_>, _>>()?;
    // Some points outside are normal, as a swinging end may leave the image. All of them mean a wrong unit or model.
    if let (Some(first), true) = (rows.first(), keypoints.iter().flat_map(seen_px).all(is_outside)) {
        let seen = rows.iter().zip(&missing).flat_map(|(r, missing)| r.points_m.into_iter().zip(*missing));
        let points_m: Vec<[f64; 2]> = seen.filter(|(_, missing)| !missing).map(|(point, _)| point).collect();
        return Err(BagError::OutOfView {
            file: source.to_owned(),
            line: first.line,
            points: points_m.len(),
            first_m: points_m.first().copied().unwrap_or_default(),
            view: view_of(camera, &points_m),
        });
    }
    warnings.extend(doubts::out_of_view(source, &rows, &keypoints, camera));
    warnings.extend(doubts::held(source, &rows, &keypoints));
    Ok(Imported { bag: write(&rows, &keypoints, model, out)?, warnings })
}

/// Pixels of the keypoints that were seen.
fn seen_px(keypoints: &Keypoints) -> impl Iterator<Item = [f64; 2]> {
    keypoints.dlo_px.into_iter().zip(keypoints.scores).filter(|(_, score)| *score > 0.0).map(|(px, _)| px)
}

/// True if a pixel of the mask lies outside of it.
fn is_outside(px: [f64; 2]) -> bool {
    px.iter().any(|v| !(0.0..=f64::from(MASK_SIZE_PX)).contains(v))
}

/// Keypoints of one row in the camera's mask.
fn keypoints(source: &str, camera: &Camera, row: &Row, missing: &[bool; 4]) -> Result<Keypoints, BagError> {
    let mut dlo_px = [[0.0; 2]; 4];
    for (i, ([x, z], px)) in row.points_m.iter().zip(&mut dlo_px).enumerate().filter(|(i, _)| !missing[*i]) {
        *px = camera.mask_from_world([*x, 0.0, *z]).ok_or_else(|| BagError::Csv {
            file: source.to_owned(),
            line: row.line,
            column: format!("p{}_x_m", i + 1),
            expected: "a point in front of the model's camera".to_owned(),
            got: format!("({x}, {z}) m, which lies behind it"),
        })?;
    }
    Ok(Keypoints {
        dlo_px,
        target_px: None,
        scores: missing.map(|missing| if missing { 0.0 } else { 1.0 }),
        target_score: 0.0,
        image_width_px: MASK_SIZE_PX,
        image_height_px: MASK_SIZE_PX,
    })
}

fn write(rows: &[Row], keypoints: &[Keypoints], model: &Model, out: &Path) -> Result<BagSummary, BagError> {
    let mut bag = BagWriter::create(out, &WriterOptions::default())?;
    let name = |topic: contract::Topic| format!("/{}", topic.name);
    let event_topic = bag.add_topic_of::<EpisodeEvent>(&name(contract::EPISODE_EVENT), contract::EPISODE_EVENT.qos)?;
    let keypoints_topic = bag.add_topic_of::<KeypointsMsg>(&name(contract::KEYPOINTS), contract::KEYPOINTS.qos)?;
    let pose_topic = bag.add_topic_of::<PoseStamped>(&name(contract::CURRENT_POSE), contract::CURRENT_POSE.qos)?;
    let wrench_topic = match rows.iter().any(|r| r.wrench.is_some()) {
        true => {
            Some(bag.add_topic_of::<WrenchStamped>(&name(contract::EXTERNAL_WRENCH), contract::EXTERNAL_WRENCH.qos)?)
        }
        false => None,
    };
    let started = EpisodeEvent {
        episode: EPISODE,
        event: EpisodeEvent::STARTED,
        policy: "recorded".to_owned(),
        step_period: model.observation.frame_period_s,
        anchor: anchor_to_msg(model.delta_anchor()),
        ..EpisodeEvent::default()
    };
    let ended = EpisodeEvent { event: EpisodeEvent::ENDED, reason: "complete".to_owned(), ..started.clone() };
    for (i, (row, seen)) in rows.iter().zip(keypoints).enumerate() {
        let at_ns = EPOCH_NS + row.time_ns;
        let header = |frame: &str| -> Header { stamp::header(Time::from_nanos(at_ns), frame) };
        if i == 0 {
            bag.write(event_topic, at_ns, at_ns, &EpisodeEvent { header: header(""), ..started.clone() })?;
        }
        let message = KeypointsMsg { header: header(CAMERA_FRAME), ..keypoints_to_msg(seen) };
        bag.write(keypoints_topic, at_ns, at_ns, &message)?;
        let message = PoseStamped { header: header(BASE_FRAME), pose: grip_pose_to_msg(&row.grip) };
        bag.write(pose_topic, at_ns, at_ns, &message)?;
        if let (Some(topic), Some([fx, fz, ty])) = (wrench_topic, row.wrench) {
            let wrench = Wrench { force: Vector3 { x: fx, y: 0.0, z: fz }, torque: Vector3 { x: 0.0, y: ty, z: 0.0 } };
            bag.write(topic, at_ns, at_ns, &WrenchStamped { header: header(BASE_FRAME), wrench })?;
        }
        if i + 1 == rows.len() {
            bag.write(event_topic, at_ns, at_ns, &EpisodeEvent { header: header(""), ..ended.clone() })?;
        }
    }
    bag.finish()
}
