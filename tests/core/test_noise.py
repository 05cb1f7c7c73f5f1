"""Sensor noise: magnitude, unaffected entries, and reproducibility per step."""

import math

import numpy as np
import torch
from refusals import refused_by_call

from hab_tasks.engine.noise import NoiseSource, SensorNoise

SIDE = 200
"""Pixels along a side: 40,000 draws give a standard deviation to within 1.5 % (4 sigma)."""


def source(seed=7, **noise):
    """Noise of an episode with this seed."""
    made = NoiseSource(SensorNoise(**noise))
    made.begin(seed)
    return made


def plain(*values, dtype=torch.int16):
    """A picture (1, H, W, C) of one value for each channel."""
    return torch.tensor(values, dtype=dtype).expand(1, SIDE, SIDE, len(values)).clone()


def color(*values):
    return plain(*values, dtype=torch.uint8)


def seen(noise, **images):
    return noise.images({"head": images})["head"]


def check_spread(noisy, exact, std, within):
    """Checks the standard deviation of what was added, and that its mean is near zero."""
    error = torch.as_tensor(noisy).double() - exact
    assert abs(float(error.std()) / std - 1) < within
    assert abs(float(error.mean())) < 4 * std / math.sqrt(error.numel())


def test_noise_is_as_large_as_said():
    for depth_m in (1.0, 2.0, 4.0):
        noisy = seen(source(depth_at_1_m_m=0.01), depth=plain(int(1000 * depth_m)))["depth"]
        assert noisy.dtype == torch.int16
        # 10 mm at 1 m, 40 mm at 2 m, 160 mm at 4 m; rounding to millimetres adds 1/12 mm².
        expected = math.hypot(10.0 * depth_m**2, math.sqrt(1 / 12))
        check_spread(noisy, 1000 * depth_m, expected, 0.02)
    rgb = seen(source(rgb_levels=10.0), rgb=color(128, 0, 255))["rgb"]
    assert rgb.dtype == torch.uint8
    check_spread(rgb[..., 0], 128.0, 10.0, 0.02)
    # Half of the noise is cut off at either end.
    assert abs(float((rgb[..., 1] == 0).double().mean()) - 0.52) < 0.02
    assert abs(float((rgb[..., 2] == 255).double().mean()) - 0.52) < 0.02
    check_spread(source(joint_rad=0.05).joints(np.full(20_000, 0.3)), 0.3, 0.05, 0.03)


def test_points_move_along_their_rays_as_far_as_their_depth():
    noise = source(depth_at_1_m_m=0.01)
    images = seen(noise, depth=plain(2000), position=plain(1000, -500, -2000))
    assert torch.equal(-images["position"][..., 2:], images["depth"])
    x, y, z = images["position"].double().unbind(-1)
    # Twice as deep as far to the right, and four times as deep as far down, to a rounding.
    assert ((x + z / 2).abs() <= 1).all()
    assert ((y - z / 4).abs() <= 1).all()
    assert z.std() > 30


def test_nothing_stays_nothing_and_what_is_no_measurement_is_left_alone():
    noise = source(depth_at_1_m_m=0.5)
    others = {"segmentation": plain(3), "albedo": color(1, 2, 3)}
    measured = {"rgb": color(1, 2, 3), "depth": plain(2345)}
    for made, images in (
        (noise, {"depth": plain(0), "position": plain(0, 0, 0)}),
        (noise, others),
        (source(depth_at_1_m_m=0.0, rgb_levels=0.0, joint_rad=0.0), measured),
    ):
        for name, image in seen(made, **images).items():
            assert torch.equal(image, images[name]), name
    assert source(joint_rad=0.0).joints(np.ones(7)).tolist() == [1.0] * 7


def test_raw_textures_get_the_noise_of_the_images_made_of_them():
    noise = source(depth_at_1_m_m=0.01, rgb_levels=5.0)
    raw = {"Color": color(9, 50, 20, 255), "PositionSegmentation": plain(1000, -500, -2000, 17)}
    found = seen(noise, **raw)
    images = seen(noise, rgb=raw["Color"][..., :3], position=raw["PositionSegmentation"][..., :3])
    for name, image in zip(raw, images.values(), strict=True):
        assert torch.equal(found[name][..., :3], image), name
        assert torch.equal(found[name][..., 3], raw[name][..., 3]), name


def samples(noise, steps=3):
    """What the joints read in the next steps, (steps, 7)."""
    found = []
    for _ in range(steps):
        found.append(noise.joints(np.zeros(7)).tolist())
        noise.advance()
    return found


def test_an_episodes_noise_is_its_own_and_begins_anew_with_it():
    noise, (seven, eight) = source(7), [samples(source(seed), 4) for seed in (7, 8)]
    assert seven != eight
    assert samples(noise, 2) == seven[:2]
    other = source(1)
    other.set_state(noise.get_state())
    assert samples(other, 2) == seven[2:], "a restored source goes on alike"
    noise.begin(8)
    assert samples(noise, 4) == eight


def test_cameras_and_channels_have_noise_of_their_own():
    pictures = {name: {"depth": plain(1000)} for name in ("head", "arm")}
    noisy = source(depth_at_1_m_m=0.01).images(pictures)
    flat = torch.stack([noisy[name]["depth"].double().flatten() for name in pictures])
    assert abs(float(torch.corrcoef(flat)[0, 1])) < 0.03


def test_a_dict_of_attributes_is_as_good_and_anything_else_is_refused():
    assert SensorNoise.of({"joint_rad": 0.1}) == SensorNoise(joint_rad=0.1)
    assert SensorNoise.of(None) is None
    refused_by_call(lambda: SensorNoise.of({"joint_radd": 0.1}), "Did you mean 'joint_rad'")
    refused_by_call(lambda: SensorNoise.of(0.1), "SensorNoise or a dict")
    for value in (-0.1, math.nan, math.inf):
        attributes = {"rgb_levels": value}
        refused_by_call(lambda x=attributes: SensorNoise.of(x), "sensor_noise.rgb_levels is")
