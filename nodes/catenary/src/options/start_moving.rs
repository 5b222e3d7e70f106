//! Option for episodes that begin while the object moves.

use crate::exit::WrongInput;
use anyhow::Result;
use catenary_core::model::Effect;
use catenary_core::policy::{GREATEST_START_SPEED_M_S, is_start_speed};
use catenary_core::{Model, Prior};
use clap::Args;

/// Effects of the model that set the object in motion, each with its greatest magnitude for a speed of 1 m/s. An object that swings passes its
/// place of rest at its greatest speed, and where it turns it is away from there by that speed times its period over 2 pi: bars of 0.2 to 0.3 m
/// swing once in 0.7 to 1.05 s, so that this is 0.11 to 0.17 m. Both are drawn by themselves: a start may be at any phase of a swing.
const EFFECTS: [(&str, f64); 2] = [("start_velocity_m_s", 1.0), ("start_offset_m", 0.15)];

/// Starts in motion.
#[derive(Debug, Clone, Copy, Args)]
pub struct StartMovingOption {
    /// Begin episodes while the object swings: the velocity of its tip, across it, is drawn between -SPEED and SPEED, m/s, and its displacement
    /// between -0.15 s and 0.15 s times SPEED. A policy that was trained so is deployed without a wait for the object to hang still; default: it
    /// hangs still
    #[arg(long, value_name = "SPEED", value_parser = speed, allow_negative_numbers = true)]
    pub start_moving: Option<f64>,
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| is_start_speed(*speed));
    speed.ok_or_else(|| format!("expected more than 0 and at most {GREATEST_START_SPEED_M_S} m/s"))
}

impl StartMovingOption {
    /// The model with starts in motion, or as it is.
    ///
    /// # Errors
    /// A model that says one of the effects already.
    pub fn applied_to(self, mut model: Model) -> Result<Model> {
        let Some(speed) = self.start_moving else { return Ok(model) };
        for (name, share) in EFFECTS {
            let field = model.field_of(name);
            if field != "parameters" {
                return Err(WrongInput::error(format!(
                    "--start-moving: model `{}` says {name} already, in `{field}`: take it out of the model, or leave the option out",
                    model.name
                )));
            }
            let high = share * speed;
            model.effects.push(Effect { name: name.to_owned(), distribution: Prior::Uniform { low: -high, high } });
        }
        Ok(model)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::model_file::read_or_soft_bar;
    use catenary_simulator::Registry;
    use catenary_simulator::parameters::range_of;

    fn moving(speed: f64) -> StartMovingOption {
        StartMovingOption { start_moving: Some(speed) }
    }

    #[test]
    fn the_model_gets_starts_to_both_sides_and_its_text_too() {
        let model = read_or_soft_bar(None).unwrap();
        let swinging = moving(0.5).applied_to(model.clone()).unwrap();
        let (before, added) = swinging.effects.split_at(model.effects.len());
        assert_eq!(before, model.effects);
        let uniform = |high: f64| Prior::Uniform { low: -high, high };
        let expected = [("start_velocity_m_s", uniform(0.5)), ("start_offset_m", uniform(0.075))];
        assert_eq!(added, expected.map(|(name, distribution)| Effect { name: name.to_owned(), distribution }));
        assert_eq!(StartMovingOption { start_moving: None }.applied_to(model.clone()).unwrap(), model);
        // The text goes to the training node.
        let text = swinging.rewrite(&model.to_yaml().unwrap()).unwrap();
        assert_eq!(Model::from_yaml(&text).unwrap(), swinging);
    }

    #[test]
    fn a_model_that_says_an_effect_already_is_refused_with_its_field() {
        let mut model = read_or_soft_bar(None).unwrap();
        let twice = moving(0.2).applied_to(moving(0.5).applied_to(model.clone()).unwrap()).unwrap_err().to_string();
        assert!(twice.contains("says start_velocity_m_s already, in `effects.start_velocity_m_s`"), "{twice}");
        model.parameters.insert("start_offset_m".to_owned(), 0.1);
        let fixed = moving(0.5).applied_to(model).unwrap_err().to_string();
        assert!(fixed.contains("in `parameters.start_offset_m`"), "{fixed}");
    }

    #[test]
    fn a_speed_is_a_number_that_the_effects_can_have() {
        assert_eq!(speed("0.5"), Ok(0.5));
        for wrong in ["0", "-1", "5.1", "nan", "inf", "fast"] {
            assert_eq!(speed(wrong), Err("expected more than 0 and at most 5 m/s".to_owned()), "{wrong}");
        }
        for (name, share) in EFFECTS {
            let [low, high] = range_of(Registry::shipped(), name).unwrap();
            let greatest = share * GREATEST_START_SPEED_M_S;
            assert!(low <= -greatest && greatest <= high, "{name}");
        }
    }
}
