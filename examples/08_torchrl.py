"""Use the environment with masked actions in TorchRL; needs `pip install torchrl`."""

import gymnasium
import torch
from tensordict.nn import (
    ProbabilisticTensorDictModule,
    ProbabilisticTensorDictSequential,
    TensorDictModule,
)
from torch import nn
from torchrl.envs import ActionMask, CatTensors, DTypeCastTransform, TransformedEnv
from torchrl.envs.libs.gym import GymWrapper
from torchrl.modules import MaskedCategorical

import mlivr_gym
from mlivr_gym import jem_map
from mlivr_gym.envs import ActionMaskObservation

torch.manual_seed(0)
torch.set_num_threads(1)
points = jem_map()
near = points.subset((points.positions[:, 0] > 1.0) & (points.positions[:, 0] < 3.5), "two racks")
plain = gymnasium.make("MLIVR-JEM-v0", map=near, max_episode_steps=30)
env = TransformedEnv(GymWrapper(ActionMaskObservation(plain), categorical_action_encoding=True))
KEYS = ["grasps", "base_position", "base_quaternion", "goal"]
env.append_transform(DTypeCastTransform(torch.int8, torch.bool, in_keys=["action_mask"]))
env.append_transform(ActionMask())
env.append_transform(CatTensors(KEYS, "observation", del_keys=False))
print(mlivr_gym.__version__, near)

actions = int(plain.action_space.n)
network = nn.Sequential(nn.LazyLinear(128), nn.Tanh(), nn.Linear(128, actions))
policy = ProbabilisticTensorDictSequential(
    TensorDictModule(network, ["observation"], ["logits"]),
    ProbabilisticTensorDictModule(
        in_keys={"logits": "logits", "mask": "action_mask"},
        out_keys=["action"],
        distribution_class=MaskedCategorical,
    ),
)
with torch.no_grad():
    walk = env.rollout(30, policy)
print(f"a walk of {len(walk)} steps with keys {sorted(walk.keys(), key=str)}")

# A few updates by REINFORCE show that gradients pass through the mask.
optimiser = torch.optim.Adam(network.parameters(), 1e-3)
for update in range(5):
    walks = [env.rollout(30, policy) for _ in range(8)]
    loss = torch.zeros(())
    for walk in walks:
        togo = walk["next", "reward"].flip(0).cumsum(0).flip(0).squeeze(-1)
        log_prob = policy.get_dist(walk).log_prob(walk["action"])
        loss = loss - (log_prob * togo).mean() / len(walks)
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    print(f"update {update + 1}: {sum(len(walk) for walk in walks) / len(walks):.1f} steps a walk")
