//! The command line; all of it is in [`cfreg::cli`].

use cfreg::experiment::scaling::Meter;
use peak_alloc::PeakAlloc;

/// Counts what is allocated, for `cfreg reproduce` to tell what a method holds. Resident
/// memory would not do: it keeps what an earlier run has freed. A count an allocation costs
/// nothing beside what methods do between two of them.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

fn main() -> std::process::ExitCode {
    let start = || {
        MEMORY.reset_peak_usage();
        MEMORY.current_usage()
    };
    cfreg::cli::main(Some(Meter { start, peak: || MEMORY.peak_usage() }))
}
