"""The fused cells of PyTorch's CUDA library in plain operations, for a processor: the same in, the same out.

After aten/src/ATen/native/cuda/RNN.cu; the gpu tests compare the library's own with cuDNN.
"""

import torch

_NAMES = {
    "_thnn_fused_lstm_cell": "lstm",
    "_thnn_fused_lstm_cell_backward_impl": "lstm_back",
    "_thnn_fused_gru_cell": "gru",
    "_thnn_fused_gru_cell_backward": "gru_back",
}


def on_the_processor():
    """Make the cells known to a processor for as long as what is returned lives."""
    library = torch.library.Library("aten", "IMPL")
    for name, function in _NAMES.items():
        library.impl(name, globals()[function], "CPU")
    return library


def lstm(inputs, hidden, cell, input_bias=None, hidden_bias=None):
    check(4, inputs, hidden, cell, input_bias, hidden_bias)
    i, f, g, o = (inputs + hidden).chunk(4, 1)
    i, f, g, o = i.sigmoid(), f.sigmoid(), g.tanh(), o.sigmoid()
    after = f * cell + i * g
    return o * after.tanh(), after, torch.cat([i, f, g, o], 1)


def lstm_back(of_output, of_cell, before, after, gates, has_bias):
    assert not has_bias
    check(4, gates, gates, of_output, None, None)
    check(4, gates, gates, of_cell, None, None)
    i, f, g, o = gates.chunk(4, 1)
    through = of_output * o * (1 - after.tanh() ** 2) + of_cell
    parts = [through * g * i * (1 - i), through * before * f * (1 - f), through * i * (1 - g**2)]
    parts.append(of_output * after.tanh() * o * (1 - o))
    return torch.cat(parts, 1), through * f, torch.empty(0)


def gru(inputs, hidden, state, input_bias=None, hidden_bias=None):
    check(3, inputs, hidden, state, input_bias, hidden_bias)
    (ir, iz, n), (hr, hz, hn) = inputs.chunk(3, 1), hidden.chunk(3, 1)
    r, z = (ir + hr).sigmoid(), (iz + hz).sigmoid()
    n = (n + r * hn).tanh()
    return n + z * (state - n), torch.cat([r, z, n, state, hn], 1)


def gru_back(of_output, kept, has_bias):
    assert not has_bias
    assert of_output.is_contiguous()
    r, z, n, state, hn = kept.chunk(5, 1)
    through = of_output * (1 - z) * (1 - n**2)
    reset, update = through * hn * r * (1 - r), of_output * (state - n) * z * (1 - z)
    of_inputs = torch.cat([reset, update, through], 1)
    of_hidden = torch.cat([reset, update, through * r], 1)
    return of_inputs, of_hidden, of_output * z, torch.empty(0), torch.empty(0)


def check(factor, inputs, hidden, state, input_bias, hidden_bias):
    assert input_bias is None
    assert hidden_bias is None
    assert inputs.shape == hidden.shape
    assert inputs.shape == (len(state), factor * state.shape[1])
    assert all(tensor.is_contiguous() for tensor in (inputs, hidden, state))  # else the slower kernel
