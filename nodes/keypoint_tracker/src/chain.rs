//! From the centre lines of the pieces to that of the object.

use crate::pieces::Pieces;
use crate::polyline::{direction, distance, length};
use crate::strand::{Strand, march};

/// Joins the longest strand with those that go on from its ends, straight across the gaps, into `line`. Lengths hidden in
/// the gaps count as part of the line.
///
/// A strand goes on from an end if the gap is at most `max_gap_px` long, lies ahead within 70 degrees, and the strand
/// does not turn back. Of several, the nearest is joined first. Gives the number of the strands that were joined, and the
/// sum of their lengths.
pub(crate) fn join(pieces: &Pieces, strands: &mut [Strand], max_gap_px: f64, line: &mut Vec<[f64; 2]>) -> (usize, f64) {
    line.clear();
    let Some(main) =
        (0..strands.len()).rev().max_by(|&a, &b| length(&strands[a].points).total_cmp(&length(&strands[b].points)))
    else {
        return (0, 0.0);
    };
    strands.swap(0, main);
    line.extend_from_slice(&strands[0].points);
    let back = 2.0 * strands[0].width_px;
    let (mut joined, mut visible_px) = (1, length(line));
    while joined < strands.len() {
        let mut best: Option<(f64, usize, bool)> = None;
        for is_end in [true, false] {
            let (end, ahead) = end_of(line, is_end, back);
            for (i, strand) in strands.iter_mut().enumerate().skip(joined) {
                if let Some(gap) = turn_towards(pieces, strand, end, ahead).filter(|gap| *gap <= max_gap_px)
                    && best.is_none_or(|(least, ..)| gap < least)
                {
                    best = Some((gap, i, is_end));
                }
            }
        }
        let Some((_, i, is_end)) = best else { break };
        let (end, ahead) = end_of(line, is_end, back);
        turn_towards(pieces, &mut strands[i], end, ahead);
        visible_px += length(&strands[i].points);
        if !is_end {
            line.reverse();
        }
        line.extend_from_slice(&strands[i].points);
        strands.swap(joined, i);
        joined += 1;
    }
    (joined, visible_px)
}

/// The first or last point, and the direction (unit) in which the line, taken over `back`, would go on from it.
fn end_of(line: &[[f64; 2]], is_end: bool, back: f64) -> ([f64; 2], [f64; 2]) {
    let point = |k: usize| if is_end { line[line.len() - 1 - k] } else { line[k] };
    let from = (1..line.len()).find(|&k| distance(point(0), point(k)) >= back).unwrap_or(line.len() - 1);
    (point(0), direction(point(from), point(0)))
}

/// Turns `strand` so that it goes on from `end`; gives the gap, or none where it does not lie `ahead`.
fn turn_towards(pieces: &Pieces, strand: &mut Strand, end: [f64; 2], ahead: [f64; 2]) -> Option<f64> {
    if !strand.is_long {
        point_along(pieces, strand, end);
    }
    let gap = |s: &Strand| distance(end, s.points[0]);
    let last = strand.points.len() - 1;
    if distance(end, strand.points[last]) < gap(strand) {
        strand.points.reverse();
    }
    let towards = direction(end, strand.points[0]);
    let onward = direction(strand.points[0], strand.points[last]);
    let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
    let lies_ahead = dot(towards, ahead) > 0.34 || gap(strand) < 0.5 * strand.width_px;
    (lies_ahead && dot(onward, ahead) > -0.3).then(|| gap(strand))
}

/// Gives a piece without a direction of its own that from `end` to its middle.
fn point_along(pieces: &Pieces, strand: &mut Strand, end: [f64; 2]) {
    let middle = pieces.list[usize::from(strand.piece) - 1].centroid_px;
    let along = direction(end, middle);
    let reach = |sign: f64| {
        let ahead = march(pieces, strand.piece, middle, along.map(|c| sign * c), 200.0).unwrap_or(0.0);
        [middle[0] + sign * ahead * along[0], middle[1] + sign * ahead * along[1]]
    };
    let ends = [reach(-1.0), reach(1.0)];
    strand.points.clear();
    strand.points.extend(ends);
}
