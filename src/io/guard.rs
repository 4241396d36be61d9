//! A guard around crates that read formats: their panics on damaged files become errors.

use crate::par;

/// Runs work of another crate; a panic becomes its message, and is not printed.
pub(super) fn guard<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    par::catch_panic(work).map_err(|panic| par::panic_text(panic.as_ref()).to_string())
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
