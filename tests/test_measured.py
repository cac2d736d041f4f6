"""Files of measured reflectance: what was written comes back, and what is damaged is refused in one line."""

from __future__ import annotations

import io
import struct
import zipfile

import mitsuba as mi
import numpy as np
import pytest
from measured_files import direction, rgl_fields, write_merl, write_tensors, write_utia
from sgtd.errors import UserError
from sgtd.measured import HEIGHTS, kind_of, read


@pytest.fixture(autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def lobe(wi, wo):
    """A smooth reciprocal reflectance of three colors."""
    h = wi + wo
    h = h / np.linalg.norm(h, axis=1, keepdims=True)
    bright = 0.1 + 2.0 * np.exp(-(np.arccos(np.clip(h[:, 2], -1.0, 1.0)) ** 2) / 0.3)
    return bright[:, None] * np.array([1.0, 0.5, 0.25])


def brushed(wi, wo):
    h = wi + wo
    h = h / np.linalg.norm(h, axis=1, keepdims=True)
    return (0.1 + np.exp(-8.0 * h[:, 0] ** 2 - 2.0 * h[:, 1] ** 2))[:, None] * np.array([1.0, 0.5, 0.25])


def oblique(count, seed=0, least=0.3):
    w = np.random.default_rng(seed).normal(size=(2, count, 3))
    w[..., 2] = np.abs(w[..., 2]) + least
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def merl(tmp_path_factory):
    path = tmp_path_factory.mktemp("merl") / "anything"
    write_merl(path, lobe)
    return path


def test_merl(merl):
    found = read(merl)
    assert found.kind == "MERL" and found.data.isotropic and found.data.channels == ("R", "G", "B")
    assert 1200 < len(found.data.value) < 2200
    assert found.data.value == pytest.approx(lobe(found.data.wi, found.data.wo), rel=1e-9)
    wi, wo = oblique(300)
    assert found.evaluate(wi, wo) == pytest.approx(lobe(wi, wo), rel=1e-2)
    assert found.evaluate(wo, wi) == pytest.approx(found.evaluate(wi, wo), rel=1e-9)


def test_utia(tmp_path):
    path = tmp_path / "fabric.bin"
    write_utia(path, brushed)
    found = read(path)
    assert found.kind == "UTIA" and not found.data.isotropic and 2000 < len(found.data.value) < 3100
    assert found.data.value == pytest.approx(brushed(found.data.wi, found.data.wo), rel=1e-12)
    wi, wo = oblique(300)
    inside = np.minimum(wi[:, 2], wo[:, 2]) > np.cos(np.radians(75.0))
    assert np.isnan(found.evaluate(wi, wo)).all(axis=1).tolist() == (~inside).tolist()
    assert found.evaluate(wi, wo)[inside] == pytest.approx(brushed(wi, wo)[inside], rel=0.15)
    # an entry of the grid, by its place in the file: light at 30 and 7.5 degrees, view at 45 and 15
    light, view = np.array([direction(*np.radians((30, 7.5)))]), np.array([direction(*np.radians((45, 15)))])
    entry = 288 * (48 * 2 + 1) + 48 * 3 + 2
    stored = struct.unpack_from("<d", path.read_bytes(), 8 * (288**2 + entry))[0]
    assert found.evaluate(light, view)[0, 1] == pytest.approx(stored)


@pytest.mark.parametrize(
    "phi", [[0.0], np.linspace(-np.pi, 0, 5), np.linspace(-np.pi, -np.pi / 2, 3), np.linspace(-np.pi, np.pi, 9)]
)
def test_rgl_is_what_mitsuba_makes_of_it(tmp_path, phi):
    path = tmp_path / "a.bsdf"
    write_tensors(path, rgl_fields(np.asarray(phi), np.radians([0.0, 20.0, 45.0, 70.0, 85.0]), 1))
    found = read(path)
    assert found.kind == "RGL" and found.data.isotropic == (len(phi) == 1)
    bsdf, si = mi.load_dict({"type": "measured", "filename": str(path)}), mi.SurfaceInteraction3f()
    wi, wo = oblique(200, least=0.1)
    expected = []
    for light, view in zip(wi, wo):
        si.wi = mi.Vector3f(*light)
        expected.append(np.array(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*view))) / view[2])
    assert found.evaluate(wi, wo) == pytest.approx(np.array(expected), rel=1e-5)
    assert found.data.value == pytest.approx(found.evaluate(found.data.wi, found.data.wo))


def test_a_flat_spectrum_is_gray(tmp_path):
    path = tmp_path / "a_spec.bsdf"
    fields = rgl_fields(np.zeros(1), np.radians([0.0, 40.0, 85.0]), 1, np.linspace(380.0, 780.0, 41))
    fields["spectra"] = np.ascontiguousarray(np.repeat(fields["spectra"][:, :, :1], 41, axis=2))
    write_tensors(path, fields)
    value = read(path).data.value
    assert value[:, 1:] == pytest.approx(np.repeat(value[:, :1], 2, axis=1), rel=1e-5)


def table(path, rows, header="theta_i,phi_i,theta_o,phi_o,R,G,B", separator=","):
    lines = [header.replace(",", separator), *(separator.join(f"{x:.9g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_csv(tmp_path, separator):
    rows = [(30, 10, 50, 200, 1, 2, 3), (45, 0, 45, 180, 4, 5, 6)]
    found = read(table(tmp_path / "scan.txt", rows, separator=separator))
    assert found.data.wi[0] == pytest.approx(direction(*np.radians((30, 10))))
    assert found.data.wo[1] == pytest.approx(direction(*np.radians((45, 180))))
    assert found.data.value.tolist() == [[1, 2, 3], [4, 5, 6]] and "degrees" in found.data.notes[0]


def test_units_of_csv(tmp_path):
    rows = [(0.5, 0, 0.7, 3, 1), (0.2, 0, 1.1, 3, 2)]
    guessed = read(table(tmp_path / "a.csv", rows, "theta_i,phi_i,theta_o,phi_o,value")).data
    told = read(table(tmp_path / "b.csv", rows, "theta_i [rad],phi_i [rad],theta_o [rad],phi_o [rad],value")).data
    degrees = read(table(tmp_path / "c.csv", rows, "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,value")).data
    assert guessed.wi == pytest.approx(told.wi) and "radians" in guessed.notes[0] and not told.notes
    assert degrees.wi[0, 2] == pytest.approx(np.cos(np.radians(0.5)))


def test_a_scan_in_the_plane(tmp_path):
    """The mirror's side has the sign of the light; a highlight on the other one is remarked."""
    path = tmp_path / "scan.csv"
    theta = np.arange(-70.0, 71.0, 2.0)
    value = np.exp(-(((theta - 45.0) / 10.0) ** 2))
    path.write_text("# theta_i: 45\ntheta,brdf\n" + "\n".join(f"{t},{f:.6g}" for t, f in zip(theta, value)))
    data = read(path).data
    brightest = data.wo[np.argmax(data.value)]
    assert np.sum(brightest * data.wi[0] * [-1, -1, 1]) > 0.999 and data.isotropic
    assert not any("retro" in note for note in data.notes)
    turned = tmp_path / "turned.csv"
    turned.write_text("# theta_i: 45\ntheta,brdf\n" + "\n".join(f"{-t},{f:.6g}" for t, f in zip(theta, value)))
    assert any("change the sign of theta_o" in note for note in read(turned).data.notes)
    cosine = tmp_path / "cosine.csv"
    cosine.write_text("theta_i,theta_o,ccbrdf\n45,60,1\n45,0,1\n")
    assert read(cosine).data.value[:, 0] == pytest.approx([2.0, 1.0])


def test_npz(tmp_path):
    wi, wo = oblique(50)
    np.savez(tmp_path / "a.npz", wi=wi, wo=wo, value=lobe(wi, wo))
    assert read(tmp_path / "a.npz").data.value == pytest.approx(lobe(wi, wo))
    np.savez_compressed(tmp_path / "b.npz", theta_i=[10.0, 20.0], theta_o=[30.0, 40.0], value=[1.0, 2.0])
    assert read(tmp_path / "b.npz").data.value.ravel().tolist() == [1.0, 2.0]


def test_highlights_keep_their_share(tmp_path):
    """Of a great file a part is used, with pairs at all half angles."""
    wi, wo = oblique(20000, least=0.1)
    np.savez(tmp_path / "a.npz", wi=wi, wo=wo, value=np.ones(len(wi)))
    data = read(tmp_path / "a.npz").data
    tilt = np.degrees(np.arccos(data.h[:, 2]))
    assert 2500 < len(data.value) < 3100 and (tilt < 3.0).sum() >= 8 and "pairs are used" in data.notes[-1]


def test_heights_are_told_by_content(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((8, 8)))
    (tmp_path / "a.bin").write_bytes((tmp_path / "a.npy").read_bytes())
    (tmp_path / "b.di").write_bytes(b"\0\1\2\3" * 100)
    assert [kind_of(tmp_path / name) for name in ("a.bin", "a.npy", "b.di")] == [HEIGHTS] * 3


def npy_claim(shape: str, body: bytes = b"") -> bytes:
    """An ``.npy`` whose header says more than there is."""
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text.encode() + body


def zipped(name: str, content: bytes) -> bytes:
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w") as archive:
        archive.writestr(name, content)
    return memory.getvalue()


def rgl_bytes(tmp_path, **changed) -> bytes:
    fields = rgl_fields(np.zeros(1), np.radians([0.0, 40.0, 85.0]), 1)
    write_tensors(tmp_path / "whole", {k: a for k, a in {**fields, **changed}.items() if a is not None})
    return (tmp_path / "whole").read_bytes()


def nan_in(content: bytes, at: int, nan=b"\0\0\0\0\0\0\xf8\x7f") -> bytes:
    return content[:at] + nan + content[at + len(nan) :]


MERL_HEAD = struct.pack("<3i", 90, 90, 180)
BAD = {
    "a.csv": (lambda _: b"", "a.csv is empty: copy it again"),
    "b.csv": (lambda _: b"hello there\nworld\n", 'line 1: "hello there" names no columns'),
    "c.csv": (lambda _: b"theta_i,phi_i,theta_o,phi_o,R\n1,2,3,4,5\n1,2,3,4\n", "line 3: 4 numbers for 5 columns"),
    "d.csv": (lambda _: b"theta_i,theta_o,R\n10,20,nan\n", "line 2: R is nan: leave lines out"),
    "e.csv": (lambda _: b"theta_i,theta_o,R\n10,twenty,1\n", 'line 2: theta_o is "twenty", which is not a number'),
    "f.csv": (lambda _: b"theta_i,theta_o,R\n", "no line of numbers"),
    "g.csv": (lambda _: b"theta_i,phi_i,R\n1,2,3\n", "no column theta_o"),
    "h.csv": (lambda _: b"theta_i,theta_o\n1,2\n", "no column with values"),
    "i.csv": (lambda _: b"theta_i,theta_o,R\n\n1,270,1\n", "line 3: theta_o is 270 degrees"),
    "j.csv": (lambda _: b"theta_i,theta_o,R\n1,2,\xff\n", "byte 22 is no text"),
    "a.binary": (lambda _: MERL_HEAD + b"\0" * 1000, "truncated at byte 1012.*34992012 bytes"),
    "b.binary": (lambda _: struct.pack("<3i", 90, 90, 360) + b"\0" * 1000, "header says 90 × 90 × 360 cells"),
    "c.binary": (lambda _: b"some text\n", r'text \("some text"\), whose first line names no columns'),
    "d.binary": (lambda _: b"", "is empty"),
    "a.bin": (lambda _: b"\0" * 1000, "truncated at byte 1000.*1990656 bytes"),
    "b.bin": (
        lambda _: nan_in(b"\0" * 1990656, 800),
        "1 of 248832 values are no finite numbers, the first at byte 800",
    ),
    "c.bin": (lambda _: b"\0" * 1990648 + b"\x7f" * 8, "byte 1990648: .* is no reflectance"),
    "a.bsdf": (lambda path: rgl_bytes(path)[:2000], 'field ".*takes .* bytes.*the file ends at byte 2000'),
    "b.bsdf": (lambda path: rgl_bytes(path)[:30], "truncated at byte 30, inside the list"),
    "c.bsdf": (lambda path: rgl_bytes(path, ndf=None), 'no field "ndf" among description'),
    "d.bsdf": (
        lambda path: rgl_bytes(path, ndf=np.full((5, 6), np.nan, np.float32)),
        '30 of 30 numbers of the field "ndf"',
    ),
    "e.bsdf": (
        lambda _: b"tensor_file\0\1\0\1\0\0\0\1\0a\1\0\x0b" + struct.pack("<QQ", 30, 1 << 29),
        r'"a" \(536870912\) takes 4294967296 bytes',
    ),
    "f.bsdf": (lambda path: rgl_bytes(path, rgb=np.ones((1, 3, 2, 6, 6), np.float32)), "do not belong to"),
    "g.bsdf": (lambda _: b"<xml>\n", "text"),
    "a.npz": (
        lambda _: zipped("value.npy", npy_claim("(536870912,)")),
        "value.npy says that it has the shape .* 4294967296 bytes",
    ),
    "b.npz": (lambda _: b"PK\3\4" + b"\0" * 40, "damaged"),
    "c.npz": (lambda _: zipped("value.npy", npy_claim("(1,)", b"\0" * 8)), "it has value: give arrays wi, wo"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused_in_one_line(tmp_path, name):
    make, message = BAD[name]
    path = tmp_path / name
    path.write_bytes(make(tmp_path))
    with pytest.raises(UserError, match=message) as caught:
        read(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_nan_in_merl(merl, tmp_path):
    path = tmp_path / "nan.binary"
    path.write_bytes(nan_in(merl.read_bytes(), 12 + 8 * 1234))
    with pytest.raises(UserError, match="1 of 4374000 values are no finite numbers, the first at byte 9884"):
        read(path)


def test_what_is_no_file(tmp_path):
    with pytest.raises(UserError, match="there is no such file"):
        read(tmp_path / "none.csv")
    with pytest.raises(UserError, match="is a folder"):
        read(tmp_path)
