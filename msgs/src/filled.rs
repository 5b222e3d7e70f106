//! `Filled` for the primitives.

use crate::Filled;

fn next(counter: &mut u32) -> u32 {
    *counter += 1;
    *counter
}

macro_rules! whole {
    ($($t:ty),*) => {$(
        impl Filled for $t {
            fn filled(counter: &mut u32) -> Self {
                (next(counter) % 100) as $t
            }
        }
    )*};
}

whole!(u8, i8, u16, i16, u32, i32, u64, i64);

impl Filled for bool {
    fn filled(counter: &mut u32) -> Self {
        next(counter) % 2 == 1
    }
}

impl Filled for f32 {
    fn filled(counter: &mut u32) -> Self {
        next(counter) as f32 + 0.5
    }
}

impl Filled for f64 {
    fn filled(counter: &mut u32) -> Self {
        f64::from(next(counter)) + 0.5
    }
}

impl Filled for String {
    fn filled(counter: &mut u32) -> Self {
        format!("s{}", next(counter))
    }
}
