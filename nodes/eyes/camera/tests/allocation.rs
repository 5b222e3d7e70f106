//! Segmentation allocates nothing after the first frame: a camera node runs for hours beside a real-time arm.
#![allow(unsafe_code, reason = "a counting allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use camera::{ColourParams, ColourSegmenter, Segmenter};
use catenary_core::LabelMask;

#[path = "../src/scene.rs"]
mod scene;

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
fn segments_without_allocating_once_warm() {
    let image = scene::Scene::hanging().image(1);
    let mut segmenter = ColourSegmenter::new(ColourParams::default()).unwrap();
    let mut mask = LabelMask::new(256, 256);
    segmenter.segment(image.view(), &mut mask).unwrap();
    let before = ALLOCATIONS.with(Cell::get);
    for _ in 0..3 {
        let report = segmenter.segment(image.view(), &mut mask).unwrap();
        assert_eq!(report.dlo_pieces, 2, "the walk over the occluder is part of the test");
    }
    assert_eq!(ALLOCATIONS.with(Cell::get) - before, 0);
}
