//! Colours of the reports. A colour has the same meaning on all pages.
//!
//! The colours are those of Okabe and Ito (2008), chosen to be distinguishable by colour-blind readers, with a purple
//! of Tol's bright scheme.

/// Meaning of a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Measured data, and the target of a task.
    Measured,
    /// The prior, and other references.
    Prior,
    /// The posterior.
    Posterior,
    /// Hidden true value.
    Truth,
    /// Model before its repair, and policies trained over the prior: pi0, U.
    Before,
    /// Model after its repair, and policies trained over the posterior: pi1, own.
    After,
    /// Measurement noise.
    Noise,
    /// Anything without a meaning of its own.
    Other,
}

impl Role {
    /// Colour as CSS.
    pub const fn css(self) -> &'static str {
        match self {
            Role::Measured => "#222222",
            Role::Prior => "#8c8c8c",
            Role::Posterior => "#0072b2",
            Role::Truth => "#aa3377",
            Role::Before => "#e69f00",
            Role::After => "#009e73",
            Role::Noise => "#56b4e9",
            Role::Other => "#b8b8b8",
        }
    }

    /// Colour as CSS, mixed with white: 0 is white, 1 the colour itself.
    pub fn tint(self, share: f64) -> String {
        let css = self.css();
        let mixed = [1, 3, 5].map(|at| {
            let full = u8::from_str_radix(&css[at..at + 2], 16).expect("every colour is #rrggbb");
            (255.0 - (255.0 - f64::from(full)) * share.clamp(0.0, 1.0)).round() as u8
        });
        format!("#{:02x}{:02x}{:02x}", mixed[0], mixed[1], mixed[2])
    }

    /// Role of a policy by its name; `None` for other names.
    pub fn of_policy(name: &str) -> Option<Self> {
        match name {
            "pi0" | "U" => Some(Role::Before),
            "pi1" | "own" => Some(Role::After),
            "mu" => Some(Role::Noise),
            "mismatched" => Some(Role::Other),
            "true" => Some(Role::Truth),
            _ => None,
        }
    }
}

/// Colour of a density, given as a share 0 to 1 of its maximum: from white over the posterior's blue to nearly black.
pub fn shade(share: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 4] = [[255.0, 255.0, 255.0], [158.0, 202.0, 225.0], [0.0, 114.0, 178.0], [3.0, 30.0, 60.0]];
    let scaled = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let k = (scaled as usize).min(STOPS.len() - 2);
    std::array::from_fn(|c| (STOPS[k][c] + (scaled - k as f64) * (STOPS[k + 1][c] - STOPS[k][c])).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_meaning_has_a_colour_of_its_own() {
        let all = [
            Role::Measured,
            Role::Prior,
            Role::Posterior,
            Role::Truth,
            Role::Before,
            Role::After,
            Role::Noise,
            Role::Other,
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| b.css() != a.css()), "{a:?}");
        }
        assert_eq!((Role::of_policy("pi1"), Role::of_policy("held-out loss")), (Some(Role::After), None));
    }

    #[test]
    fn a_tint_goes_from_white_to_the_colour() {
        assert_eq!((Role::Before.tint(0.0).as_str(), Role::Before.tint(1.0).as_str()), ("#ffffff", Role::Before.css()));
        assert_eq!(Role::Posterior.tint(0.5), "#80b9d9");
    }

    #[test]
    fn a_density_is_shaded_from_white_to_dark() {
        assert_eq!((shade(-1.0), shade(2.0)), ([255; 3], [3, 30, 60]));
        let light = |v: f64| shade(v).iter().map(|c| u32::from(*c)).sum::<u32>();
        assert!((0..100).all(|i| light(f64::from(i) / 100.0) >= light(f64::from(i + 1) / 100.0)));
    }
}
