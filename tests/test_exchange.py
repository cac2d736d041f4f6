"""The exchange of materials in the scene graph: every rough metal and glass of a scene, and nothing else.

The laws: both sides describe the same scene but for the plugin and its shape; a node is exchanged wherever it is
nested and however often it is used; the file's own materials stay as they are on their own side.
"""

from __future__ import annotations

import math

import mitsuba as mi
import pytest
from sgtd.compare.comparison import side_text
from sgtd.errors import UserError
from sgtd.scene.exchange import exchange, nearest_distribution, parse_settings
from sgtd.scene.graph import read_scene


@pytest.fixture(autouse=True)
def _scalar_variant():
    before = mi.variant()
    mi.set_variant("scalar_rgb")
    yield
    if before:
        mi.set_variant(before)


def graph_of(tmp_path, body, version="3.0.0", **parameters):
    file = tmp_path / "scene.xml"
    file.write_text(f'<scene version="{version}">{body}</scene>')
    return read_scene(file, parameters)


def pair_of(tmp_path, body, *settings, version="3.0.0", **parameters):
    return exchange(graph_of(tmp_path, body, version, **parameters), parse_settings(settings))


def properties(graph, plugin):
    return [dict(node.props.items()) for node in graph.materials(plugin)]


METAL = '<string name="material" value="Au"/><float name="alpha" value="0.3"/>'
ROUGH = f'<bsdf type="roughconductor">{METAL}</bsdf>'

NESTED = {
    "shape": f'<shape type="sphere">{ROUGH}</shape>',
    "twosided": f'<bsdf type="twosided">{ROUGH}</bsdf>',
    "twosided with two": f'<bsdf type="twosided">{ROUGH}<bsdf type="diffuse"/></bsdf>',
    "blendbsdf": f'<bsdf type="blendbsdf"><float name="weight" value="0.5"/><bsdf type="diffuse"/>{ROUGH}</bsdf>',
    "mask": f'<bsdf type="mask"><float name="opacity" value="0.5"/>{ROUGH}</bsdf>',
    "bumpmap": f'<bsdf type="bumpmap"><texture type="checkerboard"/>{ROUGH}</bsdf>',
    "normalmap": f'<bsdf type="normalmap"><texture name="normalmap" type="checkerboard"/>{ROUGH}</bsdf>',
    "twosided mask": f'<bsdf type="twosided"><bsdf type="mask"><float name="opacity" value="1"/>{ROUGH}</bsdf></bsdf>',
    "shapegroup": f'<shape type="shapegroup" id="g"><shape type="cube">{ROUGH}</shape></shape>',
}


@pytest.mark.parametrize("body", NESTED.values(), ids=NESTED.keys())
def test_nested_materials_are_exchanged(tmp_path, body):
    pair = pair_of(tmp_path, body, "distribution=student", "gamma=1.8")
    assert len(pair.exchanges) == 1
    assert properties(pair.left, "roughconductor") == [{"material": "Au", "alpha": 0.3}]
    expected = {"material": "Au", "alpha": 0.3, "distribution": "student", "gamma": 1.8}
    assert properties(pair.right, "sgtdconductor") == [expected]
    assert not properties(pair.left, "sgtdconductor")
    assert not properties(pair.right, "roughconductor")


def test_only_the_materials_differ(tmp_path):
    body = f'{ROUGH}<bsdf type="conductor"/><bsdf type="plastic"/><shape type="sphere"/><emitter type="constant"/>'
    pair = pair_of(tmp_path, body, "gamma=1.8")
    for left, right in zip(pair.left._state.nodes, pair.right._state.nodes):
        if left.props.plugin_name() != "roughconductor":
            assert left == right


def test_a_shared_material_is_exchanged_once(tmp_path):
    body = f'<bsdf type="roughconductor" id="m">{METAL}</bsdf>' + '<shape type="sphere"><ref id="m"/></shape>' * 3
    pair = pair_of(tmp_path, body, "shift=1")
    assert len(pair.exchanges) == 1
    assert next(pair.right.materials("sgtdconductor")).props.id() == "m"


def test_the_graph_itself_stays_as_it_is(tmp_path):
    graph = graph_of(tmp_path, ROUGH)
    exchange(graph, {"gamma": 1.8})
    assert properties(graph, "roughconductor") == [{"material": "Au", "alpha": 0.3}]


def test_textures_reflectance_and_anisotropy_are_kept(tmp_path):
    body = """
        <bsdf type="roughconductor">
            <texture name="alpha_u" type="checkerboard"/><float name="alpha_v" value="0.1"/>
            <rgb name="specular_reflectance" value="0.5"/>
            <rgb name="eta" value="1, 2, 3"/><rgb name="k" value="3, 2, 1"/>
            <boolean name="sample_visible" value="false"/>
        </bsdf>"""
    pair = pair_of(tmp_path, body, "lambda=0.5")
    (left,), (right,) = properties(pair.left, "roughconductor"), properties(pair.right, "sgtdconductor")
    assert set(right) - set(left) == {"distribution", "gamma", "lambda"}
    for name in left:
        assert str(left[name]) == str(right[name])


GLASS = '<string name="int_ior" value="water"/><float name="ext_ior" value="1"/><float name="alpha" value="0.3"/>'


def test_glass_is_exchanged_for_glass(tmp_path):
    """Both kinds in one file, in the order of the file; indices and transmittance stay as they are."""
    body = f"""{ROUGH}<bsdf type="roughdielectric">{GLASS}<rgb name="specular_transmittance" value="0.5"/></bsdf>
        <bsdf type="sgtddielectric">{GLASS}<float name="gamma" value="8"/><float name="shift" value="1"/></bsdf>"""
    pair = pair_of(tmp_path, body, "gamma=1.8")
    assert [exchange.left for exchange in pair.exchanges] == [
        "roughconductor, beckmann",
        "roughdielectric, beckmann",
        "roughdielectric, beckmann",
    ]
    assert [exchange.right for exchange in pair.exchanges] == [
        "sgtdconductor, sgtd, gamma = 1.8",
        "sgtddielectric, sgtd, gamma = 1.8",
        "sgtddielectric, sgtd, gamma = 1.8, shift = 1",
    ]
    (left, nearest), (right, _) = properties(pair.left, "roughdielectric"), properties(pair.right, "sgtddielectric")
    assert {key: str(value) for key, value in left.items()}.items() <= {k: str(v) for k, v in right.items()}.items()
    assert nearest == {"int_ior": "water", "ext_ior": 1.0, "alpha": 0.3, "distribution": "beckmann"}
    assert not properties(pair.left, "sgtddielectric") and not properties(pair.right, "roughdielectric")


def test_plastic_is_exchanged_for_plastic(tmp_path):
    """Base, indices and number of colors stay; a number of the roughness too."""
    own = '<rgb name="diffuse_reflectance" value="0.1, 0.2, 0.3"/><boolean name="nonlinear" value="true"/>'
    body = f"""<bsdf type="roughplastic">{own}{GLASS}<string name="distribution" value="ggx"/></bsdf>
        <bsdf type="sgtdplastic">{own}{GLASS}<float name="gamma" value="1.7"/></bsdf>"""
    pair = pair_of(tmp_path, body, "p=1.2")
    assert [(exchange.left, exchange.right) for exchange in pair.exchanges] == [
        ("roughplastic, ggx", "sgtdplastic, sgtd, gamma = 2, p = 1.2"),
        ("roughplastic, ggx", "sgtdplastic, sgtd, gamma = 1.7, p = 1.2"),
    ]
    for graph, plugin in ((pair.left, "roughplastic"), (pair.right, "sgtdplastic")):
        for found in properties(graph, plugin):
            assert found["nonlinear"] is True and found["int_ior"] == "water" and found["alpha"] == 0.3
            assert str(found["diffuse_reflectance"]) == str(
                properties(pair.left, "roughplastic")[0]["diffuse_reflectance"]
            )


def test_the_picture_names_both_kinds(tmp_path):
    pair = pair_of(tmp_path, f'{ROUGH}{ROUGH}<bsdf type="roughdielectric">{GLASS}</bsdf>')
    assert side_text(pair, "right") == (
        "right: sgtdconductor and sgtddielectric, 3 materials",
        "2 × sgtdconductor, beckmann; 1 × sgtddielectric, beckmann",
    )


@pytest.mark.parametrize(
    ("own", "settings", "expected"),
    [
        ("", [], {"distribution": "beckmann"}),
        ("ggx", [], {"distribution": "ggx"}),
        ("GGX", [], {"distribution": "ggx"}),
        ("ggx", ["shift=1"], {"distribution": "ggx", "shift": 1.0}),
        ("beckmann", ["masking=height_correlated"], {"distribution": "beckmann", "masking": "height_correlated"}),
        ("ggx", ["p=0.8"], {"distribution": "sgtd", "gamma": 2.0, "p": 0.8}),
        ("beckmann", ["p=0.8"], {"distribution": "sgtd", "gamma": math.inf, "p": 0.8}),
        ("beckmann", ["gamma=1.8"], {"distribution": "sgtd", "gamma": 1.8}),
        ("beckmann", ["gamma=inf"], {"distribution": "sgtd", "gamma": math.inf}),
        ("beckmann", ["distribution=std", "lambda=0.2"], {"distribution": "std", "lambda": 0.2}),
    ],
)
def test_settings_move_from_the_own_distribution(tmp_path, own, settings, expected):
    word = f'<string name="distribution" value="{own}"/>' if own else ""
    pair = pair_of(tmp_path, f'<bsdf type="roughconductor">{word}</bsdf>', *settings)
    assert properties(pair.right, "sgtdconductor") == [expected]


@pytest.mark.parametrize(
    ("shape", "nearest"),
    [
        ("", "ggx"),
        ('<float name="gamma" value="1.6"/>', "ggx"),
        ('<float name="gamma" value="9"/>', "beckmann"),
        ('<float name="gamma" value="inf"/>', "beckmann"),
        ('<string name="distribution" value="snd"/><float name="lambda" value="0.3"/>', "beckmann"),
        ('<string name="distribution" value="std"/><float name="mu" value="0.1"/>', "ggx"),
        ('<string name="distribution" value="beckmann"/><float name="shift" value="1"/>', "beckmann"),
    ],
)
def test_a_scene_with_sgtdconductor_is_compared_the_other_way_round(tmp_path, shape, nearest):
    body = f'<bsdf type="twosided"><bsdf type="sgtdconductor">{METAL}{shape}</bsdf></bsdf>'
    graph = graph_of(tmp_path, body)
    pair = exchange(graph, {})
    assert properties(pair.left, "roughconductor") == [{"material": "Au", "alpha": 0.3, "distribution": nearest}]
    assert properties(pair.right, "sgtdconductor") == properties(graph, "sgtdconductor")


def test_the_halfway_gamma_is_halfway():
    """Largest difference of P(slope > x) to GGX and to Beckmann, on both sides of the constant."""

    def survival(gamma, y):
        return math.exp(-y) if math.isinf(gamma) else (1 + y / (gamma - 1)) ** (1 - gamma)

    def distance(a, b):
        return max(abs(survival(a, y) - survival(b, y)) for y in (0.001 * 1.02**i for i in range(900)))

    for gamma, nearer, farther in ((3.25, 2.0, math.inf), (3.33, math.inf, 2.0)):
        assert distance(gamma, nearer) < distance(gamma, farther)
        assert nearest_distribution("student", gamma) == ("ggx" if nearer == 2.0 else "beckmann")


def test_a_mixed_scene(tmp_path):
    body = ROUGH + f'<bsdf type="sgtdconductor">{METAL}<float name="gamma" value="1.7"/></bsdf>'
    pair = pair_of(tmp_path, body)
    assert len(properties(pair.left, "roughconductor")) == 2
    assert len(properties(pair.right, "sgtdconductor")) == 2
    assert [e.left for e in pair.exchanges] == ["roughconductor, beckmann", "roughconductor, ggx"]
    assert [e.right for e in pair.exchanges] == ["sgtdconductor, beckmann", "sgtdconductor, sgtd, gamma = 1.7"]


def test_shift_and_mu_replace_each_other(tmp_path):
    body = '<bsdf type="sgtdconductor"><float name="mu" value="0.1"/></bsdf>'
    assert properties(pair_of(tmp_path, body, "shift=2").right, "sgtdconductor") == [{"shift": 2.0}]
    both = properties(pair_of(tmp_path, body, "shift=2", "mu=0.3").right, "sgtdconductor")
    assert both == [{"mu": 0.3, "shift": 2.0}]  # the plugin refuses this: it was asked for twice


def test_a_distribution_replaces_the_whole_shape(tmp_path):
    body = '<bsdf type="sgtdconductor"><float name="lambda" value="0.3"/><float name="mu" value="0.1"/></bsdf>'
    pair = pair_of(tmp_path, body, "distribution=gtd", "gamma=3")
    assert properties(pair.right, "sgtdconductor") == [{"distribution": "gtd", "gamma": 3.0}]


def test_parameters_includes_and_old_versions(tmp_path):
    (tmp_path / "materials.xml").write_text(
        '<scene version="0.6.0"><bsdf type="roughconductor" id="included"><float name="alphaU" value="0.1"/>'
        '<float name="alphaV" value="$rough"/></bsdf></scene>'
    )
    body = '<default name="rough" value="0.2"/><include filename="materials.xml"/>'
    pair = pair_of(tmp_path, body, "gamma=3", rough="0.4")
    (right,) = properties(pair.right, "sgtdconductor")
    assert right == {"alpha_u": 0.1, "alpha_v": 0.4, "distribution": "sgtd", "gamma": 3.0}
    assert "materials.xml" in pair.exchanges[0].place


def test_samples_per_pass_is_left_to_the_passes_of_the_renderer(tmp_path):
    graph = graph_of(tmp_path, '<integrator type="path"><integer name="samples_per_pass" value="7"/></integrator>')
    assert all("samples_per_pass" not in node.props for node in graph.materials("path"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gamma", "expected name=value"),
        ("=2", "expected name=value"),
        ("gamma=", "expected name=value"),
        ("gama=2", 'did you mean "gamma"?'),
        ("alpha=0.2", "unknown property"),
        ("gamma=two", "not a number"),
    ],
)
def test_bad_settings(text, message):
    with pytest.raises(UserError, match=message.replace("?", r"\?")):
        parse_settings([text])


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            '<bsdf type="conductor"/>',
            "nothing to exchange: the scene has 1 × conductor.*never exchanged: conductor \\(smooth\\)",
        ),
        ('<float name="x" value="$y"/>', "undefined parameter"),
    ],
)
def test_bad_scenes(tmp_path, body, message):
    with pytest.raises(UserError, match=message) as caught:
        pair_of(tmp_path, body)
    assert "\n" not in str(caught.value)
