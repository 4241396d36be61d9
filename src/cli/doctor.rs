//! `cfreg doctor`: what a report of a fault should say of the program and the machine.

use super::{CommandOutcome, print};
use crate::error::Result;
use crate::verify::VerdictModel;

/// Prints one line for each property of the program and the machine.
pub(super) fn run() -> Result<CommandOutcome> {
    let lines = [
        ("cfreg", env!("CARGO_PKG_VERSION").to_string()),
        ("verdict model", VerdictModel::built_in().version.clone()),
        ("built for", format!("{} {}", std::env::consts::ARCH, std::env::consts::OS)),
        ("optimised", (!cfg!(debug_assertions)).to_string()),
        ("vector instructions", vector_instructions()),
        ("processors", processors()),
        ("memory", memory()),
    ];
    let line = |(name, value): &(&str, String)| format!("{:<21}{value}\n", format!("{name}:"));
    print(&lines.iter().map(line).collect::<String>())?;
    Ok(CommandOutcome::Trusted)
}

/// Returns the instructions that matrix products and descriptors use here.
fn vector_instructions() -> String {
    #[cfg(target_arch = "x86_64")]
    {
        let found = [
            ("avx512f", std::arch::is_x86_feature_detected!("avx512f")),
            ("avx2", std::arch::is_x86_feature_detected!("avx2")),
            ("fma", std::arch::is_x86_feature_detected!("fma")),
        ];
        let names: Vec<&str> =
            found.into_iter().filter_map(|(name, has)| has.then_some(name)).collect();
        if names.is_empty() { "sse2".into() } else { names.join(" ") }
    }
    #[cfg(not(target_arch = "x86_64"))]
    "those of the architecture".into()
}

/// Returns the number of threads that the process may run at once.
fn processors() -> String {
    std::thread::available_parallelism().map_or("unknown".into(), |count| count.to_string())
}

/// Returns the memory of the machine, as far as the system says.
fn memory() -> String {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let kilobytes = |name: &str| -> Option<f64> {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim_start_matches(':').split_whitespace().next()?.parse().ok()
    };
    match (kilobytes("MemTotal"), kilobytes("MemAvailable")) {
        (Some(all), Some(free)) => {
            format!("{:.1} GiB, {:.1} GiB available", all / 1048576.0, free / 1048576.0)
        }
        _ => "unknown".into(),
    }
}
