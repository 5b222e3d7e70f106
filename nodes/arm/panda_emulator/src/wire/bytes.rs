//! Little-endian numbers in packed bytes.

/// Reader of a packed structure whose length was checked before.
///
/// Reads beyond the end give zeros; callers compare the length with the layout first.
pub struct Reader<'a> {
    bytes: &'a [u8],
}

impl<'a> Reader<'a> {
    /// Reader at the first byte.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        match self.bytes.split_first_chunk::<N>() {
            Some((head, rest)) => {
                self.bytes = rest;
                *head
            }
            None => {
                self.bytes = &[];
                [0; N]
            }
        }
    }

    /// Next u8.
    pub fn u8(&mut self) -> u8 {
        u8::from_le_bytes(self.take())
    }

    /// Next u16.
    pub fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }

    /// Next u32.
    pub fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    /// Next i32.
    pub fn i32(&mut self) -> i32 {
        i32::from_le_bytes(self.take())
    }

    /// Next u64.
    pub fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }

    /// Next C++ bool: every value but 0 is true.
    pub fn bool(&mut self) -> bool {
        self.u8() != 0
    }

    /// Next f64 values.
    pub fn f64s<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| f64::from_le_bytes(self.take()))
    }
}

/// Writer into a buffer of fixed size. It allocates nothing.
///
/// Values beyond the end of the buffer are dropped; a test compares [`Self::position`] with the size of each layout.
pub struct Writer<'a> {
    bytes: &'a mut [u8],
    position: usize,
}

impl<'a> Writer<'a> {
    /// Writer at the first byte.
    pub fn new(bytes: &'a mut [u8]) -> Self {
        Self { bytes, position: 0 }
    }

    /// Bytes written.
    pub fn position(&self) -> usize {
        self.position
    }

    /// Writes bytes.
    pub fn put(&mut self, bytes: &[u8]) {
        if let Some(place) = self.bytes.get_mut(self.position..self.position + bytes.len()) {
            place.copy_from_slice(bytes);
        }
        self.position += bytes.len();
    }

    /// Writes each flag as a byte 0 or 1.
    pub fn flags(&mut self, flags: &[bool]) {
        flags.iter().for_each(|flag| self.put(&[u8::from(*flag)]));
    }
}
