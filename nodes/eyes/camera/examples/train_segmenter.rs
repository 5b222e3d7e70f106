//! Trains the learned segmenter: `train_segmenter STEPS OUT`. Writes weights (little-endian f32) and some pictures.
#![allow(clippy::print_stdout, clippy::disallowed_methods, clippy::unwrap_used, reason = "an example")]

use camera::learned::{SHIPPED_TRAINING, Start, TrainingSettings, train};
use std::time::Instant;

fn main() {
    let mut words = std::env::args().skip(1);
    let steps = words.next().unwrap().parse().unwrap();
    let out = words.next().unwrap();
    let began = Instant::now();
    let (mut sum, mut count) = (0.0, 0);
    let settings = TrainingSettings { steps, ..SHIPPED_TRAINING };
    let weights = train(&settings, Start::Random, &[], |p| {
        sum += p.loss;
        count += 1;
        if p.step % 100 == 0 {
            println!("step {} loss {:.4} {:.0} s", p.step, sum / f64::from(count), began.elapsed().as_secs_f64());
            (sum, count) = (0.0, 0);
        }
        true
    })
    .unwrap();
    let bytes = camera::learned::bytes_of(&weights);
    std::fs::write(out, bytes).unwrap();
}
