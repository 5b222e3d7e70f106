//! Check of each state before it is used: its counter and its numbers.

use franka::{FrankaError, FrankaResult, RobotState};
use std::time::{Duration, Instant};

/// Step of the counter that a state may always take, ms. A Panda aborts a motion after 20 lost states, and this process may pause.
const STEP_MS: u64 = 100;
/// Greatest pause of this process that later steps may make up for. The queue of the socket keeps the oldest states of a pause.
const PAUSE: Duration = Duration::from_secs(600);

/// Counter of a connection's states. franka-rs drops states with a lower one; here one that leaps is found, after which the library would
/// ignore the robot's own states.
#[derive(Debug)]
pub struct StateCheck {
    last: Option<(u64, Instant)>,
    /// Time that passed by this machine's clock without steps of the counter.
    pause: Duration,
}

impl StateCheck {
    /// Creates the check of a new connection.
    pub fn new() -> Self {
        Self { last: None, pause: Duration::ZERO }
    }

    /// Checks a state that came at this time.
    ///
    /// # Errors
    /// [`FrankaError::Network`] if the counter leaps, or a number is not finite: the connection can no longer be trusted.
    pub fn check(&mut self, state: &RobotState, at: Instant) -> FrankaResult<()> {
        let counter = state.time.as_millis();
        if let Some((last, since)) = self.last {
            let step = counter.saturating_sub(last);
            let pause = (self.pause + at.saturating_duration_since(since)).min(PAUSE);
            if step > STEP_MS && Duration::from_millis(step - STEP_MS) > pause {
                return Err(untrusted(&format!(
                    "the counter of the states leaps by {step} ms within {} ms",
                    pause.as_millis()
                )));
            }
            self.pause = pause.saturating_sub(Duration::from_millis(step));
        }
        self.last = Some((counter, at));
        match not_finite(state) {
            Some(name) => Err(untrusted(&format!("{name} of a state is not finite"))),
            None => Ok(()),
        }
    }
}

fn untrusted(why: &str) -> FrankaError {
    FrankaError::Network(format!("{why}: the connection ends, because it may carry states of another program"))
}

/// Returns the name of a field with a number that is not finite, among those that the law, the gate and the topics use.
fn not_finite(state: &RobotState) -> Option<&'static str> {
    let fields: [(&'static str, &[f64]); 10] = [
        ("q", &state.q),
        ("dq", &state.dq),
        ("tau_J", &state.tau_J),
        ("tau_J_d", &state.tau_J_d),
        ("O_T_EE", &state.O_T_EE),
        ("F_T_EE", &state.F_T_EE),
        ("F_T_NE", &state.F_T_NE),
        ("O_F_ext_hat_K", &state.O_F_ext_hat_K),
        ("F_x_Ctotal", &state.F_x_Ctotal),
        ("I_total", &state.I_total),
    ];
    let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
    let scalars = [("m_total", state.m_total), ("control_command_success_rate", state.control_command_success_rate)];
    fields
        .iter()
        .find(|(_, values)| !finite(values))
        .map(|(name, _)| *name)
        .or_else(|| scalars.iter().find(|(_, value)| !value.is_finite()).map(|(name, _)| *name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(ms: u64) -> RobotState {
        RobotState { time: franka::Duration::from_millis(ms), ..RobotState::default() }
    }

    #[test]
    fn a_counter_that_leaps_is_refused_and_one_after_a_pause_is_not() {
        let start = Instant::now();
        let after = |ms: u64| start + Duration::from_millis(ms);
        let mut check = StateCheck::new();
        // The first state may have any number. An emulated arm in lock step counts faster than the clock.
        for number in 0..1000 {
            check.check(&state(5_000_000 + number), start).unwrap();
        }
        let mut lost = StateCheck::new();
        lost.check(&state(10), start).unwrap();
        lost.check(&state(10 + STEP_MS), after(1)).unwrap();
        let error = lost.check(&state(10 + STEP_MS + 500), after(2)).unwrap_err().to_string();
        assert!(error.contains("leaps by 500 ms"), "{error}");
        // A process that was stopped for 10 s finds old states in the queue, and then new ones.
        let mut stopped = StateCheck::new();
        stopped.check(&state(10), start).unwrap();
        stopped.check(&state(60), after(10_000)).unwrap();
        stopped.check(&state(10_010), after(10_001)).unwrap();
        assert!(stopped.check(&state(21_000), after(10_002)).is_err(), "the pause counts once");
    }

    #[test]
    fn a_field_without_a_number_is_named() {
        let mut wrong = state(1);
        assert_eq!(not_finite(&wrong), None);
        wrong.control_command_success_rate = f64::NAN;
        assert_eq!(not_finite(&wrong), Some("control_command_success_rate"));
        wrong.dq[6] = f64::INFINITY;
        let error = StateCheck::new().check(&wrong, Instant::now()).unwrap_err().to_string();
        assert!(error.contains("dq of a state is not finite"), "{error}");
    }
}
