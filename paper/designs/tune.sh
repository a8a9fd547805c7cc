#!/usr/bin/env bash
# Make the designs of the fair comparison again, to the digit: bash paper/designs/tune.sh
#
# For each aim and budget the least ITAE, with noise or without, among designs whose noisy run spends
# at most that integral of u^2. No margin is asked for but stability: effort is what is compared.
# Takes some 15 minutes of processor time; an interrupted one goes on where it was.
set -eu
cd "$(dirname "$0")/../.."
export PATH=$PWD/.venv/bin:$PATH
work=out/designs
common=(--seeds 4 --gain-margin 1 --modulus-margin 0 --delay-margin 0)
common+=(--sampler pso --trials 400 --population 16 --seed 0)
# The designs lie well inside these ranges, but for the ends that they share with simpler observers.
# Of two levels the outer one feeds the law, as in the paper. A search over both had taken it in all
# cases but one: nonlinear_2 with noise at 4.5 took the inner one.
one=(--vary inner_bandwidth=2:100 --vary controller_bandwidth=2:200)
two=("${one[@]}" --vary outer_share=0.1:2)
more=("${two[@]}" --vary feedback_level --vary bandwidth_ratio=0.05:2)
# A cascade with a faster law has an effort that four noise sequences do not tell: its designs for 8
# and 20 spent up to 12 % more than that with others. And where CMA-ES found more than the swarm, it
# is taken, with as many trials.
calm=(--vary inner_bandwidth=2:100 --vary controller_bandwidth=2:30 --vary outer_share=0.1:2)
curved=(--vary eso_delta=1e-3:1)

# The start is what the package has by default, not what was found last time.
mkdir -p $work
numbers="    ([a-z]+_bandwidth:|bandwidth_ratio:|eso_delta:|feedback_level: '[0-9])"
grep -vE "^$numbers" config/paper_fair.yaml > $work/start.yaml

tuned() { # aim, options of the aim: each budget starts from the designs of the one before
  local aim=$1 last=$work/start.yaml
  shift
  for budget in 4.5 8 20 100 450; do
    local options=("${common[@]}" "$@" --budget "$budget")
    group "$aim" conventional generalized -- "${one[@]}"
    group "$aim" nested_2 printed -- "${two[@]}"
    group "$aim" cascade_2 -- "${calm[@]}" --sampler cmaes
    group "$aim" nested_3 nested_4 -- "${more[@]}"
    group "$aim" nonlinear_1 -- "${one[@]}" "${curved[@]}"
    group "$aim" nonlinear_2 -- "${two[@]}" "${curved[@]}" --sampler cmaes
    cp "$last" "paper/designs/${aim}_$budget.yaml"
  done
}

group() { # aim, observers, --, what varies: the scenario goes from group to group
  local aim=$1 first=$2 out=$work/${1}_$budget/$2 chosen=()
  shift
  while [ "$1" != -- ]; do chosen+=(--controller "$1") && shift; done
  shift
  nadrc tune "$last" "${chosen[@]}" "${options[@]}" "$@" --storage "$work/$aim-$first.log" --out "$out"
  last=$out/scenario.yaml
}

tuned noisy
tuned clean --noise-free
