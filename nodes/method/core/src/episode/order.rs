//! Order of keypoints along the object.

/// Order of four unordered points along the object: the shortest path from the grip through all of them.
pub fn order_from(grip_m: [f64; 2], points_m: [[f64; 2]; 4]) -> [[f64; 2]; 4] {
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let length = |order: &[usize; 4]| {
        let path = std::iter::once(grip_m).chain(order.iter().map(|&i| points_m[i]));
        let points: Vec<[f64; 2]> = path.collect();
        points.windows(2).map(|w| distance(w[0], w[1])).sum::<f64>()
    };
    // The 24 permutations among the 256 codes of four base-4 digits.
    let orders = (0..256usize)
        .map(|code| std::array::from_fn(|i| (code >> (2 * i)) & 3))
        .filter(|o: &[usize; 4]| (0..4).all(|i| o.contains(&i)));
    let best = orders.min_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or([0, 1, 2, 3]);
    best.map(|i| points_m[i])
}
