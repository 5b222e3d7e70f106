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

/// Name, and colours in the light and in the dark scheme, of every variable of the pages.
const VARIABLES: [(&str, [&str; 2]); 17] = [
    ("measured", ["#222222", "#eceff1"]),
    ("prior", ["#8c8c8c", "#9aa0a6"]),
    ("posterior", ["#0072b2", "#4aa8e0"]),
    ("truth", ["#aa3377", "#ee77bb"]),
    ("before", ["#e69f00", "#f0b429"]),
    ("after", ["#009e73", "#2cc295"]),
    ("noise", ["#56b4e9", "#8ad1fa"]),
    ("other", ["#b8b8b8", "#70757a"]),
    ("paper", ["#ffffff", "#15181c"]),
    ("ink", ["#222222", "#e3e6e8"]),
    ("soft", ["#5c5c5c", "#a8adb2"]),
    ("rule", ["#dddddd", "#3a3f45"]),
    ("grid", ["#e4e4e4", "#2c3137"]),
    ("lead", ["#eef6fb", "#16293a"]),
    ("lead-edge", ["#0072b2", "#4aa8e0"]),
    ("doubt", ["#fff4d6", "#3a2f12"]),
    ("doubt-edge", ["#e69f00", "#f0b429"]),
];

/// Style sheet of the variables: the light scheme, and the dark one for readers who prefer it.
pub fn variables() -> String {
    let of = |scheme: usize| -> String {
        VARIABLES.iter().map(|(name, colours)| format!("--{name}:{};", colours[scheme])).collect()
    };
    format!(":root{{color-scheme:light dark;{}}}@media(prefers-color-scheme:dark){{:root{{{}}}}}", of(0), of(1))
}

impl Role {
    /// Colour of axes and texts as CSS.
    pub const INK: &str = "var(--ink)";
    /// Colour of grids and frames as CSS.
    pub const GRID: &str = "var(--grid)";
    /// Colour of the ground as CSS.
    pub const PAPER: &str = "var(--paper)";

    /// Colour as CSS: a variable, which the reader's scheme sets.
    pub const fn css(self) -> &'static str {
        match self {
            Role::Measured => "var(--measured)",
            Role::Prior => "var(--prior)",
            Role::Posterior => "var(--posterior)",
            Role::Truth => "var(--truth)",
            Role::Before => "var(--before)",
            Role::After => "var(--after)",
            Role::Noise => "var(--noise)",
            Role::Other => "var(--other)",
        }
    }

    /// Colour as CSS, mixed with the ground: 0 is the ground, 1 the colour itself.
    pub fn tint(self, share: f64) -> String {
        format!("color-mix(in srgb,{} {:.0}%,{})", self.css(), 100.0 * share.clamp(0.0, 1.0), Self::PAPER)
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

/// Opacity, 0 to 255, of a density, given as a share 0 to 1 of its maximum. The picture has the colour [`DENSITY`] on the ground of the page.
pub fn opacity(share: f64) -> u8 {
    // Half of the maximum is still plainly visible.
    (255.0 * share.clamp(0.0, 1.0).powf(0.7)).round() as u8
}

/// Colour of a density's picture: legible on light and on dark ground.
pub const DENSITY: [u8; 3] = [0x2b, 0x8c, 0xd2];

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
    fn both_schemes_have_every_colour_and_keep_text_legible() {
        let css = variables();
        let (light, dark) = css.split_once("@media").unwrap();
        for (name, _) in VARIABLES {
            assert!([light, dark].iter().all(|scheme| scheme.contains(&format!("--{name}:"))), "{name}");
        }
        // Relative luminance and contrast after WCAG 2.1.
        let luminance = |colour: &str| {
            let part = |at: usize| f64::from(u8::from_str_radix(&colour[at..at + 2], 16).unwrap()) / 255.0;
            let linear = |c: f64| if c <= 0.03928 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
            0.2126 * linear(part(1)) + 0.7152 * linear(part(3)) + 0.0722 * linear(part(5))
        };
        let of = |name: &str, scheme: usize| luminance(VARIABLES.iter().find(|(n, _)| *n == name).unwrap().1[scheme]);
        let contrast = |a: f64, b: f64| (a.max(b) + 0.05) / (a.min(b) + 0.05);
        for scheme in 0..2 {
            for text in ["ink", "soft", "measured"] {
                for ground in ["paper", "lead", "doubt"] {
                    let seen = contrast(of(text, scheme), of(ground, scheme));
                    assert!(seen >= 4.5, "{text} on {ground}: {seen:.1}");
                }
            }
        }
    }

    #[test]
    fn a_tint_goes_from_the_ground_to_the_colour() {
        assert_eq!(Role::Posterior.tint(0.5), "color-mix(in srgb,var(--posterior) 50%,var(--paper))");
        assert_eq!((opacity(-1.0), opacity(2.0)), (0, 255));
    }
}
