//! Tracking allocates nothing after the first frames: a tracker node runs for hours beside a real-time arm.
#![allow(unsafe_code, reason = "a counting allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use catenary_core::image::label;
use keypoint_tracker::{Backend, TrackingParams};

#[path = "../src/drawing.rs"]
mod drawing;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is passed on to the system allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|n| n.set(n.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn tracks_without_allocating_once_warm() {
    let line = drawing::curved([60.0, 100.0], -0.8, 140.0, |s| if s < 70.0 { 0.03 } else { -0.03 });
    let mut mask = drawing::mask_of(&line, 2.15);
    mask.data.chunks_exact_mut(256).for_each(|row| row[80..92].fill(label::BACKGROUND));
    drawing::draw_disc(&mut mask, line[line.len() - 1], 8.0, label::TARGET);
    for backend in Backend::ALL {
        let mut tracker = TrackingParams { backend, ..TrackingParams::default() }.build().unwrap();
        let first = tracker.track(&mask).unwrap();
        let is_seen = first.dlo_seen() || backend != Backend::Geometric;
        assert!(is_seen && first.target_score < 1.0, "a gap and a hidden target are part of the test: {first:?}");
        // Buffers are swapped, so that it takes some frames until each has grown.
        for _ in 0..4 {
            tracker.track(&mask).unwrap();
        }
        let before = ALLOCATIONS.with(Cell::get);
        for _ in 0..3 {
            assert_eq!(tracker.track(&mask), Ok(first));
        }
        assert_eq!(ALLOCATIONS.with(Cell::get) - before, 0, "{backend:?}");
    }
}
