//! Draws of simulated episodes, for pictures and scores.

use catenary_core::Track;
use track_fit::fitting::Problem;

/// Rounds in which draws that cannot be simulated are replaced.
const ROUNDS: usize = 3;

/// Simulated draws.
#[derive(Debug, Clone)]
pub(crate) struct Draws {
    /// Tracks without noise, by draw and episode.
    pub tracks: Vec<Vec<Track>>,
    /// Number of further draws that could not be simulated.
    pub left_out: usize,
}

impl Draws {
    /// Simulates `count` draws of the unknowns. A draw that cannot be simulated is replaced by a new one, so that there are
    /// fewer than `count` only if most draws fail.
    pub fn of(problem: &Problem<'_>, count: usize, mut draw: impl FnMut() -> Vec<f64>) -> Self {
        let mut draws = Self { tracks: Vec::with_capacity(count), left_out: 0 };
        for _ in 0..ROUNDS {
            let points: Vec<Vec<f64>> = (draws.tracks.len()..count).map(|_| draw()).collect();
            if points.is_empty() {
                break;
            }
            for tracks in problem.tracks_each(&points) {
                match tracks {
                    Ok(tracks) => draws.tracks.push(tracks),
                    Err(_) => draws.left_out += 1,
                }
            }
        }
        draws
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use track_fit::toy::{self, Toy};

    #[test]
    fn draws_that_fail_are_replaced_while_possible() {
        let toy = Toy { gain: 0.3 };
        let episodes = [toy::episode(&toy, [0.25, 2e4], &[])];
        let problem = Problem::of(&toy::model(), &episodes, &toy, 40);
        // The prior's lengths begin at 0.195 m; the toy refuses lengths under 0.2 m.
        let with_failures = |each: usize| {
            let mut number = 0;
            let draws = Draws::of(&problem, 10, || {
                number += 1;
                vec![if number % each == 0 { 0.0 } else { 0.5 }, 0.5]
            });
            (draws.tracks.len(), draws.left_out)
        };
        assert_eq!(with_failures(usize::MAX), (10, 0));
        assert_eq!(with_failures(4), (10, 3), "2 of 10 fail, none of 2");
        assert_eq!(with_failures(1), (0, 30));
    }
}
