//! Conversion between ROS messages and the types of inference.

use crate::infer::InferenceResult;
use crate::sequential::{Iteration, SupportMove};
use catenary_core::simulator::{Drive, StartShape};
use catenary_core::{GripTrajectory, Posterior, SimulationRequest};
use catenary_msgs::action::{InferFeedback, InferResult};
use catenary_msgs::msg::{GripTrajectory as GripMsg, SupportMove as SupportMoveMsg};
use catenary_msgs::srv::SimulateRequest;
use catenary_shell::convert;

/// Request to a simulator pool for the model in `model_yaml`.
#[must_use]
pub fn simulate_request(request: &SimulationRequest, model_yaml: &str) -> SimulateRequest {
    let mut message = SimulateRequest {
        model_yaml: model_yaml.to_owned(),
        theta: request.thetas.concat(),
        effect_names: request.effects.iter().map(|(name, _)| name.clone()).collect(),
        effects: (0..request.thetas.len()).flat_map(|i| request.effects.iter().map(move |(_, v)| v[i])).collect(),
        frame_times: request.frame_times_s.clone(),
        target: request.target_m.unwrap_or_default(),
        target_given: request.target_m.is_some(),
        fidelity: convert::fidelity_to_msg(request.fidelity),
        seed: request.seed,
        first_episode: request.first_episode,
        noise: request.noise,
        ..SimulateRequest::default()
    };
    match &request.drive {
        Drive::Grip(path) => {
            message.drive = SimulateRequest::DRIVE_GRIP;
            message.grip = grip(path);
        }
        Drive::Actions(actions) => {
            message.drive = SimulateRequest::DRIVE_ACTIONS;
            message.actions = actions.concat();
        }
        Drive::Policy(policy) => {
            message.drive = SimulateRequest::DRIVE_POLICY;
            message.policy = policy.to_bytes();
        }
    }
    if let StartShape::Measured { points_m, velocities_m_s } = &request.start {
        message.start_shape = points_m.concat();
        message.start_velocity = velocities_m_s.concat();
    }
    message
}

/// Message of a gripper trajectory.
fn grip(path: &GripTrajectory) -> GripMsg {
    GripMsg {
        time: path.times_s().to_vec(),
        x: path.poses().iter().map(|p| p.x_m).collect(),
        z: path.poses().iter().map(|p| p.z_m).collect(),
        pitch: path.poses().iter().map(|p| p.pitch_rad).collect(),
    }
}

/// Feedback message after an iteration.
#[must_use]
pub fn feedback(iteration: &Iteration, of: usize, posterior: &Posterior) -> InferFeedback {
    InferFeedback {
        iteration: iteration.iteration as u32,
        iterations: of as u32,
        simulations: iteration.simulations as u32,
        loss: iteration.loss,
        effective_sample_size: iteration.effective_sample_size,
        posterior: convert::posterior_to_msg(posterior),
    }
}

/// Result message of an inference.
#[must_use]
pub fn result(result: &InferenceResult) -> InferResult {
    InferResult {
        success: true,
        // A misfit is no failure of the action: the posterior is sent with the reason not to use it.
        message: result.misfit.clone().unwrap_or_default(),
        posterior: convert::posterior_to_msg(&result.posterior),
        mass_outside: result.mass_outside,
        effective_sample_size: result.effective_sample_size(),
        warnings: result.warnings.clone(),
        losses: result.losses(),
        simulations: result.simulations() as u32,
        support_moves: result.support_moves().iter().map(support_move).collect(),
    }
}

/// Message of a move of the prior's support.
fn support_move(step: &SupportMove) -> SupportMoveMsg {
    SupportMoveMsg {
        iteration: step.iteration as u32,
        parameter: step.parameter.clone(),
        from_low: step.from[0],
        from_high: step.from[1],
        to_low: step.to[0],
        to_high: step.to[1],
        because: step.because.clone(),
    }
}

/// Moves of the prior's support in the result message of an inference.
#[must_use]
pub fn support_moves(result: &InferResult) -> Vec<SupportMove> {
    let step = |m: &SupportMoveMsg| SupportMove {
        iteration: m.iteration as usize,
        parameter: m.parameter.clone(),
        from: [m.from_low, m.from_high],
        to: [m.to_low, m.to_high],
        because: m.because.clone(),
    };
    result.support_moves.iter().map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_move_of_the_support_survives_its_message() {
        let step = SupportMove {
            iteration: 3,
            parameter: "length_m".into(),
            from: [0.1, 0.15],
            to: [0.1, 0.175],
            because: "a reason".into(),
        };
        let result = InferResult { support_moves: vec![support_move(&step)], ..InferResult::default() };
        assert_eq!(support_moves(&result), [step]);
    }
}
