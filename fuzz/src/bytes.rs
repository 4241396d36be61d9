//! Bytes as choices and numbers; zeros where they end.

pub(crate) struct Bytes<'a>(pub(crate) &'a [u8]);

impl Bytes<'_> {
    pub(crate) fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// From 0 to below `count`.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count
    }

    pub(crate) fn flag(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    pub(crate) fn pick<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len())]
    }

    /// From -1 to 1, in steps of 1/127.
    pub(crate) fn unit(&mut self) -> f64 {
        f64::from(self.byte() as i8).max(-127.0) / 127.0
    }

    pub(crate) fn triple(&mut self) -> [f64; 3] {
        [self.unit(), self.unit(), self.unit()]
    }

    /// The bits of any number, NaN and infinities too.
    pub(crate) fn any(&mut self) -> f64 {
        f64::from_le_bytes(std::array::from_fn(|_| self.byte()))
    }

    pub(crate) fn number(&mut self) -> u64 {
        u64::from_le_bytes(std::array::from_fn(|k| if k < 4 { self.byte() } else { 0 }))
    }
}
