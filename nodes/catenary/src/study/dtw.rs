//! Distance of two paths by dynamic time warping.

/// Mean distance of the matched points of two paths, in their unit: the least sum of distances over all monotone matchings of the
/// points (Sakoe and Chiba 1978), over the number of matched pairs. NaN if a path has no point.
pub fn distance(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    // Sum and number of pairs of the best matching up to each pair of points.
    let mut before: Vec<(f64, f64)> = Vec::new();
    for (i, p) in a.iter().enumerate() {
        let mut row: Vec<(f64, f64)> = Vec::with_capacity(b.len());
        for (j, q) in b.iter().enumerate() {
            let ways = [
                (i == 0 && j == 0).then_some((0.0, 0.0)),
                (i > 0 && j > 0).then(|| before[j - 1]),
                (i > 0).then(|| before[j]),
                (j > 0).then(|| row[j - 1]),
            ];
            let (sum, pairs) = ways.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::NAN, 0.0));
            row.push((sum + (p[0] - q[0]).hypot(p[1] - q[1]), pairs + 1.0));
        }
        before = row;
    }
    before.last().map_or(f64::NAN, |(sum, pairs)| sum / pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_path_at_another_pace_is_near_and_a_shifted_one_is_its_shift_away() {
        let path = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]];
        let slow = [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 0.0]];
        assert_eq!(distance(&path, &slow), 0.0);
        assert!((distance(&path, &path.map(|[x, z]| [x, z + 0.5])) - 0.5).abs() < 1e-12);
        assert!(distance(&path, &[]).is_nan());
    }
}
