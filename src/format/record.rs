//! Little-endian numbers and fixed-size records.
//!
//! A type that is stored as a record lists its fields once. [`Record`] reads or writes them.

/// A number, or an array of numbers, as the file stores it.
pub(super) trait Number: Copy {
    /// The number in the first bytes.
    fn read(bytes: &[u8]) -> Self;
    /// Writes the number to the first bytes.
    fn write(self, bytes: &mut [u8]);
    /// Appends the bytes of the number.
    fn append(self, out: &mut Vec<u8>) {
        let at = out.len();
        out.resize(at + size_of::<Self>(), 0);
        self.write(&mut out[at..]);
    }
}

macro_rules! numbers {
    ($($number:ty)*) => {$(
        impl Number for $number {
            #[inline]
            fn read(bytes: &[u8]) -> Self {
                let bytes = bytes.first_chunk().expect("the record holds the field");
                <$number>::from_le_bytes(*bytes)
            }

            #[inline]
            fn write(self, bytes: &mut [u8]) {
                bytes[..size_of::<Self>()].copy_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}

numbers!(u8 u16 u32 u64 i32 i64 f32 f64);

impl<T: Number, const N: usize> Number for [T; N] {
    #[inline]
    fn read(bytes: &[u8]) -> Self {
        std::array::from_fn(|i| T::read(&bytes[i * size_of::<T>()..]))
    }

    #[inline]
    fn write(self, bytes: &mut [u8]) {
        for (number, bytes) in self.into_iter().zip(bytes.chunks_mut(size_of::<T>())) {
            number.write(bytes);
        }
    }
}

/// The bytes of a record that is being read or written.
pub(super) enum Record<'a> {
    Read(&'a [u8]),
    Write(&'a mut [u8]),
}

impl Record<'_> {
    /// Reads the field at `offset` into `value`, or writes `value` to it.
    #[inline]
    pub fn field<T: Number>(&mut self, offset: usize, value: &mut T) {
        match self {
            Record::Read(bytes) => *value = T::read(&bytes[offset..]),
            Record::Write(bytes) => value.write(&mut bytes[offset..]),
        }
    }
}
