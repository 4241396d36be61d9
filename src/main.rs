//! The command line, implemented in [`cfreg::cli`].

/// Checks whether the process started with a standard output. The check runs before Rust's startup,
/// which opens /dev/null in its place.
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
        // SAFETY: reads the flags of a file by its number, which need not be open.
        CLOSED.store(unsafe { fcntl(STDOUT, F_GETFD) } == -1, Ordering::Relaxed);
    }

    // SAFETY: functions in this section are called once, before main, with no other thread.
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
