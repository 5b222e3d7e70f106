//! The demo's answer in words: what was hidden, what was found, and what it was good for.

use super::summary::{Episode, Summary};
use crate::evaluate::Evaluated;
use crate::figures::figures;
use crate::misfit::Misfit;
use catenary_core::Goal;
use catenary_core::posterior::Marginal;
use catenary_core::track::End;

/// Explanation of one seed giving slightly different figures.
pub const REPEATS: &str = "The same seed hides the same object and trains the same pi0, to the bit. The recording differs from run \
    to run, since camera, arm and policy are separate processes that keep real time; posterior, pi1 and their figures differ with it.";

/// Label and value of a parameter with the unit in words: `length_m`, 0.262 gives `length` and `262 mm`.
pub fn quantity(name: &str, value: f64) -> (String, String) {
    let (stem, value) = if let Some(stem) = name.strip_suffix("_m") {
        (stem, format!("{:.0} mm", 1e3 * value))
    } else if let Some(stem) = name.strip_suffix("_pa") {
        (stem, format!("{:.1} kPa", 1e-3 * value))
    } else {
        (name, figures(value))
    };
    (stem.replace('_', " ").replace("youngs", "Young's"), value)
}

/// Success of an episode on the cell.
pub fn succeeded(episode: &Episode) -> bool {
    episode.end == End::Success.name()
}

impl Summary {
    /// What was hidden and what was found, a line for each parameter.
    pub fn findings(&self) -> Vec<String> {
        let line = |(m, truth): (&Marginal, &f64)| {
            let (label, hidden) = quantity(&m.name, *truth);
            let [median, low, high] = [m.median, m.q05, m.q95].map(|v| quantity(&m.name, v).1);
            format!("{label}: {hidden} hidden, {median} found (90 % between {low} and {high})")
        };
        self.inference.marginals.iter().zip(&self.truth).map(line).collect()
    }

    /// The whole answer: what was hidden, what was found, and how often each policy reached the goal.
    pub fn headline(&self) -> String {
        let values = |value: &dyn Fn(usize) -> f64, labelled: bool| -> String {
            let word = |(i, m): (usize, &Marginal)| {
                let (label, value) = quantity(&m.name, value(i));
                if labelled { format!("{label} {value}") } else { value }
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
            match after.success_gained {
                Some(d) if d.high < 0.0 => text += " pi1 is worse.",
                Some(d) if d.low <= 0.0 => text += " The difference may be chance.",
                _ => {}
            }
        }
        text
    }

    /// Aim of the task and threshold of success.
    pub fn aim(&self) -> String {
        let mm = 1e3 * self.success_distance_m;
        let seconds = self.task.steps as f64 * self.task.step_period_s;
        match self.task.goal {
            Goal::PlaceTip { .. } => format!(
                "Success: when the motion of {seconds} s ends, the free end of the bar (its outermost keypoint) is within {mm:.0} mm \
                 of the target, as the camera sees both. The position of the hand does not count."
            ),
            Goal::Reach => format!(
                "Success: at one of {} steps the bar's four keypoints are near the target, {mm:.0} mm in the root mean square. \
                 The position of the hand does not count.",
                self.task.steps
            ),
        }
    }

    /// What came of a policy's episode on the cell.
    pub fn outcome(&self, episode: &Episode) -> String {
        let mm = 1e3 * episode.distance_m;
        let what = match self.task.goal {
            Goal::PlaceTip { .. } => "tip",
            Goal::Reach => "keypoints",
        };
        match succeeded(episode) {
            true => format!("reached: {what} {mm:.0} mm from the target"),
            false if episode.end == End::LeftWorkspace.name() => "missed: the hand left its workspace".to_owned(),
            false => format!("missed: {what} {mm:.0} mm from the target"),
        }
    }

    /// The summary in a few lines.
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
        if let Some((s, r)) =
            self.evaluation.policies.last().and_then(|e| Some((e.success_gained?, e.mean_return_gained?)))
        {
            lines.push(format!(
                "pi1 minus pi0 in the same episodes: success {} points, return {}",
                s.words(100.0, 0),
                r.words(1.0, 2)
            ));
        }
        let wall: f64 = self.stages.iter().map(|s| s.wall_s).sum();
        lines.push(format!("Brackets are intervals of 95 %. {wall:.0} s in all."));
        lines.join("\n")
    }
}

/// What a policy was trained on.
pub fn training_words(policy: &str) -> &'static str {
    if policy == "pi0" { "trained without knowing the object" } else { "trained on what was found" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_those_of_people() {
        assert_eq!(quantity("length_m", 0.2624), ("length".into(), "262 mm".into()));
        assert_eq!(quantity("youngs_modulus_pa", 13_240.0), ("Young's modulus".into(), "13.2 kPa".into()));
        assert_eq!(quantity("poisson_ratio", 0.45), ("poisson ratio".into(), "0.4500".into()));
    }
}
