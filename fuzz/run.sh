#!/usr/bin/env bash
# Runs the fuzz targets long, on all cores, and prints a table of what came of it.
#
#     fuzz/run.sh [SECONDSs | EXECUTIONS] [TARGET...]
#
# `fuzz/run.sh 600s` gives each target ten minutes; `fuzz/run.sh 10000000` gives each reader that
# many inputs and the targets that take a thousand times longer, journals and registrations, a
# hundredth. Default 60s, all targets. SANITIZER=none is twice as fast as the default, address;
# JOBS is how many run at once, default all cores.
#
# Needs the nightly toolchain and cargo-fuzz (`cargo install cargo-fuzz`). What was found is in
# fuzz/artifacts, new inputs are in fuzz/corpus; exit status 1 with a finding.
set -euo pipefail
cd "$(dirname "$0")/.."

amount="${1:-60s}"
shift || true
targets=("$@")
sanitizer="${SANITIZER:-address}"
if [ ${#targets[@]} = 0 ]; then
    mapfile -t targets < <(sed -n 's/^name = "\(.*\)"/\1/p' fuzz/Cargo.toml | grep -v cfreg-fuzz)
fi

cargo +nightly fuzz build --sanitizer "$sanitizer" >&2
host="$(rustc -vV | sed -n 's/^host: //p')"
binaries="${CARGO_TARGET_DIR:-fuzz/target}/$host/release"
logs="$(mktemp -d)"
export CFREG_FUZZ_FOLDER="$(mktemp -d -p "$([ -d /dev/shm ] && echo /dev/shm || echo /tmp)")"
trap 'rm -rf "$logs" "$CFREG_FUZZ_FOLDER"' EXIT
export ASAN_OPTIONS="detect_odr_violation=0:allocator_may_return_null=1:${ASAN_OPTIONS:-}"

one() {
    local target="$1" limit
    case "$amount" in
        *s) limit="-max_total_time=${amount%s}" ;;
        *) case "$target" in
            journal | registration) limit="-runs=$((amount / 100))" ;;
            *) limit="-runs=$amount" ;;
        esac ;;
    esac
    mkdir -p "fuzz/corpus/$target" "fuzz/artifacts/$target"
    "$binaries/$target" "fuzz/corpus/$target" "fuzz/seeds/$target" "$limit" -max_len=4096 \
        -len_control=20 -timeout=60 -rss_limit_mb=4096 -print_final_stats=1 \
        -artifact_prefix="fuzz/artifacts/$target/" >"$logs/$target" 2>&1 ||
        { echo found >"$logs/$target.found"; grep -m1 -E 'panicked|ERROR|SUMMARY' -A1 "$logs/$target" >&2 || true; }
}
export -f one
export amount binaries logs
printf '%s\n' "${targets[@]}" | xargs -P "${JOBS:-$(nproc)}" -I{} bash -c 'one {}'

figure() { sed -n "s/^stat::$2: *//p" "$logs/$1" | tail -1; }
total=0 found=0
printf '| target | inputs | a second | peak MB | findings |\n|---|---|---|---|---|\n'
for target in "${targets[@]}"; do
    inputs="$(figure "$target" number_of_executed_units)"
    findings=0
    [ -e "$logs/$target.found" ] && findings=1 && found=1
    printf '| %s | %s | %s | %s | %s |\n' "$target" "$inputs" \
        "$(figure "$target" average_exec_per_sec)" "$(figure "$target" peak_rss_mb)" "$findings"
    total=$((total + ${inputs:-0}))
done
printf '\n%s inputs in all, sanitizer %s\n' "$total" "$sanitizer"
exit "$found"
