//! The one bridge to C++: evaluation, sampling, masking and tables of a validated shape.
//!
//! Constructors return errors, which become C++ exceptions. Everything else is total: nothing reachable from here panics,
//! because a panic would end the process.
#![allow(unsafe_code, missing_docs)] // cxx generates both

use crate::error::ParameterError;
use crate::family::shape::{Row, Shape as CoreShape};
use crate::family::skewed_t::SkewedT;
use crate::family::tree::Node as CoreNode;
use crate::masking::table::ENTRIES;
use crate::ndf::{Ndf as CoreNdf, Roughness, Shadowing};
use crate::profile::Profile;
use crate::sampling::visible_table::CELLS;
use crate::scattering::albedo_table::{AlbedoTable as CoreAlbedoTable, GREATEST_ALPHA, LEAST_ALPHA};
use glam::DVec3;
use rayon::prelude::*;

#[cxx::bridge(namespace = "sgtd")]
mod ffi {
    /// A direction.
    #[derive(Clone, Copy)]
    struct Vec3 {
        x: f64,
        y: f64,
        z: f64,
    }

    /// A parameter that the user may have left out.
    #[derive(Clone, Copy)]
    struct Given {
        set: bool,
        value: f64,
    }

    /// The shape parameters; shift is m = μ/σ.
    #[derive(Clone, Copy)]
    struct Shape {
        gamma: f64,
        p: f64,
        lambda: f64,
        shift: f64,
    }

    /// A row's shape, and the factor on every roughness given with it.
    struct RowShape {
        shape: Shape,
        alpha_scale: f64,
    }

    /// The node of the tree at which a shape runs: its name, its shape there, and a factor on every roughness.
    struct Node {
        name: String,
        shape: Shape,
        alpha_scale: f64,
        closed_form: bool,
    }

    /// A sampled normal; pdf 0 marks an invalid one.
    struct NormalSample {
        m: Vec3,
        pdf: f64,
        d_over_pdf: f64,
    }

    /// What a reader of the tables has to know.
    struct TableHeader {
        normalization: f64,
        scale: f64,
        lambda_entries: u32,
        visible_rows: u32,
        visible_cells: u32,
        accuracy_reached: f64,
        steepness: f64,
    }

    /// What a reader of a table of losses has to know.
    struct AlbedoHeader {
        slope: f64,
        power: f64,
        end: f64,
        spread: f64,
        greatest: f64,
        least_alpha: f64,
        greatest_alpha: f64,
        average_log: f64,
        average_u: f64,
        average_v: f64,
        reached: f64,
        views: u32,
        columns: u32,
    }

    extern "Rust" {
        type Ndf;
        type AlbedoTable;

        fn shape_of_row(row: &str, gamma: Given, p: Given, lambda: Given, shift: Given) -> Result<RowShape>;
        fn lowest_node(shape: Shape) -> Result<Node>;
        fn new_ndf(shape: Shape, accuracy: f64, visible: bool) -> Result<Box<Ndf>>;

        fn new_isotropic_albedo(ndf: &Ndf, correlated: bool) -> Box<AlbedoTable>;
        fn new_anisotropic_albedo(ndf: &Ndf, correlated: bool, alpha_u: f64, alpha_v: f64) -> Result<Box<AlbedoTable>>;
        fn albedo_header(self: &AlbedoTable) -> AlbedoHeader;
        fn flat(self: &AlbedoTable) -> &[f32];

        fn header(self: &Ndf) -> TableHeader;
        fn lambda_table(self: &Ndf) -> &[f32];
        fn visible_table(self: &Ndf) -> &[f32];

        fn d(self: &Ndf, alpha_u: f64, alpha_v: f64, m: &Vec3) -> f64;
        fn projected_area(self: &Ndf, alpha_u: f64, alpha_v: f64, w: &Vec3) -> f64;
        fn pdf(self: &Ndf, alpha_u: f64, alpha_v: f64, wi: &Vec3, m: &Vec3, visible: bool) -> f64;
        fn sample(self: &Ndf, alpha_u: f64, alpha_v: f64, wi: &Vec3, u1: f64, u2: f64, visible: bool) -> NormalSample;

        fn d_batch(self: &Ndf, alpha_u: f64, alpha_v: f64, m: &[f64], out: &mut [f64]) -> Result<()>;
        fn lambda_batch(self: &Ndf, alpha_u: f64, alpha_v: f64, w: &[f64], out: &mut [f64]) -> Result<()>;
        fn g1_batch(self: &Ndf, alpha_u: f64, alpha_v: f64, w: &[f64], out: &mut [f64]) -> Result<()>;
        fn g2_batch(
            self: &Ndf,
            alpha_u: f64,
            alpha_v: f64,
            wi: &[f64],
            wo: &[f64],
            correlated: bool,
            out: &mut [f64],
        ) -> Result<()>;
        fn pdf_batch(
            self: &Ndf,
            alpha_u: f64,
            alpha_v: f64,
            wi: &[f64],
            m: &[f64],
            visible: bool,
            out: &mut [f64],
        ) -> Result<()>;
        #[allow(clippy::too_many_arguments)]
        fn sample_batch(
            self: &Ndf,
            alpha_u: f64,
            alpha_v: f64,
            wi: &[f64],
            u: &[f64],
            visible: bool,
            m: &mut [f64],
            pdf: &mut [f64],
        ) -> Result<()>;
        fn profile_batch(self: &Ndf, x: &[f64], out: &mut [f64]) -> Result<()>;
        fn cdf_batch(self: &Ndf, x: &[f64], out: &mut [f64]) -> Result<()>;
        fn sf_batch(self: &Ndf, x: &[f64], out: &mut [f64]) -> Result<()>;
        fn quantile_batch(self: &Ndf, u: &[f64], out: &mut [f64]) -> Result<()>;
        fn isf_batch(self: &Ndf, u: &[f64], out: &mut [f64]) -> Result<()>;

        fn first_of_wrong_length(w: &[f64], tolerance: f64) -> usize;
        fn first_outside(x: &[f64], low: f64, high: f64) -> usize;
    }
}

use ffi::{AlbedoHeader, Given, Node, NormalSample, RowShape, Shape, TableHeader, Vec3};

/// The opaque object that C++ holds.
pub struct Ndf(CoreNdf);

impl From<&Vec3> for DVec3 {
    fn from(v: &Vec3) -> Self {
        DVec3::new(v.x, v.y, v.z)
    }
}

impl From<&CoreShape> for Shape {
    fn from(shape: &CoreShape) -> Self {
        Self { gamma: shape.gamma(), p: shape.p(), lambda: shape.lambda(), shift: shape.shift() }
    }
}

fn shape_of_row(row: &str, gamma: Given, p: Given, lambda: Given, shift: Given) -> Result<RowShape, ParameterError> {
    let given = |g: Given| g.set.then_some(g.value);
    let row = Row::named(row)?;
    let shape = row.shape(given(gamma), given(p), given(lambda), given(shift))?;
    Ok(RowShape { alpha_scale: row.alpha_scale(&shape), shape: (&shape).into() })
}

fn lowest_node(shape: Shape) -> Result<Node, ParameterError> {
    let node = CoreNode::lowest(&CoreShape::new(shape.gamma, shape.p, shape.lambda, shape.shift)?);
    Ok(Node {
        name: node.row.name.to_owned(),
        shape: (&node.shape).into(),
        alpha_scale: node.alpha_scale,
        closed_form: node.is_closed_form(),
    })
}

fn new_ndf(shape: Shape, accuracy: f64, visible: bool) -> Result<Box<Ndf>, ParameterError> {
    let shape = CoreShape::new(shape.gamma, shape.p, shape.lambda, shape.shift)?;
    let profile = Box::new(SkewedT::new(shape));
    let ndf = if visible { CoreNdf::new(profile, accuracy) } else { CoreNdf::projected(profile, accuracy) };
    Ok(Box::new(Ndf(ndf?)))
}

/// The opaque table of losses that C++ holds.
pub struct AlbedoTable(CoreAlbedoTable);

fn shadowing(correlated: bool) -> Shadowing {
    if correlated { Shadowing::HeightCorrelated } else { Shadowing::Separable }
}

fn new_isotropic_albedo(ndf: &Ndf, correlated: bool) -> Box<AlbedoTable> {
    Box::new(AlbedoTable(CoreAlbedoTable::isotropic(&ndf.0, shadowing(correlated))))
}

fn new_anisotropic_albedo(
    ndf: &Ndf,
    correlated: bool,
    alpha_u: f64,
    alpha_v: f64,
) -> Result<Box<AlbedoTable>, ParameterError> {
    let alpha = Roughness::new(alpha_u, alpha_v)?;
    Ok(Box::new(AlbedoTable(CoreAlbedoTable::anisotropic(&ndf.0, shadowing(correlated), alpha))))
}

impl AlbedoTable {
    fn albedo_header(&self) -> AlbedoHeader {
        let coordinates = self.0.coordinates();
        let average = self.0.average();
        AlbedoHeader {
            slope: coordinates.slope,
            power: coordinates.power,
            end: coordinates.end,
            spread: coordinates.spread,
            greatest: coordinates.greatest(),
            least_alpha: LEAST_ALPHA,
            greatest_alpha: GREATEST_ALPHA,
            average_log: average.map_or(0.0, |average| average.log),
            average_u: average.map_or(0.0, |average| average.slopes[0]),
            average_v: average.map_or(0.0, |average| average.slopes[1]),
            reached: self.0.reached(),
            views: self.0.grid().0 as u32,
            columns: self.0.grid().1 as u32,
        }
    }

    fn flat(&self) -> &[f32] {
        self.0.flat()
    }
}

/// Index of the first direction whose length differs from 1 by more than `tolerance` or is not a number; their number if
/// there is none.
fn first_of_wrong_length(w: &[f64], tolerance: f64) -> usize {
    first_where(w.par_chunks_exact(3), |w| !((direction(w).length() - 1.0).abs() <= tolerance))
}

/// Index of the first number that is not in [low, high]; their number if there is none.
fn first_outside(x: &[f64], low: f64, high: f64) -> usize {
    first_where(x.par_iter(), |&x| !(low..=high).contains(&x))
}

fn first_where<I: IndexedParallelIterator>(items: I, wrong: impl Fn(I::Item) -> bool + Send + Sync) -> usize {
    let count = items.len();
    items.with_min_len(CHUNK).position_first(wrong).unwrap_or(count)
}

/// Directions per task: large enough that the queue costs nothing, small enough to balance two cores.
const CHUNK: usize = 1024;

fn expect(name: &'static str, found: usize, expected: usize) -> Result<(), ParameterError> {
    if found == expected { Ok(()) } else { Err(ParameterError::Length { name, found, expected }) }
}

fn direction(packed: &[f64]) -> DVec3 {
    DVec3::new(packed[0], packed[1], packed[2])
}

impl Ndf {
    fn header(&self) -> TableHeader {
        TableHeader {
            normalization: self.0.profile().normalization(),
            scale: self.0.visible_table().scale(),
            lambda_entries: ENTRIES as u32,
            visible_rows: self.0.visible_table().rows() as u32,
            visible_cells: CELLS as u32,
            accuracy_reached: self.0.accuracy_reached(),
            steepness: self.0.steepness(),
        }
    }

    fn lambda_table(&self) -> &[f32] {
        self.0.lambda_table().flat()
    }

    fn visible_table(&self) -> &[f32] {
        self.0.visible_table().flat()
    }

    fn d(&self, alpha_u: f64, alpha_v: f64, m: &Vec3) -> f64 {
        self.0.d(Roughness { u: alpha_u, v: alpha_v }, m.into())
    }

    fn projected_area(&self, alpha_u: f64, alpha_v: f64, w: &Vec3) -> f64 {
        self.0.projected_area(Roughness { u: alpha_u, v: alpha_v }, w.into())
    }

    fn pdf(&self, alpha_u: f64, alpha_v: f64, wi: &Vec3, m: &Vec3, visible: bool) -> f64 {
        let alpha = Roughness { u: alpha_u, v: alpha_v };
        if visible { self.0.pdf_visible(alpha, wi.into(), m.into()) } else { self.0.pdf_projected(alpha, m.into()) }
    }

    fn sample(&self, alpha_u: f64, alpha_v: f64, wi: &Vec3, u1: f64, u2: f64, visible: bool) -> NormalSample {
        let alpha = Roughness { u: alpha_u, v: alpha_v };
        let sample = if visible {
            self.0.sample_visible(alpha, wi.into(), (u1, u2))
        } else {
            self.0.sample_projected(alpha, (u1, u2))
        };
        let m = Vec3 { x: sample.m.x, y: sample.m.y, z: sample.m.z };
        NormalSample { m, pdf: sample.pdf, d_over_pdf: sample.d_over_pdf }
    }

    /// One number per direction.
    fn per_direction(
        &self,
        alpha: (f64, f64),
        w: &[f64],
        out: &mut [f64],
        call: impl Fn(&CoreNdf, Roughness, DVec3) -> f64 + Sync,
    ) -> Result<(), ParameterError> {
        let alpha = Roughness::new(alpha.0, alpha.1)?;
        expect("directions", w.len(), 3 * out.len())?;
        out.par_chunks_mut(CHUNK).zip(w.par_chunks(3 * CHUNK)).for_each(|(out, w)| {
            for (out, w) in out.iter_mut().zip(w.chunks_exact(3)) {
                *out = call(&self.0, alpha, direction(w));
            }
        });
        Ok(())
    }

    /// One number per pair of directions.
    fn per_pair(
        &self,
        alpha: (f64, f64),
        first: &[f64],
        second: &[f64],
        out: &mut [f64],
        call: impl Fn(&CoreNdf, Roughness, DVec3, DVec3) -> f64 + Sync,
    ) -> Result<(), ParameterError> {
        let alpha = Roughness::new(alpha.0, alpha.1)?;
        expect("wi", first.len(), 3 * out.len())?;
        expect("second directions", second.len(), 3 * out.len())?;
        out.par_chunks_mut(CHUNK).zip(first.par_chunks(3 * CHUNK)).zip(second.par_chunks(3 * CHUNK)).for_each(
            |((out, first), second)| {
                for ((out, first), second) in out.iter_mut().zip(first.chunks_exact(3)).zip(second.chunks_exact(3)) {
                    *out = call(&self.0, alpha, direction(first), direction(second));
                }
            },
        );
        Ok(())
    }

    fn d_batch(&self, alpha_u: f64, alpha_v: f64, m: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        self.per_direction((alpha_u, alpha_v), m, out, CoreNdf::d)
    }

    fn lambda_batch(&self, alpha_u: f64, alpha_v: f64, w: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        self.per_direction((alpha_u, alpha_v), w, out, CoreNdf::lambda)
    }

    fn g1_batch(&self, alpha_u: f64, alpha_v: f64, w: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        self.per_direction((alpha_u, alpha_v), w, out, CoreNdf::g1)
    }

    fn g2_batch(
        &self,
        alpha_u: f64,
        alpha_v: f64,
        wi: &[f64],
        wo: &[f64],
        correlated: bool,
        out: &mut [f64],
    ) -> Result<(), ParameterError> {
        let shadowing = shadowing(correlated);
        self.per_pair((alpha_u, alpha_v), wi, wo, out, |ndf, alpha, wi, wo| ndf.g2(alpha, wi, wo, shadowing))
    }

    fn pdf_batch(
        &self,
        alpha_u: f64,
        alpha_v: f64,
        wi: &[f64],
        m: &[f64],
        visible: bool,
        out: &mut [f64],
    ) -> Result<(), ParameterError> {
        self.per_pair((alpha_u, alpha_v), wi, m, out, |ndf, alpha, wi, m| {
            if visible { ndf.pdf_visible(alpha, wi, m) } else { ndf.pdf_projected(alpha, m) }
        })
    }

    #[allow(clippy::too_many_arguments)]
    fn sample_batch(
        &self,
        alpha_u: f64,
        alpha_v: f64,
        wi: &[f64],
        u: &[f64],
        visible: bool,
        m: &mut [f64],
        pdf: &mut [f64],
    ) -> Result<(), ParameterError> {
        let alpha = Roughness::new(alpha_u, alpha_v)?;
        expect("wi", wi.len(), 3 * pdf.len())?;
        expect("u", u.len(), 2 * pdf.len())?;
        expect("m", m.len(), 3 * pdf.len())?;
        let inputs = wi.par_chunks(3 * CHUNK).zip(u.par_chunks(2 * CHUNK));
        m.par_chunks_mut(3 * CHUNK).zip(pdf.par_chunks_mut(CHUNK)).zip(inputs).for_each(|((m, pdf), (wi, u))| {
            let inputs = wi.chunks_exact(3).zip(u.chunks_exact(2));
            for ((m, pdf), (wi, u)) in m.chunks_exact_mut(3).zip(pdf).zip(inputs) {
                let sample = if visible {
                    self.0.sample_visible(alpha, direction(wi), (u[0], u[1]))
                } else {
                    self.0.sample_projected(alpha, (u[0], u[1]))
                };
                m.copy_from_slice(&sample.m.to_array());
                *pdf = sample.pdf;
            }
        });
        Ok(())
    }

    /// One number per number.
    fn per_number(
        &self,
        name: &'static str,
        x: &[f64],
        out: &mut [f64],
        call: impl Fn(&dyn Profile, f64) -> f64 + Sync,
    ) -> Result<(), ParameterError> {
        expect(name, x.len(), out.len())?;
        out.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).for_each(|(out, x)| {
            for (out, &x) in out.iter_mut().zip(x) {
                *out = call(self.0.profile(), x);
            }
        });
        Ok(())
    }

    fn profile_batch(&self, x: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        self.per_number("x", x, out, |profile, x| profile.f(x))
    }

    fn cdf_batch(&self, x: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        self.per_number("x", x, out, |profile, x| profile.cdf(x))
    }

    fn sf_batch(&self, x: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        self.per_number("x", x, out, |profile, x| profile.sf(x))
    }

    fn quantile_batch(&self, u: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        self.per_number("u", u, out, |profile, u| profile.quantile(u))
    }

    fn isf_batch(&self, u: &[f64], out: &mut [f64]) -> Result<(), ParameterError> {
        self.per_number("u", u, out, |profile, u| profile.isf(u))
    }
}
