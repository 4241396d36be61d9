//! A guard around crates that read formats: their panics on damaged files become errors.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs work of another crate; a panic becomes its message.
pub(super) fn guard<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic").to_string()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_become_messages() {
        assert_eq!(guard(|| 3), Ok(3));
        let numbers: Vec<usize> = Vec::new();
        assert!(guard(|| numbers[1]).unwrap_err().contains("index"));
    }
}
