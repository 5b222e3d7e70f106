//! Draws training pictures of the learned segmenter on a sheet: `draw_pictures OUT.ppm`. Labels are below their pictures.
#![allow(clippy::print_stdout, clippy::disallowed_methods, clippy::unwrap_used, reason = "an example")]

use camera::learned::SIDE;
use camera::learned::generator::Picture;
use catenary_core::seed;

const COLUMNS: usize = 6;
const ROWS: usize = 3;

fn main() {
    let width = COLUMNS * SIDE;
    let mut sheet = vec![0_u8; 3 * width * 2 * ROWS * SIDE];
    let mut put = |u: usize, v: usize, rgb: [u8; 3]| sheet[3 * (v * width + u)..][..3].copy_from_slice(&rgb);
    for n in 0..COLUMNS * ROWS {
        let picture = Picture::draw(&mut seed::rng(1, n as u64));
        let (left, top) = (n % COLUMNS * SIDE, n / COLUMNS * 2 * SIDE);
        for i in 0..SIDE * SIDE {
            let (u, v) = (left + i % SIDE, top + i / SIDE);
            put(u, v, picture.pixels[i].map(|c| (255.0 * c) as u8));
            let corner = i % SIDE < 24 && i / SIDE < 24;
            let shown = if corner {
                picture.clicked[i % SIDE / 12].map(|c| (255.0 * c) as u8)
            } else {
                [picture.labels[i] * 120; 3]
            };
            put(u, v + SIDE, shown);
        }
    }
    let mut file = format!("P6 {width} {} 255\n", 2 * ROWS * SIDE).into_bytes();
    file.extend(sheet);
    std::fs::write(std::env::args().nth(1).unwrap(), file).unwrap();
}
