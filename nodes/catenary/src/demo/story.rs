//! Sentences of the demo's answer: hidden values, inferred values, and success of each policy.

use super::summary::{Episode, Summary};
use crate::evaluate::score::Evaluated;
use crate::exit::Misfit;
use crate::graph::own::Cell;
use crate::report::aim;
use crate::report::quantity::Quantity;
use catenary_core::posterior::Marginal;
use catenary_core::track::End;

/// Explanation for the report: whether a run with the same seed gives the same figures.
pub fn repeats(cell: Cell) -> &'static str {
    if cell.is_in_lock_step() {
        "The same seed gives the same figures on this machine, to the bit and whatever its load: the simulated cell waits for camera, tracker \
         and policy. Processors and mathematical libraries may differ in the last place."
    } else {
        "The same seed hides the same object and trains the same pi0, to the bit. The recording differs from run to run, since camera, arm \
         and policy are separate processes that keep real time; posterior, pi1 and their figures differ with it."
    }
}

/// True if an episode on the cell ended with success.
pub fn succeeded(episode: &Episode) -> bool {
    episode.end == End::Success.name()
}

impl Summary {
    /// Hidden and inferred values, one line per parameter.
    pub fn findings(&self) -> Vec<String> {
        let line = |(m, truth): (&Marginal, &f64)| {
            let quantity = Quantity::of(&m.name);
            let [hidden, median, low, high] = [*truth, m.median, m.q05, m.q95].map(|v| quantity.brief(v));
            format!("{}: {hidden} hidden, {median} found (90 % between {low} and {high})", quantity.title)
        };
        self.inference.marginals.iter().zip(&self.truth).map(line).collect()
    }

    /// Answer in a few sentences: hidden values, inferred values, and the success rate of each policy.
    pub fn headline(&self) -> String {
        let values = |value: &dyn Fn(usize) -> f64, labelled: bool| -> String {
            let word = |(i, m): (usize, &Marginal)| {
                let quantity = Quantity::of(&m.name);
                let value = quantity.brief(value(i));
                if labelled { format!("{} {value}", quantity.title) } else { value }
            };
            self.inference.marginals.iter().enumerate().map(word).collect::<Vec<_>>().join(", ")
        };
        let rate = |scored: &Evaluated| {
            let hits = scored.successes.iter().filter(|s| **s).count();
            format!("{hits} of {}", scored.successes.len())
        };
        let mut text = format!(
            "Hidden: {}. Found from one recording: {}.",
            values(&|i| self.truth[i], true),
            values(&|i| self.inference.marginals[i].median, false)
        );
        if let [before, after] = &self.evaluation.policies[..] {
            text += &format!(
                " Goal reached in {} episodes without knowing the object (pi0), in {} with what was found (pi1).",
                rate(before),
                rate(after)
            );
            if let Some(plan) = &self.evaluation.best_plan {
                text += &format!(" The best plan found for the hidden bar reaches it in {}.", rate(plan));
            }
            // The interval of the paired difference decides: a claim of improvement needs it to exclude zero.
            match after.success_gained {
                Some(d) if d.high < 0.0 => text += " pi1 is worse.",
                Some(d) if d.low <= 0.0 => text += " The difference may be chance.",
                _ => {}
            }
        }
        text
    }

    /// Aim of the task and threshold of success, in a sentence.
    pub fn aim(&self) -> String {
        aim::of(&self.task, self.success_distance_m)
    }

    /// Comparison of the emulated arm with the law that training knows; `None` on the simulated cell.
    pub fn of_the_arm(&self) -> Option<String> {
        if self.cell != Cell::Emulated {
            return None;
        }
        let (episode, scored) = (self.episodes.last()?, self.evaluation.policies.last()?);
        let held = self.inference.marginals.iter().zip(&self.truth);
        let inside = held.filter(|(m, truth)| (m.q05..=m.q95).contains(*truth)).count();
        Some(format!(
            "The cell was an emulated Panda, which the bridge drove by torques at 1 kHz over the interface of a real arm; training knows \
             the bridge's impedance law. Reward: {} earned {:.2} and ended {:.0} mm from the target on the emulated arm, against \
             {:.2} and {:.0} mm (median) in {} simulated episodes with that law. Posterior: {inside} of {} hidden values lie in \
             their 90 % intervals, because inference follows the measured path of the hand. `catenary demo --cell sim --seed {}` runs \
             the same on an arm with a lag and a speed limit.",
            episode.policy,
            episode.episode_return,
            1e3 * episode.distance_m,
            scored.mean_return.value,
            1e3 * scored.median_distance_m(),
            self.evaluation.episodes,
            self.truth.len(),
            self.seed
        ))
    }

    /// Result of a policy's episode on the cell, in words.
    pub fn outcome(&self, episode: &Episode) -> String {
        let mm = 1e3 * episode.distance_m;
        let what = aim::part(&self.task.goal);
        match succeeded(episode) {
            true => format!("reached: {what} {mm:.0} mm from the target"),
            false if episode.end == End::LeftWorkspace.name() => "missed: the hand left its workspace".to_owned(),
            false => format!("missed: {what} {mm:.0} mm from the target"),
        }
    }

    /// Summary for the terminal.
    pub fn words(&self) -> String {
        let mut lines: Vec<String> = self.inference.misfit.iter().map(|reason| Misfit::headline(reason)).collect();
        lines.push(self.headline());
        lines.extend(self.findings());
        lines.push(self.aim());
        for (episode, scored) in self.episodes.iter().zip(&self.evaluation.policies) {
            lines.push(format!(
                "{}, {}: on the cell {}; in {} simulated episodes success {} %, return {}, median distance {:.0} mm",
                episode.policy,
                training_words(&episode.policy),
                self.outcome(episode),
                self.evaluation.episodes,
                scored.success_rate.words(100.0, 0),
                scored.mean_return.words(1.0, 2),
                1e3 * scored.median_distance_m()
            ));
        }
        if let Some(plan) = &self.evaluation.best_plan {
            lines.push(format!(
                "best plan found for the hidden object, which sees the target once and nothing else: success {} %, median distance {:.0} mm",
                plan.success_rate.words(100.0, 0),
                1e3 * plan.median_distance_m()
            ));
        }
        if let Some((s, r)) =
            self.evaluation.policies.last().and_then(|e| Some((e.success_gained?, e.mean_return_gained?)))
        {
            lines.push(format!(
                "pi1 minus pi0 in the same episodes: success {} points, return {}",
                s.words(100.0, 0),
                r.words(1.0, 2)
            ));
        }
        lines.extend(self.of_the_arm());
        let wall: f64 = self.stages.iter().map(|s| s.wall_s).sum();
        lines.push(format!("Brackets are intervals of 95 %. {wall:.0} s in all."));
        lines.join("\n")
    }
}

/// Training distribution of a policy, in words.
pub fn training_words(policy: &str) -> &'static str {
    if policy == "pi0" { "trained without knowing the object" } else { "trained on what was found" }
}
