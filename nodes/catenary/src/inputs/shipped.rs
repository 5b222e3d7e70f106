//! Launch files, parameters and models that are compiled into the program.

use std::path::Path;

/// Contents of `launch_configs` without its pictures, by relative path.
pub const LAUNCH_CONFIGS: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/launch_configs.rs"));

/// Names and texts of the models.
pub fn models() -> impl Iterator<Item = (&'static str, &'static str)> {
    LAUNCH_CONFIGS.iter().filter_map(|(path, bytes)| {
        let name = path.strip_prefix("models/")?.strip_suffix(".yaml")?;
        Some((name, std::str::from_utf8(bytes).ok()?))
    })
}

/// Text of the model with this name; `None` if `path` is more than a name, or if there is no such model.
pub fn model(path: &Path) -> Option<&'static str> {
    let name = path.to_str()?;
    models().find(|(known, _)| *known == name).map(|(_, text)| text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_found_by_their_names_alone() {
        let names: Vec<&str> = models().map(|(name, _)| name).collect();
        assert!(names.contains(&"soft_bar") && names.contains(&"measured_cable"), "{names:?}");
        assert!(model(Path::new("soft_bar")).unwrap().contains("name: soft_bar"));
        for other in ["soft_bar.yaml", "models/soft_bar", "./soft_bar", "bar", ""] {
            assert!(model(Path::new(other)).is_none(), "{other}");
        }
    }
}
