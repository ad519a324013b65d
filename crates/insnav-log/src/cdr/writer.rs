//! The writing cursor.

/// Order of the bytes of a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Endian {
    /// Least significant byte first: what every common machine writes.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

/// Writes fields one after the other into the bytes of one message; [`CdrWriter::clear`] makes it ready for the next.
#[derive(Clone, Debug)]
pub struct CdrWriter {
    message: Vec<u8>,
    endian: Endian,
}

macro_rules! scalar {
    ($(#[$doc:meta])* $name:ident, $type:ty) => {
        $(#[$doc])*
        #[inline]
        pub fn $name(&mut self, value: $type) {
            self.align(size_of::<$type>());
            let bytes = match self.endian {
                Endian::Little => value.to_le_bytes(),
                Endian::Big => value.to_be_bytes(),
            };
            self.message.extend_from_slice(&bytes);
        }
    };
}

impl CdrWriter {
    /// An empty message.
    pub fn new(endian: Endian) -> Self {
        let mut writer = CdrWriter {
            message: Vec::with_capacity(512),
            endian,
        };
        writer.clear();
        writer
    }

    /// Forget the message but keep its memory.
    pub fn clear(&mut self) {
        self.message.clear();
        self.message.extend_from_slice(match self.endian {
            Endian::Little => &[0, 1, 0, 0],
            Endian::Big => &[0, 0, 0, 0],
        });
    }

    /// The message so far, with its encapsulation header.
    pub fn bytes(&self) -> &[u8] {
        &self.message
    }

    #[inline]
    fn align(&mut self, size: usize) {
        let end = (self.message.len() - 4).next_multiple_of(size) + 4;
        self.message.resize(end, 0);
    }

    scalar!(
        /// An unsigned byte.
        u8, u8
    );
    scalar!(
        /// A signed byte.
        i8, i8
    );
    scalar!(
        /// A 16-bit unsigned number.
        u16, u16
    );
    scalar!(
        /// A 32-bit signed number.
        i32, i32
    );
    scalar!(
        /// A 32-bit unsigned number.
        u32, u32
    );
    scalar!(
        /// A 32-bit floating-point number.
        f32, f32
    );
    scalar!(
        /// A 64-bit floating-point number.
        f64, f64
    );

    /// Consecutive numbers of a fixed-size array.
    pub fn f64_array(&mut self, values: &[f64]) {
        for value in values {
            self.f64(*value);
        }
    }

    /// A string with its NUL.
    pub fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.message.extend_from_slice(text.as_bytes());
        self.message.push(0);
    }

    /// The number of elements of the sequence that follows.
    pub fn sequence(&mut self, count: usize) {
        self.u32(count as u32);
    }
}
