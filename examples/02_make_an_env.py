"""Create an environment and step it. A seed determines the object, its pose and its openness."""

import gensim2

# gymnasium.make("gensim2.sim:GenSim2-OpenDrawer-v1", ...) creates the same environment.
env = gensim2.make_env("OpenDrawer", obs_mode="state", assets="builtin")
hold_still = gensim2.robot("panda").rest_action  # seven joint targets in rad; 1 opens the gripper
world = env.unwrapped
for seed in (0, 1):
    observation, _ = env.reset(seed=seed)
    drawer = world.initial_state.objects["drawer"].model
    print(
        f"seed {seed}: {drawer.asset_class}/{drawer.id}, {drawer.mass:.2f} kg, "
        f"openness {world.measure().openness['drawer']:.2f}, observation {tuple(observation.shape)}"
    )
    for _ in range(20):  # one second
        observation, reward, terminated, truncated, info = env.step(hold_still)
    print(f"  after a second: openness {world.measure().openness['drawer']:.2f}, success {bool(info['success'])}")
env.close()
