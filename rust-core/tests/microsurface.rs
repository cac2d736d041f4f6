//! Do generated surfaces have the slopes that were asked for, and does light on them go where geometry sends it?

mod cases;

use cases::{Case, Random, row_cases};
use glam::{DVec2, DVec3};
use sgtd_core::error::ParameterError;
use sgtd_core::microsurface::agreement::Agreement;
use sgtd_core::microsurface::facet::Material;
use sgtd_core::microsurface::generate::{Generated, Settings, generate};
use sgtd_core::microsurface::goniometer::{Counts, Setup};
use sgtd_core::microsurface::surface::Surface;
use sgtd_core::microsurface::trace::{End, Side, Tracer};
use sgtd_core::ndf::{Ndf, Roughness, Shadowing};
use sgtd_core::scattering::albedo::{Incidence, Rule, SingleScattering};
use sgtd_core::scattering::fresnel::dielectric;
use sgtd_core::scattering::random_walk::RandomWalk;
use std::f64::consts::PI;

fn made(case: Case, settings: &Settings) -> Generated {
    generate(&case.profile(), settings, |_, _| true).unwrap_or_else(|error| panic!("{case:?}: {error}"))
}

fn case(gamma: f64, p: f64, lambda: f64, shift: f64) -> Case {
    Case { gamma, p, lambda, shift }
}

const GGX: Case = Case { gamma: 2.0, p: 1.0, lambda: 0.0, shift: 0.0 };

fn small() -> Settings {
    Settings { size: 128, ..Settings::default() }
}

fn towards(degrees: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(sin, 0.0, cos)
}

fn setup(wi: DVec3, material: Material) -> Setup {
    Setup { wi, material, orders: 4, polar: 9, azimuths: 12, cosines: 8 }
}

/// Energy per color of one hemisphere.
fn hemisphere(counts: &Counts, below: usize) -> f64 {
    let half = counts.energy.len() / 2;
    counts.energy[below * half..(below + 1) * half].iter().sum::<f64>() / (3.0 * counts.walks as f64)
}

/// Every row at 128²: 32 768 facets. As many independent ones have a Kolmogorov–Smirnov distance of 4.8e-3 on average, and the worst of 100 bins
/// is off by 15 %.
#[test]
fn slopes_have_the_distribution_that_was_asked_for() {
    for (name, case) in row_cases() {
        let Generated { agreement, steps, .. } = made(case, &small());
        println!("{name} {case:?}: {agreement:?} in {steps} steps");
        assert!(agreement.ks < 1.5e-3, "{name}: {agreement:?}");
        assert!(agreement.tv < agreement.tv_independent, "{name}: {agreement:?}");
        assert!(agreement.worst_bin < 0.15, "{name}: {agreement:?}");
    }
}

/// Masking, the one number that Smith's theory and a surface share, against that of the target where tails are not too heavy.
#[test]
fn mean_masking_is_that_of_the_target() {
    for shape in [case(f64::INFINITY, 1.0, 0.0, 0.0), case(2.5, 1.5, 0.4, 0.7)] {
        let Generated { surface, agreement, .. } = made(shape, &Settings::default());
        assert!(agreement.ks < 5e-4 && agreement.worst_bin < 0.03, "{agreement:?}");
        let ndf = Ndf::new(Box::new(shape.profile()), 1e-8).unwrap_or_else(|error| panic!("{error}"));
        let alpha = Roughness { u: 0.5, v: 0.2 };
        let surface = surface.stretched(DVec2::new(alpha.u, alpha.v));
        for theta in [20.0, 50.0, 70.0, 85.0, 89.0] {
            let w = towards(theta);
            let error = surface.g1(w) / ndf.g1(alpha, w) - 1.0;
            assert!(error.abs() < 1e-3, "{shape:?} {theta}: {error:.1e}");
        }
    }
}

/// Smith's integral over slopes and the areas of facets are one thing only because a periodic surface is level on average.
#[test]
fn areas_are_smiths_integral() {
    let surface = made(GGX, &small()).surface.stretched(DVec2::new(0.4, 0.1));
    for (theta, phi) in [(10.0, 0.3), (60.0, 2.0), (80.0, -1.0), (89.5, 1.5_f64)] {
        let w = towards(theta);
        let w = DVec3::new(w.x * phi.cos(), w.x * phi.sin(), w.z);
        assert!((surface.g1(w) * (1.0 + surface.lambda(w)) - 1.0).abs() < 1e-12);
        let areas = setup(w, Material::Mirror).projected_areas(&Tracer::new(&surface));
        assert!((areas.iter().sum::<f64>() * surface.g1(w) / w.z - 1.0).abs() < 1e-12);
    }
}

/// Anisotropy is a spacing, roughness a scale: the statistics are those of the isotropic surface to rounding.
#[test]
fn anisotropy_changes_no_statistics() {
    let Generated { surface, agreement, .. } = made(GGX, &small());
    let alpha = DVec2::new(0.4, 0.1);
    let stretched = surface.stretched(alpha);
    for (a, b) in surface.slopes().iter().zip(stretched.slopes()) {
        assert!((b / alpha - *a).length() <= 1e-12 * (1.0 + a.length()));
    }
    let other = Agreement::of(&stretched, alpha, &GGX.profile());
    for (a, b) in [
        (agreement.ks, other.ks),
        (agreement.tv, other.tv),
        (agreement.worst_bin, other.worst_bin),
        (agreement.mean_error, other.mean_error),
    ] {
        assert!((a - b).abs() < 1e-12, "{agreement:?} {other:?}");
    }
}

/// The same surface and the same counts on one thread and on three; others for another seed.
#[test]
fn a_seed_says_everything() {
    let run = |threads: usize, seed: u64| {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap_or_else(|error| panic!("{error}"));
        pool.install(|| {
            let surface = made(GGX, &Settings { size: 64, seed, ..Settings::default() }).surface;
            let surface = surface.stretched(DVec2::splat(0.5));
            let counts = setup(towards(60.0), Material::Dielectric { eta: 1.5 }).measure(
                &Tracer::new(&surface),
                40_000,
                seed,
                |_| true,
            );
            (surface, counts)
        })
    };
    let one = run(1, 7);
    assert!(one == run(3, 7));
    assert!(one.0 != run(1, 8).0);
}

/// A watcher stops the work, and what was reached by then comes back.
#[test]
fn it_stops_when_told_to() {
    let mut seen = Vec::new();
    let watch = |step, distance| {
        seen.push(distance);
        step < 3
    };
    let result = generate(&GGX.profile(), &small(), watch).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((result.steps, seen.len()), (3, 4));
    // a thin ring does not get there in so few steps, and says so
    let ring = made(case(f64::INFINITY, 1.0, 0.0, 5.0), &Settings { steps: 10, ..small() });
    assert!(ring.steps == 10 && ring.agreement.ks > 2e-3, "{ring:?}");
}

#[test]
fn settings_out_of_range_are_named() {
    let base = small();
    for (name, settings) in [
        ("size", Settings { size: 8, ..base }),
        ("correlation", Settings { correlation: 0.5, ..base }),
        ("correlation", Settings { correlation: 33.0, ..base }),
        ("tolerance", Settings { tolerance: f64::NAN, ..base }),
        ("steps", Settings { steps: 0, ..base }),
    ] {
        let error = generate(&GGX.profile(), &settings, |_, _| true).err();
        assert!(matches!(error, Some(ParameterError::OutOfRange { name: found, .. }) if found == name), "{error:?}");
    }
    assert!(Surface::new(4, 4, DVec2::ONE, vec![0.0; 15]).is_err());
    assert!(Surface::new(4, 4, DVec2::new(1.0, 0.0), vec![0.0; 16]).is_err());
    assert!(Surface::new(4, 4, DVec2::ONE, vec![f64::NAN; 16]).is_err());
    assert!(Surface::new(3, 4, DVec2::ONE, vec![0.0; 12]).is_err());
}

/// The first crossing of a ray with the plane of each of nearby triangles that lies in the triangle: slow, and by other formulas.
fn by_force(surface: &Surface, origin: DVec3, d: DVec3, skip: Option<(i64, i64, usize)>, sign: f64) -> Option<f64> {
    let (nx, ny, spacing) = (surface.nx() as i64, surface.ny() as i64, surface.spacing());
    let mut nearest: Option<f64> = None;
    let z = |i: i64, j: i64| surface.heights()[(j.rem_euclid(ny) * nx + i.rem_euclid(nx)) as usize];
    let corner = |i: i64, j: i64| DVec3::new(i as f64 * spacing.x, j as f64 * spacing.y, z(i, j));
    for j in -3 * ny..4 * ny {
        for i in -3 * nx..4 * nx {
            let [a, b, c, e] = [corner(i, j), corner(i + 1, j), corner(i, j + 1), corner(i + 1, j + 1)];
            for (upper, [p, q, r]) in [[a, b, c], [e, c, b]].into_iter().enumerate() {
                if skip == Some((i, j, upper)) {
                    continue;
                }
                let n = (q - p).cross(r - p);
                if sign * n.dot(d) >= 0.0 {
                    continue;
                }
                let t = n.dot(p - origin) / n.dot(d);
                let at = origin + t * d;
                let inside = |u: DVec3, v: DVec3| (v - u).cross(at - u).dot(n) >= -1e-9 * n.length_squared();
                if t > 0.0 && inside(p, q) && inside(q, r) && inside(r, p) && nearest.is_none_or(|best| t < best) {
                    nearest = Some(t);
                }
            }
        }
    }
    nearest
}

/// Rays of all kinds, those along edges and through corners among them, meet what the slow search finds.
#[test]
fn rays_meet_the_first_triangle_in_their_way() {
    let mut random = Random::new(11);
    let (nx, ny) = (6, 5);
    let heights = (0..nx * ny).map(|_| random.unit() * 1.5).collect();
    let surface = Surface::new(nx, ny, DVec2::new(1.0, 0.7), heights).unwrap_or_else(|error| panic!("{error}"));
    let tracer = Tracer::new(&surface);
    let top = surface.range().1;
    let position = |end: End| match end {
        End::Hit(point) => Some(point),
        _ => None,
    };
    let (mut hits, mut away) = (0, 0);
    for k in 0..3000 {
        let special = k % 4 == 0;
        let at = if special {
            (f64::from(random.below(12)) / 12.0, f64::from(random.below(10)) / 10.0)
        } else {
            (random.unit(), random.unit())
        };
        let mut d = -random.direction();
        // not so flat that the slow search ends
        d.z = d.z.min(-0.35);
        if special {
            d = [DVec3::NEG_Z, DVec3::new(1.0, 0.0, -0.5), DVec3::new(0.0, -0.7, -0.4), DVec3::new(-1.0, 0.7, -0.8)]
                [random.below(4) as usize];
        }
        let d = d.normalize();
        let Some(point) = position(tracer.first(d, at)) else { panic!("{d:?} {at:?}: no hit from above") };
        let origin = DVec3::new(at.0 * nx as f64, at.1 * ny as f64 * 0.7, f64::from((top as f32).next_up()));
        let Some(t) = by_force(&surface, origin, d, None, 1.0) else { panic!("{d:?} {at:?}: the slow search fails") };
        let height = tracer.height(&point);
        assert!((origin.z + t * d.z - height).abs() < 1e-6, "{d:?} {at:?}: {height}, not {}", origin.z + t * d.z);
        // onwards, above or below
        let slope = tracer.slope(&point);
        let m = DVec3::new(-slope.x, -slope.y, 1.0).normalize();
        let side = if random.below(2) == 0 { Side::Above } else { Side::Below };
        let sign = if side == Side::Above { 1.0 } else { -1.0 };
        let mut next = random.direction();
        next.z = next.z.max(0.35) * random.sign();
        let next = next.normalize();
        if sign * next.dot(m) <= 1e-3 {
            continue;
        }
        let facet = point.facet(nx);
        let cell = ((facet / 2 % nx) as i64, (facet / 2 / nx) as i64);
        let foot = origin + t * d;
        let wrapped = |x: f64, size: f64, cell: i64, spacing: f64| {
            let x = x.rem_euclid(size);
            // onto the side of the tile that the cell is at
            if (x / spacing - cell as f64 - 0.5).abs() > 2.0 { x - size * (x / size - 0.5).signum() } else { x }
        };
        let foot =
            DVec3::new(wrapped(foot.x, nx as f64, cell.0, 1.0), wrapped(foot.y, ny as f64 * 0.7, cell.1, 0.7), height);
        let slow = by_force(&surface, foot, next, Some((cell.0, cell.1, facet % 2)), sign);
        match (tracer.next(&point, next, side), slow) {
            (End::Hit(point), Some(t)) => {
                hits += 1;
                let height = tracer.height(&point);
                // where a ray starts on an edge, the neighbor may or may not be in its way
                assert!(special || (foot.z + t * next.z - height).abs() < 1e-6, "{next:?} {foot:?}: {height}, {t}");
            }
            (End::Away, None) => away += 1,
            (found, slow) => assert!(special, "{next:?} from {foot:?} {side:?}: {found:?}, not {slow:?}"),
        }
    }
    assert!(hits > 300 && away > 300, "{hits} {away}");
}

/// No ray is lost and no energy appears, in heavy tails and at grazing angles too; and as much is seen of each kind of facet as there is.
#[test]
fn every_walk_ends() {
    for (shape, theta) in [(GGX, 0.0), (GGX, 85.0), (case(1.6, 1.0, 0.0, 0.0), 60.0), (row_cases()[0].1, 89.0)] {
        let surface = made(shape, &small()).surface.stretched(DVec2::new(0.8, 0.3));
        let tracer = Tracer::new(&surface);
        let setup = setup(towards(theta), Material::Mirror);
        let counts = setup.measure(&tracer, 50_000, 3, |_| true);
        assert_eq!((counts.walks, counts.lost), (50_000, 0), "{shape:?} {theta}");
        assert!((hemisphere(&counts, 0) - 1.0).abs() < 1e-12 && hemisphere(&counts, 1) == 0.0);
        assert_eq!(counts.first.iter().sum::<u64>(), 50_000);
        let noise = 4.0 * (setup.wi.z * setup.wi.z / 200_000.0).sqrt();
        for (first, area) in counts.first.iter().zip(setup.projected_areas(&tracer)) {
            let visible = *first as f64 / 50_000.0 * setup.wi.z;
            assert!(visible <= area + noise, "{shape:?} {theta}: {visible} of {area}");
        }
    }
}

/// Energies of the first bounce on surfaces made and traced by another program (numpy, tiles), α = .5, 60°.
#[test]
fn first_bounces_have_the_energy_of_other_programs() {
    for (shape, expected) in
        [(case(f64::INFINITY, 1.0, 0.0, 0.0), 0.872), (case(f64::INFINITY, 3.0, 0.0, 0.0), 0.888), (GGX, 0.743)]
    {
        let surface = made(shape, &Settings { size: 256, ..Settings::default() }).surface.stretched(DVec2::splat(0.5));
        let counts = setup(towards(60.0), Material::Mirror).measure(&Tracer::new(&surface), 100_000, 0, |_| true);
        let order = counts.energy.len() / 8;
        let first = counts.energy[..order].iter().sum::<f64>() / 300_000.0;
        println!("{shape:?}: {first:.4}");
        assert!((first - expected).abs() < 0.01, "{shape:?}: {first}, not {expected}");
    }
}

/// Glass keeps all light, from outside and (an index below 1) from inside; where it is flat it is Fresnel's.
#[test]
fn glass_reflects_or_transmits() {
    let rough = made(GGX, &small()).surface.stretched(DVec2::splat(0.5));
    let flat = Surface::new(4, 4, DVec2::ONE, vec![0.0; 16]).unwrap_or_else(|error| panic!("{error}"));
    for eta in [1.1, 1.5, 2.5, 1.0 / 1.1, 1.0 / 1.5, 0.4] {
        let glass = Material::Dielectric { eta };
        for theta in [0.0, 60.0, 80.0] {
            let counts = setup(towards(theta), glass).measure(&Tracer::new(&rough), 20_000, 1, |_| true);
            assert_eq!(counts.lost, 0);
            assert!((hemisphere(&counts, 0) + hemisphere(&counts, 1) - 1.0).abs() < 1e-12);
            assert!(hemisphere(&counts, 1) > 0.0);
            let setup = setup(towards(theta), glass);
            let counts = setup.measure(&Tracer::new(&flat), 20_000, 1, |_| true);
            let (expected, beyond) = dielectric(towards(theta).z, eta);
            let noise = (expected * (1.0 - expected) / 20_000.0).sqrt();
            assert!((hemisphere(&counts, 0) - expected).abs() <= 4.0 * noise, "{eta} {theta}");
            // all that is transmitted is in one polar bin
            let polar = ((beyond.acos() / (0.5 * PI) * setup.polar as f64) as usize).min(setup.polar - 1);
            let (half, row) = (counts.energy.len() / 2, 3 * setup.azimuths);
            let bin: f64 = counts.energy[half + polar * row..half + (polar + 1) * row].iter().sum();
            assert!((bin / (3.0 * 20_000.0) - hemisphere(&counts, 1)).abs() < 1e-12, "{eta} {theta}");
        }
    }
}

/// A metal pays at every facet: each color by its own indices, and a flat one by Fresnel's formula alone.
#[test]
fn metals_absorb() {
    let gold = Material::Conductor { eta: DVec3::new(0.18, 0.42, 1.37), k: DVec3::new(3.43, 2.35, 1.77) };
    let flat = Surface::new(4, 4, DVec2::ONE, vec![0.0; 16]).unwrap_or_else(|error| panic!("{error}"));
    let counts = setup(towards(0.0), gold).measure(&Tracer::new(&flat), 1000, 0, |_| true);
    for (color, (eta, k)) in [(0.18_f64, 3.43_f64), (0.42, 2.35), (1.37, 1.77)].into_iter().enumerate() {
        let normal = ((eta - 1.0).powi(2) + k * k) / ((eta + 1.0).powi(2) + k * k);
        let found: f64 = counts.energy.iter().skip(color).step_by(3).sum::<f64>() / 1000.0;
        assert!((found - normal).abs() < 1e-12, "{found}, not {normal}");
    }
    let rough = made(GGX, &small()).surface.stretched(DVec2::splat(0.8));
    let counts = setup(towards(60.0), gold).measure(&Tracer::new(&rough), 20_000, 0, |_| true);
    let red: f64 = counts.energy.iter().step_by(3).sum::<f64>() / 20_000.0;
    let blue: f64 = counts.energy.iter().skip(2).step_by(3).sum::<f64>() / 20_000.0;
    assert!(blue < 0.4 && red > 0.85 && red < 0.95, "{red} {blue}");
}

/// The goniometer on the model finds what the walk alone finds: what meets one facet has correlated masking, a metal pays at every facet, and the
/// first facets are those that a view sees.
#[test]
fn the_model_is_measured_alike() {
    let ndf = Ndf::new(Box::new(GGX.profile()), 1e-6).unwrap_or_else(|error| panic!("{error}"));
    let alpha = Roughness { u: 0.5, v: 0.5 };
    let model = RandomWalk::new(&ndf, alpha);
    const WALKS: u64 = 100_000;
    let mirror = setup(towards(60.0), Material::Mirror).measure_model(&model, WALKS, 0, |_| true);
    assert_eq!((mirror.walks, mirror.lost, mirror.first.iter().sum::<u64>()), (WALKS, 0, WALKS));
    assert!((hemisphere(&mirror, 0) - 1.0).abs() < 1e-12 && hemisphere(&mirror, 1) == 0.0);
    let source = SingleScattering::new(&ndf, Shadowing::HeightCorrelated, Rule::REFERENCE);
    let expected = 1.0 - source.missing_energy(Incidence::new(alpha, towards(60.0)));
    let order = mirror.energy.len() / 8;
    let first = mirror.energy[..order].iter().sum::<f64>() / (3.0 * WALKS as f64);
    assert!((first - expected).abs() < 4.0 * (0.25 / WALKS as f64).sqrt(), "{first}, not {expected}");
    let gold = Material::Conductor { eta: DVec3::splat(0.2), k: DVec3::splat(3.0) };
    let metal = setup(towards(60.0), gold).measure_model(&model, WALKS, 0, |_| true);
    // the same walks, paid for
    assert_eq!(metal.bounces, mirror.bounces);
    let first = metal.energy[..order].iter().sum::<f64>() / mirror.energy[..order].iter().sum::<f64>();
    let later =
        metal.energy[order..2 * order].iter().sum::<f64>() / mirror.energy[order..2 * order].iter().sum::<f64>();
    assert!(first < 0.96 && (later - first * first).abs() < 0.02, "{first} {later}");
    // 64 chunks of 8192 at a time
    let mut seen = Vec::new();
    let part = setup(towards(60.0), gold).measure_model(&model, 10 * WALKS, 0, |walks| {
        seen.push(walks);
        false
    });
    assert_eq!((part.walks, seen), (64 * 8192, vec![64 * 8192]));
    let flat = part.flat();
    assert_eq!(flat.len(), 4 + part.first.len() + 2 * part.energy.len());
    assert_eq!((flat[0], flat[1], flat[2]), (part.walks as f64, 0.0, part.bounces[0] as f64));
}
