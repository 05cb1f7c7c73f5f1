"""Networks compute rows in groups of one size, so that what a row gets is independent of others."""

import torch
from hab_ppo.row_layers import ROWS, RowEncoder, RowLinear
from torch import nn
from torch.nn import functional


def test_products_are_of_whole_groups_except_in_learning(monkeypatch):
    products, linear = [], functional.linear

    def counted(values, weight, bias=None):
        products.append(len(values))
        return linear(values, weight, bias)

    monkeypatch.setattr(functional, "linear", counted)
    assert ROWS == 8
    layer = RowLinear(5, 3)
    for rows in (1, 8, 9, 16):
        values = torch.randn(rows, 5)
        with torch.no_grad():
            out = layer(values)
        expected = values @ layer.weight.T + layer.bias
        torch.testing.assert_close(out, expected, atol=1e-6, rtol=0)
    layer(torch.randn(3, 5)).sum().backward()
    assert products == [8, 8, 16, 16, 3]
    assert layer.bias.grad.tolist() == [3.0, 3.0, 3.0]


def test_no_image_is_encoded_alone():
    seen, watch = [], nn.Conv2d(2, 4, 3)
    watch.register_forward_pre_hook(lambda layer, inputs: seen.append(len(inputs[0])))
    encoder = RowEncoder(watch, nn.Flatten())
    for images in (1, 2, 3):
        pictures = torch.rand(images, 2, 6, 6)
        with torch.no_grad():
            out = encoder(pictures)
        expected = functional.conv2d(pictures, watch.weight, watch.bias).flatten(1)
        torch.testing.assert_close(out, expected, atol=1e-6, rtol=0)
    assert seen == [2, 2, 3]
