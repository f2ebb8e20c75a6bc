#!/usr/bin/env bash
# A policy of LeRobot itself on our demonstrations, trained by `lerobot-train` and measured by `lerobot-eval` in our
# environment. It is shown keypoints (`gensim2 render --source keypoints`), so it is privileged: pictures would take
# a GPU. Needs the environment that scripts/check_lerobot.sh has made.
#
#     scripts/lerobot_baseline.sh act|diffusion TASK DATA OUT [STEPS] [EPISODES]     # DATA: a collection, not rendered
set -euo pipefail
kind=$1 task=$2 data=$(realpath "$3") out=$(realpath -m "$4") steps=${5:-2000} episodes=${6:-100}
cd "$(dirname "$0")/.."
# Chunks as ours: 16 actions of which 8 are executed, two frames for diffusion; sizes that a CPU can take.
case $kind in
act) sizes=(--policy.chunk_size=16 --policy.n_action_steps=8 --policy.dim_model=256 --policy.dim_feedforward=1024
    --policy.optimizer_lr=1e-4) ;;
diffusion) sizes=(--policy.horizon=16 --policy.n_action_steps=8 --policy.n_obs_steps=2 --policy.down_dims='[128,256,512]'
    --policy.num_inference_steps=10 --policy.noise_scheduler_type=DDIM) ;;
*) echo "must be act or diffusion, is $kind" >&2 && exit 2 ;;
esac
env=runs/lerobot/env
[ -x "$env/bin/lerobot-train" ] || { echo "there is no $env: run scripts/check_lerobot.sh" >&2; exit 2; }
PATH=$PWD/.tools/bin:$PATH
uv pip install --quiet --python "$env/bin/python" "lerobot[training,diffusion]>=0.6,<0.7"

mkdir -p "$out"
if [ -d "$out/frames" ] && [ "$(cat "$out/from")" != "$data" ]; then
    echo "$out holds frames of $(cat "$out/from"): choose another OUT" >&2
    exit 2
fi
echo "$data" >"$out/from"
if [ ! -d "$out/frames" ]; then
    rm -rf "$out/data" && cp -r "$data" "$out/data" && rm -rf "$out"/data/*/observations
    .venv/bin/gensim2 render "$out/data" --source keypoints --points 64 --workers 1
    .venv/bin/gensim2 data export "$out/data" --to lerobot --out "$out/frames"
fi
rm -rf "$out/$kind"
"$env/bin/lerobot-train" --dataset.repo_id="gensim2/$task" --dataset.root="$out/frames" --policy.type="$kind" \
    --policy.device=cpu --policy.push_to_hub=false "${sizes[@]}" --output_dir="$out/$kind" --steps="$steps" \
    --batch_size=32 --num_workers=0 --env_eval_freq=0 --save_freq="$steps" --log_freq=100 --wandb.enable=false
"$env/bin/lerobot-eval" --policy.path="$out/$kind/checkpoints/last/pretrained_model" --policy.device=cpu \
    --env.type=gensim2 --env.task="$task" --env.source=keypoints --env.points=64 --env.instances=new \
    --eval.n_episodes="$episodes" --eval.batch_size=5 --eval.use_async_envs=false --output_dir="$out/$kind/eval"
