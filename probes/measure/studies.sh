#!/usr/bin/env bash
# Every study of a record: what accuracy costs, for two fields and the real volumes that are there.
#
#   probes/measure/studies.sh DIR [DATA]
#
# DATA holds volumes/ [../shared/data]. Writes DIR/NAME/study.{csv,json,svg} and DIR/NAME/study.txt, what was printed.
set -euo pipefail
out=${1:?give the folder of the record}
data=${2:-../shared/data}
cargo build --release --locked
study() {
  local name=$1 input=$2
  shift 2
  if [[ $input != *:* && ! -f $input ]]; then
    echo "$name: no $input, left out"
    return
  fi
  mkdir -p "$out/$name"
  echo "$name"
  target/release/isolume study "$input" "$@" --env courtyard -o "$out/$name" >"$out/$name/study.txt"
}
study bumpbox bumpbox:96
study gyroid gyroid:64 --isovalue 0 --most-rays 128
study mni152_t1 "$data/volumes/mni152_t1.nii.gz" --isovalue 90 --most-rays 128
study caffeine_density "$data/volumes/caffeine_density.nrrd" --isovalue 0.05
study purkinje_neuron "$data/volumes/purkinje_neuron.nrrd" --isovalue 45 --most-rays 128
