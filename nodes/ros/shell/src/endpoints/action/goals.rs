//! Goals of an action server, with their states and the clients that wait for their results. Pure.

use std::collections::BTreeMap;

/// Identifier of a goal, chosen by the client.
pub(super) type Id = [u8; 16];

/// Number of ended goals whose results are kept for late requests. Chosen; rclcpp keeps results for 10 s by default instead.
const KEPT_RESULTS: usize = 16;

/// States of a goal, with the codes of `action_msgs/GoalStatus`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    Executing,
    Canceling,
    Succeeded,
    Canceled,
    Aborted,
}

impl State {
    pub(super) fn is_over(self) -> bool {
        matches!(self, Self::Succeeded | Self::Canceled | Self::Aborted)
    }
}

/// Answers to a cancel request, with the codes of `action_msgs/CancelGoal`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CancelCode {
    Accepted,
    Rejected,
    UnknownGoal,
    GoalTerminated,
}

/// Goal. `R` is its result, `W` a client that waits for the result.
pub(super) struct Goal<R, W> {
    pub(super) state: State,
    /// Time of acceptance, nanoseconds of the node's clock.
    pub(super) accepted: i64,
    order: u64,
    result: Option<R>,
    waiting: Vec<W>,
    answered: bool,
}

/// Answer to a result request.
#[derive(Debug, PartialEq)]
pub(super) enum ResultAnswer<R> {
    /// Answer later, when the goal ends.
    Wait,
    /// Answer now.
    Now(State, R),
    /// Unknown goal.
    Unknown,
}

pub(super) struct Goals<R, W> {
    goals: BTreeMap<Id, Goal<R, W>>,
    accepted: u64,
}

impl<R: Clone, W> Goals<R, W> {
    pub(super) fn new() -> Self {
        Self { goals: BTreeMap::new(), accepted: 0 }
    }

    pub(super) fn contains(&self, id: &Id) -> bool {
        self.goals.contains_key(id)
    }

    pub(super) fn running(&self) -> usize {
        self.goals.values().filter(|goal| !goal.state.is_over()).count()
    }

    /// Returns true if no client has requested the result of some ended goal.
    pub(super) fn unanswered(&self) -> bool {
        self.goals.values().any(|goal| goal.state.is_over() && !goal.answered)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (&Id, &Goal<R, W>)> {
        self.goals.iter()
    }

    /// Adds a new goal as executing.
    pub(super) fn start(&mut self, id: Id, accepted: i64) {
        self.accepted += 1;
        let goal = Goal {
            state: State::Executing,
            accepted,
            order: self.accepted,
            result: None,
            waiting: Vec::new(),
            answered: false,
        };
        self.goals.insert(id, goal);
    }

    /// Cancels the goals that a request selects (`action_msgs/srv/CancelGoal`): all goals if `id` and `stamp` are zero; goals
    /// accepted up to `stamp` if only `id` is zero; the goal `id` if only `stamp` is zero; otherwise both.
    pub(super) fn cancel(&mut self, id: &Id, stamp: i64) -> (CancelCode, Vec<Id>) {
        let by_id = *id != [0; 16];
        let selects = |candidate: &Id, accepted: i64| match (by_id, stamp != 0) {
            (false, false) => true,
            (false, true) => accepted <= stamp,
            (true, false) => candidate == id,
            (true, true) => candidate == id || accepted <= stamp,
        };
        let mut cancelled = Vec::new();
        for (candidate, goal) in &mut self.goals {
            if !goal.state.is_over() && selects(candidate, goal.accepted) {
                goal.state = State::Canceling;
                cancelled.push(*candidate);
            }
        }
        let code = match self.goals.get(id) {
            _ if !cancelled.is_empty() => CancelCode::Accepted,
            None if by_id => CancelCode::UnknownGoal,
            Some(goal) if goal.state.is_over() => CancelCode::GoalTerminated,
            _ => CancelCode::Rejected,
        };
        (code, cancelled)
    }

    /// Ends a goal, and returns its state and the waiting clients. A goal is cancelled only if a client requested it.
    pub(super) fn finish(&mut self, id: &Id, state: State, result: R) -> Option<(State, Vec<W>)> {
        let goal = self.goals.get_mut(id).filter(|goal| !goal.state.is_over())?;
        goal.state = match (state, goal.state) {
            // A handler also stops at shutdown; the clients must not take that for their own request.
            (State::Canceled, State::Executing) => State::Aborted,
            _ => state,
        };
        goal.result = Some(result);
        goal.answered = !goal.waiting.is_empty();
        let answer = (goal.state, std::mem::take(&mut goal.waiting));
        self.forget_old();
        Some(answer)
    }

    /// Records the result request of a client.
    pub(super) fn ask(&mut self, id: &Id, client: W) -> ResultAnswer<R> {
        match self.goals.get_mut(id) {
            None => ResultAnswer::Unknown,
            Some(Goal { state, result: Some(result), answered, .. }) => {
                *answered = true;
                ResultAnswer::Now(*state, result.clone())
            }
            Some(goal) => {
                goal.waiting.push(client);
                ResultAnswer::Wait
            }
        }
    }

    fn forget_old(&mut self) {
        let mut ended: Vec<_> =
            self.goals.iter().filter(|(_, goal)| goal.state.is_over()).map(|(id, goal)| (goal.order, *id)).collect();
        // By order of acceptance. Running goals are never dropped.
        ended.sort_unstable();
        for (_, id) in ended.iter().take(ended.len().saturating_sub(KEPT_RESULTS)) {
            self.goals.remove(id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Id = [1; 16];
    const B: Id = [2; 16];
    const NONE: Id = [0; 16];

    fn two() -> Goals<&'static str, u32> {
        let mut goals = Goals::new();
        goals.start(A, 100);
        goals.start(B, 200);
        goals
    }

    #[test]
    fn a_result_reaches_waiting_clients_and_late_ones() {
        let mut goals = two();
        assert_eq!(goals.ask(&A, 7), ResultAnswer::Wait);
        assert_eq!(goals.finish(&A, State::Succeeded, "done"), Some((State::Succeeded, vec![7])));
        assert_eq!(goals.ask(&A, 8), ResultAnswer::Now(State::Succeeded, "done"));
        assert!(!goals.unanswered());
        assert_eq!(goals.ask(&[9; 16], 8), ResultAnswer::Unknown);
        assert_eq!(goals.finish(&A, State::Aborted, "again"), None);
        assert_eq!(goals.running(), 1);
        goals.finish(&B, State::Succeeded, "done");
        assert!(goals.unanswered());
        goals.ask(&B, 9);
        assert!(!goals.unanswered());
    }

    #[test]
    fn a_cancel_request_selects_by_id_stamp_or_both() {
        assert_eq!(two().cancel(&NONE, 0), (CancelCode::Accepted, vec![A, B]));
        assert_eq!(two().cancel(&NONE, 150), (CancelCode::Accepted, vec![A]));
        assert_eq!(two().cancel(&B, 0), (CancelCode::Accepted, vec![B]));
        assert_eq!(two().cancel(&B, 150), (CancelCode::Accepted, vec![A, B]));
        assert_eq!(two().cancel(&[9; 16], 0), (CancelCode::UnknownGoal, vec![]));
        assert_eq!(two().cancel(&NONE, 50), (CancelCode::Rejected, vec![]));
        let mut goals = two();
        goals.finish(&A, State::Succeeded, "done");
        assert_eq!(goals.cancel(&A, 0), (CancelCode::GoalTerminated, vec![]));
    }

    #[test]
    fn a_goal_is_cancelled_only_on_request_of_a_client() {
        let mut goals = two();
        goals.cancel(&A, 0);
        assert_eq!(goals.finish(&A, State::Canceled, "").map(|(state, _)| state), Some(State::Canceled));
        assert_eq!(goals.finish(&B, State::Canceled, "").map(|(state, _)| state), Some(State::Aborted));
    }

    #[test]
    fn old_results_are_forgotten_and_running_goals_are_not() {
        let mut goals: Goals<u8, u32> = Goals::new();
        goals.start(A, 1);
        for index in 10..60 {
            goals.start([index; 16], 2);
            goals.finish(&[index; 16], State::Succeeded, index);
        }
        assert_eq!(goals.iter().count(), KEPT_RESULTS + 1);
        // 44 to 59 are the last 16.
        assert!(goals.contains(&A) && goals.contains(&[59; 16]) && !goals.contains(&[43; 16]));
    }
}
