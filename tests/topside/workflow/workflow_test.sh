#!/usr/bin/env bash
# The workflow gives the files of a run: workflow_test.sh PROGRAM SNAKEFILE MISSION FOLDER SNAKEMAKE-OPTIONS...
# With the option "slurm" as the only one: as jobs of the Slurm that SLURM_CONF names. Then nothing is left to do, until
# an image changes, or the work is gone.
set -euo pipefail
program=$1 snakefile=$2 mission=$3 folder=$(realpath -m "$4")
shift 4
command -v snakemake >/dev/null || { echo "skipped: no snakemake"; exit 77; }
rm -rf "$folder"
mkdir -p "$folder/home"
export HOME=$folder/home XDG_CACHE_HOME=$folder/home
options=("$@")
[ "${1:-}" = slurm ] && options=(--jobs 2 --latency-wait 20 --cluster
  "sbatch --parsable --cpus-per-task=1 --output=$folder/job-%j.log --export=ALL")
cp -a "$mission" "$folder/dive"
rm -rf "$folder"/dive/topside*
"$program" run "$folder/dive" --out "$folder/run" --work "$folder/run.work"
cd "$folder"
flow() {
  snakemake --snakefile "$snakefile" --directory "$folder" "${options[@]}" "$@" --config mission="$folder/dive" \
    program="$program" work="$folder/dive/flow.work" out="$folder/flow" threads=1 groups=1 pieces=2
}
flow
diff -rq --exclude=report.json --exclude=report.html "$folder/run" "$folder/flow"
echo "the same files"

# planned WHEN RULE...: the rules of the jobs that a dry run plans; without rules it plans none.
planned() {
  local plan
  plan=$(flow --dry-run 2>&1) || { echo "$plan"; exit 1; }
  for rule in "${@:2}"; do
    grep -qE "^(rule|checkpoint) $rule:" <<<"$plan" || { echo "$1: no $rule in the plan"; echo "$plan"; exit 1; }
  done
  [ $# -gt 1 ] || grep -q "Nothing to be done" <<<"$plan" || { echo "$1: there is a plan"; echo "$plan"; exit 1; }
}
planned "after a whole run"
printf x >>"$(find "$folder/dive/img" -name '*.tif' | head -n 1)"
planned "after an image changed" survey
flow 2>&1 | tee "$folder/again.txt"
grep -q "^rule piece:" "$folder/again.txt" || { echo "a changed image makes no pieces anew"; exit 1; }
planned "after that image was used"
rm -rf "$folder/dive/flow.work"
planned "without the work" survey
echo "changes and loss are noticed"
