//! Hashes that identify the inputs of a run.

/// FNV-1a, 64 bits: the same on every machine, and not secure against malice.
pub(super) struct Fnv1a(u64);

impl Default for Fnv1a {
    fn default() -> Self {
        Fnv1a(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv1a {
    fn add_byte(&mut self, byte: u8) {
        self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
    }

    /// Returns the hash of these bytes.
    pub(super) fn hash_bytes(bytes: &[u8]) -> u64 {
        let mut hash = Fnv1a::default();
        hash.add_bytes(bytes);
        hash.value()
    }

    /// Adds bytes. Inputs of one length that differ in one byte have different hashes.
    pub(super) fn add_bytes(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.add_byte(byte));
    }

    /// Adds a text and a terminator.
    pub(super) fn add_text(&mut self, text: &str) {
        self.add_bytes(text.as_bytes());
        // This byte is in no UTF-8.
        self.add_byte(0xff);
    }

    /// Adds the bits of a number.
    pub(super) fn add_number(&mut self, number: f64) {
        number.to_bits().to_le_bytes().into_iter().for_each(|byte| self.add_byte(byte));
    }

    pub(super) fn value(&self) -> u64 {
        self.0
    }
}
