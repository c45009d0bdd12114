from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as check_gymnasium
from omegaconf import OmegaConf
from stable_baselines3 import A2C
from stable_baselines3.common.env_checker import check_env as check_stable_baselines3

from deux.contracts import DEPTH, Channel, Need, Reward
from deux.environment import ENVIRONMENT
from deux.environment.egocentric import Crops
from deux.environment.exploration_env import ExplorationEnv
from deux.environment.scene_pool import ScenePool
from deux.errors import DeuxError
from deux.geometry.camera import Camera
from deux.simulator.mesh_simulator import MeshSimulator

ACTIONS = np.random.default_rng(0).choice(3, size=25, p=[0.6, 0.2, 0.2])


@pytest.fixture
def make(flats):
    """A function that makes an environment in the flat."""
    pool, scenes = flats
    return lambda **options: ExplorationEnv(scenes, pool=pool, **options)


def play(environment, seed, actions=ACTIONS, options=None):
    """All that an episode shows: observations, rewards, ends and infos."""
    observation, info = environment.reset(seed=seed, options=options)
    return [(observation, info), *(environment.step(action) for action in actions)]


def assert_same(first, second):
    assert len(first) == len(second)
    for ours, theirs in zip(first, second, strict=True):
        assert ours[0].keys() == theirs[0].keys()
        for name in ours[0]:
            np.testing.assert_array_equal(ours[0][name], theirs[0][name])
        assert ours[1:] == theirs[1:]


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"extras": ("depth", "rgb"), "render_mode": "rgb_array"},
        {"reward": "semantic_reconstruction", "extras": ("depth",)},
        {"reward": "curiosity", "crops": Crops(near=3.0, far=9.0, pixels=16)},
    ],
)
# Both libraries remark on what is chosen on purpose: small crops, and environments that are not made by name.
@pytest.mark.filterwarnings("ignore:.*render_mode.*:UserWarning", "ignore:.*spec.*:UserWarning")
@pytest.mark.filterwarnings("ignore:.*minimal resolution for an image:UserWarning")
def test_both_libraries_accept_it(make, options):
    check_gymnasium(make(**options), skip_render_check="render_mode" not in options)
    check_stable_baselines3(make(**options), skip_render_check="render_mode" not in options)


def test_it_is_made_by_name(flats):
    pool, scenes = flats
    environment = gymnasium.make(f"deux.environment:{ENVIRONMENT}", scenes=scenes, pool=pool, steps=3)
    assert isinstance(environment.unwrapped, ExplorationEnv)
    assert [step[3] for step in play(environment, 0, ACTIONS[:3])[1:]] == [False, False, True]


@pytest.fixture
def configured(monkeypatch):
    """The configuration's defaults: generated flats, and the built-in simulator."""

    def compose(overrides=()):
        defaults = {"scenes": {"name": "apartments", "train": 4}, "simulator": {"name": "mesh"}}
        return OmegaConf.merge(defaults, OmegaConf.from_dotlist(list(overrides)))

    monkeypatch.setattr("deux.environment.exploration_env.compose", compose)


# The default camera and crops; a smaller one of either needs a features extractor of its own.
@pytest.mark.parametrize("extras", [(), ("depth",), ("rgb",), ("depth", "rgb")])
def test_stable_baselines3_learns_with_its_own_network(references, configured, extras):
    policy = A2C("MultiInputPolicy", ExplorationEnv(references, extras=extras)).learn(10)
    assert policy.num_timesteps == 10


def test_a_number_of_scenes_means_flats_of_the_training_split(configured):
    environment = ExplorationEnv(1)
    _, info = environment.reset(seed=0)
    assert info["scene"] == "apartment_000000"


@pytest.mark.parametrize("reward", ["coverage", "curiosity", "semantic_reconstruction"])
def test_the_seed_decides_everything(make, reward):
    first, second = (make(reward=reward, extras=("depth",)) for _ in range(2))
    episodes = [play(environment, 5) for environment in (first, second)]
    assert_same(*episodes)
    # The next episode, without a seed of its own, goes on from the same generator.
    assert_same(play(first, None), play(second, None))
    assert not np.array_equal(play(first, 6)[0][0]["near"], episodes[0][0][0]["near"])
    assert_same(play(first, 5)[:1], episodes[0][:1])


def test_an_episode_is_truncated_after_its_steps_and_never_terminated(make):
    environment = make(steps=4)
    ends = [step[2:4] for step in play(environment, 0, ACTIONS[:4])[1:]]
    assert ends == [(False, False)] * 3 + [(False, True)]
    ends = [step[3] for step in play(environment, None, ACTIONS[:2], {"steps": 2})[1:]]
    assert ends == [False, True]
    ends = [step[3] for step in play(environment, None, ACTIONS[:4])[1:]]
    assert ends == [False] * 3 + [True], "the option is for one episode"


def test_scenes_are_drawn_at_random_or_chosen(flats, references):
    pool, _ = flats
    for reference in references:
        pool._loaded[reference] = pool.simulator(flats[1][0])  # the same flat under three names
        pool._loaded[reference].scene = replace(pool._loaded[reference].scene, name=reference.name)
    environment = ExplorationEnv(references, pool=pool)
    environment.reset(seed=0)
    drawn = [environment.reset()[1]["scene"] for _ in range(30)]
    assert set(drawn) == {"a", "b", "c"}
    assert [environment.reset(options={"scene": i})[1]["scene"] for i in (2, 0, 1)] == ["c", "a", "b"]
    with pytest.raises(DeuxError, match="there is no scene 3: the environment has 3"):
        environment.reset(options={"scene": 3})


def test_episodes_take_place_on_every_floor_that_there_is(make, monkeypatch):
    """The simulator has two floors; the second is 3 m higher and otherwise the first one again."""
    free_space, reset = MeshSimulator.free_space, MeshSimulator.reset
    began = []
    monkeypatch.setattr(MeshSimulator, "free_space", lambda self, floor=0: free_space(self))
    monkeypatch.setattr(
        MeshSimulator, "reset", lambda self, x, z, yaw, floor=0: (began.append(floor), reset(self, x, z, yaw))
    )
    environment = make(steps=1)
    for seed in range(3):
        environment.reset(seed=seed)
    assert began == [0, 0, 0]
    simulator = environment.simulator
    monkeypatch.setattr(environment._pool, "simulator", lambda scene: simulator)
    monkeypatch.setattr(simulator, "floors", simulator.floors * 2)
    for seed in range(12):
        environment.reset(seed=seed)
    assert set(began[3:]) == {0, 1}


def test_extras_are_what_the_camera_sees(make):
    environment = make(extras=("depth", "rgb"))
    observation = play(environment, 2)[-1][0]
    seen = environment.simulator.observe()
    np.testing.assert_array_equal(observation["rgb"], seen.rgb.transpose(2, 0, 1))
    metres = observation["depth"][0] * (10.0 / 255.0)
    assert np.abs(metres - seen.depth).max() <= 10.0 / 255.0
    assert np.isin(observation["depth"][0] == 0, seen.depth == 0).all()
    assert set(make().reset(seed=2)[0]) == {"near", "far", "body"}


@pytest.fixture
def rendered(monkeypatch):
    """The channels of every frame that the simulator draws."""
    drawn = []
    render = MeshSimulator.render

    def record(self, poses, channels):
        drawn.extend([channels] * len(poses))
        return render(self, poses, channels)

    monkeypatch.setattr(MeshSimulator, "render", record)
    return drawn


@pytest.mark.parametrize(
    ("options", "channels"),
    [
        ({}, set()),
        ({"extras": ("depth",), "reward": "curiosity"}, set()),
        ({"extras": ("rgb",)}, {Channel.COLOR}),
        ({"reward": "semantic_reconstruction"}, {Channel.LABELS}),
        ({"reward": "semantic_reconstruction", "extras": ("rgb",)}, {Channel.COLOR, Channel.LABELS}),
    ],
)
def test_what_is_not_asked_for_is_not_rendered(make, rendered, options, channels):
    environment = make(**options)
    play(environment, 0, ACTIONS[:5])
    assert rendered == [channels] * 6, "one look at reset, one each step"


def test_textures_are_not_even_prepared_for_maps(references, configured, monkeypatch):
    def fail(*_):
        raise AssertionError("shading was prepared")

    monkeypatch.setattr("deux.simulator.embree_renderer.prepare_surfaces", fail)
    play(ExplorationEnv(references), 0, ACTIONS[:3])


def test_coverage_adds_up_to_the_growth_of_the_area_seen(make):
    environment = make(reward="coverage")
    first, *steps = play(environment, 1)
    assert sum(step[1] for step in steps) == pytest.approx(steps[-1][4]["area_seen"] - first[1]["area_seen"])
    cells = environment.memory.occupancy.cells
    assert steps[-1][4]["area_seen"] == pytest.approx(np.count_nonzero(cells) * 0.01)
    assert steps[-1][4]["area_seen"] < 200.0


def test_observations_do_not_change_afterwards(make):
    environment = make(extras=("depth", "rgb"))
    observation, _ = environment.reset(seed=0)
    before = {name: part.copy() for name, part in observation.items()}
    for action in ACTIONS[:5]:
        environment.step(action)
    assert all(np.array_equal(observation[name], before[name]) for name in before)


class Witness(Reward):
    """Keeps what it is told."""

    def __init__(self, needs=frozenset()):
        self.needs = needs
        self.experiences = []

    def reset(self, episode):
        self.episode = episode
        self.experiences.clear()

    def __call__(self, experience):
        self.experiences.append(replace(experience, seen=experience.seen.copy()))
        return float(len(self.experiences))

    def state(self):
        return {"looks": np.array(len(self.experiences))}

    def load_state(self, state):
        self.loaded = dict(state)


def test_a_reward_gets_what_it_declares_and_nothing_else(make):
    reward = Witness()
    environment = make(reward=reward, extras=("rgb",), steps=50)
    steps = play(environment, 0, ACTIONS[:4])
    assert [step[1] for step in steps[1:]] == [2.0, 3.0, 4.0, 5.0]
    assert [experience.action for experience in reward.experiences] == [None, *ACTIONS[:4]]
    last = reward.experiences[-1]
    assert last.observation.labels is None
    assert reward.episode.label_names == ()
    assert (reward.episode.steps, reward.episode.free_space) == (50, None)
    assert last.observation.step == 4
    np.testing.assert_array_equal(last.observation.sensor_depth, environment.simulator.observe(DEPTH).depth)
    np.testing.assert_array_equal(last.view["near"], steps[-1][0]["near"])
    assert last.occupancy.shape == last.views.shape == last.seen.shape == last.frame.shape
    assert (last.views[last.seen] > 0).all()
    assert environment.reward_state() == {"looks": 5}
    environment.load_reward_state({"looks": np.array(7)})
    assert reward.loaded == {"looks": 7}

    labelled = Witness(frozenset({Need.LABELS}))
    environment = make(reward=labelled)
    environment.reset(seed=0)
    assert labelled.experiences[0].observation.labels.shape == (32, 32)
    assert labelled.episode.label_names == environment.simulator.label_names != ()


def test_rewards_are_chosen_by_name_with_their_options(make):
    environment = make(reward="novelty", reward_options={"cell": 100.0})
    values = [step[1] for step in play(environment, 0, ACTIONS[:3])[1:]]
    assert values == pytest.approx([2**-0.5, 3**-0.5, 0.5])
    with pytest.raises(DeuxError, match="there is no reward called 'coverige': did you mean coverage"):
        make(reward="coverige")
    with pytest.raises(DeuxError, match=r"explorer_training\.reward_options\.sell is not an option of NoveltyReward"):
        make(reward="novelty", reward_options={"sell": 1.0})


def test_mistakes_are_reported_in_one_sentence(make, flats, configured):
    with pytest.raises(DeuxError, match="extras contains 'colour': it must be a list of depth and rgb"):
        make(extras=("colour",))
    with pytest.raises(DeuxError, match="extras contains 'rgb': it must be a list"):
        make(extras="rgb")
    with pytest.raises(DeuxError, match="no scene"):
        ExplorationEnv([], pool=flats[0])
    with pytest.raises(DeuxError, match="no scene"):
        ExplorationEnv(0)
    with pytest.raises(DeuxError, match="steps is 0"):
        make(steps=0)
    for scenes in ("houses", True, ["flat"], object()):
        with pytest.raises(DeuxError, match="it must be a number of scenes, or a list of references"):
            ExplorationEnv(scenes)
    with pytest.raises(DeuxError, match=r"camera is \{'width': 64\}: it must be a deux\.geometry\.camera\.Camera"):
        ExplorationEnv(flats[1], camera={"width": 64})
    with pytest.raises(DeuxError, match="the pool has a camera already"):
        make(camera=Camera(64, 64))
    environment = make()
    for options, sentence in (({"scen": 0}, "no option 'scen': did you mean scene"), ({"steps": 0}, "steps is 0")):
        with pytest.raises(DeuxError, match=sentence):
            environment.reset(options=options)


@pytest.mark.parametrize("action", [3, -1, "forward", 0.5, None])
def test_an_action_that_there_is_not_is_refused(make, action):
    environment = make()
    environment.reset(seed=0)
    with pytest.raises(DeuxError, match="it must be a whole number, 0 for FORWARD, 1 for LEFT, 2 for RIGHT"):
        environment.step(action)


def test_a_reward_that_cannot_be_used_is_refused(make):
    with pytest.raises(DeuxError, match=r"must be the name of a reward or an instance of"):
        make(reward=Witness)
    with pytest.raises(DeuxError, match="and Witness is an object: pass them to its constructor"):
        make(reward=Witness(), reward_options={"cell": 1.0})
    with pytest.raises(DeuxError, match="the reward Witness needs predicted_depth, which the environment does not"):
        make(reward=Witness(frozenset({Need.PREDICTED_DEPTH})))


@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), np.zeros(3), "1"])
def test_a_reward_that_is_no_finite_number_is_reported_and_not_learned_from(make, value):
    class Odd(Witness):
        def __call__(self, experience):
            return value if experience.observation.step else 0.0

    environment = make(reward=Odd())
    environment.reset(seed=0)
    with pytest.raises(DeuxError, match=r"the reward Odd gives .* at step 1: it must be a finite number\."):
        environment.step(0)


def test_scenes_without_labels_say_that_they_cannot(flat, references, configured):
    bare = replace(flat, mesh=replace(flat.mesh, label_names=(), face_label=np.full_like(flat.mesh.face_label, -1)))
    environment = ExplorationEnv([replace(references[0], scene=bare)], reward="semantic_reconstruction")
    with pytest.raises(DeuxError, match="this scene has none"):
        environment.reset(seed=0)


def test_it_draws_what_the_camera_sees_if_it_is_to(make):
    environment = make(render_mode="rgb_array")
    environment.reset(seed=0)
    np.testing.assert_array_equal(environment.render(), environment.simulator.observe().rgb)
    environment = make()
    environment.reset(seed=0)
    assert environment.render() is None


def test_a_pool_without_colours_has_none_to_show(references, simulation):
    bare = ScenePool(simulation, colors=False)
    for options in ({"extras": ("rgb",)}, {"render_mode": "rgb_array"}):
        with pytest.raises(DeuxError, match="have no colours"):
            ExplorationEnv(references, pool=bare, **options)
