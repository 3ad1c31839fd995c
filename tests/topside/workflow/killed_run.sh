#!/usr/bin/env bash
# Kills a run at random moments, then lets it end: killed_run.sh PROGRAM MISSION FOLDER [KILLS] [SEED] [RUN-OPTIONS...]
# Tells the stage at each moment and compares the files with those of a run that nobody disturbed.
set -euo pipefail
program=$1 mission=$2 folder=$(realpath -m "$3") kills=${4:-10} seed=${5:-1}
shift $(($# < 5 ? $# : 5))
rm -rf "$folder"
mkdir -p "$folder"
begun=$(date +%s%N)
"$program" run "$mission" --out "$folder/whole" --work "$folder/whole.work" "$@" 2>/dev/null | tee "$folder/whole.txt"
whole_ms=$((($(date +%s%N) - begun) / 1000000))
RANDOM=$seed
for kill in $(seq "$kills"); do
  "$program" run "$mission" --out "$folder/killed" --work "$folder/killed.work" "$@" >"$folder/log" 2>&1 &
  pid=$!
  delay_ms=$((RANDOM * 32768 + RANDOM))
  delay_ms=$((100 + delay_ms % (whole_ms / kills)))
  sleep "$(printf '%d.%03d' $((delay_ms / 1000)) $((delay_ms % 1000)))"
  kill -KILL "$pid" 2>/dev/null || true
  wait "$pid" 2>/dev/null || true
  files=$(find "$folder/killed.work" -name '*.work' | wc -l)
  printf 'kill %2d after %6d ms: %3d results kept; %s\n' "$kill" "$delay_ms" "$files" "$(tail -n 1 "$folder/log")"
done
"$program" run "$mission" --out "$folder/killed" --work "$folder/killed.work" "$@" 2>/dev/null | tee "$folder/killed.txt"
diff -rq --exclude=report.json --exclude=report.html "$folder/whole" "$folder/killed"
[ "$(grep ^content "$folder/whole.txt")" = "$(grep ^content "$folder/killed.txt")" ]
echo "the same files after $kills kills"
