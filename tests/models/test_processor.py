import time

import torch
from torch import nn

from clearance.models.processor import denormals_flushed, efficient_processor


def test_denormals_are_flushed_inside_and_kept_outside():
    with efficient_processor():
        assert denormals_flushed()
    assert not denormals_flushed()


def test_a_vanishing_gradient_costs_no_more_than_another():
    def seconds(forget):
        torch.manual_seed(0)
        lstm = nn.LSTM(4, 64, batch_first=True)
        with torch.no_grad():
            for bias in (lstm.bias_ih_l0, lstm.bias_hh_l0):
                bias[64:128] = forget  # the second quarter is the forget gate's
            lstm.weight_hh_l0.mul_(0.1)
        signals = torch.randn(32, 300, 4)
        best = float("inf")
        for _ in range(3):
            output = lstm(signals)[0][:, -1].sum()
            begin = time.perf_counter()
            output.backward()
            best = min(best, time.perf_counter() - begin)
        return best

    with efficient_processor(threads=1):
        lasting, vanishing = seconds(forget=3.0), seconds(forget=-1.0)
    assert vanishing < 3 * lasting  # 10 times and more where denormals are kept
