//! What the bridge hands on of explicit surfaces.

use super::ffi::{FacetMaterial, Goniometer, SlopeAgreement, SurfaceSettings};
use super::{Ndf, threads};
use crate::error::{ParameterError, require};
use crate::microsurface::agreement::Agreement;
use crate::microsurface::facet::Material;
use crate::microsurface::generate::{Settings, generate};
use crate::microsurface::goniometer::{Counts, Setup};
use crate::microsurface::surface::Surface;
use crate::microsurface::trace::Tracer;
use crate::ndf::Roughness;
use crate::scattering::random_walk::RandomWalk;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// How far a long call is, for other threads to see; they may ask it to stop.
#[derive(Default)]
pub struct Watch {
    done: AtomicU64,
    distance: AtomicU64,
    stopped: AtomicBool,
}

/// Nothing has been done yet.
pub(super) fn new_watch() -> Box<Watch> {
    Box::default()
}

impl Watch {
    /// Steps or walks.
    pub(super) fn done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }

    /// Kolmogorov–Smirnov distance that the last step of a generator began with.
    pub(super) fn distance(&self) -> f64 {
        f64::from_bits(self.distance.load(Ordering::Relaxed))
    }

    /// Asks for an end.
    pub(super) fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    fn goes_on(&self, done: u64) -> bool {
        self.done.store(done, Ordering::Relaxed);
        !self.stopped.load(Ordering::Relaxed)
    }
}

/// The opaque surface that C++ holds.
pub struct Microsurface(Surface);

/// Any thread count above one task.
const PARALLEL: usize = usize::MAX;

/// A surface at unit roughness and spacing.
pub(super) fn generate_surface(
    ndf: &Ndf,
    settings: &SurfaceSettings,
    watch: &Watch,
) -> Result<Box<Microsurface>, ParameterError> {
    let SurfaceSettings { size, correlation, seed, tolerance, steps } = *settings;
    let settings = Settings { size, correlation, seed, tolerance, steps };
    let tell = |step: usize, distance: f64| {
        watch.distance.store(distance.to_bits(), Ordering::Relaxed);
        watch.goes_on(step as u64)
    };
    let made = threads::run(PARALLEL, || generate(ndf.core.profile(), &settings, tell))?;
    Ok(Box::new(Microsurface(made.surface)))
}

/// A tile of given heights, x first.
pub(super) fn surface_of_heights(
    nx: usize,
    ny: usize,
    dx: f64,
    dy: f64,
    heights: &[f64],
) -> Result<Box<Microsurface>, ParameterError> {
    Ok(Box::new(Microsurface(Surface::new(nx, ny, DVec2::new(dx, dy), heights.to_vec())?)))
}

/// Distances of slopes (packed x, y) from a distribution.
pub(super) fn slope_agreement(
    ndf: &Ndf,
    alpha_u: f64,
    alpha_v: f64,
    slopes: &[f64],
) -> Result<SlopeAgreement, ParameterError> {
    let alpha = Roughness::new(alpha_u, alpha_v)?;
    let alpha = DVec2::new(alpha.u, alpha.v);
    let slopes: Vec<DVec2> = slopes.chunks_exact(2).map(|s| DVec2::from_slice(s) / alpha).collect();
    if slopes.is_empty() {
        return Err(ParameterError::Length { name: "slopes", found: 0, expected: 2 });
    }
    let found = threads::run(slopes.len(), || Agreement::of_slopes(&slopes, ndf.core.profile()));
    Ok(SlopeAgreement {
        ks: found.ks,
        tv: found.tv,
        tv_independent: found.tv_independent,
        worst_bin: found.worst_bin,
        mean_error: found.mean_error,
    })
}

impl Goniometer {
    fn setup(&self) -> Result<Setup, ParameterError> {
        let setup = Setup {
            wi: DVec3::from(&self.wi),
            material: match self.material {
                FacetMaterial::Conductor => {
                    Material::Conductor { eta: DVec3::from_array(self.eta), k: DVec3::from_array(self.k) }
                }
                FacetMaterial::Dielectric => Material::Dielectric { eta: self.eta[0] },
                _ => Material::Mirror,
            },
            orders: self.orders,
            polar: self.polar,
            azimuths: self.azimuths,
            cosines: self.cosines,
        };
        for (name, count, greatest) in [
            ("orders", self.orders, 64),
            ("polar", self.polar, 360),
            ("azimuths", self.azimuths, 720),
            ("cosines", self.cosines, 1000),
        ] {
            require(
                (1..=greatest).contains(&count),
                name,
                count as f64,
                "a number of bins: 1 to 64 orders, 360 polar angles, 720 azimuths, 1000 cosines",
                "more bins than that have no walks in them",
            )?;
        }
        require(
            setup.wi.z > 0.0 && (setup.wi.length() - 1.0).abs() < 1e-6,
            "wi",
            setup.wi.z,
            "a unit vector with z > 0",
            "it is where the light comes from",
        )?;
        Ok(setup)
    }

    fn put(&self, counts: &Counts, out: &mut [f64]) -> Result<(), ParameterError> {
        let flat = counts.flat();
        if flat.len() != out.len() {
            return Err(ParameterError::Length { name: "counts", found: out.len(), expected: flat.len() });
        }
        out.copy_from_slice(&flat);
        Ok(())
    }
}

/// What facets reflect of light from outside at each of the cosines, three colors in a row.
pub(super) fn facet_reflectance(
    goniometer: &Goniometer,
    cosines: &[f64],
    out: &mut [f64],
) -> Result<(), ParameterError> {
    if out.len() != 3 * cosines.len() {
        return Err(ParameterError::Length { name: "reflectances", found: out.len(), expected: 3 * cosines.len() });
    }
    let material = goniometer.setup()?.material;
    for (out, &cosine) in out.chunks_exact_mut(3).zip(cosines) {
        out.copy_from_slice(&material.reflectance(cosine).to_array());
    }
    Ok(())
}

/// How many numbers a goniometer has to say.
pub(super) fn count_numbers(setup: &Goniometer) -> Result<usize, ParameterError> {
    let setup = setup.setup()?;
    Ok(4 + setup.cosines + 2 * setup.bins())
}

/// Walks on Smith's model of a surface.
pub(super) fn measure_model(
    ndf: &Ndf,
    alpha_u: f64,
    alpha_v: f64,
    goniometer: &Goniometer,
    watch: &Watch,
    out: &mut [f64],
) -> Result<(), ParameterError> {
    let setup = goniometer.setup()?;
    let model = RandomWalk::new(&ndf.core, Roughness::new(alpha_u, alpha_v)?);
    let tell = |walks| watch.goes_on(walks);
    let counts = threads::run(PARALLEL, || setup.measure_model(&model, goniometer.walks, goniometer.seed, tell));
    goniometer.put(&counts, out)
}

impl Microsurface {
    pub(super) fn heights(&self) -> &[f64] {
        self.0.heights()
    }

    /// Slopes of all facets, packed x, y.
    pub(super) fn slopes(&self) -> Vec<f64> {
        threads::run(PARALLEL, || self.0.slopes().into_iter().flat_map(|s| [s.x, s.y]).collect())
    }

    /// Areas of facets that face each of the directions, packed xyz.
    pub(super) fn projected_areas(&self, w: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        if w.len() != 3 * out.len() {
            return Err(ParameterError::Length { name: "areas", found: out.len(), expected: w.len() / 3 });
        }
        threads::run(PARALLEL, || {
            out.par_iter_mut()
                .zip(w.par_chunks_exact(3))
                .for_each(|(area, w)| *area = self.0.projected_area(DVec3::from_slice(w)));
        });
        Ok(())
    }

    /// The areas that one view sees, by the cosine between it and the normal.
    pub(super) fn areas_by_cosine(&self, goniometer: &Goniometer) -> Result<Vec<f64>, ParameterError> {
        let setup = goniometer.setup()?;
        Ok(threads::run(PARALLEL, || setup.projected_areas(&Tracer::new(&self.0))))
    }

    /// Walks on the surface.
    pub(super) fn measure(
        &self,
        goniometer: &Goniometer,
        watch: &Watch,
        out: &mut [f64],
    ) -> Result<(), ParameterError> {
        let setup = goniometer.setup()?;
        let tell = |walks| watch.goes_on(walks);
        let counts =
            threads::run(PARALLEL, || setup.measure(&Tracer::new(&self.0), goniometer.walks, goniometer.seed, tell));
        goniometer.put(&counts, out)
    }
}
