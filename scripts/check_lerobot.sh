#!/usr/bin/env bash
# LeRobot's own evaluation of our policy in our environment, in a virtual environment of its own: LeRobot 0.6 wants
# Python 3.12 and another PyTorch than .venv/ has. Needs .venv/ with the extension built, and the registry.
#
#     scripts/check_lerobot.sh [CHECKPOINT TASK]     # without: a policy of a minute is taught first
set -euo pipefail
cd "$(dirname "$0")/.."
out=runs/lerobot
mkdir -p "$out"
PATH=$PWD/.tools/bin:$PATH

if [ ! -x "$out/env/bin/lerobot-eval" ]; then
    uv venv --quiet --clear --python 3.12 "$out/env"
    # The extension is one file for all Pythons from 3.11 on, so the tree is put on the path as it stands; what it asks for
    # is installed beside LeRobot, whose bounds decide.
    .venv/bin/python -c '
import tomllib
project = tomllib.load(open("pyproject.toml", "rb"))["project"]
print(*project["dependencies"], *(extra for name in ("sim", "train") for extra in project["optional-dependencies"][name]), sep="\n")
' >"$out/requirements.txt"
    uv pip install --quiet --python "$out/env/bin/python" --requirements "$out/requirements.txt" \
        "lerobot[dataset,evaluation]>=0.6,<0.7" setuptools
    uv pip install --quiet --python "$out/env/bin/python" --no-deps --editable plugins/lerobot_policy_gensim2 \
        --editable plugins/lerobot_env_gensim2
    echo "$PWD/python" >"$("$out/env/bin/python" -c 'import site; print(site.getsitepackages()[0])')/gensim2.pth"
fi

checkpoint=${1:-$out/policy} task=${2:-CloseBox}
if [ ! -e "$checkpoint/config.json" ]; then
    .venv/bin/gensim2 learn "$task" --assets builtin --minutes 1 --episodes 4 --controls none --videos 0 --out "$checkpoint"
fi
"$out/env/bin/python" - "$checkpoint" "$task" "$out/pretrained" <<'PY'
"""Write the checkpoint as one of LeRobot's, as `save_pretrained` does."""
import sys
from lerobot.envs import env_to_policy_features
from lerobot_env_gensim2 import GenSim2EnvConfig
from lerobot_policy_gensim2 import GenSim2Config
from lerobot_policy_gensim2.modeling_gensim2 import GenSim2Policy

checkpoint, task, out = sys.argv[1:]
seen = env_to_policy_features(GenSim2EnvConfig(task=task, checkpoint=checkpoint))
actions = {name: seen.pop(name) for name in ("action",)}
config = GenSim2Config(checkpoint=checkpoint, device="cpu", input_features=seen, output_features=actions)
GenSim2Policy(config).save_pretrained(out)
PY
rm -rf "$out/eval"
"$out/env/bin/lerobot-eval" --policy.path="$out/pretrained" --policy.device=cpu --env.type=gensim2 --env.task="$task" \
    --env.checkpoint="$checkpoint" --env.instances=new --eval.n_episodes=4 --eval.batch_size=2 \
    --eval.use_async_envs=false --output_dir="$out/eval"
.venv/bin/python -c '
import json, sys
found = json.load(open(sys.argv[1]))["overall"]
print(found["n_episodes"], "episodes by lerobot-eval,", found["pc_success"], "% succeeded")
sys.exit(found["pc_success"] < 50)
' "$out/eval/eval_info.json"
