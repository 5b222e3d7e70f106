//! Law of an arm: in words, as the text that nodes and policy files exchange, and compared with another law. A policy whose training knew
//! another law than the arm follows ends each step at another place.

use super::outline::Node;
use super::{ArmLaw, Impedance, ModelError, check};
use std::fmt;

/// Step whose responses are compared, m: the greatest action along one axis.
const STEP_M: f64 = 0.06;
/// Period of the responses, s.
const PERIOD_S: f64 = 1e-3;
/// Number of places of a response: 1.5 s, in which the arms in use arrive.
const PLACES: usize = 1500;
/// Distance of two responses up to which two laws count as equal, m. Chosen, 5 % of the greatest action: friction of 2 N shifts an arm of
/// 2000 N/m by 1 mm, and a lag of 0.16 s is up to 16 mm ahead of the bridge's law.
const EQUAL_M: f64 = 0.003;

/// Greatest distance of two arms on the way of one greatest action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawGap {
    /// Distance, m.
    pub apart_m: f64,
    /// Time since the command, s.
    pub after_s: f64,
}

impl fmt::Display for LawGap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [step, apart] = [STEP_M, self.apart_m].map(|m| 1e3 * m);
        write!(f, "{apart:.0} mm apart {:.2} s after a step of {step:.0} mm", self.after_s)
    }
}

impl fmt::Display for ArmLaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lag { time_constant_s, max_speed_m_s } => {
                write!(f, "a lag of {time_constant_s} s with at most {max_speed_m_s} m/s")
            }
            Self::Impedance(law) => {
                let Impedance { stiffness_n_m, damping_n_s_m, clip_m, reference_time_constant_s, .. } = law;
                let Impedance { mass_kg, friction_n, max_speed_m_s, .. } = law;
                write!(
                    f,
                    "an impedance of {stiffness_n_m} N/m and {damping_n_s_m} N s/m with a clip of {clip_m} m and a reference \
                     {reference_time_constant_s} s behind"
                )?;
                max_speed_m_s.map_or(Ok(()), |limit| write!(f, " with at most {limit} m/s"))?;
                // Two laws that differ in these alone would read alike. An arm's own announcement leaves them at the defaults.
                let usual = Impedance::default();
                for (name, value, usual, unit) in
                    [("a mass", *mass_kg, usual.mass_kg, "kg"), ("friction", *friction_n, usual.friction_n, "N")]
                {
                    if value != usual {
                        write!(f, ", {name} of {value} {unit}")?;
                    }
                }
                Ok(())
            }
        }
    }
}

impl ArmLaw {
    /// Law as one line, which a model file takes as `arm.law` and a task file as `arm_law`.
    #[must_use]
    pub fn to_text(&self) -> String {
        serde_json::to_string(self).expect("a law has names and numbers alone")
    }

    /// Reads the text of [`ArmLaw::to_text`], or one as in a model file. Constants of an impedance that it omits have their defaults.
    ///
    /// # Errors
    /// [`ModelError`] with the field `arm_law`.
    pub fn from_text(text: &str) -> Result<Self, ModelError> {
        let options = serde_saphyr::options! { with_snippet: false };
        let read = serde_saphyr::from_str_with_options(text, options);
        let law: Self = read.map_err(|e| ModelError::from_yaml(&e, text, Node::of(text).as_ref()))?;
        check::arm_law(&law).map_err(|e| e.with_field(|field| field.replacen("arm.law", "arm_law", 1)))?;
        Ok(law)
    }

    /// Way of the hand along an axis after each millisecond, m, from rest to a target that is one greatest action of 60 mm ahead.
    #[must_use]
    pub fn step_response_m(&self) -> Vec<f64> {
        let nearer = |time_s: f64| if time_s > 0.0 { -(-PERIOD_S / time_s).exp_m1() } else { 1.0 };
        let (mut way_m, mut speed_m_s, mut reference_m) = (0.0, 0.0, 0.0);
        let mut step = || {
            match self {
                Self::Lag { time_constant_s, max_speed_m_s } => {
                    way_m += (nearer(*time_constant_s) * (STEP_M - way_m)).min(PERIOD_S * max_speed_m_s);
                }
                Self::Impedance(law) => {
                    let per_mass = PERIOD_S / law.mass_kg;
                    let fastest_m = law.max_speed_m_s.map_or(f64::INFINITY, |limit| PERIOD_S * limit);
                    reference_m += (nearer(law.reference_time_constant_s) * (STEP_M - reference_m)).min(fastest_m);
                    let pull_n = law.stiffness_n_m * f64::clamp(reference_m - way_m, -law.clip_m, law.clip_m);
                    // Damping is implicit, and friction takes at most the whole speed.
                    let damped = 1.0 / (1.0 + per_mass * law.damping_n_s_m);
                    let free_m_s: f64 = damped * (speed_m_s + per_mass * pull_n);
                    speed_m_s = free_m_s.signum() * (free_m_s.abs() - damped * per_mass * law.friction_n).max(0.0);
                    way_m += PERIOD_S * speed_m_s;
                }
            }
            way_m
        };
        (0..PLACES).map(|_| step()).collect()
    }

    /// Difference to an arm of another law, as their responses to a step of the greatest action show it. None if they are nowhere more than
    /// 3 mm apart: a policy need not know the difference, whatever the names of the laws are.
    #[must_use]
    pub fn gap(&self, other: &Self) -> Option<LawGap> {
        let [own, others] = [self, other].map(Self::step_response_m);
        let apart = own.iter().zip(&others).map(|(a, b)| (a - b).abs());
        let (place, apart_m) = apart.enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        (apart_m > EQUAL_M).then_some(LawGap { apart_m, after_s: PERIOD_S * (place + 1) as f64 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BRIDGE: ArmLaw = ArmLaw::Impedance(Impedance {
        clip_m: 0.02,
        stiffness_n_m: 2000.0,
        damping_n_s_m: 89.0,
        reference_time_constant_s: 0.2,
        mass_kg: 3.0,
        friction_n: 0.0,
        max_speed_m_s: None,
    });

    fn lag(time_constant_s: f64) -> ArmLaw {
        ArmLaw::Lag { time_constant_s, max_speed_m_s: 0.5 }
    }

    /// Law of the bridge whose reference has a greatest speed.
    fn limited(max_speed_m_s: f64) -> ArmLaw {
        let ArmLaw::Impedance(law) = BRIDGE else { unreachable!("it is an impedance") };
        ArmLaw::Impedance(Impedance { max_speed_m_s: Some(max_speed_m_s), ..law })
    }

    #[test]
    fn the_text_of_a_law_reads_as_that_law_and_a_part_of_it_keeps_the_defaults() {
        for law in [BRIDGE, limited(0.1), lag(0.16)] {
            assert_eq!(ArmLaw::from_text(&law.to_text()).unwrap(), law);
        }
        assert_eq!(ArmLaw::from_text("impedance: {clip_m: 0.02}").unwrap(), BRIDGE);
        assert_eq!(ArmLaw::from_text("impedance: {clip_m: 0.02, max_speed_m_s: 0.1}").unwrap(), limited(0.1));
        assert!(!BRIDGE.to_text().contains("max_speed_m_s"), "{}", BRIDGE.to_text());
    }

    #[test]
    fn errors_name_the_field() {
        for (text, words) in [
            ("{lag: {time_constant_s: -1.0, max_speed_m_s: 0.5}}", "`arm_law.lag.time_constant_s`"),
            ("{lag: {time_constant_s: 0.1}}", "max_speed_m_s"),
            ("{impedance: {max_speed_m_s: 0.0}}", "`arm_law.impedance.max_speed_m_s`"),
            ("spring", "spring"),
        ] {
            let error = ArmLaw::from_text(text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn the_shipped_lag_is_another_arm_than_the_emulated_one_and_small_differences_are_none() {
        let gap = BRIDGE.gap(&lag(0.16)).expect("a lag of 0.16 s is faster");
        assert!((0.014..0.018).contains(&gap.apart_m) && (0.05..0.15).contains(&gap.after_s), "{gap}");
        assert_eq!(BRIDGE.gap(&BRIDGE), None);
        assert_eq!(lag(0.16).gap(&lag(0.155)), None);
        assert!(lag(0.16).gap(&lag(0.08)).is_some());
        let ArmLaw::Impedance(law) = BRIDGE else { unreachable!("it is an impedance") };
        assert_eq!(BRIDGE.gap(&ArmLaw::Impedance(Impedance { mass_kg: 4.0, friction_n: 2.0, ..law })), None);
    }

    #[test]
    fn a_slow_reference_is_another_arm_and_a_limit_that_is_not_reached_changes_no_bit() {
        // The step begins at 0.06 m / 0.2 s = 0.3 m/s.
        assert_eq!(limited(0.5).step_response_m(), BRIDGE.step_response_m());
        let gap = limited(0.1).gap(&limited(0.5)).expect("0.1 m/s is slower");
        assert!((0.015..0.022).contains(&gap.apart_m), "{gap}");
    }

    #[test]
    fn a_law_in_words_has_its_constants() {
        assert_eq!(lag(0.16).to_string(), "a lag of 0.16 s with at most 0.5 m/s");
        let words = "an impedance of 2000 N/m and 89 N s/m with a clip of 0.02 m and a reference 0.2 s behind";
        assert_eq!(BRIDGE.to_string(), words);
        assert_eq!(limited(0.1).to_string(), format!("{words} with at most 0.1 m/s"));
        let other = Impedance { clip_m: 0.02, friction_n: 10.0, mass_kg: 4.0, ..Impedance::default() };
        assert_eq!(ArmLaw::Impedance(other).to_string(), format!("{words}, a mass of 4 kg, friction of 10 N"));
        let gap = LawGap { apart_m: 0.0071, after_s: 0.2 };
        assert_eq!(gap.to_string(), "7 mm apart 0.20 s after a step of 60 mm");
    }
}
