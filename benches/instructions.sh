#!/usr/bin/env bash
# Instructions (Ir) per call of the filter's parts, by callgrind: independent of load and clock, so that they can be held to.
# With --check, anything more than a tenth above what is written here fails.
set -euo pipefail
cd "$(dirname "$0")/.."

# part, states (of noise identification: unknowns, or lags of streaming sums), instructions when last measured (rustc 1.95, plain
# x86-64); als_batch is a record of 20 000 samples, once, ahrs_record one sample of a thousand
counts=(
    "propagate 15 6144"
    "propagate 21 10559"
    "update 15 3537"
    "update 21 5559"
    "dynamics 15 912"
    "step 15 8151"
    "step 21 13600"
    "fix 15 5280"
    "als_general 9 170968"
    "als_channel 3 3155"
    "als_stream 13 126"
    "als_batch 3 19083504"
    "ahrs_record 21 2653"
)

if ! command -v valgrind >/dev/null; then
    echo "SKIPPED: instruction counts: no valgrind here"
    exit 0
fi

bench=$(cargo bench --bench instructions --no-run --message-format=json 2>/dev/null |
    sed -n 's/.*"executable":"\([^"]*instructions-[^"]*\)".*/\1/p')
out=$(mktemp)
trap 'rm -f "$out" "$out.callgrind"' EXIT
status=0
for line in "${counts[@]}"; do
    read -r part states expected <<<"$line"
    valgrind --tool=callgrind --callgrind-out-file="$out.callgrind" --collect-atstart=no \
        --toggle-collect="*counted_$part*" "$bench" "$part" "$states" >"$out" 2>&1 || { cat "$out"; exit 1; }
    calls=1000
    [ "$part" = als_batch ] && calls=1
    ir=$(($(sed -n 's/.*Collected : \([0-9]*\).*/\1/p' "$out") / calls))
    printf '%-11s %2d %9d Ir (%d)\n' "$part" "$states" "$ir" "$expected"
    if [ "${1:-}" = --check ] && [ $((ir * 10)) -gt $((expected * 11)) ]; then
        echo "  more than a tenth above"
        status=1
    fi
done
exit $status
