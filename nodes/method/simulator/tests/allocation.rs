//! Allocation: a beam allocates nothing after it was made.

use catenary_core::Fidelity;
use catenary_core::model::{AxialLaw, Section};
use catenary_simulator::beam::{Beam, BeamParameters, Discretisation, GripState, Table};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Number of blocks that this thread has allocated.
    static TAKEN: Cell<u64> = const { Cell::new(0) };
}

/// System allocator that counts blocks by thread.
struct Counting;

// SAFETY: every call goes to the system's allocator as it came; the counter takes no memory.
#[allow(unsafe_code, reason = "an allocator is unsafe by its trait; this one only counts")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        TAKEN.with(|taken| taken.set(taken.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static MEMORY: Counting = Counting;

fn taken_by(work: impl FnOnce()) -> u64 {
    let before = TAKEN.with(Cell::get);
    work();
    TAKEN.with(Cell::get) - before
}

/// Makes a bar with every parameter of the beam in use.
fn bar(length_m: f64) -> BeamParameters {
    BeamParameters {
        axial_law: AxialLaw::NeoHookean,
        kelvin_voigt_time_s: 0.02,
        creep_fraction: 0.2,
        sticking_stiffness_n_m2: 1e-4,
        slip_moment_n_m: 1e-4,
        linear_drag_n_s_m2: 1e-3,
        quadratic_drag_n_s2_m3: 1e-3,
        rest_curvature_per_m: 0.5,
        grip_compliance_rad_n_m: 1.0,
        grip_slip_m_s: 1e-4,
        overhang_m: 0.01,
        table: Some(Table { adhesion_n_m: 0.05, ..Table::new(0.0, 0.5) }),
        ..BeamParameters::from_youngs_modulus(length_m, Section::Square { side_m: 0.015 }, 1055.0, 1e4, 0.45)
    }
}

/// Path of the grip down to the table and along it.
fn grip(time_s: f64) -> GripState {
    GripState { x_m: 0.4 + 0.05 * time_s, z_m: 0.25 - 0.1 * time_s.min(1.0), tangent_rad: 0.0 }
}

#[test]
fn the_counter_counts() {
    assert_eq!(taken_by(|| drop(std::hint::black_box(Box::new(1_u64)))), 1);
}

#[test]
fn a_beam_starts_moves_and_starts_again_in_the_memory_it_was_made_with() {
    let mut beam = Beam::new(bar(0.2), Discretisation::of(Fidelity::Standard), grip(0.0)).unwrap();
    let taken = taken_by(|| {
        for length_m in [0.2, 0.3] {
            beam.reset(bar(length_m), grip(0.0)).unwrap();
            assert!(beam.hang_at_rest(grip(0.0)).converged);
            beam.advance_to(2.0, grip);
        }
    });
    assert!(beam.table_force().normal_n > 0.0, "the bar lies on the table");
    assert_eq!(taken, 0);
}

#[test]
fn neighbours_go_in_step_without_memory() {
    let at = Discretisation::of(Fidelity::Fast);
    let mut beams = [0.2, 0.2 + 1e-9].map(|length_m| {
        let mut beam = Beam::new(bar(length_m), at, grip(0.0)).unwrap();
        assert!(beam.hang_at_rest(grip(0.0)).converged);
        beam
    });
    let [first, other] = &mut beams;
    let mut neighbours = [other];
    assert_eq!(taken_by(|| first.advance_with(&mut neighbours, 1.0, |_, time_s| grip(time_s))), 0);
}
