//! Conversions between the pool's wire types and the simulator's types.

use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{EnvError, GripPose, GripTrajectory, Observation, Policy, SimulationRequest, Transition};
use catenary_msgs::srv::{SimulateRequest, StepEnvsResponse};
use catenary_shell::convert::{self, ConvertError};

fn refuse(field: &'static str, expected: &str, got: impl ToString) -> ConvertError {
    ConvertError { field, expected: expected.to_owned(), got: got.to_string() }
}

/// Converts a request to a batch, for a model with `dimension` inferred parameters.
///
/// # Errors
/// [`ConvertError`] naming the field that does not fit.
pub fn simulation_request(r: &SimulateRequest, dimension: usize) -> Result<SimulationRequest, ConvertError> {
    if dimension == 0 || !r.theta.len().is_multiple_of(dimension) {
        return Err(refuse("theta", &format!("rows of {dimension} values"), format!("{} values", r.theta.len())));
    }
    let thetas: Vec<Vec<f64>> = r.theta.chunks_exact(dimension).map(<[f64]>::to_vec).collect();
    let (n, e) = (thetas.len(), r.effect_names.len());
    if r.effects.len() != n * e {
        return Err(refuse("effects", &format!("{n} rows of {e} values"), format!("{} values", r.effects.len())));
    }
    // The wire has rows of effects by episode; the batch has columns by effect.
    let column = |k: usize| (0..n).map(|i| r.effects[i * e + k]).collect();
    Ok(SimulationRequest {
        effects: r.effect_names.iter().enumerate().map(|(k, name)| (name.clone(), column(k))).collect(),
        drive: drive(r)?,
        start: start_shape(&r.start_shape, &r.start_velocity)?,
        frame_times_s: r.frame_times.clone(),
        target_m: r.target_given.then_some(r.target),
        fidelity: convert::fidelity_from_msg(r.fidelity)?,
        seed: r.seed,
        first_episode: r.first_episode,
        noise: r.noise,
        thetas,
    })
}

fn drive(r: &SimulateRequest) -> Result<Drive, ConvertError> {
    use catenary_core::model::DriveKind;
    Ok(match convert::drive_from_msg(r.drive)? {
        DriveKind::Grip => {
            let g = &r.grip;
            let n = g.time.len();
            if [g.x.len(), g.z.len(), g.pitch.len()] != [n; 3] {
                return Err(refuse(
                    "grip",
                    &format!("{n} values of x, z and pitch"),
                    format!("{}, {}, {}", g.x.len(), g.z.len(), g.pitch.len()),
                ));
            }
            let poses = (0..n).map(|i| GripPose { x_m: g.x[i], z_m: g.z[i], pitch_rad: g.pitch[i] }).collect();
            Drive::Grip(GripTrajectory::new(g.time.clone(), poses).map_err(|e| refuse("grip", "a path", e))?)
        }
        DriveKind::Actions => {
            if !r.actions.len().is_multiple_of(2) {
                return Err(refuse("actions", "pairs (dx, dz)", r.actions.len()));
            }
            Drive::Actions(r.actions.chunks_exact(2).map(|a| [a[0], a[1]]).collect())
        }
        DriveKind::Policy => {
            let policy = Policy::from_bytes(&r.policy).map_err(|e| refuse("policy", "a policy file", e))?;
            Drive::Policy(Box::new(policy))
        }
    })
}

fn start_shape(points: &[f64], velocities: &[f64]) -> Result<StartShape, ConvertError> {
    let four = |field, v: &[f64]| -> Result<[[f64; 2]; 4], ConvertError> {
        if v.len() != 8 {
            return Err(refuse(field, "four pairs (x, z), or nothing", format!("{} values", v.len())));
        }
        Ok(std::array::from_fn(|k| [v[2 * k], v[2 * k + 1]]))
    };
    if points.is_empty() {
        return Ok(StartShape::HangingAtRest);
    }
    let velocities_m_s = if velocities.is_empty() { [[0.0; 2]; 4] } else { four("start_velocity", velocities)? };
    Ok(StartShape::Measured { points_m: four("start_shape", points)?, velocities_m_s })
}

/// Flattens observations row by row.
#[must_use]
pub fn observations(observations: &[Observation]) -> Vec<f64> {
    observations.iter().flat_map(|o| o.0).collect()
}

/// Splits a flat list into pairs (dx, dz).
///
/// # Errors
/// [`EnvError::Input`] for an odd number of values.
pub fn actions(flat: &[f64]) -> Result<Vec<[f64; 2]>, EnvError> {
    if !flat.len().is_multiple_of(2) {
        return Err(EnvError::Input(format!("actions: expected pairs (dx, dz), got {} values", flat.len())));
    }
    Ok(flat.chunks_exact(2).map(|a| [a[0], a[1]]).collect())
}

/// Converts the transitions of one step of all environments.
#[must_use]
pub fn transitions(transitions: &[Transition]) -> StepEnvsResponse {
    StepEnvsResponse {
        success: true,
        message: String::new(),
        observations: transitions.iter().flat_map(|t| t.observation.0).collect(),
        rewards: transitions.iter().map(|t| t.reward).collect(),
        terminated: transitions.iter().map(|t| t.terminated).collect(),
        truncated: transitions.iter().map(|t| t.truncated).collect(),
        final_observations: transitions.iter().flat_map(|t| t.final_observation.0).collect(),
    }
}
