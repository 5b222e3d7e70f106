//! Colours of an object from clicks or from a labelled picture.

use catenary_core::RgbView;

use crate::colour_segmenter::Sector;
use crate::{ColourRange, Error};

/// Half the side of the square around a click whose mean colour counts, in pixels: a single pixel is noisy.
const PATCH_PX: u32 = 2;
/// Largest angle between the colours of a click and of a pixel of the same thing, rad, from the black point. Shading moves a colour
/// along its ray.
const SAME_ANGLE_RAD: f64 = 0.14;
/// Range of the brightness of such a pixel, in brightnesses of the click.
const SAME_LIGHT: [f64; 2] = [0.3, 3.0];
/// Smallest median saturation and chroma of an object that colours can tell from greys.
const LEAST_SATURATION: f64 = 0.15;
const LEAST_CHROMA: f64 = 16.0;
/// Shares of the object's pixels that a candidate range may leave outside, on each of its three borders.
const LEFT_OUT: [f64; 5] = [0.002, 0.01, 0.03, 0.08, 0.15];
/// Margins of a range beyond the pixels that it is fitted to, because the light of the next picture differs: degrees of hue, and factor
/// of saturation and chroma.
const HUE_MARGIN_DEG: f64 = 6.0;
const MARGIN: f64 = 0.8;
/// Widest sector of hue, degrees to each side.
const WIDEST_DEG: f64 = 60.0;
/// Most pixels, of the object and of the rest, that a fit looks at.
const MOST_PIXELS: usize = 40_000;

/// Colours that tell the object's pixels from the others, and how well they do in the picture that they were fitted to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourFit {
    /// Fitted colours.
    pub range: ColourRange,
    /// Share of the object's pixels with these colours.
    pub found: f64,
    /// Share of the pixels with these colours that are not the object's.
    pub false_share: f64,
}

/// Pixels that look like a click's and are connected with it: true for each, row by row.
///
/// # Errors
/// [`Error::Click`] if a click lies outside the image, or if there is none.
pub fn pixels_of_clicks(image: RgbView<'_>, clicks: &[[u32; 2]]) -> Result<Vec<bool>, Error> {
    check_clicks(image, clicks)?;
    let (width, height) = (image.width(), image.height());
    let mut is_object = vec![false; width as usize * height as usize];
    for &[u, v] in clicks {
        let seed = mean_colour(image, [u, v]);
        let mut edge = vec![[u, v]];
        is_object[(v * width + u) as usize] = true;
        while let Some([u, v]) = edge.pop() {
            for y in v.saturating_sub(1)..(v + 2).min(height) {
                for x in u.saturating_sub(1)..(u + 2).min(width) {
                    let near = (y * width + x) as usize;
                    if !is_object[near] && is_same(seed, pixel(image, [x, y])) {
                        is_object[near] = true;
                        edge.push([x, y]);
                    }
                }
            }
        }
    }
    Ok(is_object)
}

/// Fits the colours of the pixels where `is_object` is true, against all others. Of the candidate ranges, the one with the largest
/// F1 measure in the picture is taken, and widened by a margin that costs none of it.
///
/// # Errors
/// [`Error::Colourless`] if the object is grey, black or white; [`Error::Labels`] if `is_object` does not fill the image, or marks all or
/// none of it.
pub fn fit_colours(image: RgbView<'_>, is_object: &[bool]) -> Result<ColourFit, Error> {
    let (width, height) = (image.width(), image.height());
    let marked = is_object.iter().filter(|&&o| o).count();
    if is_object.len() != width as usize * height as usize || marked == 0 || marked == is_object.len() {
        return Err(Error::Labels { width, height, pixels: is_object.len(), marked });
    }
    let sample = |wanted: bool, count: usize| -> Vec<[u8; 3]> {
        let step = count.div_ceil(MOST_PIXELS);
        let of = is_object.iter().enumerate().filter(|&(_, &o)| o == wanted).step_by(step);
        of.map(|(i, _)| pixel(image, [i as u32 % width, i as u32 / width])).collect()
    };
    let object = sample(true, marked);
    let others = sample(false, is_object.len() - marked);
    // Weight of a sampled pixel, so that shares are those of the whole picture.
    let weight = [marked as f64 / object.len() as f64, (is_object.len() - marked) as f64 / others.len() as f64];
    let looks: Vec<[f64; 3]> = object.iter().map(|&rgb| look(rgb)).collect();
    let (saturation, chroma) = (sorted(&looks, 1), sorted(&looks, 2));
    let (middle_saturation, middle_chroma) = (quantile(&saturation, 0.5), quantile(&chroma, 0.5));
    if middle_saturation < LEAST_SATURATION || middle_chroma < LEAST_CHROMA {
        return Err(Error::Colourless { saturation: middle_saturation, chroma: middle_chroma });
    }
    // Chroma weighs the mean, because the hue of a pale pixel is noise.
    let (sum_x, sum_y) = looks.iter().fold((0.0, 0.0), |(x, y), &[hue, _, chroma]| {
        let (sin, cos) = hue.to_radians().sin_cos();
        (x + chroma * cos, y + chroma * sin)
    });
    let centre = sum_y.atan2(sum_x).to_degrees();
    let mut off: Vec<f64> = looks.iter().map(|l| (l[0] - centre + 540.0).rem_euclid(360.0) - 180.0).collect();
    off.sort_by(f64::total_cmp);
    let range = |[hue, pale, dim]: [f64; 3], margin_deg: f64, factor: f64| {
        let low = (quantile(&off, hue) - margin_deg).max(-WIDEST_DEG);
        let high = (quantile(&off, 1.0 - hue) + margin_deg).min(WIDEST_DEG);
        ColourRange {
            hue_deg: [centre + low, centre + high].map(|h| h.rem_euclid(360.0).round()),
            min_saturation: (100.0 * factor * quantile(&saturation, pale)).round().clamp(1.0, 99.0) / 100.0,
            min_chroma: (factor * quantile(&chroma, dim)).round().clamp(4.0, 255.0) as u8,
        }
    };
    let judged = |range: ColourRange| {
        let sector = Sector::new(&range);
        let count = |of: &[[u8; 3]]| of.iter().filter(|&&rgb| sector.holds_pixel(rgb)).count() as f64;
        let (found, wrong) = (weight[0] * count(&object), weight[1] * count(&others));
        let f1 = 2.0 * found / (marked as f64 + found + wrong);
        let false_share = if found + wrong > 0.0 { wrong / (found + wrong) } else { 0.0 };
        (f1, ColourFit { range, found: found / marked as f64, false_share })
    };
    let every =
        LEFT_OUT.iter().flat_map(|&h| LEFT_OUT.iter().flat_map(move |&s| LEFT_OUT.iter().map(move |&c| [h, s, c])));
    let best =
        every.map(|left_out| (judged(range(left_out, 0.0, 1.0)), left_out)).max_by(|a, b| a.0.0.total_cmp(&b.0.0));
    let ((f1, fit), left_out) = best.expect("there are candidates");
    // Half the margin if the whole one takes in something else.
    for part in [1.0, 0.5] {
        let (wider, fit) = judged(range(left_out, part * HUE_MARGIN_DEG, 1.0 - part * (1.0 - MARGIN)));
        if wider >= f1 - 0.005 {
            return Ok(fit);
        }
    }
    Ok(fit)
}

/// Colour of an object from clicks on it, RGB, 0 to 1: the median of the clicks' surroundings, in each channel.
///
/// # Errors
/// [`Error::Click`] if a click lies outside the image, or if there is none.
pub fn colour_of_clicks(image: RgbView<'_>, clicks: &[[u32; 2]]) -> Result<[f32; 3], Error> {
    check_clicks(image, clicks)?;
    let colours: Vec<[f64; 3]> = clicks.iter().map(|&click| mean_colour(image, click)).collect();
    Ok(median(&colours).expect("there is a click"))
}

/// Returns an error if there is no click, or if one lies outside the image.
fn check_clicks(image: RgbView<'_>, clicks: &[[u32; 2]]) -> Result<(), Error> {
    let (width, height) = (image.width(), image.height());
    let got = match clicks.iter().find(|[u, v]| *u >= width || *v >= height) {
        Some([u, v]) => format!("{u},{v}"),
        None if clicks.is_empty() => "none".to_owned(),
        None => return Ok(()),
    };
    Err(Error::Click { width, height, got })
}

/// Colour of an object from its pixels, RGB, 0 to 1: their median in each channel.
///
/// # Errors
/// [`Error::Labels`] if `is_object` does not fill the image, or marks none of it.
pub fn colour_of_labels(image: RgbView<'_>, is_object: &[bool]) -> Result<[f32; 3], Error> {
    let (width, height) = (image.width(), image.height());
    let marked = is_object.iter().enumerate().filter(|(_, o)| **o);
    let fault = || Error::Labels { width, height, pixels: is_object.len(), marked: marked.clone().count() };
    if is_object.len() != width as usize * height as usize {
        return Err(fault());
    }
    let colour = |i: usize| pixel(image, [i as u32 % width, i as u32 / width]).map(f64::from);
    let colours: Vec<[f64; 3]> = marked.clone().map(|(i, _)| colour(i)).collect();
    median(&colours).ok_or_else(fault)
}

/// Median of colours of 0 to 255 in each channel, as 0 to 1; none of no colours.
fn median(colours: &[[f64; 3]]) -> Option<[f32; 3]> {
    let middle = |c: usize| (quantile(&sorted(colours, c), 0.5) / 255.0) as f32;
    (!colours.is_empty()).then(|| [0, 1, 2].map(middle))
}

fn pixel(image: RgbView<'_>, [u, v]: [u32; 2]) -> [u8; 3] {
    let row = image.row(v);
    let i = 3 * u as usize;
    [row[i], row[i + 1], row[i + 2]]
}

/// Mean colour of the square around a pixel.
fn mean_colour(image: RgbView<'_>, [u, v]: [u32; 2]) -> [f64; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for y in v.saturating_sub(PATCH_PX)..(v + PATCH_PX + 1).min(image.height()) {
        for x in u.saturating_sub(PATCH_PX)..(u + PATCH_PX + 1).min(image.width()) {
            let rgb = pixel(image, [x, y]);
            (0..3).for_each(|c| sum[c] += f64::from(rgb[c]));
            count += 1.0;
        }
    }
    sum.map(|s| s / count)
}

/// Returns true if a pixel may be the same thing as the click, in another light.
fn is_same(seed: [f64; 3], rgb: [u8; 3]) -> bool {
    let rgb = rgb.map(f64::from);
    let norm = |c: [f64; 3]| c.iter().map(|v| v * v).sum::<f64>().sqrt();
    let (a, b) = (norm(seed), norm(rgb));
    let dot: f64 = seed.iter().zip(rgb).map(|(x, y)| x * y).sum();
    b >= SAME_LIGHT[0] * a && b <= SAME_LIGHT[1] * a && dot >= SAME_ANGLE_RAD.cos() * a * b
}

/// Hue in degrees, saturation and chroma of a pixel, as [`ColourRange`] defines them.
fn look(rgb: [u8; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(f64::from);
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let hue = (3f64.sqrt() * (g - b)).atan2(2.0 * r - g - b).to_degrees();
    [hue, if most > 0.0 { (most - least) / most } else { 0.0 }, most - least]
}

fn sorted(looks: &[[f64; 3]], part: usize) -> Vec<f64> {
    let mut values: Vec<f64> = looks.iter().map(|l| l[part]).collect();
    values.sort_by(f64::total_cmp);
    values
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[(share * (sorted.len() - 1) as f64).round() as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::{ColourParams, ColourSegmenter, Segmenter};
    use catenary_core::LabelMask;
    use catenary_core::image::label;

    /// A green bar where the default colours look for a blue one.
    fn green() -> Scene {
        Scene { hue_shift_deg: -90.0, target: None, ..Scene::hanging() }
    }

    #[test]
    fn one_click_gives_colours_that_find_the_whole_bar() {
        let image = green().image(4);
        let marked = pixels_of_clicks(image.view(), &[[361, 249]]).unwrap();
        let fit = fit_colours(image.view(), &marked).unwrap();
        let params = ColourParams { dlo: fit.range, target: ColourParams::default().dlo, ..ColourParams::default() };
        let mut mask = LabelMask::new(1, 1);
        ColourSegmenter::new(params).unwrap().segment(image.view(), &mut mask).unwrap();
        let truth = green().truth();
        let count = |test: fn(bool, bool) -> bool| {
            let pairs = mask.data.iter().zip(&truth.data);
            pairs.filter(|&(&a, &b)| test(a == label::DLO, b == label::DLO)).count() as f64
        };
        let iou = count(|a, b| a && b) / count(|a, b| a || b);
        assert!(iou > 0.85, "IoU {iou:.3} with {fit:?}");
        // The edge of a bar of eight pixels is mixed, and not among the pixels of the click.
        assert!(fit.found > 0.9 && fit.false_share < 0.15, "{fit:?}");
    }

    #[test]
    fn a_click_and_labels_give_the_same_colour_of_a_grey_object_too() {
        let image = green().image(4);
        for click in [[361, 249], [294, 120]] {
            let marked = pixels_of_clicks(image.view(), &[click]).unwrap();
            let (a, b) =
                (colour_of_clicks(image.view(), &[click]).unwrap(), colour_of_labels(image.view(), &marked).unwrap());
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.15), "{a:?} {b:?}");
        }
        assert!(matches!(colour_of_clicks(image.view(), &[]), Err(Error::Click { .. })));
        assert!(matches!(colour_of_clicks(image.view(), &[[640, 0]]), Err(Error::Click { .. })));
        assert!(matches!(colour_of_labels(image.view(), &[false; 640 * 480]), Err(Error::Labels { .. })));
    }

    #[test]
    fn a_grey_object_an_empty_click_and_wrong_labels_are_refused() {
        let image = green().image(4);
        let view = image.view();
        let fitted = |clicks: &[[u32; 2]]| pixels_of_clicks(view, clicks).and_then(|marked| fit_colours(view, &marked));
        // The gripper is dark grey.
        assert!(matches!(fitted(&[[294, 120]]), Err(Error::Colourless { .. })));
        assert!(matches!(fitted(&[]), Err(Error::Click { .. })));
        let message = fitted(&[[640, 3]]).unwrap_err().to_string();
        assert_eq!(message, "click: expected u,v within the image of 640 x 480 pixels, got 640,3");
        assert!(matches!(fit_colours(view, &[true, false]), Err(Error::Labels { .. })));
        assert!(matches!(fit_colours(view, &vec![false; 640 * 480]), Err(Error::Labels { .. })));
    }
}
