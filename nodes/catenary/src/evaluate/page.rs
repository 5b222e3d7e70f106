//! Page of an evaluation.

use super::score::Evaluated;
use crate::report::palette::Role;
use crate::report::plots::search::{Interval, intervals};
use crate::report::{Estimate, Page};

/// Page with the scores of policies. `sentences` are the answer in words.
pub fn page(sentences: &[String], policies: &[&Evaluated]) -> Page {
    let mut page = Page::new("How do the policies fare?");
    page.answer(sentences, false);
    page.note("All policies ran the same episodes. Intervals of 95 % over the episodes: they say nothing about another training of a policy.");
    let mut picture = |title: &str, unit: &str, scale: f64, of: fn(&Evaluated) -> Option<&Estimate>| {
        let row = |e: &Evaluated| {
            let estimate = of(e)?;
            let values = [estimate.low, estimate.value, estimate.high].map(|v| scale * v);
            Some(Interval { name: e.policy.display().to_string(), values, role: Role::Posterior })
        };
        let rows: Vec<Interval> = policies.iter().copied().filter_map(row).collect();
        if !rows.is_empty() {
            page.svg(&intervals(title, unit, &rows));
        }
    };
    picture("Mean return", "reward", 1.0, |e| Some(&e.mean_return));
    picture("Success", "%", 100.0, |e| Some(&e.success_rate));
    picture("Return minus that of the first policy", "reward", 1.0, |e| e.mean_return_gained.as_ref());
    picture("Success minus that of the first policy", "%", 100.0, |e| e.success_gained.as_ref());
    page
}
