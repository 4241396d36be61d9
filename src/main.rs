//! The command line; all of it is in [`cfreg::cli`].

fn main() -> std::process::ExitCode {
    cfreg::cli::main()
}
