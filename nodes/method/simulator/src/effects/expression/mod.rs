//! Effects that a model file states as expressions.

mod formula;
#[cfg(test)]
mod tests;

use super::effect::{About, Effect, Hook};
use crate::beam::{BendState, ForceTerm, MomentTerm, PointState};
use crate::episode_model::EpisodeModel;
use catenary_core::model::Expression;
use formula::Formula;
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use thiserror::Error;

/// Variables of forces and couples, in the order of [`Force::state`].
const FORCE_VARIABLES: [&str; 8] = ["s", "t", "x", "z", "vx", "vz", "speed", "angle"];
/// Variables of moments.
const MOMENT_VARIABLES: [&str; 4] = ["s", "t", "curvature", "curvature_rate"];
/// Greatest size of a magnitude, in multiples of the prior's. A search looks beyond the prior.
const ROOM: f64 = 10.0;
/// Distance in m over which a force is differentiated by the position. It is small against the bends of an object.
const STEP_M: f64 = 1e-6;

/// Expression of a model file that makes no effect.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ExpressionError {
    /// Text that is no formula.
    #[error("`{text}`: {what}")]
    Text {
        /// Path of the field in the model file.
        field: String,
        /// Text.
        text: String,
        /// Character and expectation.
        what: String,
    },
    /// Name that something else has.
    #[error("expected a name that is free, got that of {what}")]
    Taken {
        /// Path of the field in the model file.
        field: String,
        /// Owner of the name.
        what: String,
    },
}

impl ExpressionError {
    /// Returns the path of the field in the model file.
    pub fn field(&self) -> &str {
        match self {
            ExpressionError::Text { field, .. } | ExpressionError::Taken { field, .. } => field,
        }
    }
}

/// Makes the effects of a model's expressions, each after its companions. `is_effect` tells whether an effect has a name already.
pub(super) fn all(
    expressions: &[Expression],
    is_effect: impl Fn(&str) -> bool,
) -> Result<Vec<Arc<dyn Effect>>, ExpressionError> {
    let mut effects: Vec<Arc<dyn Effect>> = Vec::new();
    for expression in expressions {
        for name in names(expression) {
            let is_variable = FORCE_VARIABLES.iter().chain(&MOMENT_VARIABLES).any(|v| *v == name);
            let what = match (is_variable, is_effect(name)) {
                (true, _) => format!("the variable `{name}` of expressions"),
                (_, true) => format!("the effect `{name}`"),
                _ => continue,
            };
            return Err(taken(expression, what));
        }
        for companion in &expression.companions {
            effects.push(Arc::new(Number::new(companion)));
        }
        effects.push(Arc::new(Stated::read(expression)?));
    }
    Ok(effects)
}

/// Fails if an expression has the name of a physical parameter.
pub(crate) fn check_names(
    expressions: &[Expression],
    is_parameter: impl Fn(&str) -> bool,
) -> Result<(), ExpressionError> {
    let mut all = expressions.iter().flat_map(|e| names(e).map(move |name| (e, name)));
    match all.find(|(_, name)| is_parameter(name)) {
        Some((expression, name)) => Err(taken(expression, format!("the parameter `{name}`"))),
        None => Ok(()),
    }
}

/// Names of an expression and its companions.
fn names(expression: &Expression) -> impl Iterator<Item = &str> {
    std::iter::once(expression.name.as_str()).chain(expression.companions.iter().map(|c| c.name.as_str()))
}

fn taken(expression: &Expression, what: String) -> ExpressionError {
    ExpressionError::Taken { field: format!("expressions.{}", expression.name), what }
}

/// Returns the text for as long as the program runs. Equal texts are kept once, so that a program that reads its models again and
/// again does not grow.
fn kept(text: &str) -> &'static str {
    static KEPT: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = all.get(text) {
        return known;
    }
    let leaked: &'static str = Box::leak(text.to_owned().into_boxed_str());
    all.insert(leaked);
    leaked
}

/// Number that expressions name.
struct Number {
    about: About,
    median: f64,
}

impl Number {
    fn new(companion: &catenary_core::model::ExpressionCompanion) -> Self {
        let (low, high) = companion.prior.bounds();
        let about = About {
            name: kept(&companion.name),
            title: kept(&companion.name),
            description: "number that an expression of the model file names; nothing alone",
            unit: kept(&companion.unit),
            hook: Hook::Force,
            prior: companion.prior.clone(),
            range: [low, high],
        };
        Self { about, median: companion.prior.from_unit(0.5) }
    }
}

impl Effect for Number {
    fn about(&self) -> About {
        self.about.clone()
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        episode.expression_numbers.insert(self.about.name, magnitude);
        Ok(())
    }

    fn if_absent(&self) -> f64 {
        self.median
    }
}

/// Effect that a model file states.
struct Stated {
    about: About,
    /// Names of the companions, with the values where nothing gives others.
    companions: Vec<&'static str>,
    medians: Vec<f64>,
    /// Forces along x and z, and the couple, per length.
    forces: [Option<Arc<Formula>>; 3],
    moment: Option<Arc<Formula>>,
}

impl Stated {
    fn read(stated: &Expression) -> Result<Self, ExpressionError> {
        let companions: Vec<&str> = stated.companions.iter().map(|c| c.name.as_str()).collect();
        let read = |field: &'static str, text: &Option<String>, variables: &[&str]| {
            let names: Vec<&str> = variables.iter().chain(&companions).copied().collect();
            let formula = text.as_ref().map(|text| {
                Formula::read(text, &names).map_err(|what| ExpressionError::Text {
                    field: format!("expressions.{}.{field}", stated.name),
                    text: text.clone(),
                    what,
                })
            });
            formula.transpose().map(|formula| formula.map(Arc::new))
        };
        let forces = [
            read("force_x_n_m", &stated.force_x_n_m, &FORCE_VARIABLES)?,
            read("force_z_n_m", &stated.force_z_n_m, &FORCE_VARIABLES)?,
            read("couple_n_m_m", &stated.couple_n_m_m, &FORCE_VARIABLES)?,
        ];
        let moment = read("moment_n_m", &stated.moment_n_m, &MOMENT_VARIABLES)?;
        let hook = if moment.is_some() { Hook::Material } else { Hook::Force };
        Ok(Self {
            about: about(stated, hook),
            companions: companions.iter().map(|name| kept(name)).collect(),
            medians: stated.companions.iter().map(|c| c.prior.from_unit(0.5)).collect(),
            forces,
            moment,
        })
    }
}

fn about(stated: &Expression, hook: Hook) -> About {
    let texts: Vec<String> = stated.texts().map(|(field, text)| format!("{field} = magnitude * ({text})")).collect();
    let (low, high) = stated.prior.bounds();
    let most = ROOM * low.abs().max(high.abs());
    About {
        name: kept(&stated.name),
        title: kept(stated.title.as_ref().unwrap_or(&stated.name)),
        description: kept(&format!("expression of the model file: {}", texts.join(", "))),
        unit: kept(&stated.unit),
        hook,
        prior: stated.prior.clone(),
        range: [if low < 0.0 { -most } else { 0.0 }, most],
    }
}

impl Effect for Stated {
    fn about(&self) -> About {
        self.about.clone()
    }

    fn apply(&self, magnitude: f64, episode: &mut EpisodeModel) -> Result<(), &'static str> {
        // Not even the last bit of a model without the effect changes.
        if magnitude == 0.0 {
            return Ok(());
        }
        let given = &episode.expression_numbers;
        let numbers: Vec<f64> = self
            .companions
            .iter()
            .zip(&self.medians)
            .map(|(name, median)| given.get(name).copied().unwrap_or(*median))
            .collect();
        if let Some(formula) = &self.moment {
            episode.terms.moments.push(Arc::new(Moment {
                magnitude,
                formula: Arc::clone(formula),
                numbers: numbers.clone(),
            }));
        }
        if self.forces.iter().any(Option::is_some) {
            episode.terms.forces.push(Arc::new(Force { magnitude, formulas: self.forces.clone(), numbers }));
        }
        Ok(())
    }

    fn companions(&self) -> &[&'static str] {
        &self.companions
    }
}

/// Forces and couple per length, in multiples of the formulas.
struct Force {
    magnitude: f64,
    formulas: [Option<Arc<Formula>>; 3],
    numbers: Vec<f64>,
}

impl Force {
    /// Returns the values of [`FORCE_VARIABLES`].
    fn state(at: &PointState) -> [f64; 8] {
        let ([x, z], [vx, vz]) = (at.position_m, at.velocity_m_s);
        [at.fraction, at.time_s, x, z, vx, vz, vx.hypot(vz), at.angle_rad]
    }

    fn component(&self, i: usize, at: &PointState) -> f64 {
        let Some(formula) = &self.formulas[i] else { return 0.0 };
        self.magnitude * at.length_m * formula.value(&Self::state(at), &self.numbers)
    }
}

impl ForceTerm for Force {
    fn force_n(&self, at: &PointState) -> [f64; 2] {
        [self.component(0, at), self.component(1, at)]
    }

    fn couple_n_m(&self, at: &PointState) -> f64 {
        self.component(2, at)
    }

    fn stiffness_n_m(&self, at: &PointState, rate_per_s: f64) -> [f64; 3] {
        let derivative = |axis: usize| {
            let moved = |sign: f64| {
                let mut at = *at;
                at.position_m[axis] += sign * STEP_M;
                at.velocity_m_s[axis] += sign * STEP_M * rate_per_s;
                self.force_n(&at)
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            [0, 1].map(|i| (down[i] - up[i]) / (2.0 * STEP_M))
        };
        let (by_x, by_z) = (derivative(0), derivative(1));
        without_negative([by_x[0], 0.5 * (by_x[1] + by_z[0]), by_z[1]])
    }
}

/// Returns the part of a symmetric matrix (xx, xz, zz) that has no negative eigenvalue.
fn without_negative([xx, xz, zz]: [f64; 3]) -> [f64; 3] {
    let (mean, half) = (0.5 * (xx + zz), 0.5 * (xx - zz));
    let radius = half.hypot(xz);
    let [larger, smaller] = [mean + radius, mean - radius];
    // A force that is not finite ends the simulation; a stiffness that is not would hide where.
    if !radius.is_finite() || !mean.is_finite() || larger <= 0.0 {
        return [0.0; 3];
    }
    if smaller >= 0.0 {
        return [xx, xz, zz];
    }
    // The projection on the eigenvector of the larger eigenvalue.
    let scale = 0.5 * larger / radius;
    [scale * (radius + half), scale * xz, scale * (radius - half)]
}

/// Moment in multiples of the formula.
struct Moment {
    magnitude: f64,
    formula: Arc<Formula>,
    numbers: Vec<f64>,
}

impl MomentTerm for Moment {
    fn moment_n_m(&self, at: &BendState) -> f64 {
        let state = [at.fraction, at.time_s, at.curvature_per_m, at.curvature_rate_per_m_s];
        self.magnitude * self.formula.value(&state, &self.numbers)
    }
}
