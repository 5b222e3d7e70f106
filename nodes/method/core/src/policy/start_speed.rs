//! Speed of the object at the start, in the file of a policy that was trained for starts in motion.

/// Greatest start speed of a training, m/s. The tip of an object of 0.3 m that reaches it swings far beyond its length.
pub const GREATEST_START_SPEED_M_S: f64 = 5.0;
/// Name of the metadata entry.
pub(super) const ENTRY: &str = "start_speed_m_s";

/// True for a start speed that a training can have, m/s. 0 is none: such a policy knows objects at rest alone.
#[must_use]
pub fn is_start_speed(speed_m_s: f64) -> bool {
    speed_m_s > 0.0 && speed_m_s <= GREATEST_START_SPEED_M_S
}

/// Reads the entry's text.
///
/// # Errors
/// The expected values, in words.
pub(super) fn of(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| is_start_speed(*speed));
    speed.ok_or_else(|| format!("more than 0 and at most {GREATEST_START_SPEED_M_S} m/s"))
}

#[cfg(test)]
mod tests {
    use super::super::Policy;
    use super::super::tests::policy;
    use super::*;

    #[test]
    fn a_file_keeps_the_start_speed_and_one_without_it_is_as_before() {
        let moving = Policy { start_speed_m_s: Some(0.3), ..policy() };
        assert_eq!(Policy::from_bytes(&moving.to_bytes()).unwrap(), moving);
        let words = "policy `pi0` was trained for starts in motion, up to 0.3 m/s at the tip";
        assert_eq!((moving.moving_start().as_deref(), policy().moving_start()), (Some(words), None));
        let bytes = policy().to_bytes();
        assert!(!bytes.windows(ENTRY.len()).any(|w| w == ENTRY.as_bytes()));
        assert_eq!(Policy::from_bytes(&bytes).unwrap().start_speed_m_s, None);
    }

    #[test]
    fn a_speed_that_no_training_has_is_refused() {
        for (speed, got) in [(0.0, "0"), (-0.5, "-0.5"), (5.5, "5.5"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
            let wrong = Policy { start_speed_m_s: Some(speed), ..policy() };
            let words = Policy::from_bytes(&wrong.to_bytes()).unwrap_err().to_string();
            assert_eq!(words, format!("policy: `start_speed_m_s`: expected more than 0 and at most 5 m/s, got {got}"));
        }
    }
}
