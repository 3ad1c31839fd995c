#!/usr/bin/env bash
# The workflow gives the files of a run: workflow_test.sh PROGRAM SNAKEFILE MISSION FOLDER SNAKEMAKE-OPTIONS...
# With the option "slurm" as the only one: as jobs of the Slurm that SLURM_CONF names.
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
"$program" run "$mission" --out "$folder/run" --work "$folder/run.work"
cd "$folder"
snakemake --snakefile "$snakefile" --directory "$folder" "${options[@]}" --config mission="$mission" \
  program="$program" work="$folder/flow.work" out="$folder/flow" threads=1 groups=1 pieces=2
diff -rq --exclude=report.json --exclude=report.html "$folder/run" "$folder/flow"
echo "the same files"
