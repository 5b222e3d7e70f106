//! Joining of the pieces' centre lines into that of the object.

use super::pieces::Pieces;
use super::polyline::{direction, distance, length};
use super::strand::{Strand, march};

/// Joins the longest strand with the strands that continue it across gaps, and writes the result to `line`. The straight
/// bridges across the gaps are part of the line.
///
/// A strand continues an end of the line if the gap is at most `max_gap_px` long and lies ahead within 70 degrees, and if
/// the strand does not turn back. The nearest of several is joined first. Returns the number of joined strands and the
/// sum of their lengths without gaps.
pub(crate) fn join(pieces: &Pieces, strands: &mut [Strand], max_gap_px: f64, line: &mut Vec<[f64; 2]>) -> (usize, f64) {
    line.clear();
    // Reversed, as `max_by` returns the last of equals: the first one is wanted.
    let Some(main) =
        (0..strands.len()).rev().max_by(|&a, &b| length(&strands[a].points).total_cmp(&length(&strands[b].points)))
    else {
        return (0, 0.0);
    };
    strands.swap(0, main);
    line.extend_from_slice(&strands[0].points);
    // The direction at an end is taken over two widths: over less, the end cap's roughness turns it.
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
        // A later comparison may have turned the chosen strand the other way round.
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

/// First or last point, and the unit direction in which the line would continue from it. The direction is taken over the
/// length `back`.
fn end_of(line: &[[f64; 2]], is_end: bool, back: f64) -> ([f64; 2], [f64; 2]) {
    let point = |k: usize| if is_end { line[line.len() - 1 - k] } else { line[k] };
    let from = (1..line.len()).find(|&k| distance(point(0), point(k)) >= back).unwrap_or(line.len() - 1);
    (point(0), direction(point(from), point(0)))
}

/// Orients `strand` to begin at the gap after `end`. Returns the length of the gap, or none if `strand` does not lie
/// `ahead` or turns back.
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
    // 0.34 is the cosine of 70 degrees. Across a gap shorter than half a width the direction is noise.
    let lies_ahead = dot(towards, ahead) > 0.34 || gap(strand) < 0.5 * strand.width_px;
    // -0.3 is the cosine of 107 degrees: a bar may bend by a right angle and a little more behind the gripper.
    (lies_ahead && dot(onward, ahead) > -0.3).then(|| gap(strand))
}

/// Replaces the centre line of a piece as wide as long by the line from `end` through its middle, from border to border.
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
