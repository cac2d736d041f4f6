"""Rendering in passes gives what one pass gives: for every integrator, film and sampler of the wheel."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from conftest import use
from sgtd.scene.render import PassRenderer, plan_passes, render

INTEGRATORS = {
    **{name: {"type": name} for name in ("path", "direct", "volpath", "volpathmis", "ptracer", "depth")},
    **{name: {"type": name} for name in ("prb", "prb_basic", "prbvolpath", "direct_projective", "prb_projective")},
    "aov": {"type": "aov", "aovs": "depth:depth,normal:sh_normal", "image": {"type": "path"}},
    "aov alone": {"type": "aov", "aovs": "depth:depth"},
    "moment": {"type": "moment", "image": {"type": "path"}},
    "moment of aov": {"type": "moment", "image": {"type": "aov", "aovs": "d:depth", "i": {"type": "path"}}},
    "stokes": {"type": "stokes", "image": {"type": "path"}},
}
# Renders what is none of ours: volumes of Gaussians
NOT_TESTED = {"volprim_rf_basic"}
ONLY_TRACED = {"prb", "prb_basic", "prbvolpath", "direct_projective", "prb_projective"}
ONLY_POLARIZED = {"stokes"}


def scene(integrator=None, film="hdrfilm", rfilter="gaussian", sampler="independent", spp=16, bands=0, **more):
    transform = mi.ScalarTransform4f
    spectra = {f"band{i}": {"type": "spectrum", "value": [(450 + 30 * i, 1), (600 + 30 * i, 2)]} for i in range(bands)}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": integrator or {"type": "path"},
            "sensor": {
                "type": "perspective",
                "fov": 40,
                "to_world": transform().look_at([0, 3, 4], [0, 0, 0], [0, 1, 0]),
                "film": {"type": film, "width": 8, "height": 8, "rfilter": {"type": rfilter}, **spectra, **more},
                "sampler": {"type": sampler, "sample_count": spp},
            },
            "floor": {
                "type": "rectangle",
                "to_world": transform().rotate([1, 0, 0], -90).scale(2),
                "bsdf": {"type": "sgtdconductor", "alpha": 0.4},
            },
            "lamp": {
                "type": "rectangle",
                "to_world": transform().translate([0, 5, 0]).rotate([1, 0, 0], 90).scale(1.5),
                "emitter": {"type": "area", "radiance": 3.0},
            },
        }
    )


def one_pass(built, spp):
    """What Mitsuba itself makes of the scene, with all channels of the film."""
    built.integrator().render(built, built.sensors()[0], seed=99, spp=spp)
    return np.array(built.sensors()[0].film().bitmap(), dtype=float)


def test_every_integrator_of_the_wheel_is_tested():
    folder = Path(mi.__file__).parent
    sources = "".join(path.read_text() for path in (folder / "python" / "ad" / "integrators").glob("*.py"))
    registered = {line.split('"')[1] for line in sources.splitlines() if line.startswith("mi.register_integrator")}
    native = {"aov", "depth", "direct", "moment", "path", "ptracer", "stokes", "volpath", "volpathmis"}
    assert all((folder / "plugins" / f"{name}.so").exists() for name in native)
    assert registered | native == {config["type"] for config in INTEGRATORS.values()} | NOT_TESTED


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("mode", ["scalar", "traced"])
def test_four_passes_are_as_bright_as_one(name, mode):
    if mode == "scalar" and name in ONLY_TRACED:
        pytest.skip(f"{name} is for JIT variants only")
    rgb = "scalar_rgb" if mode == "scalar" else "llvm_ad_rgb"
    use(rgb if name not in ONLY_POLARIZED else rgb.replace("_rgb", "_spectral_polarized"))
    built, spp = scene(INTEGRATORS[name]), 1024
    (result,) = render([built], 0, spp, lambda _: None)
    image, reference = np.array(result.bitmap, dtype=float), one_pass(built, spp)
    assert (result.passes, result.spp) == (4, spp)
    assert image.shape == reference.shape
    # Of each channel the mean, which knows no noise to speak of; a factor of 4 was the fault.
    means = reference.mean(axis=(0, 1))
    assert image.mean(axis=(0, 1)) == pytest.approx(means, rel=0.06, abs=0.01 * np.abs(means).max())
    for half, _ in result.halves:
        assert half.mean() == pytest.approx(result.rgb().mean(), rel=0.12)


@pytest.mark.parametrize("rfilter", ["box", "gaussian", "mitchell", "lanczos", "tent"])
@pytest.mark.parametrize("integrator", ["path", "ptracer"])
def test_filters_crops_and_films(scalar, rfilter, integrator):
    built = scene({"type": integrator}, rfilter=rfilter, crop_offset_x=2, crop_offset_y=3, crop_width=5, crop_height=4)
    (result,) = render([built], 0, 512, lambda _: None)
    image, reference = np.array(result.bitmap), one_pass(built, 512)
    assert image.shape == reference.shape == (4, 5, 3)
    assert image.mean() == pytest.approx(reference.mean(), rel=0.05)


@pytest.mark.parametrize("pixels", ["luminance", "luminance_alpha", "rgba", "xyz"])
@pytest.mark.parametrize("integrator", ["path", "ptracer"])
def test_pixel_formats(scalar, pixels, integrator):
    built = scene({"type": integrator}, pixel_format=pixels)
    (result,) = render([built], 0, 512, lambda _: None)
    assert np.array(result.bitmap).mean((0, 1)) == pytest.approx(one_pass(built, 512).mean((0, 1)), rel=0.1)
    assert result.rgb().shape == (8, 8, 3)


@pytest.mark.parametrize("bands", [1, 2, 4])
def test_a_spectral_film_is_shown_as_the_mean_of_its_bands(bands):
    use("scalar_spectral")
    built = scene(film="specfilm", bands=bands)
    (result,) = render([built], 0, 64, lambda _: None)
    image, reference = (np.reshape(a, (8, 8, bands)) for a in (np.array(result.bitmap, float), one_pass(built, 64)))
    assert image.mean((0, 1)) == pytest.approx(reference.mean((0, 1)), rel=0.1)
    assert result.bands == bands
    assert result.rgb()[..., 0] == pytest.approx(image.mean(axis=2), rel=1e-5)


def test_the_passes_of_independent_samples_are_the_sum_of_their_seeds(variant):
    """To the last digits: four passes by hand, summed as the film would have."""
    built = scene(rfilter="box")
    (result,) = render([built], 0, 18, lambda _: None)
    camera, parts = built.sensors()[0], []
    for seed, spp in enumerate((5, 5, 4, 4)):
        built.integrator().render(built, camera, seed=seed, spp=spp)
        parts.append(spp * np.array(camera.film().bitmap(), dtype=float))
    assert np.array(result.bitmap, dtype=float) == pytest.approx(sum(parts) / 18, rel=1e-5, abs=1e-6)


def test_the_halves_have_disjoint_samples_and_make_the_whole(scalar):
    (result,) = render([scene(rfilter="box")], 0, 10, lambda _: None)
    (a, n), (b, m) = result.halves
    assert (n + m, result.spp, result.passes) == (10, 10, 4)
    assert np.mean(np.abs(a - b)) > 1e-3
    assert result.rgb() == pytest.approx((n * a + m * b) / (n + m), rel=1e-5, abs=1e-5)


# --- samplers with structure

STRUCTURED = ["stratified", "multijitter", "orthogonal", "ldsampler"]


@pytest.mark.parametrize("sampler", STRUCTURED)
def test_a_sampler_with_structure_renders_in_one_pass(variant, sampler):
    built = scene(sampler=sampler)
    (result,) = render([built], 0, 16, lambda _: None)
    assert (result.passes, result.halves, result.structure) == (1, None, built.sensors()[0].sampler().class_name())
    assert "keeps its structure in one pass" in result.sampling_note()
    built.integrator().render(built, built.sensors()[0], seed=0, spp=16)
    assert np.array(result.bitmap) == pytest.approx(np.array(built.sensors()[0].film().bitmap()), rel=1e-5, abs=1e-6)


def test_where_memory_asks_for_passes_the_output_says_so(llvm, monkeypatch):
    monkeypatch.setattr("sgtd.scene.render._PASS_STRUCTURED", 8 * 8 * 16)
    (result,) = render([scene(sampler="stratified")], 0, 64, lambda _: None)
    assert result.passes == 4
    assert "within each of 4 passes only" in result.sampling_note()


@pytest.mark.parametrize("integrator", ["path", "prb", "ptracer"])
def test_the_samples_that_are_counted_are_those_that_are_taken(llvm, integrator):
    (result,) = render([scene({"type": integrator}, sampler="stratified", spp=64)], 0, 10, lambda _: None)
    assert result.spp == 16  # stratified samples come in squares
    (result,) = render([scene({"type": integrator}, spp=64)], 0, 10, lambda _: None)
    assert result.spp == 10


@pytest.mark.parametrize("structured", [False, True])
@pytest.mark.parametrize("scalar", [False, True])
def test_passes_add_up_and_fit_in_memory(structured, scalar):
    for pixels, spp in ((1, 1), (100, 3), (2_000_000, 256), (24, 1001), (50_000_000, 2)):
        plan = plan_passes(pixels, spp, structured, scalar)
        assert sum(plan) == spp
        assert max(plan) - min(plan) <= 1
        if not (structured and scalar):  # a scalar variant keeps no samples
            assert max(plan) * pixels <= 2**25 or max(plan) == 1


def test_a_plan_of_very_many_samples_takes_no_time():
    plan = plan_passes(2_000_000, 2**32 - 1, False, False)
    assert (len(plan) > 10**9, plan[0], plan[len(plan) - 1]) == (True, 3, 2)


# --- interruptions


def test_a_pass_that_is_cut_short_is_not_taken_for_whole(scalar):
    built = scene(spp=2**18)
    renderer = PassRenderer(built, 0, 2**18)
    finished = threading.Event()

    def cancel():
        # one that comes before a pass begins is forgotten
        while not finished.wait(0.1):
            built.integrator().cancel()

    thread = threading.Thread(target=cancel)
    thread.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            for number in range(len(renderer.plan)):
                renderer.render_pass(number)
    finally:
        finished.set()
        thread.join()


@pytest.mark.slow
def test_a_signal_that_the_parent_ignores_changes_nothing(tmp_path):
    """As a job in the background of a script has it: SIGINT is ignored, but Mitsuba listens to it while it renders."""
    file = tmp_path / "long.xml"
    file.write_text(
        """<scene version="3.0.0"><integrator type="path"/><emitter type="constant"/><sensor type="perspective">
        <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/></film></sensor>
        <shape type="sphere"><point name="center" x="0" y="0" z="5"/><bsdf type="roughconductor"/></shape></scene>"""
    )
    images = []
    for interrupted in (False, True):
        output = tmp_path / f"{interrupted}.exr"
        command = [sys.executable, "-m", "sgtd", "render", file, "-o", output, "--variant", "scalar_rgb"]
        process = subprocess.Popen(
            [*command, "--spp", "6000"],
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(4 if interrupted else 0):
            time.sleep(0.3)
            if process.poll() is None:
                os.kill(process.pid, signal.SIGINT)
        out, _ = process.communicate(timeout=60)
        assert process.returncode == 0
        assert "6000 samples per pixel" in out
        images.append(np.array(mi.Bitmap(str(output))))
    assert images[0] == pytest.approx(images[1], rel=1e-5)
