//! Benchmark of one episode: 8 s, 16 moves of the grip, table contact. The throughput is in episodes per core-second.

use std::hint::black_box;

use catenary_core::Fidelity;
use catenary_core::model::{AxialLaw, Section};
use catenary_simulator::beam::{Beam, BeamParameters, Discretisation, GripState, Table};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

#[path = "../src/beam/tests/episode.rs"]
mod episode;

/// Number of episodes in a batch, with bars from the whole prior.
const BATCH: u64 = 8;

fn parameters(index: u64) -> BeamParameters {
    let [length_m, youngs_modulus_pa, friction, kelvin_voigt_time_s] = episode::draw(index);
    BeamParameters {
        axial_law: AxialLaw::NeoHookean,
        kelvin_voigt_time_s,
        table: Some(Table::new(0.0, friction)),
        ..BeamParameters::from_youngs_modulus(
            length_m,
            Section::Square { side_m: 0.015 },
            1055.0,
            youngs_modulus_pa,
            0.45,
        )
    }
}

fn episodes(c: &mut Criterion) {
    let paths: Vec<_> = (0..BATCH).map(episode::grip_path).collect();
    let mut group = c.benchmark_group("episode");
    group.throughput(Throughput::Elements(BATCH)).sample_size(10);
    for fidelity in [Fidelity::Fast, Fidelity::Standard, Fidelity::Reference] {
        let discretisation = Discretisation::of(fidelity);
        let mut beam = Beam::new(parameters(0), discretisation, GripState::default()).expect("the bars are in range");
        group.bench_function(fidelity.name(), |b| {
            b.iter(|| {
                for (index, path) in (0..BATCH).zip(&paths) {
                    let at = |time_s: f64| GripState::from_pose(path.at(time_s), 0.0);
                    beam.reset(parameters(index), at(0.0)).expect("the bars are in range");
                    let _shape = beam.hang_at_rest(at(0.0));
                    beam.advance_to(episode::DURATION_S, at);
                    black_box(beam.tip());
                }
            })
        });
    }
}

criterion_group!(benches, episodes);
criterion_main!(benches);
