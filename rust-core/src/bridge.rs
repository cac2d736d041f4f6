//! The one bridge to C++: evaluation, sampling, masking and tables of a validated shape.
//!
//! Constructors return errors, which become C++ exceptions. Everything else is total: nothing reachable from here panics,
//! because a panic would end the process.
#![allow(unsafe_code, missing_docs)] // cxx generates both

use crate::batch::{self, Query};
use crate::error::ParameterError;
use crate::family::shape::{Row, Shape};
use crate::family::tree::Node as CoreNode;
use crate::masking::table::ENTRIES;
use crate::masking::{GradientTable as CoreGradientTable, NumbersGradient, NumbersTable as CoreNumbersTable};
use crate::ndf::{INVALID, Ndf as CoreNdf, NormalSample as CoreSample, Normals as CoreNormals, Roughness, Shadowing};
use crate::profile::{Coordinate, ProfileCells, TabulatedProfile};
use crate::radial::{self, Kind as CoreKind, Radial as CoreRadial};
use crate::sampling::visible_table::CELLS;
use crate::scattering::albedo_table::{AlbedoTable as CoreAlbedoTable, GREATEST_ALPHA, LEAST_ALPHA};
use crate::scattering::interface_table::{InterfaceTable as CoreInterfaceTable, Quantity};
use crate::scattering::reflection::{Reflected as CoreReflected, Reflection as CoreReflection};
use glam::DVec3;
use std::sync::{Arc, OnceLock};

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

    /// A row's shape, γ, p, λ and m as everywhere here, and the factor on every roughness given with it.
    struct RowShape {
        shape: [f64; 4],
        alpha_scale: f64,
    }

    /// The node of the tree at which a shape runs: its name, its shape there, and a factor on every roughness.
    struct Node {
        name: String,
        shape: [f64; 4],
        alpha_scale: f64,
        closed_form: bool,
    }

    /// What a distribution is made from.
    #[derive(Debug, PartialEq, Eq)]
    enum Kind {
        Family,
        Table,
        Mixture,
    }

    /// A table as the user gives it.
    struct TableSource {
        places: Vec<f64>,
        by_angles: bool,
        values: Vec<f64>,
        quantity: String,
        tail: String,
        tail_exponent: Given,
        knee: Given,
        path: String,
    }

    /// What a table has besides its nodes: slopes, a tail exponent of 0 where nothing is beyond the last node.
    struct TableEnds {
        knee: f64,
        tail_exponent: f64,
    }

    /// Which normals are drawn.
    #[derive(Debug, PartialEq, Eq)]
    enum Normals {
        All,
        Visible,
        Reflecting,
    }

    /// A sampled normal; pdf 0 marks an invalid one.
    struct NormalSample {
        m: Vec3,
        pdf: f64,
        d_over_pdf: f64,
    }

    /// A view that is reflected: roughness, direction, how masking is combined, and which normals are drawn.
    struct Reflection {
        alpha_u: f64,
        alpha_v: f64,
        wi: Vec3,
        correlated: bool,
        normals: Normals,
    }

    /// What a pair of directions gives: D, cosine and density of its half vector, masking.
    struct Reflected {
        d: f64,
        cos: f64,
        g2: f64,
        pdf: f64,
    }

    /// A sampled normal, and the masking of the reflection about it.
    struct ReflectionSample {
        normal: NormalSample,
        g2: f64,
    }

    /// Both for one view.
    struct ReflectedAndSample {
        reflected: Reflected,
        sample: ReflectionSample,
    }

    /// What is known of a distribution before the tables that normals are drawn from.
    struct Numbers {
        normalization: f64,
        accuracy_reached: f64,
        mean: f64,
        by_odds: bool,
    }

    /// What a reader of a matrix of derivatives by numbers has to know: see `masking::NumbersTable`. The two last are the numbers of the cells of f in
    /// which 0 is.
    struct NumbersHeader {
        columns: usize,
        cells_of_h: usize,
        cells_of_f: usize,
        first: usize,
        first_precise: usize,
    }

    /// What else a reader of the tables has to know.
    struct TableHeader {
        scale: f64,
        lambda_entries: u32,
        visible_rows: u32,
        visible_cells: u32,
        steepness: f64,
    }

    /// What a reader of a table of missing energy has to know.
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

    /// What a reader of a table of a rough interface has to know.
    struct InterfaceHeader {
        columns: u32,
        critical: f64,
        average: f64,
        internal_reflectance: f64,
        facet_reflectance: f64,
    }

    /// What an explicit surface should be: see `microsurface::generate::Settings`.
    #[derive(Clone, Copy)]
    struct SurfaceSettings {
        size: usize,
        correlation: f64,
        seed: u64,
        tolerance: f64,
        steps: usize,
    }

    /// How near slopes are to a distribution: see `microsurface::agreement::Agreement`.
    struct SlopeAgreement {
        ks: f64,
        tv: f64,
        tv_independent: f64,
        worst_bin: f64,
        mean_error: f64,
    }

    /// What facets are made of.
    #[derive(Debug, PartialEq, Eq)]
    enum FacetMaterial {
        Mirror,
        Conductor,
        Dielectric,
    }

    /// What a virtual goniometer measures: see `microsurface::goniometer::Setup`. A dielectric has its relative index in all of `eta`.
    struct Goniometer {
        wi: Vec3,
        material: FacetMaterial,
        eta: [f64; 3],
        k: [f64; 3],
        orders: usize,
        polar: usize,
        azimuths: usize,
        cosines: usize,
        walks: u64,
        seed: u64,
    }

    extern "Rust" {
        type Radial;
        type Parts;
        type Ndf;
        type AlbedoTable;
        type GradientTable;
        type NumbersTable;
        type InterfaceTable;

        fn radial_of_shape(shape: [f64; 4]) -> Result<Box<Radial>>;
        fn radial_of_table(source: &TableSource) -> Result<Box<Radial>>;
        fn read_table(path: &str, quantity: &str, tail: &str, tail_exponent: Given) -> Result<TableSource>;
        fn new_parts() -> Box<Parts>;
        fn add(self: &mut Parts, weight: f64, scale: f64, radial: &Radial);
        fn radial_of_mixture(parts: &Parts) -> Result<Box<Radial>>;
        fn resampled(self: &Radial, nodes: usize) -> Result<Box<Radial>>;
        fn kind(self: &Radial) -> Kind;
        fn width(self: &Radial) -> f64;
        fn key(self: &Radial) -> &[u8];
        fn slopes(self: &Radial) -> Vec<f64>;
        fn slope_densities(self: &Radial) -> Vec<f64>;
        fn ends(self: &Radial) -> TableEnds;

        fn shape_of_row(row: &str, gamma: Given, p: Given, lambda: Given, shift: Given) -> Result<RowShape>;
        fn lowest_node(shape: [f64; 4]) -> Result<Node>;
        fn check_roughness(alpha_u: f64, alpha_v: f64) -> Result<()>;
        fn new_ndf(radial: &Radial, accuracy: f64, visible: bool) -> Result<Box<Ndf>>;

        fn new_isotropic_albedo(ndf: &Ndf, correlated: bool) -> Box<AlbedoTable>;
        fn new_anisotropic_albedo(ndf: &Ndf, correlated: bool, alpha_u: f64, alpha_v: f64) -> Result<Box<AlbedoTable>>;
        fn albedo_header(self: &AlbedoTable) -> AlbedoHeader;
        fn flat(self: &AlbedoTable) -> &[f32];

        fn new_interface_table(
            ndf: &Ndf,
            correlated: bool,
            alpha_u: f64,
            alpha_v: f64,
            eta: f64,
            transmittance: bool,
        ) -> Result<Box<InterfaceTable>>;
        fn interface_header(self: &InterfaceTable) -> InterfaceHeader;
        fn flat(self: &InterfaceTable) -> &[f32];

        fn new_gradient_table(ndf: &Ndf) -> Result<Box<GradientTable>>;
        fn log_normalization(self: &GradientTable) -> [f64; 4];
        fn flat(self: &GradientTable) -> &[f32];

        fn new_numbers_table(ndf: &Ndf, precise: bool) -> Result<Box<NumbersTable>>;
        fn numbers_header(self: &NumbersTable) -> NumbersHeader;
        fn flat(self: &NumbersTable) -> &[f32];
        fn count_of_numbers(self: &Ndf) -> usize;
        fn by_numbers(self: &Ndf, quantity: &str, alpha_u: f64, alpha_v: f64, w: &[f64], out: &mut [f64])
        -> Result<()>;

        fn numbers(self: &Ndf) -> Numbers;
        fn header(self: &Ndf) -> TableHeader;
        fn lambda_table(self: &Ndf) -> &[f32];
        fn visible_table(self: &Ndf) -> &[f32];
        fn cells(self: &Ndf) -> &[f32];
        fn precise_cells(self: &Ndf) -> &[f64];

        fn d(self: &Ndf, alpha_u: f64, alpha_v: f64, m: &Vec3) -> f64;
        fn projected_area(self: &Ndf, alpha_u: f64, alpha_v: f64, w: &Vec3) -> f64;
        fn pdf(self: &Ndf, alpha_u: f64, alpha_v: f64, wi: &Vec3, m: &Vec3, normals: Normals) -> f64;
        fn sample(
            self: &Ndf,
            alpha_u: f64,
            alpha_v: f64,
            wi: &Vec3,
            u1: f64,
            u2: f64,
            normals: Normals,
        ) -> NormalSample;
        fn reflected(self: &Ndf, view: &Reflection, wo: &Vec3) -> Reflected;
        fn sample_reflection(self: &Ndf, view: &Reflection, u1: f64, u2: f64) -> ReflectionSample;
        fn reflected_and_sample(self: &Ndf, view: &Reflection, wo: &Vec3, u1: f64, u2: f64) -> ReflectedAndSample;

        fn results_of(query: &str, numbers: usize) -> Result<usize>;
        fn eval_batch(
            self: &Ndf,
            query: &str,
            alpha_u: f64,
            alpha_v: f64,
            first: &[f64],
            second: &[f64],
            out: &mut [f64],
        ) -> Result<()>;

        fn first_of_wrong_length(w: &[f64], tolerance: f64) -> usize;
        fn first_outside(x: &[f64], low: f64, high: f64) -> usize;

        fn forget_threads();

        type Microsurface;
        type Watch;

        fn new_watch() -> Box<Watch>;
        fn done(self: &Watch) -> u64;
        fn distance(self: &Watch) -> f64;
        fn stop(self: &Watch);

        fn generate_surface(ndf: &Ndf, settings: &SurfaceSettings, watch: &Watch) -> Result<Box<Microsurface>>;
        fn surface_of_heights(nx: usize, ny: usize, dx: f64, dy: f64, heights: &[f64]) -> Result<Box<Microsurface>>;
        fn heights(self: &Microsurface) -> &[f64];
        fn slopes(self: &Microsurface) -> Vec<f64>;
        fn projected_areas(self: &Microsurface, w: &[f64], out: &mut [f64]) -> Result<()>;
        fn areas_by_cosine(self: &Microsurface, goniometer: &Goniometer) -> Result<Vec<f64>>;
        fn measure(self: &Microsurface, goniometer: &Goniometer, watch: &Watch, out: &mut [f64]) -> Result<()>;

        fn slope_agreement(ndf: &Ndf, alpha_u: f64, alpha_v: f64, slopes: &[f64]) -> Result<SlopeAgreement>;
        fn facet_reflectance(goniometer: &Goniometer, cosines: &[f64], out: &mut [f64]) -> Result<()>;
        fn count_numbers(goniometer: &Goniometer) -> Result<usize>;
        fn measure_model(
            ndf: &Ndf,
            alpha_u: f64,
            alpha_v: f64,
            goniometer: &Goniometer,
            watch: &Watch,
            out: &mut [f64],
        ) -> Result<()>;
    }
}

use ffi::{
    AlbedoHeader, Given, InterfaceHeader, Kind, Node, NormalSample, Normals, Numbers, NumbersHeader, Reflected,
    ReflectedAndSample, Reflection, ReflectionSample, RowShape, TableEnds, TableHeader, TableSource, Vec3,
};

mod microsurface;
use microsurface::{
    Microsurface, Watch, count_numbers, facet_reflectance, generate_surface, measure_model, new_watch, slope_agreement,
    surface_of_heights,
};

/// What a distribution is made from.
pub struct Radial(CoreRadial);

/// Distributions that are to be mixed.
pub struct Parts(Vec<(f64, f64, CoreRadial)>);

/// The opaque object that C++ holds.
pub struct Ndf {
    core: CoreNdf,
    /// what single precision evaluates if it is no member of the family; made when it is first asked for
    cells: OnceLock<Option<ProfileCells>>,
    is_family: bool,
}

impl From<&Vec3> for DVec3 {
    fn from(v: &Vec3) -> Self {
        DVec3::new(v.x, v.y, v.z)
    }
}

fn packed(shape: &Shape) -> [f64; 4] {
    [shape.gamma(), shape.p(), shape.lambda(), shape.shift()]
}

impl From<Normals> for CoreNormals {
    fn from(normals: Normals) -> Self {
        match normals {
            Normals::All => Self::All,
            Normals::Reflecting => Self::Reflecting,
            _ => Self::Visible,
        }
    }
}

impl From<CoreSample> for NormalSample {
    fn from(sample: CoreSample) -> Self {
        let m = Vec3 { x: sample.m.x, y: sample.m.y, z: sample.m.z };
        Self { m, pdf: sample.pdf, d_over_pdf: sample.d_over_pdf }
    }
}

impl From<(CoreSample, f64)> for ReflectionSample {
    fn from((normal, g2): (CoreSample, f64)) -> Self {
        Self { normal: normal.into(), g2 }
    }
}

impl From<CoreReflected> for Reflected {
    fn from(CoreReflected { d, cos, g2, pdf }: CoreReflected) -> Self {
        Self { d, cos, g2, pdf }
    }
}

fn shape_of_row(row: &str, gamma: Given, p: Given, lambda: Given, shift: Given) -> Result<RowShape, ParameterError> {
    let given = |g: Given| g.set.then_some(g.value);
    let row = Row::named(row)?;
    let shape = row.shape(given(gamma), given(p), given(lambda), given(shift))?;
    Ok(RowShape { alpha_scale: row.alpha_scale(&shape), shape: packed(&shape) })
}

fn lowest_node([gamma, p, lambda, shift]: [f64; 4]) -> Result<Node, ParameterError> {
    let node = CoreNode::lowest(&Shape::new(gamma, p, lambda, shift)?);
    Ok(Node {
        name: node.row.name.to_owned(),
        shape: packed(&node.shape),
        alpha_scale: node.alpha_scale,
        closed_form: node.is_closed_form(),
    })
}

fn check_roughness(alpha_u: f64, alpha_v: f64) -> Result<(), ParameterError> {
    Roughness::new(alpha_u, alpha_v).map(drop)
}

fn radial_of_shape([gamma, p, lambda, shift]: [f64; 4]) -> Result<Box<Radial>, ParameterError> {
    Ok(Box::new(Radial(CoreRadial::family(Shape::new(gamma, p, lambda, shift)?))))
}

impl Given {
    fn number(&self) -> Option<f64> {
        self.set.then_some(self.value)
    }
}

impl From<Option<f64>> for Given {
    fn from(number: Option<f64>) -> Self {
        Self { set: number.is_some(), value: number.unwrap_or(0.0) }
    }
}

fn radial_of_table(source: &TableSource) -> Result<Box<Radial>, ParameterError> {
    let source = radial::TableSource {
        places: source.places.clone(),
        by_angles: source.by_angles,
        values: source.values.clone(),
        quantity: source.quantity.clone(),
        tail: source.tail.clone(),
        tail_exponent: source.tail_exponent.number(),
        knee: source.knee.number(),
        path: source.path.clone(),
    };
    Ok(Box::new(Radial(CoreRadial::table(&source)?)))
}

/// Empty texts are what the user left out.
fn read_table(path: &str, quantity: &str, tail: &str, tail_exponent: Given) -> Result<TableSource, ParameterError> {
    let (quantity, tail) = (Some(quantity).filter(|name| !name.is_empty()), Some(tail).filter(|name| !name.is_empty()));
    let radial::TableSource { places, by_angles, values, quantity, tail, tail_exponent, knee, path } =
        radial::read_table(path, quantity, tail, tail_exponent.number())?;
    Ok(TableSource {
        places,
        by_angles,
        values,
        quantity,
        tail,
        tail_exponent: tail_exponent.into(),
        knee: knee.into(),
        path,
    })
}

fn new_parts() -> Box<Parts> {
    Box::new(Parts(Vec::new()))
}

impl Parts {
    fn add(&mut self, weight: f64, scale: f64, radial: &Radial) {
        self.0.push((weight, scale, radial.0.clone()));
    }
}

fn radial_of_mixture(parts: &Parts) -> Result<Box<Radial>, ParameterError> {
    Ok(Box::new(Radial(CoreRadial::mixture(&parts.0)?)))
}

impl Radial {
    fn resampled(&self, nodes: usize) -> Result<Box<Radial>, ParameterError> {
        Ok(Box::new(Self(self.0.resampled(nodes)?)))
    }

    fn kind(&self) -> Kind {
        match self.0.kind() {
            CoreKind::Family => Kind::Family,
            CoreKind::Table => Kind::Table,
            CoreKind::Mixture => Kind::Mixture,
        }
    }

    fn width(&self) -> f64 {
        self.0.width()
    }

    fn key(&self) -> &[u8] {
        self.0.key()
    }

    /// Nodes of a table at its own width; none of anything else.
    fn slopes(&self) -> Vec<f64> {
        self.0.as_table().map_or(Vec::new(), |table| table.nodes().map(|node| node.0 * table.width()).collect())
    }

    fn slope_densities(&self) -> Vec<f64> {
        self.0.as_table().map_or(Vec::new(), |table| table.nodes().map(|node| node.1).collect())
    }

    fn ends(&self) -> TableEnds {
        let table = self.0.as_table();
        TableEnds {
            knee: table.map_or(0.0, |table| table.knee() * table.width()),
            tail_exponent: table.and_then(TabulatedProfile::tail_power).unwrap_or(0.0),
        }
    }
}

fn new_ndf(radial: &Radial, accuracy: f64, visible: bool) -> Result<Box<Ndf>, ParameterError> {
    let profile = radial.0.profile();
    let core = CoreNdf::shared(Arc::clone(profile), accuracy, visible)?;
    Ok(Box::new(Ndf { core, cells: OnceLock::new(), is_family: radial.0.kind() == CoreKind::Family }))
}

/// The opaque table of missing energy that C++ holds.
pub struct AlbedoTable(CoreAlbedoTable);

fn shadowing(correlated: bool) -> Shadowing {
    if correlated { Shadowing::HeightCorrelated } else { Shadowing::Separable }
}

fn new_isotropic_albedo(ndf: &Ndf, correlated: bool) -> Box<AlbedoTable> {
    threads::run(usize::MAX, || Box::new(AlbedoTable(CoreAlbedoTable::isotropic(&ndf.core, shadowing(correlated)))))
}

fn new_anisotropic_albedo(
    ndf: &Ndf,
    correlated: bool,
    alpha_u: f64,
    alpha_v: f64,
) -> Result<Box<AlbedoTable>, ParameterError> {
    let alpha = Roughness::new(alpha_u, alpha_v)?;
    let table = || CoreAlbedoTable::anisotropic(&ndf.core, shadowing(correlated), alpha);
    Ok(Box::new(AlbedoTable(threads::run(usize::MAX, table))))
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

/// The opaque table of a rough interface that C++ holds.
pub struct InterfaceTable(CoreInterfaceTable);

fn new_interface_table(
    ndf: &Ndf,
    correlated: bool,
    alpha_u: f64,
    alpha_v: f64,
    eta: f64,
    transmittance: bool,
) -> Result<Box<InterfaceTable>, ParameterError> {
    let alpha = Roughness::new(alpha_u, alpha_v)?;
    let quantity = if transmittance { Quantity::Transmittance } else { Quantity::Reflectance };
    let table = || CoreInterfaceTable::new(&ndf.core, shadowing(correlated), alpha, eta, quantity);
    Ok(Box::new(InterfaceTable(threads::run(usize::MAX, table))))
}

impl InterfaceTable {
    fn interface_header(&self) -> InterfaceHeader {
        InterfaceHeader {
            columns: self.0.columns() as u32,
            critical: self.0.critical(),
            average: self.0.average(),
            internal_reflectance: self.0.internal_reflectance(),
            facet_reflectance: self.0.facet_reflectance(),
        }
    }

    fn flat(&self) -> &[f32] {
        self.0.flat()
    }
}

/// The opaque table of derivatives that C++ holds.
pub struct GradientTable(CoreGradientTable);

fn new_gradient_table(ndf: &Ndf) -> Result<Box<GradientTable>, ParameterError> {
    let table = ndf.core.gradient_table().ok_or(ParameterError::NoGradient)?;
    Ok(Box::new(GradientTable(table)))
}

impl GradientTable {
    fn log_normalization(&self) -> [f64; 4] {
        self.0.log_normalization()
    }

    fn flat(&self) -> &[f32] {
        self.0.flat()
    }
}

/// The opaque matrix of derivatives that C++ holds, and the first cells of f.
pub struct NumbersTable {
    table: CoreNumbersTable,
    first: [usize; 2],
}

fn new_numbers_table(ndf: &Ndf, precise: bool) -> Result<Box<NumbersTable>, ParameterError> {
    let cells = ndf.profile_cells().ok_or(ParameterError::NoNumbers)?;
    let table = ndf.core.numbers_table(cells, precise).ok_or(ParameterError::NoNumbers)?;
    let first = [cells.first(true), if precise { cells.first(false) } else { 0 }];
    Ok(Box::new(NumbersTable { table, first }))
}

impl NumbersTable {
    fn numbers_header(&self) -> NumbersHeader {
        NumbersHeader {
            columns: self.table.columns(),
            cells_of_h: self.table.cells_of_h(),
            cells_of_f: self.table.cells_of_f(),
            first: self.first[0],
            first_precise: self.first[1],
        }
    }

    fn flat(&self) -> &[f32] {
        self.table.flat()
    }
}

fn first_of_wrong_length(w: &[f64], tolerance: f64) -> usize {
    threads::run(w.len() / 3, || batch::first_of_wrong_length(w, tolerance))
}

fn first_outside(x: &[f64], low: f64, high: f64) -> usize {
    threads::run(x.len(), || batch::first_outside(x, low, high))
}

/// How many numbers a query has to say about an array of so many.
fn results_of(query: &str, numbers: usize) -> Result<usize, ParameterError> {
    let query = Query::named(query)?;
    Ok(query.results() * (numbers / query.width()))
}

/// For the child of a fork, which has none of its parent's threads.
fn forget_threads() {
    threads::forget();
}

impl Ndf {
    fn numbers(&self) -> Numbers {
        let profile = self.core.profile();
        Numbers {
            normalization: profile.normalization(),
            accuracy_reached: self.core.accuracy_reached(),
            mean: profile.mean(),
            by_odds: profile.coordinate() == Coordinate::Odds,
        }
    }

    fn profile_cells(&self) -> Option<&ProfileCells> {
        self.cells.get_or_init(|| (!self.is_family).then(|| ProfileCells::new(self.core.profile()))).as_ref()
    }

    fn header(&self) -> TableHeader {
        TableHeader {
            scale: self.core.visible_table().scale(),
            lambda_entries: ENTRIES as u32,
            visible_rows: self.core.visible_table().rows() as u32,
            visible_cells: CELLS as u32,
            steepness: self.profile_cells().map_or_else(|| self.core.steepness(), ProfileCells::steepness),
        }
    }

    fn lambda_table(&self) -> &[f32] {
        self.core.lambda_table().flat()
    }

    fn visible_table(&self) -> &[f32] {
        self.core.visible_table().flat()
    }

    /// What single precision evaluates; empty for members of the family.
    fn cells(&self) -> &[f32] {
        self.profile_cells().map_or(&[], ProfileCells::single)
    }

    fn precise_cells(&self) -> &[f64] {
        self.profile_cells().map_or(&[], ProfileCells::double)
    }

    fn d(&self, alpha_u: f64, alpha_v: f64, m: &Vec3) -> f64 {
        self.core.d(Roughness { u: alpha_u, v: alpha_v }, m.into())
    }

    fn projected_area(&self, alpha_u: f64, alpha_v: f64, w: &Vec3) -> f64 {
        self.core.projected_area(Roughness { u: alpha_u, v: alpha_v }, w.into())
    }

    fn pdf(&self, alpha_u: f64, alpha_v: f64, wi: &Vec3, m: &Vec3, normals: Normals) -> f64 {
        self.core.pdf(Roughness { u: alpha_u, v: alpha_v }, wi.into(), m.into(), normals.into())
    }

    fn sample(&self, alpha_u: f64, alpha_v: f64, wi: &Vec3, u1: f64, u2: f64, normals: Normals) -> NormalSample {
        self.core.sample(Roughness { u: alpha_u, v: alpha_v }, wi.into(), (u1, u2), normals.into()).into()
    }

    fn reflected(&self, view: &Reflection, wo: &Vec3) -> Reflected {
        self.reflection(view).map_or(CoreReflected::default(), |view| view.at(wo.into())).into()
    }

    fn sample_reflection(&self, view: &Reflection, u1: f64, u2: f64) -> ReflectionSample {
        self.reflection(view).map_or((INVALID, 0.0), |view| view.sample((u1, u2))).into()
    }

    fn reflected_and_sample(&self, view: &Reflection, wo: &Vec3, u1: f64, u2: f64) -> ReflectedAndSample {
        let (reflected, sample) = self
            .reflection(view)
            .map_or((CoreReflected::default(), (INVALID, 0.0)), |view| (view.at(wo.into()), view.sample((u1, u2))));
        ReflectedAndSample { reflected: reflected.into(), sample: sample.into() }
    }

    #[inline]
    fn reflection(&self, view: &Reflection) -> Option<CoreReflection<'_>> {
        let alpha = Roughness { u: view.alpha_u, v: view.alpha_v };
        CoreReflection::new(&self.core, alpha, shadowing(view.correlated), (&view.wi).into(), view.normals.into())
    }

    /// 0 for a member of the family.
    fn count_of_numbers(&self) -> usize {
        self.core.numbers_gradient().map_or(0, NumbersGradient::count)
    }

    fn by_numbers(
        &self,
        quantity: &str,
        alpha_u: f64,
        alpha_v: f64,
        w: &[f64],
        out: &mut [f64],
    ) -> Result<(), ParameterError> {
        let alpha = Roughness::new(alpha_u, alpha_v)?;
        threads::run(usize::MAX, || batch::by_numbers(&self.core, quantity, alpha, w, out))
    }

    fn eval_batch(
        &self,
        query: &str,
        alpha_u: f64,
        alpha_v: f64,
        first: &[f64],
        second: &[f64],
        out: &mut [f64],
    ) -> Result<(), ParameterError> {
        let (query, alpha) = (Query::named(query)?, Roughness::new(alpha_u, alpha_v)?);
        threads::run(first.len() / query.width(), || query.eval(&self.core, alpha, first, second, out))
    }
}

/// The threads that arrays and tables are computed on.
mod threads {
    use crate::batch::is_parallel;
    use rayon::{ThreadPool, ThreadPoolBuilder};
    use std::ptr;
    use std::sync::atomic::{AtomicPtr, Ordering};

    /// Rayon's own global pool does not survive a fork: the child has none of its threads, and would wait for them for ever. No lock
    /// guards this one, because a thread that the child lacks could hold it.
    static POOL: AtomicPtr<ThreadPool> = AtomicPtr::new(ptr::null_mut());

    /// Runs `work` among the threads of this process if it has rows for more than one.
    pub(super) fn run<R: Send>(rows: usize, work: impl FnOnce() -> R + Send) -> R {
        match if is_parallel(rows) { pool() } else { None } {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }

    /// The next [`run`] starts new threads. The old pool is left as it is: its locks may be held by threads that are gone.
    pub(super) fn forget() {
        POOL.store(ptr::null_mut(), Ordering::Release);
    }

    /// None where the system grants no threads.
    fn pool() -> Option<&'static ThreadPool> {
        let mut found = POOL.load(Ordering::Acquire);
        if found.is_null() {
            let made = Box::into_raw(Box::new(ThreadPoolBuilder::new().build().ok()?));
            found = match POOL.compare_exchange(ptr::null_mut(), made, Ordering::AcqRel, Ordering::Acquire) {
                Ok(_) => made,
                Err(other) => {
                    // SAFETY: made above, and nobody else has seen it: another thread was faster
                    drop(unsafe { Box::from_raw(made) });
                    other
                }
            };
        }
        // SAFETY: what has stood in POOL is never freed
        Some(unsafe { &*found })
    }
}
