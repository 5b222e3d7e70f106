//! Target position of an action, relative to the measured position or to the last target.

use super::DeltaAnchor;
use super::definition::MAX_LEAD_M;

impl DeltaAnchor {
    /// Returns the other anchor.
    pub fn other(self) -> Self {
        match self {
            DeltaAnchor::Measured => DeltaAnchor::LastTarget,
            DeltaAnchor::LastTarget => DeltaAnchor::Measured,
        }
    }

    /// Returns the target (x, z) in m of the action `delta_m`, given the measured position and the last target (x, z) in m. It lies at most
    /// [`MAX_LEAD_M`] from the measured position.
    ///
    /// `other_share`, 0 to 1, moves the anchor towards the other one: 0 is this anchor, 1 the other. A task has 0; the
    /// simulator's effect `delta_anchor_change` has more.
    pub fn target_m(
        self,
        delta_m: [f64; 2],
        measured_m: [f64; 2],
        last_target_m: [f64; 2],
        other_share: f64,
    ) -> [f64; 2] {
        self.limited(delta_m, measured_m, last_target_m, other_share).0
    }

    /// As [`Self::target_m`], with the delta that the limit leaves of `delta_m`.
    pub fn limited(
        self,
        delta_m: [f64; 2],
        measured_m: [f64; 2],
        last_target_m: [f64; 2],
        other_share: f64,
    ) -> ([f64; 2], [f64; 2]) {
        let place = |anchor| match anchor {
            DeltaAnchor::Measured => measured_m,
            DeltaAnchor::LastTarget => last_target_m,
        };
        let (own, other) = (place(self), place(self.other()));
        // Interpolation is skipped at 0, so that the result has the same bits as without the effect.
        let from = if other_share == 0.0 { own } else { [0, 1].map(|i| own[i] + other_share * (other[i] - own[i])) };
        let target = [from[0] + delta_m[0], from[1] + delta_m[1]];
        // On the line to the target: deltas that add up while the arm lags behind may lead too far.
        let lead = [0, 1].map(|i| target[i] - measured_m[i]);
        let length = lead[0].hypot(lead[1]);
        if length <= MAX_LEAD_M {
            return (target, delta_m);
        }
        let nearer = [0, 1].map(|i| measured_m[i] + lead[i] * MAX_LEAD_M / length);
        (nearer, [0, 1].map(|i| nearer[i] - from[i]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn target_is_relative_to_the_anchor_and_other_share_interpolates_between_anchors() {
        let (delta, measured, last) = ([0.01, -0.02], [0.4, 0.3], [0.43, 0.27]);
        let target = |anchor: DeltaAnchor, share| anchor.target_m(delta, measured, last, share);
        assert_eq!(target(DeltaAnchor::Measured, 0.0), [0.4 + 0.01, 0.3 - 0.02]);
        assert_eq!(target(DeltaAnchor::LastTarget, 0.0), [0.43 + 0.01, 0.27 - 0.02]);
        let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12;
        assert!(near(target(DeltaAnchor::Measured, 1.0), target(DeltaAnchor::LastTarget, 0.0)));
        assert!(near(target(DeltaAnchor::LastTarget, 0.5), target(DeltaAnchor::Measured, 0.5)));
    }

    #[test]
    fn a_target_leads_the_measured_position_by_a_limited_distance() {
        let (target, delta) = DeltaAnchor::LastTarget.limited([0.06, -0.06], [0.4, 0.3], [0.46, 0.24], 0.0);
        assert!(
            delta.iter().zip([0.46, 0.24]).zip(target).all(|((d, from), to)| (from + d - to).abs() < 1e-12),
            "{delta:?}"
        );
        let lead = [target[0] - 0.4, target[1] - 0.3];
        assert!((lead[0].hypot(lead[1]) - MAX_LEAD_M).abs() < 1e-12 && (lead[0] + lead[1]).abs() < 1e-12, "{lead:?}");
    }
}
