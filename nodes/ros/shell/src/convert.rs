//! Conversions between messages and the types of the core that more than one node needs. Conversions of a single node are in its
//! own `convert.rs`.

use catenary_core::model::DriveKind;
use catenary_core::task::DeltaAnchor;
use catenary_core::track::End;
use catenary_core::{
    Fidelity, Frame, GripPose, Keypoints, Mixture, Parameter, ParameterSpace, Posterior, Prior, Track, Weighted,
};
use catenary_msgs::geometry_msgs::msg::{Point, Pose, Quaternion};
use catenary_msgs::msg::{
    EefDelta, Keypoints as KeypointsMsg, Mixture as MixtureMsg, Parameter as ParameterMsg, PriorPart, Track as TrackMsg,
};
use catenary_msgs::srv::SimulateRequest;
use nalgebra::{DMatrix, DVector};
use thiserror::Error;

/// Invalid field of a message.
#[derive(Debug, Error, PartialEq)]
#[error("`{field}`: expected {expected}, got {got}")]
pub struct ConvertError {
    /// Name of the field.
    pub field: &'static str,
    /// Expected value.
    pub expected: String,
    /// Received value.
    pub got: String,
}

fn error(field: &'static str, expected: impl Into<String>, got: impl ToString) -> ConvertError {
    ConvertError { field, expected: expected.into(), got: got.to_string() }
}

/// Converts a posterior to a message.
#[must_use]
pub fn posterior_to_msg(posterior: &Posterior) -> MixtureMsg {
    let mixture = &posterior.mixture;
    let components = || (0..mixture.weights().len()).map(|k| mixture.component(k));
    MixtureMsg {
        parameters: posterior.parameters.parameters().iter().map(parameter_to_msg).collect(),
        weights: mixture.weights().to_vec(),
        means: components().flat_map(|(mean, _)| mean.iter().copied()).collect(),
        // nalgebra stores columns, the message rows.
        covariances: components().flat_map(|(_, covariance)| covariance.transpose().as_slice().to_vec()).collect(),
    }
}

/// Converts a message to a posterior.
///
/// # Errors
/// [`ConvertError`]: wrong sizes, invalid priors or covariances.
pub fn posterior_from_msg(message: &MixtureMsg) -> Result<Posterior, ConvertError> {
    let parameters = message.parameters.iter().map(parameter_from_msg).collect::<Result<_, _>>()?;
    let parameters =
        ParameterSpace::new(parameters).map_err(|e| error("parameters", "names and priors of a model", e))?;
    let (d, k) = (parameters.dimension(), message.weights.len());
    let sizes = [("means", message.means.len(), k * d), ("covariances", message.covariances.len(), k * d * d)];
    for (field, got, expected) in sizes {
        if d == 0 || k == 0 || got != expected {
            return Err(error(field, format!("{expected} numbers for {k} components of {d} parameters"), got));
        }
    }
    let means = message.means.chunks_exact(d).map(DVector::from_row_slice).collect();
    let covariances = message.covariances.chunks_exact(d * d).map(|c| DMatrix::from_row_slice(d, d, c)).collect();
    let mixture = Mixture::new(&message.weights, means, covariances)
        .map_err(|e| error("covariances", "a mixture of Gaussians", e))?;
    Ok(Posterior { parameters, mixture })
}

fn parameter_to_msg(parameter: &Parameter) -> ParameterMsg {
    let PriorPart { prior, low, high, mean, sd, .. } = prior_to_msg(1.0, &parameter.prior);
    let parts = match &parameter.prior {
        Prior::Mixture(parts) => parts.iter().map(|p| prior_to_msg(p.weight, &p.prior)).collect(),
        _ => Vec::new(),
    };
    ParameterMsg { name: parameter.name.clone(), prior, low, high, mean, sd, parts }
}

/// Converts a prior without the parts of a mixture.
fn prior_to_msg(weight: f64, prior: &Prior) -> PriorPart {
    let (low, high) = prior.bounds();
    let (prior, mean, sd) = match *prior {
        Prior::Uniform { .. } => (ParameterMsg::PRIOR_UNIFORM, 0.0, 0.0),
        Prior::LogUniform { .. } => (ParameterMsg::PRIOR_LOG_UNIFORM, 0.0, 0.0),
        Prior::Normal { mean, sd, .. } => (ParameterMsg::PRIOR_NORMAL, mean, sd),
        Prior::Mixture(_) => (ParameterMsg::PRIOR_MIXTURE, 0.0, 0.0),
    };
    PriorPart { weight, prior, low, high, mean, sd }
}

fn parameter_from_msg(message: &ParameterMsg) -> Result<Parameter, ConvertError> {
    let &ParameterMsg { prior, low, high, mean, sd, .. } = message;
    let prior = match prior {
        ParameterMsg::PRIOR_MIXTURE => {
            let part = |p: &PriorPart| Ok(Weighted { weight: p.weight, prior: prior_from_msg(p)? });
            Prior::Mixture(message.parts.iter().map(part).collect::<Result<_, _>>()?)
        }
        _ => prior_from_msg(&PriorPart { weight: 1.0, prior, low, high, mean, sd })?,
    };
    Ok(Parameter { name: message.name.clone(), prior })
}

fn prior_from_msg(message: &PriorPart) -> Result<Prior, ConvertError> {
    let &PriorPart { low, high, mean, sd, .. } = message;
    match message.prior {
        ParameterMsg::PRIOR_UNIFORM => Ok(Prior::Uniform { low, high }),
        ParameterMsg::PRIOR_LOG_UNIFORM => Ok(Prior::LogUniform { low, high }),
        ParameterMsg::PRIOR_NORMAL => Ok(Prior::Normal { mean, sd, low, high }),
        other => Err(error("prior", "one of PRIOR_*, and no mixture in a mixture", other)),
    }
}

/// Converts a fidelity to its number in `Simulate`.
#[must_use]
pub fn fidelity_to_msg(fidelity: Fidelity) -> u8 {
    match fidelity {
        Fidelity::Fast => SimulateRequest::FIDELITY_FAST,
        Fidelity::FineMesh => SimulateRequest::FIDELITY_FINE_MESH,
        Fidelity::Standard => SimulateRequest::FIDELITY_STANDARD,
        Fidelity::Reference => SimulateRequest::FIDELITY_REFERENCE,
    }
}

/// Converts a number in `Simulate` to a fidelity.
///
/// # Errors
/// [`ConvertError`] for any other number.
pub fn fidelity_from_msg(number: u8) -> Result<Fidelity, ConvertError> {
    Fidelity::ALL
        .into_iter()
        .find(|f| fidelity_to_msg(*f) == number)
        .ok_or_else(|| error("fidelity", "one of FIDELITY_*", number))
}

/// Converts a drive to its number in `Simulate`.
#[must_use]
pub fn drive_to_msg(drive: DriveKind) -> u8 {
    match drive {
        DriveKind::Grip => SimulateRequest::DRIVE_GRIP,
        DriveKind::Actions => SimulateRequest::DRIVE_ACTIONS,
        DriveKind::Policy => SimulateRequest::DRIVE_POLICY,
    }
}

/// Converts a number in `Simulate` to a drive.
///
/// # Errors
/// [`ConvertError`] for any other number.
pub fn drive_from_msg(number: u8) -> Result<DriveKind, ConvertError> {
    [DriveKind::Grip, DriveKind::Actions, DriveKind::Policy]
        .into_iter()
        .find(|d| drive_to_msg(*d) == number)
        .ok_or_else(|| error("drive", "one of DRIVE_*", number))
}

/// Converts a delta anchor to its number in `EefDelta`.
#[must_use]
pub fn anchor_to_msg(anchor: DeltaAnchor) -> u8 {
    match anchor {
        DeltaAnchor::Measured => EefDelta::ANCHOR_MEASURED,
        DeltaAnchor::LastTarget => EefDelta::ANCHOR_LAST_TARGET,
    }
}

/// Converts a number in `EefDelta` to a delta anchor.
///
/// # Errors
/// [`ConvertError`] for any other number.
pub fn anchor_from_msg(number: u8) -> Result<DeltaAnchor, ConvertError> {
    [DeltaAnchor::Measured, DeltaAnchor::LastTarget]
        .into_iter()
        .find(|a| anchor_to_msg(*a) == number)
        .ok_or_else(|| error("anchor", "one of ANCHOR_*", number))
}

/// Converts keypoints to a message with an empty header.
#[must_use]
pub fn keypoints_to_msg(keypoints: &Keypoints) -> KeypointsMsg {
    let [target_u, target_v] = keypoints.target_px.unwrap_or_default();
    KeypointsMsg {
        header: Default::default(),
        image_width: keypoints.image_width_px,
        image_height: keypoints.image_height_px,
        dlo_u: keypoints.dlo_px.map(|p| p[0]),
        dlo_v: keypoints.dlo_px.map(|p| p[1]),
        dlo_scores: keypoints.scores,
        target_seen: keypoints.target_px.is_some(),
        target_u,
        target_v,
        target_score: keypoints.target_score,
    }
}

/// Converts a message to keypoints.
///
/// # Errors
/// [`ConvertError`]: an image without pixels, coordinates that are not finite.
pub fn keypoints_from_msg(message: &KeypointsMsg) -> Result<Keypoints, ConvertError> {
    let (width, height) = (message.image_width, message.image_height);
    if width == 0 || height == 0 {
        return Err(error("image_width", "an image of at least one pixel", format!("{width} x {height}")));
    }
    let dlo_px: [[f64; 2]; 4] = std::array::from_fn(|k| [message.dlo_u[k], message.dlo_v[k]]);
    let target_px = message.target_seen.then_some([message.target_u, message.target_v]);
    let numbers = dlo_px.iter().chain(target_px.iter()).flatten();
    if let Some(bad) = numbers.clone().find(|v| !v.is_finite()) {
        return Err(error("dlo_u, dlo_v, target_u, target_v", "finite numbers", bad));
    }
    Ok(Keypoints {
        dlo_px,
        target_px,
        scores: message.dlo_scores,
        target_score: message.target_score,
        image_width_px: width,
        image_height_px: height,
    })
}

/// Converts a pose of the grip in the plane y = 0 to a pose of panda_hand_tcp in panda_link0. The tool points down at pitch 0.
#[must_use]
pub fn grip_pose_to_msg(pose: &GripPose) -> Pose {
    let [x, y, z, w] = pose.quaternion_xyzw();
    Pose { position: Point { x: pose.x_m, y: 0.0, z: pose.z_m }, orientation: Quaternion { x, y, z, w } }
}

/// Projects a pose of panda_hand_tcp in panda_link0 on the plane y = 0.
#[must_use]
pub fn grip_pose_from_msg(pose: &Pose) -> GripPose {
    let q = &pose.orientation;
    GripPose {
        x_m: pose.position.x,
        z_m: pose.position.z,
        pitch_rad: GripPose::pitch_from_quaternion([q.x, q.y, q.z, q.w]),
    }
}

/// Converts a track to a message.
#[must_use]
pub fn track_to_msg(track: &Track) -> TrackMsg {
    let frames = || track.frames.iter();
    let is_felt = frames().any(|f| f.wrench.is_some());
    TrackMsg {
        time: frames().map(|f| f.time_s).collect(),
        dlo: frames().flat_map(|f| f.dlo.into_iter().flatten()).collect(),
        target: frames().flat_map(|f| f.target).collect(),
        eef: frames().flat_map(|f| f.eef).collect(),
        action: frames().flat_map(|f| f.action).collect(),
        wrench: frames().filter(|_| is_felt).flat_map(|f| f.wrench.unwrap_or([f64::NAN; 3])).collect(),
        end: track.end.name().to_owned(),
    }
}

/// Converts a message to a track.
///
/// # Errors
/// [`ConvertError`]: wrong sizes, an unknown end.
pub fn track_from_msg(message: &TrackMsg) -> Result<Track, ConvertError> {
    let n = message.time.len();
    let sizes = [
        ("dlo", message.dlo.len(), 8),
        ("target", message.target.len(), 2),
        ("eef", message.eef.len(), 3),
        ("action", message.action.len(), 2),
    ];
    let is_felt = !message.wrench.is_empty();
    let wrench = is_felt.then_some(("wrench", message.wrench.len(), 3));
    if let Some((field, got, each)) = sizes.into_iter().chain(wrench).find(|(_, got, each)| *got != n * each) {
        return Err(error(field, format!("{each} numbers for each of {n} moments"), got));
    }
    let end = End::from_name(&message.end).ok_or_else(|| error("end", "an end of an episode", &message.end))?;
    let frame = |i: usize| Frame {
        time_s: message.time[i],
        dlo: std::array::from_fn(|k| [message.dlo[8 * i + 2 * k], message.dlo[8 * i + 2 * k + 1]]),
        target: [message.target[2 * i], message.target[2 * i + 1]],
        eef: std::array::from_fn(|k| message.eef[3 * i + k]),
        action: [message.action[2 * i], message.action[2 * i + 1]],
        wrench: is_felt
            .then(|| std::array::from_fn(|k| message.wrench[3 * i + k]))
            .filter(|w: &[f64; 3]| !w[0].is_nan()),
    };
    Ok(Track { frames: (0..n).map(frame).collect(), end })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn posterior() -> Posterior {
        let parameter = |name: &str, prior| Parameter { name: name.into(), prior };
        let parameters = ParameterSpace::new(vec![
            parameter("length_m", Prior::Uniform { low: 0.1, high: 0.3 }),
            parameter("youngs_modulus_pa", Prior::LogUniform { low: 1e3, high: 1e5 }),
        ])
        .unwrap();
        let covariance = DMatrix::from_row_slice(2, 2, &[0.02, 0.005, 0.005, 0.01]);
        let means = vec![DVector::from_vec(vec![0.2, 0.3]), DVector::from_vec(vec![0.5, 0.6])];
        let mixture = Mixture::new(&[0.25, 0.75], means, vec![covariance.clone(), covariance]).unwrap();
        Posterior { parameters, mixture }
    }

    #[test]
    fn posteriors_and_tracks_survive_the_conversion() {
        let there = posterior_to_msg(&posterior());
        assert_eq!(posterior_from_msg(&there).unwrap(), posterior());
        let frame = |t: f64| Frame {
            time_s: t,
            dlo: [[t, 0.1], [0.2, 0.3], [0.4, 0.5], [0.6, 0.7]],
            target: [0.8, 0.9],
            eef: [1.0, 1.1, 1.2],
            action: [0.01, -0.02],
            wrench: None,
        };
        let mut track = Track { frames: vec![frame(0.0), frame(0.5)], end: End::StepLimit };
        assert_eq!(track_from_msg(&track_to_msg(&track)).unwrap(), track);
        assert!(track_to_msg(&track).wrench.is_empty(), "a track without a wrench is no longer for it");
        track.frames[1].wrench = Some([0.1, -4.0, 0.2]);
        let mut message = track_to_msg(&track);
        assert_eq!(track_from_msg(&message).unwrap(), track);
        message.wrench.pop();
        assert_eq!(track_from_msg(&message).unwrap_err().field, "wrench");
    }

    #[test]
    fn every_kind_of_prior_survives_the_conversion() {
        let normal = Prior::Normal { mean: 0.2, sd: 0.01, low: 0.1, high: 0.3 };
        let log_uniform = Prior::LogUniform { low: 0.01, high: 0.3 };
        let parts = [(2.0, &normal), (0.5, &log_uniform), (1.0, &Prior::Uniform { low: 0.0, high: 1.0 })];
        let mixture = parts.map(|(weight, prior)| Weighted { weight, prior: prior.clone() });
        for prior in [normal.clone(), log_uniform.clone(), Prior::Mixture(mixture.to_vec())] {
            let there = Parameter { name: "length_m".into(), prior };
            assert_eq!(parameter_from_msg(&parameter_to_msg(&there)).unwrap(), there);
        }
        let nested = PriorPart { prior: ParameterMsg::PRIOR_MIXTURE, ..PriorPart::default() };
        let message =
            ParameterMsg { prior: ParameterMsg::PRIOR_MIXTURE, parts: vec![nested], ..ParameterMsg::default() };
        assert!(parameter_from_msg(&message).unwrap_err().to_string().contains("no mixture in a mixture, got 3"));
    }

    #[test]
    fn wrong_sizes_are_named() {
        let mut message = posterior_to_msg(&posterior());
        message.covariances.pop();
        assert_eq!(posterior_from_msg(&message).unwrap_err().field, "covariances");
        assert_eq!(posterior_from_msg(&MixtureMsg::default()).unwrap_err().field, "means");
        assert!(fidelity_from_msg(9).is_err() && drive_from_msg(9).is_err() && anchor_from_msg(9).is_err());
    }
}
