//! The command line; all of it is in [`cfreg::cli`].

/// Whether the process was begun with a standard output: asked before Rust starts up, which opens
/// /dev/null in its place.
#[cfg(any(target_os = "linux", target_os = "macos"))]
mod output {
    use std::sync::atomic::{AtomicBool, Ordering};

    static CLOSED: AtomicBool = AtomicBool::new(false);

    unsafe extern "C" {
        fn fcntl(file: i32, command: i32, ...) -> i32;
    }

    extern "C" fn check_output() {
        const STDOUT: i32 = 1;
        const F_GETFD: i32 = 1;
        // SAFETY: asks for the flags of a file by its number, whether there is one or not.
        CLOSED.store(unsafe { fcntl(STDOUT, F_GETFD) } == -1, Ordering::Relaxed);
    }

    // SAFETY: functions in this section are called once, before main, with no thread beside.
    #[used]
    #[cfg_attr(target_os = "linux", unsafe(link_section = ".init_array"))]
    #[cfg_attr(target_os = "macos", unsafe(link_section = "__DATA,__mod_init_func"))]
    static BEFORE_MAIN: extern "C" fn() = check_output;

    pub fn is_open() -> bool {
        !CLOSED.load(Ordering::Relaxed)
    }
}

#[cfg(not(any(target_os = "linux", target_os = "macos")))]
mod output {
    pub fn is_open() -> bool {
        true
    }
}

fn main() -> std::process::ExitCode {
    cfreg::cli::main(output::is_open())
}
