//! Suggestions for misspelt names: "did you mean ...?".

/// Least similarity (Jaro, 0 to 1) of a suggestion. Command lines use 0.7 for words. Names here are longer and share
/// parts such as units, so unrelated names reach 0.7.
const LEAST_SIMILARITY: f64 = 0.78;
/// Least length of a part that suggests the whole name, such as `mass` for `tip_mass_kg`.
const LEAST_PART: usize = 3;

/// Nearest of `names` to the unknown `name`, or none if no name is near.
pub fn nearest<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let plain = |text: &str| text.trim().to_lowercase().replace('-', "_");
    let asked = plain(name);
    let similarity = |known: &str| {
        let known = plain(known);
        // A part of a name, such as a name without its unit, counts as the least similarity that is suggested.
        let holds = |long: &str, short: &str| short.chars().count() >= LEAST_PART && long.contains(short);
        let part = if holds(&known, &asked) || holds(&asked, &known) { LEAST_SIMILARITY } else { 0.0 };
        strsim::jaro(&asked, &known).max(part)
    };
    let rated = names.into_iter().map(|known| (similarity(known), known));
    let near = rated.filter(|(similarity, _)| *similarity >= LEAST_SIMILARITY);
    // First of equally similar names wins, because callers list preferred names first.
    near.fold(None, |best: Option<(f64, &str)>, next| match best {
        Some(best) if best.0 >= next.0 => Some(best),
        _ => Some(next),
    })
    .map(|(_, known)| known)
}

/// End of a message about an unknown name: `; did you mean ...?`, or nothing if no name is near.
pub fn did_you_mean<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    nearest(name, names).map_or_else(String::new, |known| format!("; did you mean `{known}`?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 6] = [
        "length_m",
        "youngs_modulus_pa",
        "table_friction",
        "tip_mass_kg",
        "table_height_change_m",
        "linear_drag_n_s_m2",
    ];

    #[test]
    fn misspelt_names_find_the_name() {
        let found = |name| nearest(name, NAMES);
        assert_eq!(found("lenght_m"), Some("length_m"));
        assert_eq!(found("Length_M"), Some("length_m"));
        assert_eq!(found("length"), Some("length_m"));
        assert_eq!(found("youngs_modulus"), Some("youngs_modulus_pa"));
        assert_eq!(found("young-modulus-pa"), Some("youngs_modulus_pa"));
        assert_eq!(found("friction"), Some("table_friction"));
        assert_eq!(found("tip_mass_g"), Some("tip_mass_kg"));
        assert_eq!(found("mass"), Some("tip_mass_kg"));
    }

    #[test]
    fn a_name_that_resembles_no_other_gets_no_suggestion() {
        for name in ["", "x", "wind", "seed", "colour", "gravity"] {
            assert_eq!(nearest(name, NAMES), None, "{name}");
            assert_eq!(did_you_mean(name, NAMES), "");
        }
        assert_eq!(nearest("length_m", []), None);
    }

    #[test]
    fn the_nearest_of_several_is_named() {
        assert_eq!(nearest("dlo_5", ["soft_bar", "dlo_0", "measured_cable"]), Some("dlo_0"));
        assert_eq!(did_you_mean("sed", ["bin", "seed"]), "; did you mean `seed`?");
    }
}
