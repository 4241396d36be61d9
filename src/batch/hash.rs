//! Numbers that tell what a run was given from what another was.

/// FNV-1a, 64 bits: the same on every machine, and no proof against malice.
pub(super) struct Hash(u64);

impl Default for Hash {
    fn default() -> Self {
        Hash(0xcbf2_9ce4_8422_2325)
    }
}

impl Hash {
    fn byte(&mut self, byte: u8) {
        self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
    }

    /// That of these bytes.
    pub(super) fn of(bytes: &[u8]) -> u64 {
        let mut hash = Hash::default();
        hash.bytes(bytes);
        hash.value()
    }

    /// Adds bytes. Those of one length that differ in one byte have different numbers.
    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.byte(byte));
    }

    /// Adds a text, and that it ends.
    pub(super) fn add(&mut self, text: &str) {
        self.bytes(text.as_bytes());
        // In no UTF-8.
        self.byte(0xff);
    }

    /// Adds the bits of a number.
    pub(super) fn number(&mut self, number: f64) {
        number.to_bits().to_le_bytes().into_iter().for_each(|byte| self.byte(byte));
    }

    pub(super) fn value(&self) -> u64 {
        self.0
    }
}
