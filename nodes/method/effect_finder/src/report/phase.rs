//! Phase of an episode in which a change of the simulated values shows most.

use nalgebra::DVector;
use track_fit::data::Channel;

/// Share of the energy of the change in the phase.
const SHARE: f64 = 0.8;

/// Phase of an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Phase {
    /// Index of the episode.
    pub episode: usize,
    /// Times in s of the first and the last frame.
    pub times_s: [f64; 2],
}

/// Episode in which `change` has most of its energy, and the shortest time with four fifths of it. `change` has a row a
/// channel. None without energy.
pub fn shows_most(channels: &[Channel], change: &DVector<f64>) -> Option<Phase> {
    // Time and energy of each frame, by episode.
    let mut energies: Vec<Vec<(f64, f64)>> = Vec::new();
    for (channel, value) in channels.iter().zip(change.iter()) {
        energies.resize_with(energies.len().max(channel.episode + 1), Vec::new);
        let frames = &mut energies[channel.episode];
        frames.resize(frames.len().max(channel.frame + 1), (channel.time_s, 0.0));
        frames[channel.frame].1 += value * value;
    }
    let sum = |frames: &[(f64, f64)]| frames.iter().map(|f| f.1).sum::<f64>();
    let episode = (0..energies.len()).max_by(|a, b| sum(&energies[*a]).total_cmp(&sum(&energies[*b])))?;
    let frames = &energies[episode];
    let wanted = SHARE * sum(frames);
    if wanted <= 0.0 {
        return None;
    }
    // Last frame of the shortest window from each frame on.
    let window = |from: usize| {
        let mut held = 0.0;
        let to = frames[from..].iter().position(|f| {
            held += f.1;
            held >= wanted
        })?;
        Some([frames[from].0, frames[from + to].0])
    };
    let shorter = |a: &[f64; 2], b: &[f64; 2]| (a[1] - a[0]).total_cmp(&(b[1] - b[0]));
    let times_s = (0..frames.len()).filter_map(window).min_by(shorter)?;
    Some(Phase { episode, times_s })
}

#[cfg(test)]
mod tests {
    use super::*;
    use track_fit::data::Quantity;

    #[test]
    fn the_phase_is_the_shortest_with_most_of_the_energy() {
        let channels: Vec<Channel> = (0..2)
            .flat_map(|episode| (0..40).map(move |frame| (episode, frame)))
            .flat_map(|(episode, frame)| {
                let one = move |axis| Channel {
                    episode,
                    frame,
                    time_s: 0.1 * frame as f64,
                    quantity: Quantity::Keypoint { point: 3, axis },
                };
                [0, 1].map(one)
            })
            .collect();
        let change = |size: &dyn Fn(&Channel) -> f64| DVector::from_iterator(160, channels.iter().map(size));
        let burst = |c: &Channel| if c.episode == 1 && (10..20).contains(&c.frame) { 2.0 } else { 0.1 };
        let found = shows_most(&channels, &change(&burst)).unwrap();
        assert_eq!(found.episode, 1);
        let [from_s, to_s] = found.times_s;
        // Eight or nine of ten equal frames hold four fifths of all energy.
        assert!(from_s > 0.95 && to_s < 1.95 && (0.65..0.95).contains(&(to_s - from_s)), "{found:?}");
        assert_eq!(shows_most(&channels, &change(&|_| 0.0)), None);
    }
}
