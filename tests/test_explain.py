"""`sgtd explain`: is what it says of a scene true, and is it said of every material?"""

from __future__ import annotations

import gc
import json
import math

import conftest
import mitsuba as mi
import pytest
import sgtd
from sgtd import _core, cli
from sgtd._core import Shape
from sgtd.explain.advice import greatest_change

SENSOR = '<sensor type="perspective"><film type="hdrfilm"/></sensor><emitter type="constant"/>'


@pytest.fixture(autouse=True)
def _variant_is_restored():
    before = mi.variant()
    # materials of other tests would be counted among the code of this process
    gc.collect()
    yield
    if before:
        mi.set_variant(before)


@pytest.fixture
def explain(capsys, tmp_path):
    """Explains a scene with this body: (status, standard output, error output)."""

    def run(body, *arguments, variant="scalar_rgb"):
        file = tmp_path / "scene.xml"
        file.write_text(f'<scene version="3.0.0">{SENSOR}{body}</scene>')
        with pytest.raises(SystemExit) as exit_:
            cli.main(["explain", str(file), "--variant", variant, *arguments])
        captured = capsys.readouterr()
        return exit_.value.code, captured.out, captured.err

    return run


@pytest.fixture
def explained(explain):
    """The same as JSON, without timings."""

    def run(body, *arguments, variant="scalar_rgb"):
        status, out, err = explain(body, "--json", "--repetitions", "0", *arguments, variant=variant)
        assert (status, err) == (0, "")
        return json.loads(out)

    return run


def ours(identity, inside="", plugin="sgtdconductor", **numbers):
    floats = "".join(f'<float name="{name.rstrip("_")}" value="{value}"/>' for name, value in numbers.items())
    return f'<bsdf type="{plugin}" id="{identity}">{floats}{inside}</bsdf>'


def word(name, value):
    return f'<string name="{name}" value="{value}"/>'


def shape_of(bsdf):
    return f'<shape type="sphere">{bsdf}</shape>'


# written, node, shifted, code, factor on the roughness
NODES = {
    "nothing": (ours("x"), "ggx", False, "ggx", 1.0),
    "shifted ggx": (ours("x", word("distribution", "ggx"), shift=0.5), "ggx", True, "tables", 1.0),
    "student": (ours("x", word("distribution", "student"), gamma=1.6), "student", False, "tables", 1.0),
    "student 2": (ours("x", word("distribution", "student"), gamma=2), "ggx", False, "ggx", 1.0),
    "hyper_cauchy": (ours("x", word("distribution", "hyper_cauchy"), gamma=2), "ggx", False, "ggx", math.sqrt(2)),
    "beckmann": (ours("x", word("distribution", "beckmann")), "beckmann", False, "beckmann", 1.0),
    "exact beckmann": (ours("x", gamma="inf"), "beckmann", False, "tables", 1.0),
    "gnd": (ours("x", word("distribution", "sgnd"), p=1.5), "gnd", False, "tables", 1.0),
    "std": (ours("x", gamma=1.8, lambda_=0.3, shift=0.2), "std", True, "tables", 1.0),
    "skew only": (ours("x", lambda_=0.3), "ggx", False, "ggx", 1.3),
    "sgtd": (ours("x", gamma=1.8, p=1.2, lambda_=0.3, shift=0.2), "sgtd", True, "tables", 1.0),
    "mu": (ours("x", mu=0.1, alpha=0.2), "ggx", True, "tables", 1.0),
}


@pytest.mark.parametrize("name", NODES)
def test_node_and_tables_are_those_of_the_core(explained, name):
    bsdf, node, shifted, code, scale = NODES[name]
    report = explained(bsdf)
    (material,) = report["materials"]
    assert (material["id"], material["node"], material["shifted"], material["code"]) == ("x", node, shifted, code)
    assert material["alpha_scale"] == pytest.approx(scale, rel=1e-12)
    assert material["why"]
    if code == "tables":
        shape = material["shape"]
        ndf = sgtd.Ndf(**{**shape, "gamma": float(shape["gamma"])}, accuracy=material["accuracy_asked"])
        assert (material["table_bytes"], material["accuracy_reached"]) == (ndf.table_bytes, ndf.accuracy_reached)
        assert ndf.node == node
        assert 0 < material["build_seconds"] < 1
        assert report["table_bytes"] == ndf.table_bytes
    else:
        assert (material["table_bytes"], material["accuracy_reached"], report["table_bytes"]) == (0, None, 0)
    if name == "mu":
        assert material["shape"]["shift"] == pytest.approx(0.5)


def test_the_plugin_has_tables_where_it_is_said_to(explained):
    """The explanation and the plugin decide on their own: equal bit patterns tell which code ran."""
    import scattering as sc

    conftest.use("scalar_rgb")
    wi, wo = sc.direction(40.0, 10.0), sc.direction(20.0, 190.0)
    rough = {d: sc.evaluate(sc.load("roughconductor", distribution=d, alpha=0.3), wi, wo) for d in ("ggx", "beckmann")}
    for name in ("nothing", "student 2", "beckmann", "exact beckmann", "student", "shifted ggx"):
        bsdf, _, _, code, _ = NODES[name]
        (material,) = explained(bsdf)["materials"]
        given = {k: math.inf if v == "inf" else v for k, v in material["properties"].items()}
        found = sc.evaluate(sc.load(alpha=0.3, **given), wi, wo)
        equal = {d: all((a == b).all() for a, b in zip(found, value)) for d, value in rough.items()}
        assert equal == {d: d == code for d in rough}, name


def test_effects(explained):
    def on(bsdf):
        (material,) = explained(bsdf)["materials"]
        return {effect["name"] for effect in material["effects"] if effect["on"]}

    base = {"visible normals"}
    assert on(ours("x")) == base
    assert on(ours("x", '<boolean name="sample_visible" value="false"/>')) == set()
    assert on(ours("x", lambda_=0.1)) == base
    assert on(ours("x", alpha_u=0.1, alpha_v=0.2)) == base | {"anisotropy"}
    assert on(ours("x", word("masking", "height_correlated"))) == base | {"height-correlated masking"}
    assert on(ours("x", '<texture type="checkerboard" name="alpha"/>')) == base | {"roughness texture"}
    assert on(ours("x", '<boolean name="sample_bounded" value="true"/>')) == base | {"bounded sampling"}
    # what has tables is bounded if nothing is said
    base |= {"bounded sampling"}
    assert on(ours("x", shift=0.2)) == base | {"shift"}
    assert on(ours("x", shift=0.2, lambda_=0.1)) == base | {"shift", "skew"}
    assert on(ours("x", p=1.1)) == base | {"kurtosis"}
    assert on(ours("x", gamma=1.8)) == base | {"tail"}
    assert on(ours("x", p=50)) == base | {"kurtosis", "double precision"}
    assert on(ours("x", '<boolean name="sample_bounded" value="false"/>', gamma=1.8)) == {"visible normals", "tail"}
    (material,) = explained(ours("x", gamma=1.8))["materials"]
    assert material["properties"] == {"gamma": 1.8}
    assert set(material["defaults"]) == {"distribution", "alpha", "masking", "sample_visible", "accuracy"}


NESTED = (
    '<bsdf type="twosided" id="outer">' + ours("inner", '<texture type="checkerboard" name="alpha"/>', gamma=1.7) + "</bsdf>"
    '<bsdf type="mask" id="hole"><float name="opacity" value="0.5"/><ref id="outer"/></bsdf>'
    '<bsdf type="blendbsdf" id="blend"><float name="weight" value="0.5"/><ref id="alone"/>'
    '<bsdf type="roughconductor" id="theirs"/></bsdf>'
    + ours("alone", gamma=1.7)
    + '<bsdf type="bumpmap"><texture type="checkerboard"/>' + ours("bumped", shift=0.3) + "</bsdf>"
    + shape_of('<ref id="hole"/>') + shape_of('<ref id="blend"/>') + shape_of('<ref id="alone"/>')
    + shape_of('<bsdf type="diffuse"/>')
)  # fmt: skip


def test_nested_referenced_and_included_materials(explained, tmp_path):
    (tmp_path / "more.xml").write_text(f'<scene version="3.0.0">{ours("included", p=1.4)}</scene>')
    report = explained(NESTED + '<include filename="more.xml"/>')
    materials = {material["id"]: material for material in report["materials"]}
    assert set(materials) == {"inner", "alone", "bumped", "included"}
    assert materials["inner"]["inside"] == ['twosided "outer"']
    assert materials["alone"]["inside"] == ['blendbsdf "blend"']
    assert materials["bumped"]["inside"] == ["bumpmap"]
    assert materials["included"]["inside"] == []
    assert "more.xml" in materials["included"]["place"]
    assert materials["inner"]["properties"]["alpha"] == "a checkerboard"
    # one table for both
    assert materials["inner"]["shares_tables_with"] == ["alone"]
    assert materials["alone"]["shares_tables_with"] == ["inner"]
    bytes_ = [materials[name]["table_bytes"] for name in ("alone", "bumped", "included")]
    assert report["table_bytes"] == sum(bytes_)
    others = {other["id"]: other for other in report["others"]}
    assert others["theirs"]["exchangeable"] and not others["hole"]["exchangeable"]
    assert report["code_paths"] is None


@pytest.mark.slow
def test_code_paths_are_counted(explained):
    conftest.use("llvm_ad_rgb")

    def paths(*bsdfs):
        gc.collect()
        return explained("".join(map(shape_of, bsdfs)), variant="llvm_ad_rgb")

    a, b, ggx = ours("a", gamma=1.7), ours("b", p=1.3, shift=0.4), ours("c")
    assert paths(a)["code_paths"] == 1
    assert paths(a, b)["code_paths"] == 1
    assert paths(a, b)["advice"] == []
    two = paths(a, b, ggx)
    assert two["code_paths"] == 2 and "2 code paths" in two["advice"][0]
    correlated = ours("d", word("masking", "height_correlated"), gamma=1.7)
    four = paths(a, correlated, ggx, '<bsdf type="diffuse"/>')
    assert four["code_paths"] == 4
    assert any("a and d differ in masking alone" in text for text in four["advice"])
    assert paths(a, ours("steep", p=50))["code_paths"] == 2
    unbounded = paths(a, ours("e", '<boolean name="sample_bounded" value="false"/>', gamma=1.7))
    assert unbounded["code_paths"] == 2
    assert any("a and e differ in sample_bounded alone" in text for text in unbounded["advice"])


def advice_on(report):
    (material,) = report["materials"]
    return "\n".join(material["advice"])


def test_advice_names_what_would_be_cheaper(explained):
    text = advice_on(explained(ours("x", gamma=2.003)))
    change = greatest_change(Shape(2.003, 1.0, 0.0, 0.0), Shape(2.0, 1.0, 0.0, 0.0))
    assert "gamma = 2 (is 2.003) makes it GGX" in text and f"{100 * change:.2g} %" in text
    # by hand: for Student's, P(slope > x) = (1 + x^2/(g-1))^(1-g)
    x = [0.01 * k for k in range(1, 1000)]
    assert change == pytest.approx(max(abs((1 + t * t / 1.003) ** -1.003 - 1 / (1 + t * t)) for t in x), rel=1e-2)
    assert "GGX" not in advice_on(explained(ours("x", gamma=2.1)))
    assert "alpha_u and alpha_v are both 0.3" in advice_on(explained(ours("x", alpha_u=0.3, alpha_v=0.3)))
    assert "needs no logarithm" in advice_on(explained(ours("x", gamma=2.501, shift=0.3)))
    assert "1e-7" in advice_on(explained(ours("x", gamma=1.7, accuracy=0)))
    assert "sample_visible" in advice_on(explained(ours("x", '<boolean name="sample_visible" value="false"/>')))
    assert "lambda = 0 with alpha 1.3" in advice_on(explained(ours("x", gamma=1.7, lambda_=0.3)))
    assert advice_on(explained(ours("x"))) == ""


def test_advice_on_double_precision_is_right(explained):
    conftest.use("llvm_ad_rgb")
    for given, name in ((dict(p=50.0), "p"), (dict(shift=1000.0), "shift")):
        text = advice_on(explained(ours("x", **given), variant="llvm_ad_rgb"))
        least = float(text.split(f"{name} up to ")[1].split()[0])
        for factor, steep in ((0.97, False), (1.05, True)):
            values = dict(gamma=2.0, p=1.0, lam=0.0, shift=0.0) | {name: least * factor}
            assert (_core.Ndf.get(Shape(**values), 1e-2).steepness > _core.steep) == steep


def test_a_render_is_timed(explain):
    """What a user sees: the scene with these materials and with the built-ins, and nothing that is not asked for."""
    body = shape_of(ours("x", gamma=1.7, alpha=0.3))
    status, out, err = explain(body, "--json", "--repetitions", "3")
    assert (status, err) == (0, "")
    report = json.loads(out)
    cost = report["render"]
    assert 0.3 < cost["low"] <= cost["ratio"] <= cost["high"] < 30
    assert cost["against"] == "roughconductor, ggx" and "148 x 111 pixels" in cost["what"] and "3 pairs" in cost["what"]
    assert report["materials"][0]["costs"] == []
    status, out, _ = explain(body, "--repetitions", "1")
    assert status == 0 and out.startswith("A render of ") and "times (quartiles" in out.partition("\n")[0]
    assert "by itself" not in out


def test_a_scene_that_cannot_be_rendered_is_explained(explain, monkeypatch):
    monkeypatch.setattr(f"{__name__}.SENSOR", "")
    status, out, err = explain(ours("x", gamma=1.7), "--repetitions", "1")
    assert (status, err) == (0, "")
    assert out.startswith("A render was not timed: the scene has no sensor.") and "because" in out


def test_materials_alike_are_told_of_once(explain):
    """Four plates that differ in roughness alone, one of another shape: two tables, and one line for all that can be exchanged."""
    plates = [ours(name, gamma=1.7, alpha=alpha) for name, alpha in zip("abcd", (0.1, 0.2, 0.3, 0.4))]
    others = [f'<bsdf type="roughconductor" id="{name}"/>' for name in "xyz"]
    status, out, _ = explain("".join([*plates, ours("e", gamma=1.8), *others]), "--repetitions", "0")
    assert status == 0
    assert out.count("because") == 2 and "4 × sgtdconductor: a, b, c, d" in out and "e: sgtdconductor" in out
    for name, alpha in zip("abcd", (0.1, 0.2, 0.3, 0.4)):
        assert f"{name}: alpha = {alpha}" in out
    assert out.count("could be exchanged") == 1 and "x, y, z: roughconductor" in out


def test_costs_of_functions_are_measured(explain):
    status, out, err = explain(ours("x", gamma=1.7), "--json", "--repetitions", "3", "--functions")
    assert (status, err) == (0, "")
    (cost,) = json.loads(out)["materials"][0]["costs"]
    assert 0.3 < cost["low"] <= cost["ratio"] <= cost["high"] < 30
    assert cost["against"] == "roughconductor ggx" and "scalar_rgb, 3 pairs" in cost["what"]


def test_costs_in_kernels(explain):
    conftest.use("llvm_ad_rgb")
    body = ours("x", '<texture type="checkerboard" name="alpha"/>' + word("masking", "height_correlated"), gamma=1.7)
    status, out, _ = explain(body, "--json", "--repetitions", "3", "--functions", variant="llvm_ad_rgb")
    alone, render = json.loads(out)["materials"][0]["costs"]
    assert status == 0
    assert "alone" in alone["what"] and "render" in render["what"]
    # tables are gathers where GGX is arithmetic
    assert alone["ratio"] > 1


def test_the_terminal_says_what_json_says(explain):
    status, out, err = explain(NESTED, "--repetitions", "1", "--functions")
    assert (status, err) == (0, "")
    for text in ("inner: sgtdconductor", "student", "because", "bytes", "one for alone, inner", "ms", "permitted"):
        assert text in out
    assert "theirs: roughconductor" in out and "could be exchanged" in out
    assert "×" in out and "roughconductor ggx" in out
    assert "1 × diffuse, never exchanged: no microfacets" in out


def test_scenes_without_our_materials(explain):
    status, out, err = explain(shape_of('<bsdf type="roughconductor" id="metal"/>'))
    assert (status, err) == (0, "")
    assert "no material of this family" in out and "metal: roughconductor" in out and "could be exchanged" in out
    status, out, err = explain("")
    assert (status, err) == (0, "")
    assert "no materials" in out


@pytest.mark.parametrize(
    "body, words",
    [
        (ours("x", gamma=0.5), ["gamma", "0.5"]),
        (ours("x", word("distribution", "ggx"), gamma=2.5), ["ggx", "gamma"]),
        (ours("x", gama=2.5), ["gama"]),
        ("<bsdf", ["scene.xml"]),
        (shape_of('<ref id="nobody"/>'), ["nobody"]),
    ],
)
def test_files_that_cannot_be_read(explain, body, words):
    status, out, err = explain(body)
    assert status == 1 and out == ""
    assert err.count("\n") == 1 and err.startswith("sgtd: ")
    for text in words:
        assert text in err


def test_a_file_that_is_not_there(capsys, tmp_path):
    with pytest.raises(SystemExit) as exit_:
        cli.main(["explain", str(tmp_path / "none.xml"), "--variant", "scalar_rgb"])
    assert exit_.value.code == 1
    assert "no such file" in capsys.readouterr().err


def test_json_has_every_key(explained):
    report = explained(NESTED)
    assert set(report) == {"scene", "variant", "render", "code_paths", "table_bytes", "advice", "materials", "others"}
    keys = {
        "id",
        "plugin",
        "place",
        "inside",
        "distribution",
        "properties",
        "defaults",
        "shape",
        "node",
        "shifted",
        "code",
    }
    keys |= {"why", "alpha_scale", "effects", "table_bytes", "build_seconds", "accuracy_asked", "accuracy_reached"}
    keys |= {"shares_tables_with", "costs", "advice", "missing_energy_table_bytes", "missing_energy_error"}
    for material in report["materials"]:
        assert set(material) == keys
        assert set(material["shape"]) == {"gamma", "p", "lam", "shift"}
    assert explained(ours("x", gamma="inf"))["materials"][0]["shape"]["gamma"] == "inf"


def test_losses_are_told(explain, explained):
    """Bytes and error of the table of missing energy, for one roughness and for a pair; nothing without it."""
    flag = '<boolean name="multiple_scattering" value="true"/>'
    body = ours("a", flag, gamma=1.8, alpha=0.3) + ours("b", flag, gamma=1.8, alpha_u=0.3, alpha_v=0.1)
    one, pair, none = explained(body + ours("c", gamma=1.8))["materials"]
    assert (
        one["missing_energy_table_bytes"] == 4 * (4 * 32 * 32 + 512)
        and pair["missing_energy_table_bytes"] == 4 * 4 * 128 * 32
    )
    assert 0 < one["missing_energy_error"] < 1e-3 and 0 < pair["missing_energy_error"] < 1e-3
    assert none["missing_energy_table_bytes"] == 0 and none["missing_energy_error"] is None
    _, out, _ = explain(body, "--repetitions", "0")
    assert out.count("error of E") == 2


def test_multiple_scattering_of_a_smooth_material_is_questioned(explained):
    flag = '<boolean name="multiple_scattering" value="true"/>'
    smooth, rough = explained(ours("a", flag, gamma=1.8, alpha=0.05) + ours("b", flag, gamma=1.8, alpha=0.5))[
        "materials"
    ]
    assert any("multiple_scattering = false" in advice for advice in smooth["advice"])
    assert not any("multiple_scattering = false" in advice for advice in rough["advice"])
