//! Continuation of an inference from the state of a process that was killed.

use super::proposal::Drawn;
use super::state::State;
use super::{Sequential, covered, support};
use crate::error::StateError;
use crate::network::{Samples, Shape};
use crate::prior_support::PriorSupport;

impl Sequential<'_> {
    /// Continues from `state`, as if its iterations had been made here.
    ///
    /// # Errors
    /// [`StateError`] if the state belongs to another inference or its parts do not fit together.
    pub fn resume(&mut self, state: State) -> Result<(), StateError> {
        if !state.belongs_to(self.state.fingerprint) {
            return Err(StateError::Other);
        }
        let broken = |what, expected: String, got: String| Err(StateError::Broken { what, expected, got });
        let sizes =
            |s: &Samples| format!("{} frames, {} plain numbers, {} parameters", s.frames(), s.plain(), s.dimension());
        if !state.samples.is_whole() || sizes(&state.samples) != sizes(&self.state.samples) {
            let got = format!("{}, {} tracks", sizes(&state.samples), state.samples.len());
            return broken("samples", format!("whole tracks of {}", sizes(&self.state.samples)), got);
        }
        let made = state.iterations.len();
        if state.posteriors.len() != made || made > self.settings.iterations {
            let expected = format!("one for each of at most {} iterations", self.settings.iterations);
            return broken("posteriors", expected, format!("{} of {made} iterations", state.posteriors.len()));
        }
        if state.simulations != made * self.settings.simulations || state.samples.len() > state.simulations {
            let got = format!("{} with {} usable ones", state.simulations, state.samples.len());
            return broken("simulations", (made * self.settings.simulations).to_string(), got);
        }
        let moving = if self.settings.prior_support == PriorSupport::Fixed { 0 } else { made };
        if state.supports.len() != moving || !state.supports.iter().all(|s| s.equals_up_to_bounds(self.space)) {
            let expected = format!("{moving} with the parameters of the model");
            return broken("supports", expected, format!("{} for {made} iterations", state.supports.len()));
        }
        let before = std::mem::replace(&mut self.state, state);
        let checked = self.replay(made);
        if checked.is_err() {
            self.state = before;
            self.proposals.clear();
        }
        checked
    }

    /// Makes the proposals of the `made` iterations of the state again, and checks the networks. Proposals are not saved: the
    /// posteriors and the seed reproduce them.
    fn replay(&mut self, made: usize) -> Result<(), StateError> {
        let broken = |what, expected: String, got: String| Err(StateError::Broken { what, expected, got });
        for number in 1..=made {
            let posteriors = &self.state.posteriors[..number - 1];
            match self.next_proposal(number, &self.proposals, posteriors) {
                Ok(proposal) => self.proposals.push(Drawn::new(proposal, self.settings.simulations)),
                Err(why) => return broken("posteriors", "some to draw from".into(), why.to_string()),
            }
            if let Some(map) = support::map(self.space_of(number), self.space_of(number + 1)) {
                self.proposals.iter_mut().for_each(|p| p.follow(&map));
            }
        }
        let (samples, ensemble) = (&self.state.samples, &self.state.ensemble);
        let networks = ensemble.networks().len();
        let expected = self.settings.ensemble * usize::from(made > 0);
        let fit = self.proposals.last().is_none_or(|newest| {
            let indices = covered(samples, newest);
            !indices.is_empty() && ensemble.fits(&Shape::of_samples(&samples.gather(&indices), self.settings))
        });
        if networks != expected || !fit {
            let got = format!("{networks}{}", if fit { "" } else { " of others" });
            return broken("ensemble", format!("{expected} whole networks of this inference's sizes"), got);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{TOY, TRUTH, quick, seen};
    use super::*;
    use crate::sequential::Progress;
    use crate::settings::{ProposalKind, Settings};
    use catenary_core::Posterior;
    use std::ops::ControlFlow;

    /// Runs all iterations from the beginning or from a state. Returns the state after each one and the last posterior.
    fn states(settings: &Settings, from: Option<State>) -> (Vec<State>, Option<Posterior>) {
        let (space, observed) = (TOY.space(), TOY.track(&TRUTH, 5));
        let mut sequential = Sequential::new(&space, seen(&observed, 6), settings, 7).unwrap();
        if let Some(state) = from {
            sequential.resume(state).unwrap();
        }
        let (mut states, mut last) = (Vec::new(), None);
        while sequential.state().iterations().len() < settings.iterations {
            let mut listen = |progress: &Progress<'_>| {
                if let Progress::Iteration { state, .. } = progress {
                    states.push((*state).clone());
                }
                ControlFlow::Continue(())
            };
            last = Some(sequential.step(&TOY, &mut listen).unwrap().1);
        }
        (states, last)
    }

    #[test]
    fn an_inference_that_continues_from_a_file_ends_with_the_same_bits() {
        for proposal in [Settings::default().proposal, ProposalKind::Posterior { prior_share: 0.2 }] {
            let settings = Settings { iterations: 4, proposal, ..quick() };
            let (whole, last) = states(&settings, None);
            assert_eq!(whole.len(), 4);
            for made in [1, 3] {
                let text = serde_json::to_string(&whole[made - 1]).unwrap();
                let read: State = serde_json::from_str(&text).unwrap();
                assert_eq!(read, whole[made - 1], "a number was lost in the text");
                let (rest, resumed) = states(&settings, Some(read));
                assert_eq!((rest.as_slice(), &resumed), (&whole[made..], &last), "from iteration {made}");
            }
        }
    }

    #[test]
    fn a_state_that_does_not_fit_is_refused_with_the_part_at_fault() {
        let settings = Settings { iterations: 2, ..quick() };
        let good = states(&settings, None).0.remove(1);
        let refusal = |change: &dyn Fn(&mut serde_json::Value)| {
            let mut value = serde_json::to_value(&good).unwrap();
            change(&mut value);
            let state: State = serde_json::from_value(value).unwrap();
            let (space, observed) = (TOY.space(), TOY.track(&TRUTH, 5));
            Sequential::new(&space, seen(&observed, 6), &settings, 7).unwrap().resume(state).unwrap_err().to_string()
        };
        assert!(refusal(&|v| v["question"] = 8.into()).contains("another model"));
        assert!(refusal(&|v| v["version"] = 0.into()).contains("another model"));
        let short = |v: &mut serde_json::Value| drop(v["samples"]["points"].as_array_mut().unwrap().pop());
        assert!(refusal(&short).starts_with("samples: expected whole tracks of 6 frames"));
        assert!(refusal(&|v| v["samples"]["frames"] = 5.into()).contains("got 5 frames"));
        let fewer = |v: &mut serde_json::Value| drop(v["posteriors"].as_array_mut().unwrap().pop());
        assert!(refusal(&fewer).ends_with("got 1 of 2 iterations"));
        let one = |v: &mut serde_json::Value| drop(v["ensemble"]["networks"].as_array_mut().unwrap().pop());
        assert!(refusal(&one).ends_with("whole networks of this inference's sizes, got 1"), "{}", refusal(&one));
        // Complete networks with other settings.
        let narrow = states(&Settings { hidden: vec![9], ..settings.clone() }, None).0.remove(1);
        let narrow = serde_json::to_value(narrow).unwrap();
        let words = refusal(&|v| v["ensemble"] = narrow["ensemble"].clone());
        assert!(words.starts_with("ensemble: expected 2 whole networks") && words.ends_with("2 of others"), "{words}");
        assert_eq!(refusal(&|v| v["simulations"] = 79.into()), "simulations: expected 80, got 79 with 80 usable ones");
    }
}
