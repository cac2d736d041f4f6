"""BSDFs over numpy arrays, in whatever variant is set: one call per array in JIT variants, a loop in scalar ones."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest


def load(plugin: str = "sgtdconductor", **properties) -> mi.BSDF:
    """A BSDF; arrays become bitmap textures without filtering, looked up at (u, v)."""
    made = {name: texture(value) if isinstance(value, np.ndarray) else value for name, value in properties.items()}
    return mi.load_dict({"type": plugin, **made})


def texture(values: np.ndarray) -> dict:
    """A raw one-channel texture with one texel per number."""
    data = np.ascontiguousarray(np.atleast_2d(values)[..., None], dtype=np.float32)
    return {"type": "bitmap", "data": mi.TensorXf(data), "raw": True, "filter_type": "nearest", "wrap_mode": "clamp"}


def needs_equal_rounding() -> None:
    """Skips a test that asks Mitsuba's code and ours for the same last bit, where they come from different compilers.

    Scalar code of the wheels before 3.9.1 fuses other operations than ours. JIT variants compile both alike, and the scalar ones are held to them.
    """
    if is_scalar() and tuple(int(part) for part in mi.__version__.split(".")) < (3, 9, 1):
        pytest.skip(f"scalar code of Mitsuba {mi.__version__} rounds otherwise; JIT variants are compared")


def is_scalar() -> bool:
    return mi.variant().startswith("scalar_")


def channel(value) -> list:
    """The color channels of a spectrum; of a Mueller matrix, those of its first element."""
    return value[0, 0] if "polarized" in mi.variant() else value


def _interaction(wi, uv, count):
    si = dr.zeros(mi.SurfaceInteraction3f, count) if count is not None else dr.zeros(mi.SurfaceInteraction3f)
    si.wi = wi
    si.uv = uv
    if "spectral" in mi.variant():
        si.wavelengths = type(si.wavelengths)([450.0, 520.0, 580.0, 650.0])
    return si


def _rows(wi, uv, *others):
    """Broadcasts to (N, k) arrays of single precision."""
    arrays = [np.asarray(a, dtype=np.float32) for a in (wi, (0.5, 0.5) if uv is None else uv, *others)]
    count = max(a.shape[0] if a.ndim == 2 else 1 for a in arrays)
    return count, [np.broadcast_to(a, (count, a.shape[-1])) for a in arrays]


def _vector(kind, a):
    return kind(*(mi.Float(np.ascontiguousarray(c)) for c in a.T))


def _collect(result, count):
    """(N, k) numbers of a Dr.Jit value."""
    return np.stack([np.broadcast_to(np.array(c, dtype=np.float32), (count,)) for c in result], axis=-1)


def context(mode=None, component=None) -> mi.BSDFContext:
    """Of radiance and all components, if not said otherwise."""
    ctx = mi.BSDFContext()
    if mode is not None:
        ctx.mode = mode
    if component is not None:
        ctx.component = component
    return ctx


def evaluate(bsdf, wi, wo, uv=None, mode=None, component=None):
    """eval_pdf: values (N, channels) and densities (N,)."""
    value, pdf = _evaluate("eval_pdf", bsdf, wi, wo, uv, mode, component)
    return value, pdf


def evaluate_apart(bsdf, wi, wo, uv=None, component=None):
    """The same from eval and pdf."""
    return tuple(_evaluate(call, bsdf, wi, wo, uv, None, component)[i] for i, call in enumerate(("eval", "pdf")))


def _evaluate(call, bsdf, wi, wo, uv=None, mode=None, component=None):
    ctx = context(mode, component)
    count, (wi, uv, wo) = _rows(wi, uv, wo)

    def split(answer):
        if call == "eval":
            return answer, None
        if call == "pdf":
            return None, answer
        return answer

    if is_scalar():
        values, pdfs = [], []
        function = getattr(bsdf, call)
        for one_wi, one_uv, one_wo in zip(wi.tolist(), uv.tolist(), wo.tolist()):
            value, pdf = split(function(ctx, _interaction(one_wi, one_uv, None), one_wo))
            if value is not None:
                values.append([float(v) for v in channel(value)])
            if pdf is not None:
                pdfs.append(pdf)
        return np.array(values, dtype=np.float32), np.array(pdfs, dtype=np.float32)
    si = _interaction(_vector(mi.Vector3f, wi), _vector(mi.Point2f, uv), count)
    value, pdf = split(getattr(bsdf, call)(ctx, si, _vector(mi.Vector3f, wo)))
    dr.eval(value, pdf)
    values = None if value is None else _collect(channel(value), count)
    return values, None if pdf is None else np.broadcast_to(pdf.numpy(), (count,))


def sample(bsdf, wi, u, uv=None, mode=None, component=None):
    """Directions (N, 3), densities (N,), weights (N, channels); invalid samples have weight 0.

    The third column of u, 0.5 if there is none, selects the component.
    """
    wo, pdf, weight, *_ = sample_all(bsdf, wi, u, uv, mode, component)
    return wo, pdf, weight


def sample_all(bsdf, wi, u, uv=None, mode=None, component=None):
    """As `sample`, with eta, the type and the component of each sample."""
    ctx = context(mode, component)
    count, (wi, uv, u) = _rows(wi, uv, u)
    if u.shape[1] == 2:
        u = np.concatenate([u, np.full((count, 1), 0.5, dtype=np.float32)], axis=1)
    if is_scalar():
        rows = []
        for one_wi, one_uv, one_u in zip(wi.tolist(), uv.tolist(), u.tolist()):
            bs, w = bsdf.sample(ctx, _interaction(one_wi, one_uv, None), one_u[2], one_u[:2])
            weight = [float(c) for c in channel(w)]
            rows.append(([float(c) for c in bs.wo], bs.pdf, weight, bs.eta, bs.sampled_type, bs.sampled_component))
        kinds = (np.float32,) * 4 + (np.uint32,) * 2
        return tuple(np.array(column, dtype=kind) for column, kind in zip(zip(*rows), kinds))
    si = _interaction(_vector(mi.Vector3f, wi), _vector(mi.Point2f, uv), count)
    bs, w = bsdf.sample(ctx, si, mi.Float(u[:, 2].copy()), _vector(mi.Point2f, u[:, :2]))
    dr.eval(bs, w)
    numbers = (np.broadcast_to(a.numpy(), (count,)) for a in (bs.pdf, bs.eta, bs.sampled_type, bs.sampled_component))
    pdf, eta, kind, which = numbers
    return _collect(bs.wo, count), pdf, _collect(channel(w), count), eta, kind, which


# -- inputs


def direction(theta_degrees, phi_degrees=0.0):
    theta, phi = np.radians(theta_degrees), np.radians(phi_degrees)
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def uniform_directions(rng, count, lower=False):
    """Uniform on the upper hemisphere, or on the sphere."""
    z = rng.uniform(-1.0 if lower else 0.0, 1.0, count)
    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1)


def normals(rng, count, alpha_u, alpha_v, reach=3.0):
    """Normals whose stretched slopes spread over some multiples of the roughness, tails included."""
    rho = reach * np.abs(rng.standard_cauchy(count))
    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    m = np.stack([alpha_u * rho * np.cos(phi), alpha_v * rho * np.sin(phi), np.ones(count)], axis=-1)
    return m / np.linalg.norm(m, axis=-1, keepdims=True)


def reflect(wi, m):
    return 2.0 * np.sum(wi * m, axis=-1, keepdims=True) * m - wi


def refract(wi, m, eta):
    """The refracted direction for the relative index below the surface `eta`, and whether there is one."""
    wi, m = np.asarray(wi, dtype=np.float64), np.asarray(m, dtype=np.float64)
    cos = np.sum(wi * m, axis=-1, keepdims=True)
    ratio = np.where(cos > 0, 1.0 / eta, eta)
    square = 1.0 - ratio**2 * (1.0 - cos**2)
    return m * (ratio * cos - np.sign(cos) * np.sqrt(np.maximum(square, 0.0))) - ratio * wi, square[..., 0] > 0


def relative_error(found, expected, floor=0.0):
    """|found - expected| / |expected|, where expected exceeds the floor; 0 where both are equal."""
    found, expected = np.broadcast_arrays(np.asarray(found, dtype=np.float64), np.asarray(expected, dtype=np.float64))
    size = np.maximum(np.abs(expected), floor)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(found == expected, 0.0, np.abs(found - expected) / size)
