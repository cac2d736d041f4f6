"""Light on explicit surfaces, beside Mitsuba's on the same mesh and beside Smith's model."""

from __future__ import annotations

import csv
import json
import math

import mitsuba as mi
import numpy as np
import pytest
import sgtd
from sgtd.errors import UserError
from sgtd.microsurface import Surface, generate
from sgtd.microsurface.comparison import compare
from sgtd.microsurface.figures import draw_directions
from sgtd.microsurface.goniometer import Bins, Material, Setup, goniometer, measure, measure_model, visible_shares
from sgtd.microsurface.smith import MASKINGS, MeshModel, TargetModel, lobe, single_scattering
from sgtd.microsurface.tables import sentences
from test_microsurface import run

GGX = sgtd.Ndf(distribution="ggx", alpha=0.5)


@pytest.fixture(autouse=True)
def variant() -> None:
    mi.set_variant("scalar_rgb")


@pytest.fixture(scope="module")
def ggx() -> Surface:
    return generate(GGX, n=128, tolerance=2e-3)


def setup(theta: float, material: Material | None = None, walks: int = 200_000, **bins: int) -> Setup:
    return Setup(theta, 0.0, material or Material.of(), Bins(**bins), walks)


def rendered(surface: Surface, theta: float, bounces: int, folder, size: int = 512, spp: int = 3) -> float:
    """What leaves a field of tiles after so many bounces, or fewer, by Mitsuba: a camera looks at one period, all around is light."""
    path = folder / "tile.ply"
    surface.save(path)
    tile = {"type": "ply", "filename": str(path), "face_normals": True}
    tile["bsdf"] = {"type": "conductor", "material": "none"}
    scene = {"type": "scene", "group": {"type": "shapegroup", "tile": tile}, "light": {"type": "constant"}}
    (ny, nx), (dx, dy) = surface.heights.shape, surface.spacing
    width, depth = nx * dx, ny * dy
    transform = mi.ScalarTransform4f()
    for i in range(-4, 5):
        for j in range(-4, 5):
            place = transform.translate([i * width, j * depth, 0.0])
            scene[f"tile_{i}_{j}"] = {"type": "instance", "to_world": place, "group": {"type": "ref", "id": "group"}}
    t = math.radians(theta)
    target = np.array([0.5 * width, 0.5 * depth, surface.heights.max()])
    origin = target + 10.0 * max(width, depth) * np.array([math.sin(t), 0.0, math.cos(t)])
    to_world = transform.look_at(list(origin), list(target), [0, 1, 0])
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "luminance"}
    scene["sensor"] = {
        "type": "orthographic",
        "far_clip": 1e6,
        "to_world": to_world @ transform.scale([0.5 * width * math.cos(t), 0.5 * depth, 1.0]),
        "film": film,
        "sampler": {"type": "independent", "sample_count": spp},
    }
    scene["integrator"] = {"type": "path", "max_depth": bounces + 1, "rr_depth": 1000}
    return float(np.array(mi.render(mi.load_dict(scene))).mean())


@pytest.mark.parametrize("distribution, theta", [("beckmann", 60), ("ggx", 30)])
def test_mitsuba_traces_the_same(tmp_path, distribution, theta):
    """Three standard errors of the two are 2.5e-3; no ray is lost here, where Mitsuba moves rays off the surface by an epsilon."""
    surface = generate(sgtd.Ndf(distribution=distribution, alpha_u=0.5, alpha_v=0.4), n=128, tolerance=2e-3)
    found = measure(surface, setup(theta, walks=600_000))
    assert found.lost == 0 and found.scattered.total()[0] == pytest.approx(1.0, abs=1e-12)
    for bounces in (1, 2):
        energy = found.scattered.total(0, slice(0, bounces))[0]
        assert rendered(surface, theta, bounces, tmp_path) == pytest.approx(energy, abs=3e-3)


def test_energies_of_the_first_bounce():
    """Surfaces made and traced by another program (numpy, tiles), α = 0.5, 60°."""
    for shape, mesh, smith in (
        (dict(distribution="beckmann"), 0.872, 0.869),
        (dict(distribution="gnd", p=3), 0.888, 0.886),
        (dict(distribution="ggx"), 0.743, 0.698),
    ):
        ndf = sgtd.Ndf(**shape, alpha=0.5)
        at = setup(60, walks=150_000)
        assert measure(generate(ndf, n=256), at).scattered.total(0, 0)[0] == pytest.approx(mesh, abs=0.01)
        assert single_scattering(TargetModel(ndf), at, MASKINGS[1]).total()[0] == pytest.approx(smith, abs=1e-3)


def test_the_model_of_the_facets_themselves(ggx):
    model = MeshModel(ggx)
    w = np.random.default_rng(1).normal(size=(40, 3))
    w = np.abs(w) * (1, 1, 1) / np.linalg.norm(w, axis=1, keepdims=True)
    assert model.projected_area(w) == pytest.approx(ggx.projected_area(w), rel=1e-3)
    # what is drawn is what a view sees: facets by their projected area
    at = setup(60)
    m, _ = model.visible(at.wi, np.random.default_rng(2).random((200_000, 2)))
    found, _ = np.histogram(m @ at.wi, np.linspace(0, 1, at.bins.cosines + 1))
    area = ggx.core.areas_by_cosine(at.core)
    assert found / 200_000 == pytest.approx(area / area.sum(), abs=5e-3)


def test_the_walk_is_height_correlated_scattering_and_more():
    at = setup(60)
    walk = measure_model(GGX, at)
    single = single_scattering(TargetModel(GGX), at, "height_correlated")
    energy, error = walk.scattered.total(0, 0)
    assert single.total()[0] == pytest.approx(energy, abs=4 * error)
    # by direction
    a, b = (x.directions(0, slice(0, 1)) for x in (walk.scattered, single))
    errors = np.hypot(walk.scattered.errors()[0, 0].mean(axis=-1), single.errors()[0, 0].mean(axis=-1))
    assert np.mean(((a - b)[errors > 1e-5] / errors[errors > 1e-5]) ** 2) < 1.3
    # the lobe has the energy of all further orders
    assert lobe(GGX, at, "height_correlated").total(0)[0] == pytest.approx(1.0 - single.total()[0], abs=3e-3)


def test_metals_pay_at_every_facet(ggx):
    gold = Material.of("Au")
    assert gold.kind == "conductor" and gold.eta[2] > gold.eta[0]
    red, _, blue = measure(ggx, setup(30, gold, 50_000)).scattered.energy.sum(axis=(0, 1, 2, 3))
    assert red > 0.85 and blue < 0.4
    single = single_scattering(TargetModel(GGX), setup(0, gold), "separable").energy.sum(axis=(0, 1, 2, 3))
    mirror = single_scattering(TargetModel(GGX), setup(0), "separable").energy.sum(axis=(0, 1, 2, 3))
    bsdf = mi.load_dict({"type": "conductor", "material": "Au"})
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(0, 0, 1)
    _, normal = bsdf.sample(mi.BSDFContext(), si, 0.5, mi.Point2f(0.5, 0.5))
    assert single / mirror == pytest.approx(np.array(normal).ravel(), abs=0.01)


@pytest.mark.parametrize("ior", [1.1, 1.5, 2.5, 1 / 1.5])
def test_glass_keeps_all_light(ggx, ior):
    glass = Material.of(ior=ior)
    at = setup(40, glass, 100_000)
    scattered = measure(ggx, at).scattered
    (above, error), (below, _) = scattered.total(0), scattered.total(1)
    assert above + below == pytest.approx(1.0, abs=1e-12) and error < 2e-3
    # Smith's single scattering has less than the surface's first order and all further ones together
    for masking in MASKINGS:
        single = single_scattering(MeshModel(ggx), at, masking)
        assert single.total(0)[0] < above + 3 * error and single.total(1)[0] < below + 3 * error
        assert single.total(1)[0] > 0.6 * below


def test_a_flat_surface_is_fresnels(tmp_path):
    flat = Surface(np.zeros((8, 8)), (1.0, 1.0))
    at = setup(50, Material.of(ior=1.5), 40_000)
    scattered = measure(flat, at).scattered
    reflected = mi.fresnel(math.cos(math.radians(50)), 1.5)[0]
    assert scattered.total(0)[0] == pytest.approx(reflected, abs=4 * scattered.total(0)[1])
    refracted = math.degrees(math.asin(math.sin(math.radians(50)) / 1.5))
    assert scattered.directions(1, slice(None)).sum(axis=1).argmax() == int(refracted / 3)


def test_what_is_seen_of_facets(ggx):
    at = setup(70, walks=400_000)
    share, error, area = visible_shares(ggx, at, measure(ggx, at))
    known = area > 1e-4
    # the mean over the facing area is G1, whatever the arrangement
    assert (share * area)[known].sum() == pytest.approx(ggx.g1(at.wi), abs=2e-3)
    assert share[known].max() <= 1 + 5 * error[known].max()
    # facets turned away hide behind what they belong to: Smith's model does not know that
    assert share[known][0] < 0.9 * ggx.g1(at.wi)


def test_a_comparison_knows_its_own_model(ggx):
    """The model beside itself has no failures; beside the surface it has."""
    found = compare(ggx, GGX, [0, 60], material=Material.of(), bins=Bins(15, 12), walks=100_000)
    by_name = {(e.theta, e.effect, e.model): e for e in found.effects}
    first = by_name[60, "energy, 1 facet", "Smith, target, height-correlated"]
    assert first.significant and -0.08 < first.difference < -0.01
    mean = by_name[60, "mean masking", "Smith, target"]
    assert mean.expected == pytest.approx(float(GGX.g1(found.views[1].setup.wi))) and abs(mean.relative) < 0.03
    walk = by_name[60, "energy, 2 and more facets", "random walk"]
    assert walk.expected == pytest.approx(1 - first.expected, abs=5e-3)
    orders = sum(by_name[60, f"energy, {k} facets", "random walk"].surface for k in ("2", "3", "4 and more"))
    assert walk.surface == pytest.approx(orders, abs=1e-12)
    turned = by_name[60, "masking, facets turned away", "Smith, mesh"]
    assert turned.surface < turned.expected and turned.significant


def test_command_gonio(ggx, tmp_path):
    ggx.save(tmp_path / "S.npy")
    few = ("--walks", 20_000, "--polar", 9, "--azimuths", 8, "--orders", 3)
    said = run("gonio", tmp_path / "S.npy", "--theta", 0, 60, *few, "--material", "Au", "-o", tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"report.html", "gonio.json", "effects.csv", "masking.csv", "bins.csv", "energies.png"} <= names
    page = (tmp_path / "out" / "report.html").read_text()
    assert "random walk" in page and "http" not in page.replace("http://www.w3.org", "") and page.count("<img") == 5
    found = json.loads((tmp_path / "out" / "gonio.json").read_text())
    assert [view["theta"] for view in found["views"]] == [0, 60] and found["material"]["name"] == "Au"
    assert found["sentences"][0] in said
    # bins add up to energies by order
    table = np.genfromtxt(tmp_path / "out" / "bins.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    mine = table[(table["theta"] == 60) & (table["source"] == "surface") & (table["facets"] == 1)]
    energy = np.mean([mine[color].sum() for color in ("red", "green", "blue")])
    assert energy == pytest.approx(found["views"][1]["energy_by_order"][0][0][0], abs=1e-5)


def test_a_comparison_of_glass(ggx):
    found = compare(ggx, GGX, [30], material=Material.of(ior=1.5), bins=Bins(9, 8, 3), walks=20_000)
    assert {e.effect for e in found.effects} >= {"energy, 1 facet transmitted", "directions, 1 facet transmitted"}
    # the walk has all light too, and of the transmitted second order about what the surface has
    walk = found.views[0].walk.scattered
    assert sum(walk.total(side)[0] for side in (0, 1)) == pytest.approx(1.0, abs=1e-12)
    again = next(e for e in found.effects if e.effect == "energy, 2 and more facets transmitted")
    assert again.surface > 0.02 and again.relative == pytest.approx(0.0, abs=0.5)
    assert "transmitted" in " ".join(sentences(found)) and len(draw_directions(found, found.views[0]).png) > 1000


def test_goniometer_by_one_call(ggx):
    first, second = goniometer(ggx, [0, 60], walks=10_000, seed=4)
    assert first.scattered.walks == 10_000 and second.mean_bounces > 1
    again = goniometer(ggx, [60], walks=10_000, seed=4)[0]
    assert np.array_equal(again.scattered.energy, second.scattered.energy)


def test_arguments_out_of_range(ggx):
    for wrong, said in (
        (lambda: setup(90), "theta is 90"),
        (lambda: Material.of("Au", 1.5), "together"),
        (lambda: Material.of(ior=1.0), "the index is 1"),
        (lambda: Material.of("unobtainium"), "unobtainium"),
        (lambda: measure(ggx, setup(0, orders=100)), '"orders" is 100'),
    ):
        with pytest.raises(UserError, match=said):
            wrong()


def test_command_study(tmp_path):
    few = ("-n", 32, "--correlation", 4, "--tolerance", 0.02, "--walks", 5000, "--theta", 60, "--workers", 1)
    arguments = ("study", "--shape", "ggx", "--alpha", 0.3, 0.6, "--seeds", 2, *few, "-o", tmp_path)
    said = run(*arguments)
    assert len(list((tmp_path / "surfaces").glob("*.npy"))) == 2  # one for both roughnesses
    lines = (tmp_path / "study.jsonl").read_text().splitlines()
    assert len(lines) == 4 and "means over seeds" in said
    assert run(*arguments) == said and len((tmp_path / "study.jsonl").read_text().splitlines()) == 4
    results = [json.loads(line)["result"]["effects"] for line in lines if json.loads(line)["arguments"]["alpha"] == 0.6]
    mean = [next(e for e in effects if e["effect"] == "mean masking")["surface"] for effects in results]
    with (tmp_path / "summary.csv").open() as file:
        row = next(r for r in csv.DictReader(file) if r["alpha"] == "0.6" and r["effect"] == "mean masking")
    assert float(row["surface"]) == pytest.approx(np.mean(mean), rel=1e-7)
    assert float(row["spread"]) == pytest.approx(np.std(mean, ddof=1) / math.sqrt(2), rel=1e-3)


def test_a_mesh_from_afar_is_the_material(tmp_path):
    """The scene of the README: light tails at low roughness, where what Smith's model leaves out is a percent."""
    surface = generate(sgtd.Ndf(distribution="beckmann", alpha=0.2), n=128)
    surface.save(tmp_path / "S.ply")
    scene = sgtd.PACKAGE_DIR / "scenes" / "with_mesh" / "patch.xml"
    values = dict(mesh=tmp_path / "S.ply", scale=0.5 / 128, gamma=1e6, alpha=0.2, width=64, height=64, spp=100)
    image = np.array(mi.render(mi.load_file(str(scene), **{k: str(v) for k, v in values.items()}), seed=1))[..., 0]
    material, mesh = (half[14:58].mean() for half in (image[:, 12:32], image[:, 32:52]))
    assert mesh == pytest.approx(material, rel=0.03)
