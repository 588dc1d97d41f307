"""Codecs give back what they were given, within the bounds they promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tcrdata.errors import StoreError
from tcrdata.store.arrays import (
    decode_bits,
    decode_flow,
    decode_mask,
    decode_points,
    encode_bits,
    encode_flow,
    encode_mask,
    encode_points,
)

SIDES = st.integers(1, 24)
FEW = settings(max_examples=60, deadline=None)


def images(dtype, elements):
    return st.tuples(SIDES, SIDES).flatmap(lambda s: hnp.arrays(dtype, s, elements=elements))


@FEW
@given(
    st.tuples(SIDES, SIDES).flatmap(
        lambda side: hnp.arrays(np.float32, (*side, 2), elements=st.floats(-511, 511, width=32))
    )
)
def test_flow_errs_by_at_most_half_a_step(flow):
    codec, data = encode_flow(flow)
    decoded = decode_flow(codec, data, *flow.shape[:2])
    assert codec == "i16"
    assert decoded.dtype == np.float32
    assert decoded.shape == flow.shape
    assert np.abs(decoded - flow).max() <= 1 / 128


@FEW
@given(
    hnp.arrays(np.float32, (5, 7, 2), elements=st.floats(-60000, 60000, width=32)),
    st.sampled_from([513.0, -513.0, np.nan, np.inf]),
)
def test_flow_that_leaves_the_steps_takes_f16(flow, outlier):
    flow[2, 3, 1] = outlier
    codec, data = encode_flow(flow)
    assert codec == "f16"
    np.testing.assert_allclose(decode_flow(codec, data, 5, 7), flow, rtol=2**-10, atol=1e-4)


def test_flow_at_the_edge_of_the_steps():
    edge = np.full((1, 1, 2), 32767 / 64, np.float32)
    assert encode_flow(edge)[0] == "i16"
    assert encode_flow(-edge)[0] == "i16"
    assert encode_flow(edge + 1 / 64)[0] == "f16"


def test_smooth_flow_is_much_smaller_than_its_floats():
    y, x = np.mgrid[0:120, 0:400].astype(np.float32)
    flow = np.stack([np.sin(x / 60) * 20, y / 10], axis=2)
    assert len(encode_flow(flow)[1]) < flow.nbytes / 10


@FEW
@given(hnp.arrays(bool, st.integers(0, 300)))
def test_bits_round_trip(values):
    decoded = decode_points("bits", encode_points(values, "bits"), len(values))
    assert decoded.dtype == bool
    np.testing.assert_array_equal(decoded, values)


@FEW
@given(hnp.arrays(np.int64, st.integers(0, 300), elements=st.integers(0, 255)))
def test_u8_round_trips(values):
    decoded = decode_points("u8", encode_points(values, "u8"), len(values))
    assert decoded.dtype == np.uint8
    np.testing.assert_array_equal(decoded, values)


@FEW
@given(hnp.arrays(np.float32, st.integers(0, 300), elements=st.floats(width=32)))
def test_f32_round_trips_bit_by_bit(values):
    decoded = decode_points("f32", encode_points(values, "f32"), len(values))
    np.testing.assert_array_equal(decoded.view(np.uint32), values.view(np.uint32))


@FEW
@given(hnp.arrays(np.float32, st.integers(0, 300), elements=st.floats(-65504, 65504, width=32)))
def test_f16_rounds(values):
    decoded = decode_points("f16", encode_points(values, "f16"), len(values))
    assert decoded.dtype == np.float32
    np.testing.assert_array_equal(decoded, values.astype(np.float16).astype(np.float32))


def test_f16_saturates_what_is_finite_and_keeps_what_is_not():
    values = np.array([1e6, -1e6, np.inf, -np.inf, np.nan], np.float32)
    decoded = decode_points("f16", encode_points(values, "f16"), 5)
    np.testing.assert_array_equal(decoded, [65504, -65504, np.inf, -np.inf, np.nan])


@FEW
@given(images(np.uint8, st.integers(0, 255)))
def test_bit_planes_round_trip(image):
    np.testing.assert_array_equal(decode_bits(encode_bits(image), *image.shape), image)


@FEW
@given(images(bool, st.booleans()))
def test_masks_round_trip(mask):
    decoded = decode_mask(encode_mask(mask), *mask.shape)
    assert decoded.dtype == bool
    np.testing.assert_array_equal(decoded, mask)


def test_u8_refuses_what_does_not_fit():
    with pytest.raises(StoreError, match="values -1 to 256 do not fit the codec u8"):
        encode_points(np.array([-1, 256]), "u8")


@pytest.mark.parametrize(
    "decode",
    [
        lambda: decode_points("f32", b"torn", 3),
        lambda: decode_points("u8", encode_points(np.arange(9), "u8"), 10),
        lambda: decode_points("u16", b"", 0),
        lambda: decode_flow("i16", b"", 2, 2),
        lambda: decode_flow("png", b"", 2, 2),
        lambda: decode_bits(b"", 2, 2),
        lambda: encode_points(np.arange(3), "u16"),
    ],
)
def test_what_does_not_decode_is_a_store_error(decode):
    with pytest.raises(StoreError):
        decode()
