"""Texture samples, masks and principal components, and appearances encoded from them."""

from dataclasses import replace

import numpy as np
import pytest
from shots import Shots, whole

from encoder.appearance.masks import MOUTH_WEIGHT, OUTSIDE_WEIGHT, face_mask, mouth_weights
from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.texture import default_colours
from encoder.appearance.texture_samples import (
    TextureSamples,
    mean_texture,
    sample_textures,
    texel_footprints,
)
from encoder.learning.appearance_encoder import (
    MODE_OVERHEAD_BYTES,
    CodedAppearance,
    encode_appearance,
)
from encoder.learning.person_model import DISOCCLUSION_SHARE, disocclusion_weight
from encoder.learning.sample_fitting import luma_modes, make_template
from protocol.pictures.picture_codec import to_luma
from shared_model.animate import Face, Identity
from shared_model.appearance import atlas_of
from shared_model.arrays import Single
from shared_model.mesh import PARTS, Head
from shared_model.parameters import AAUS
from shared_model.surround import head_with_surround

SIZE = 64


@pytest.fixture(scope="module")
def head() -> Head:
    return head_with_surround()


@pytest.fixture(scope="module")
def shape(head: Head, shots: Shots) -> ShapeFreeFrame:
    face = Face(head, Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices)))
    return ShapeFreeFrame(face, atlas_of(head, SIZE), shots.camera)


def patterns(shape: ShapeFreeFrame) -> Single:
    """(2, k) smooth patterns over the face that are nowhere alike."""
    u, v = shape.atlas.columns / SIZE, shape.atlas.rows / SIZE
    return np.stack([np.sin(7 * u), np.cos(9 * v + 2 * u)]).astype(np.float32)


def synthetic_samples(
    shape: ShapeFreeFrame, count: int = 24, noise: float = 1.0
) -> tuple[TextureSamples, Single]:
    """Samples that two independent patterns vary, and the patterns' coefficients (t, 2)."""
    rng = np.random.default_rng(7)
    coefficients = np.asarray(rng.normal(size=(count, 2)) * (20, 10), np.float32)
    grey = 120 + coefficients @ patterns(shape)
    colours: Single = np.repeat(grey[..., None], 3, axis=2)
    colours += rng.normal(size=colours.shape).astype(np.float32) * noise
    visible = np.ones(colours.shape[:2], bool)
    return TextureSamples(
        colours.astype(np.float32), visible, np.ones(len(shape), np.float32)
    ), coefficients


def residual_error(
    shape: ShapeFreeFrame, samples: TextureSamples, appearance: CodedAppearance, mask: Single
) -> float:
    """Mean squared luma error of the face under the best coefficients."""
    at = (shape.atlas.rows, shape.atlas.columns)
    root = np.sqrt(samples.weight * mask)
    target = (to_luma(samples.colours) - to_luma(appearance.mean[at])) * root
    if len(appearance.modes):
        rows = np.array([to_luma(image[at]) * root for image in appearance.mode_images])
        target = target - np.linalg.lstsq(rows.T, target.T, rcond=None)[0].T @ rows
    return float((target**2).sum() / (len(target) * (root**2).sum()))


def test_the_face_mask_is_1_on_the_face(head: Head, shape: ShapeFreeFrame) -> None:
    mask = face_mask(head, shape.atlas)
    assert (
        mask.shape == (len(shape),)
        and mask.min() == pytest.approx(OUTSIDE_WEIGHT)
        and mask.max() == 1
    )
    places = shape.atlas.points(head.vertices)
    nose = np.linalg.norm(places - head.vertices[head.landmarks["prn"]], axis=1) < 10
    assert (mask[nose] == 1).all()
    assert mask[np.abs(places[:, 0]) > 70].mean() < 0.5


def test_mouth_and_lips_alone_have_a_higher_weight(head: Head, shape: ShapeFreeFrame) -> None:
    weight = mouth_weights(head, shape.atlas)
    assert weight.min() == 1 and weight.max() == pytest.approx(MOUTH_WEIGHT)
    inside = head.parts[shape.atlas.corners[:, 0]] == PARTS.index("mouth")
    assert (weight[inside] == weight.max()).all()
    places = shape.atlas.points(head.vertices)
    lips, nose = (
        np.linalg.norm(places - head.vertices[head.landmarks[name]], axis=1) < 4
        for name in ("sto_lower", "prn")
    )
    assert weight[lips].mean() > 0.9 * MOUTH_WEIGHT and (weight[nose] == 1).all()
    assert (weight > 1).mean() < 0.3


def test_footprints_sum_to_the_area_of_the_face(shots: Shots, shape: ShapeFreeFrame) -> None:
    positions = shape.positions(shots.faces[2])
    areas = texel_footprints(shape, positions)
    low, high = positions.min(0), positions.max(0)
    assert (areas >= 0).all()
    # Front and ears lie one over the other, the corners of the box are empty.
    assert 0.4 < areas.sum() / float(np.prod(high - low)) < 2


def test_samples_are_the_colours_that_each_picture_shows(
    head: Head, shots: Shots, shape: ShapeFreeFrame
) -> None:
    vertices = [shape_face(head).animate(face.eau) for face in shots.faces]
    crops = [whole(picture) for picture in shots.pictures]
    samples = sample_textures(shape, crops, shots.faces, vertices)
    assert samples.colours.shape == (len(crops), len(shape), 3)
    assert samples.visible.shape == samples.colours.shape[:2]
    skin = samples.visible.all(0) & (face_mask(head, shape.atlas) == 1)
    # The same skin at the same texel, whatever the pose: what varies is light and lids.
    within = samples.colours[:, skin].std(0).mean()
    between = samples.colours[:, skin].mean(0).std()
    assert within < 0.5 * between
    assert (samples.weight[~samples.visible.any(0)] == 0).all()


def shape_face(head: Head) -> Face:
    return Face(head, Identity(np.zeros(len(AAUS)), np.zeros_like(head.vertices)))


def test_a_mean_is_of_visible_texels(head: Head, shape: ShapeFreeFrame) -> None:
    samples, _ = synthetic_samples(shape, 4, 0.0)
    visible = samples.visible.copy()
    visible[1:, ::2] = False
    default = default_colours(head, shape.atlas)
    never = np.isnan(default[:, 0]) & (np.arange(len(shape)) % 50 == 3)
    visible[:, never] = False
    mean = mean_texture(shape, TextureSamples(samples.colours, visible, samples.weight), default)
    once = (np.arange(len(shape)) % 2 == 0) & ~never
    assert np.allclose(mean[once], samples.colours[0][once], atol=1e-3)
    # What no picture shows continues what is around it.
    assert np.isfinite(mean).all() and 40 < mean[never].mean() < 200


def test_luma_modes_are_the_principal_components(shape: ShapeFreeFrame) -> None:
    coloured, _ = synthetic_samples(shape, noise=0.1)
    samples = replace(coloured, colours=to_luma(coloured.colours)[..., None])
    mean = samples.colours.mean(0)
    modes = luma_modes(samples, mean, 2)
    residual = (samples.colours - mean)[..., 0]
    left = residual - residual @ modes.T @ np.linalg.inv(modes @ modes.T) @ modes
    assert left.var() < 0.001 * residual.var()
    assert luma_modes(samples, mean, 0).shape == (0, len(shape))
    template = make_template(samples, mean, modes)
    assert np.array_equal(template.mean, mean[:, 0]) and template.modes is modes


def coded(
    shape: ShapeFreeFrame, samples: TextureSamples, face_bytes: int, most: int = 8
) -> CodedAppearance:
    mask = np.ones(len(shape), np.float32)
    return encode_appearance(shape, samples, samples.colours.mean(0), mask, face_bytes, most)


def test_an_appearance_stays_within_its_bytes(shape: ShapeFreeFrame) -> None:
    samples, _ = synthetic_samples(shape, noise=6.0)
    for limit, most in ((1500, 8), (5000, 3)):
        found = coded(shape, samples, limit, most)
        assert len(found.texture) + sum(map(len, found.modes)) <= limit
        assert len(found.mode_images) == len(found.modes) <= most


def test_the_last_bytes_go_into_a_coarser_last_mode(shape: ShapeFreeFrame) -> None:
    samples, _ = synthetic_samples(shape, noise=6.0)
    whole = coded(shape, samples, 20_000, most=2)
    first, second = whole.modes
    limit = len(whole.texture) + len(first) + 2 * len(second) // 3 + 2 * MODE_OVERHEAD_BYTES
    found = coded(shape, samples, limit)
    assert len(found.texture) + sum(map(len, found.modes)) <= limit
    steps = [mode[0] for mode in found.modes]
    assert len(steps) > 1 and max(steps) > steps[0]


def test_each_mode_explains_more_of_the_face(shape: ShapeFreeFrame) -> None:
    samples, _ = synthetic_samples(shape)
    mask = np.ones(len(shape), np.float32)
    left = [
        residual_error(shape, samples, coded(shape, samples, 12_000, most), mask)
        for most in (0, 1, 2)
    ]
    # Two patterns: two modes explain nearly all, coding errors included.
    assert left[1] < 0.5 * left[0] and left[2] < 0.05 * left[0]


def test_later_modes_correct_coding_errors_of_earlier_ones(shape: ShapeFreeFrame) -> None:
    samples, _ = synthetic_samples(shape, noise=0.0)
    mask = np.ones(len(shape), np.float32)
    two, more = (coded(shape, samples, 20_000, most) for most in (2, 5))
    assert residual_error(shape, samples, more, mask) < residual_error(shape, samples, two, mask)


def test_hidden_texels_do_not_change_the_model(shape: ShapeFreeFrame) -> None:
    samples, _ = synthetic_samples(shape)
    hidden = samples.visible.copy()
    hidden[::2, : len(shape) // 2] = False
    wild = samples.colours.copy()
    wild[~hidden] = 255
    tame = samples.colours.copy()
    tame[~hidden] = 0
    mean, mask = samples.colours.mean(0), np.ones(len(shape), np.float32)
    one, other = (
        encode_appearance(shape, TextureSamples(c, hidden, samples.weight), mean, mask, 4500, 4)
        for c in (wild, tame)
    )
    assert one.modes == other.modes and one.texture == other.texture


def test_a_closed_mouth_has_the_weight_of_an_open_one(
    head: Head, shots: Shots, shape: ShapeFreeFrame
) -> None:
    closed = [replace(shots.faces[2], eau=np.zeros_like(shots.faces[2].eau))]
    vertices = [shape_face(head).animate(closed[0].eau)]
    samples = sample_textures(shape, [whole(shots.pictures[2])], closed, vertices)
    weight = disocclusion_weight(shape_face(head), shape, closed)
    part = head.parts[shape.atlas.corners[:, 0]]
    hidden = (part == PARTS.index("mouth")) & (samples.weight == 0)
    assert hidden.sum() > 100 and (weight[hidden] > 0).mean() > 0.7
    # Skin counts for what is visible of it.
    skin = (part == PARTS.index("skin")) & (samples.weight > 0)
    assert weight[skin].mean() == pytest.approx(
        DISOCCLUSION_SHARE * samples.weight[skin].mean(), rel=0.1
    )
