//! An allocator that counts, and the bound on the memory that reading may take.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Bytes of memory for each byte of a file that is read, the file itself counted.
const TIMES: usize = 10;
/// Bytes above the bound at which memory is refused, which ends the process: a test that would
/// take the whole machine down tells nobody what it found.
const REFUSED: usize = 1 << 30;

thread_local! {
    /// Bytes that this thread has taken and not given back since [`bounded`] began.
    static NOW: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
    static BOUND: Cell<Option<usize>> = const { Cell::new(None) };
}

/// Counts what each thread allocates.
struct Counting;

#[global_allocator]
static MEMORY: Counting = Counting;

impl Counting {
    /// Whether so many bytes more may be had.
    fn take(&self, bytes: usize) -> bool {
        let now = NOW.get().saturating_add_unsigned(bytes);
        if let Some(bound) = BOUND.get().filter(|bound| now > (bound + REFUSED) as isize) {
            BOUND.set(None);
            eprintln!("{bytes} bytes are asked for at once where {bound} are allowed in all");
            return false;
        }
        NOW.set(now);
        PEAK.set(PEAK.get().max(now));
        true
    }

    fn give(&self, bytes: usize) {
        NOW.set(NOW.get().saturating_sub_unsigned(bytes));
    }
}

// SAFETY: all memory is that of `System`, by the same layouts; what is added counts.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if !self.take(layout.size()) {
            return std::ptr::null_mut();
        }
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if !self.take(layout.size()) {
            return std::ptr::null_mut();
        }
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        self.give(layout.size());
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both are there while one is copied to the other.
        if !self.take(size) {
            return std::ptr::null_mut();
        }
        self.give(layout.size());
        unsafe { System.realloc(memory, layout, size) }
    }
}

/// Does work on an input of so many bytes.
///
/// # Panics
/// When this thread holds more than ten times the input and `beside` at once.
pub(crate) fn bounded<T>(input: usize, beside: usize, work: impl FnOnce() -> T) -> T {
    let bound = TIMES * input + beside;
    NOW.set(0);
    PEAK.set(0);
    BOUND.set(Some(bound));
    let done = work();
    BOUND.set(None);
    let peak = PEAK.get();
    assert!(peak <= bound as isize, "{peak} bytes of memory for {input} of input, {bound} allowed");
    done
}
