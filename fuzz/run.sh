#!/bin/sh
# Runs each target for SECONDS, starting from its seeds, its regressions and its corpus; stops at
# the first crash.
#
# usage: fuzz/run.sh SECONDS [TARGET ...]
set -eu
seconds=${1:?usage: fuzz/run.sh SECONDS [TARGET ...]}
shift
cd "$(dirname "$0")"
[ $# -gt 0 ] || set -- open_verify decode_tile encode_decode compress_croquet compress_lookahead \
    compress_minimal deep_exr load_object
# No sanitizer by default: almost all of the code under test is safe Rust. Set
# FUZZ_SANITIZER=address to check the C codecs.
cargo +nightly fuzz build --fuzz-dir . -s "${FUZZ_SANITIZER:-none}"
for target; do
    # The checks do not use longer inputs.
    case $target in compress_* | encode_decode) len=512 ;; *) len=4096 ;; esac
    mkdir -p "corpus/$target" "artifacts/$target"
    echo "== $target for $seconds s"
    if ! cargo +nightly fuzz run --fuzz-dir . -s "${FUZZ_SANITIZER:-none}" "$target" \
        "corpus/$target" "seeds/$target" "regressions/$target" -- \
        -max_total_time="$seconds" -max_len="$len" -rss_limit_mb=2048 -timeout=10 \
        -print_final_stats=1 >"artifacts/$target/log" 2>&1; then
        tail -n 60 "artifacts/$target/log"
        echo "FAILED: $target; the input is in fuzz/artifacts/$target" >&2
        exit 1
    fi
    grep -E "number_of_executed|average_exec" "artifacts/$target/log"
done
