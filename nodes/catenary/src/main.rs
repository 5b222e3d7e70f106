//! The program `catenary`: see the library of the same name.

use std::process::ExitCode;

/// Allocator that returns unused memory to the system. The heap of glibc's allocator shrinks only at its end: with it, a
/// recorder of images and states of many sizes grew by a megabyte every few minutes at constant use.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    catenary::main()
}
