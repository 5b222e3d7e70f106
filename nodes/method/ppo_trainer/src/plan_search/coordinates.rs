//! Coordinates of a plan in a search.

use catenary_core::Track;
use catenary_core::policy::Plan;

/// Standard deviation of the target in the image, scaled to -1 .. 1, below which a plan does not follow it: what the noise of a camera moves a
/// target that stands still.
const LEAST_SPREAD: f64 = 2e-3;

/// Coordinates of a plan: for each action, first dx and then dz of each step, its value at the mean target, and in an affine plan its change with
/// one standard deviation of the target's x and y. All have the unit of the action limit.
#[derive(Debug, Clone, Copy)]
pub struct Coordinates {
    steps: usize,
    centre: [f64; 2],
    spread: [f64; 2],
    is_affine: bool,
}

impl Coordinates {
    /// Coordinates of constant plans of `steps` steps, at the targets of these episodes. None without an episode.
    pub fn of(tracks: &[Track], steps: usize) -> Option<Self> {
        let targets: Vec<[f64; 2]> = tracks.iter().filter_map(|track| Some(track.frames.first()?.target)).collect();
        if targets.is_empty() {
            return None;
        }
        let n = targets.len() as f64;
        let centre: [f64; 2] = std::array::from_fn(|i| targets.iter().map(|t| t[i]).sum::<f64>() / n);
        let spread = std::array::from_fn(|i| {
            let spread = (targets.iter().map(|t| (t[i] - centre[i]).powi(2)).sum::<f64>() / n).sqrt();
            // Nothing in these episodes tells how to follow a target that never moves.
            if spread < LEAST_SPREAD { f64::INFINITY } else { spread }
        });
        Some(Self { steps, centre, spread, is_affine: false })
    }

    /// Coordinates of affine plans.
    pub fn affine(self) -> Self {
        Self { is_affine: true, ..self }
    }

    /// Numbers of an action.
    fn width(&self) -> usize {
        if self.is_affine { 3 } else { 1 }
    }

    /// Number of actions, counting dx and dz apart.
    pub fn actions_count(&self) -> usize {
        2 * self.steps
    }

    /// Number of coordinates.
    pub fn len(&self) -> usize {
        self.width() * self.actions_count()
    }

    /// Index of the constant of an action.
    pub fn constant_of(&self, action: usize) -> usize {
        self.width() * action
    }

    /// Coordinates of a constant plan in these.
    pub fn of_constants(&self, constants: &[f64]) -> Vec<f64> {
        let mut z = vec![0.0; self.len()];
        constants.iter().enumerate().for_each(|(action, value)| z[self.constant_of(action)] = *value);
        z
    }

    /// Plan at these coordinates.
    pub fn plan(&self, z: &[f64]) -> Plan {
        let numbers = z.chunks_exact(self.width()).flat_map(|row| {
            let by = [0, 1].map(|i| row.get(1 + i).map_or(0.0, |change| change / self.spread[i]));
            [row[0] - by[0] * self.centre[0] - by[1] * self.centre[1], by[0], by[1]].map(|v| v as f32)
        });
        Plan::of_numbers(&numbers.collect::<Vec<f32>>())
    }

    /// Actions of the plan at a target, not limited.
    pub fn actions(&self, z: &[f64], target: [f64; 2]) -> Vec<f64> {
        let off: [f64; 2] = std::array::from_fn(|i| (target[i] - self.centre[i]) / self.spread[i]);
        let action = |row: &[f64]| row[0] + row.iter().skip(1).zip(off).map(|(change, off)| change * off).sum::<f64>();
        z.chunks_exact(self.width()).map(action).collect()
    }
}
