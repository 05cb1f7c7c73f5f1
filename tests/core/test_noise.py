"""Sensor noise: magnitude, unaffected entries, and reproducibility per step."""

import math

import pytest
import torch

from hab_tasks.engine.noise import NoiseSource, SensorNoise
from hab_tasks.errors import OptionError, UnknownNameError

SIDE = 200
"""Pixels along a side: 40,000 draws give a standard deviation to within 1.5 % (4 sigma)."""

EVERY_ROW = torch.tensor([0])


def source(num_envs=1, seeds=(7,), **noise):
    made = NoiseSource(SensorNoise(**noise), num_envs)
    made.begin(torch.arange(num_envs), list(seeds))
    return made


def plain(*values, dtype=torch.int16):
    """A picture (1, H, W, C) of one value for each channel."""
    return torch.tensor(values, dtype=dtype).expand(1, SIDE, SIDE, len(values)).clone()


def seen(noise, **images):
    return noise.images({"head": images})["head"]


def spread(image, of):
    """Standard deviation and mean of what was added."""
    error = image.double() - of
    return float(error.std()), float(error.mean())


def test_depth_noise_grows_with_the_square_of_the_distance():
    for depth_m in (1.0, 2.0, 4.0):
        noisy = seen(source(depth_at_1_m_m=0.01), depth=plain(int(1000 * depth_m)))["depth"]
        assert noisy.dtype == torch.int16
        std, mean = spread(noisy, 1000 * depth_m)
        # 10 mm at 1 m, 40 mm at 2 m, 160 mm at 4 m; rounding to millimetres adds 1/12 mm².
        expected = math.hypot(10.0 * depth_m**2, math.sqrt(1 / 12))
        assert abs(std / expected - 1) < 0.02
        assert abs(mean) < 4 * expected / SIDE


def test_nothing_stays_nothing_and_what_is_no_measurement_is_left_alone():
    noise = source(depth_at_1_m_m=0.5)
    images = seen(noise, depth=plain(0), position=plain(0, 0, 0))
    assert not images["depth"].any()
    assert not images["position"].any()
    segmentation, albedo = plain(3), plain(1, 2, 3, dtype=torch.uint8)
    images = seen(noise, segmentation=segmentation, albedo=albedo)
    assert torch.equal(images["segmentation"], segmentation)
    assert torch.equal(images["albedo"], albedo)


def test_points_move_along_their_rays_as_far_as_their_depth():
    noise = source(depth_at_1_m_m=0.01)
    images = seen(noise, depth=plain(2000), position=plain(1000, -500, -2000))
    assert torch.equal(-images["position"][..., 2:], images["depth"])
    x, y, z = images["position"].double().unbind(-1)
    # Twice as deep as far to the right, and four times as deep as far down, to a rounding.
    assert ((x + z / 2).abs() <= 1).all()
    assert ((y - z / 4).abs() <= 1).all()
    assert z.std() > 30


def test_raw_textures_get_the_noise_of_the_images_made_of_them():
    noise = source(depth_at_1_m_m=0.01, rgb_levels=5.0)
    raw = seen(
        noise,
        Color=plain(100, 50, 20, 255, dtype=torch.uint8),
        PositionSegmentation=plain(1000, -500, -2000, 17),
    )
    images = seen(
        noise, rgb=plain(100, 50, 20, dtype=torch.uint8), position=plain(1000, -500, -2000)
    )
    assert torch.equal(raw["Color"][..., :3], images["rgb"])
    assert torch.equal(raw["PositionSegmentation"][..., :3], images["position"])
    assert (raw["Color"][..., 3] == 255).all()
    assert (raw["PositionSegmentation"][..., 3] == 17).all()


def test_colours_are_off_by_levels_and_stay_colours():
    noise = source(rgb_levels=10.0)
    rgb = seen(noise, rgb=plain(128, 0, 255, dtype=torch.uint8))["rgb"]
    assert rgb.dtype == torch.uint8
    std, mean = spread(rgb[..., 0], 128.0)
    assert abs(std / 10.0 - 1) < 0.02
    assert abs(mean) < 0.2
    # Half of the noise is cut off at either end.
    assert abs(float((rgb[..., 1] == 0).double().mean()) - 0.52) < 0.02
    assert abs(float((rgb[..., 2] == 255).double().mean()) - 0.52) < 0.02


def test_joint_noise_is_as_large_as_said_and_none_changes_nothing():
    noisy = source(joint_rad=0.05).joints(torch.full((1, 20_000), 0.3))
    std, mean = spread(noisy, 0.3)
    assert abs(std / 0.05 - 1) < 0.03
    assert abs(mean) < 0.002
    noise = source(depth_at_1_m_m=0.0, rgb_levels=0.0, joint_rad=0.0)
    images = {"rgb": plain(1, 2, 3, dtype=torch.uint8), "depth": plain(2345)}
    for name, image in seen(noise, **images).items():
        assert torch.equal(image, images[name])
    assert torch.equal(noise.joints(torch.ones(1, 7)), torch.ones(1, 7))


# The same again --------------------------------------------------------------------------------


def samples(noise, steps=3):
    """What the joints read in the next steps, (steps, N, 7)."""
    found = []
    for _ in range(steps):
        found.append(noise.joints(torch.zeros(len(noise.get_state()["seeds"]), 7)))
        noise.advance()
    return torch.stack(found)


def test_an_episodes_noise_is_its_own_and_that_of_no_other_row():
    alone, other = (samples(source(seeds=(seed,))) for seed in (7, 8))
    assert torch.equal(alone, samples(source(seeds=(7,))))
    assert not torch.equal(alone, other)
    both = samples(source(num_envs=2, seeds=(7, 8)))
    assert torch.equal(both[:, :1], alone)
    assert torch.equal(both[:, 1:], other)


def test_a_row_that_begins_anew_leaves_the_other_where_it_is():
    noise, whole = source(num_envs=2, seeds=(7, 8)), samples(source(num_envs=2, seeds=(7, 8)), 4)
    samples(noise, 2)
    noise.begin(torch.tensor([1]), [0, 9])
    now = samples(noise, 2)
    assert torch.equal(now[:, 0], whole[2:, 0])
    assert torch.equal(now[:, 1:], samples(source(seeds=(9,)), 2))


def test_a_restored_source_goes_on_alike():
    noise, other = source(seeds=(7,)), source(seeds=(1,))
    samples(noise, 2)
    other.set_state(noise.get_state(), EVERY_ROW)
    assert torch.equal(samples(noise), samples(other))


def test_cameras_and_channels_have_noise_of_their_own():
    noise = source(depth_at_1_m_m=0.01)
    pictures = {name: {"depth": plain(1000)} for name in ("head", "arm")}
    noisy = noise.images(pictures)
    assert not torch.equal(noisy["head"]["depth"], noisy["arm"]["depth"])
    flat = [noisy[name]["depth"].double().flatten() for name in ("head", "arm")]
    assert abs(float(torch.corrcoef(torch.stack(flat))[0, 1])) < 0.03


# What is taken ---------------------------------------------------------------------------------


def test_a_dict_of_attributes_is_as_good_and_anything_else_is_refused():
    assert SensorNoise.of({"joint_rad": 0.1}) == SensorNoise(joint_rad=0.1)
    assert SensorNoise.of(None) is None
    noise = SensorNoise()
    assert SensorNoise.of(noise) is noise
    with pytest.raises(UnknownNameError, match="Did you mean 'joint_rad'"):
        SensorNoise.of({"joint_radd": 0.1})
    for value in (-0.1, math.nan, math.inf):
        with pytest.raises(OptionError, match=r"sensor_noise\.rgb_levels is"):
            SensorNoise(rgb_levels=value)
    with pytest.raises(OptionError, match="SensorNoise or a dict"):
        SensorNoise.of(0.1)
