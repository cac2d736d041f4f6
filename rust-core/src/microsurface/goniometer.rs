//! A virtual goniometer: light from one direction, counted by where it goes and by how many facets it met.
//!
//! It measures surfaces, and Smith's model of them by its random walk: what the two differ in is what the model leaves out.

use super::facet::Material;
use super::generate::unit;
use super::trace::{End, Side, Tracer};
use crate::scattering::random_walk::RandomWalk;
use glam::DVec3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use std::f64::consts::PI;

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setup {
    /// Where the light comes from, a unit vector with z > 0.
    pub wi: DVec3,
    /// What the surface is made of.
    pub material: Material,
    /// Numbers of facets that are told apart; the last one holds all greater ones.
    pub orders: usize,
    /// Bins of the polar angle of one hemisphere, of even width.
    pub polar: usize,
    /// Bins of the azimuth from −π, of even width.
    pub azimuths: usize,
    /// Bins of the cosine at the first facet.
    pub cosines: usize,
}

/// Sums over walks. A walk carries an energy of 1 per color when it arrives.
#[derive(Debug, Clone, PartialEq)]
pub struct Counts {
    /// Walks that were made.
    pub walks: u64,
    /// Those that did not end.
    pub lost: u64,
    /// Σ of energies by (hemisphere, order, polar bin, azimuth bin, color): upper hemisphere first.
    pub energy: Vec<f64>,
    /// Σ of their squares.
    pub squares: Vec<f64>,
    /// First facets by the cosine between the light and their normal.
    pub first: Vec<u64>,
    /// Σ of facets that were met, and of its square.
    pub bounces: [u64; 2],
}

/// Facets after which a walk is given up: without absorption fewer than one in 1e9 get there at roughness 10.
const MOST_BOUNCES: u32 = 100_000;
/// Walks that share a stream of random numbers.
const CHUNK: u64 = 1 << 13;
/// Chunks whose counts are in memory at a time.
const GROUP: u64 = 64;

impl Setup {
    /// Number of sums of energies.
    pub fn bins(&self) -> usize {
        2 * self.orders * self.polar * self.azimuths * 3
    }

    fn empty(&self) -> Counts {
        Counts {
            walks: 0,
            lost: 0,
            energy: vec![0.0; self.bins()],
            squares: vec![0.0; self.bins()],
            first: vec![0; self.cosines],
            bounces: [0; 2],
        }
    }

    /// Sends `walks` rays; the same for the same seed, whatever the number of threads. `watch` is told now and then how many have been followed,
    /// and may stop the rest by returning false.
    pub fn measure(&self, tracer: &Tracer, walks: u64, seed: u64, watch: impl FnMut(u64) -> bool) -> Counts {
        self.in_chunks(walks, seed, watch, |random, counts| self.walk(tracer, random, counts))
    }

    /// Sends `walks` rays to Smith's model of a surface, by its random walk.
    pub fn measure_model(
        &self,
        model: &RandomWalk<'_>,
        walks: u64,
        seed: u64,
        watch: impl FnMut(u64) -> bool,
    ) -> Counts {
        self.in_chunks(walks, seed, watch, |random, counts| {
            counts.walks += 1;
            let (mut weight, mut first) = (DVec3::ONE, true);
            let mut facet = |cosine| {
                if first {
                    counts.first[self.cosine_bin(cosine)] += 1;
                    first = false;
                }
                // glass reflects or refracts all of a walk
                if !matches!(self.material, Material::Dielectric { .. }) {
                    weight *= self.material.reflectance(cosine);
                }
            };
            let exit = match self.material {
                Material::Dielectric { eta } => model.walk_dielectric(self.wi, eta, &mut || unit(random), &mut facet),
                Material::Mirror | Material::Conductor { .. } => model.walk(self.wi, &mut || unit(random), &mut facet),
            };
            match exit {
                Some(exit) => {
                    let side = if exit.direction.z < 0.0 { Side::Below } else { Side::Above };
                    self.count(exit.direction, side, weight, exit.bounces, counts);
                }
                None => counts.lost += 1,
            }
        })
    }

    fn in_chunks(
        &self,
        walks: u64,
        seed: u64,
        mut watch: impl FnMut(u64) -> bool,
        walk: impl Fn(&mut ChaCha8Rng, &mut Counts) + Sync,
    ) -> Counts {
        let mut sum = self.empty();
        let chunks = walks.div_ceil(CHUNK);
        for group in (0..chunks).step_by(GROUP as usize) {
            let parts: Vec<Counts> = (group..(group + GROUP).min(chunks))
                .into_par_iter()
                .map(|chunk| {
                    let mut random = ChaCha8Rng::seed_from_u64(seed);
                    random.set_stream(chunk);
                    let mut counts = self.empty();
                    for _ in 0..CHUNK.min(walks - chunk * CHUNK) {
                        walk(&mut random, &mut counts);
                    }
                    counts
                })
                .collect();
            parts.iter().for_each(|part| sum.add(part));
            if !watch(sum.walks) {
                break;
            }
        }
        sum
    }

    fn cosine_bin(&self, cosine: f64) -> usize {
        ((cosine.max(0.0) * self.cosines as f64) as usize).min(self.cosines - 1)
    }

    fn walk(&self, tracer: &Tracer, random: &mut ChaCha8Rng, counts: &mut Counts) {
        counts.walks += 1;
        let (mut direction, mut side, mut weight) = (-self.wi, Side::Above, DVec3::ONE);
        let mut end = tracer.first(direction, (unit(random), unit(random)));
        for bounces in 0..MOST_BOUNCES {
            let point = match end {
                End::Hit(point) => point,
                End::Away => return self.count(direction, side, weight, bounces, counts),
                End::Lost => break,
            };
            let slope = tracer.slope(&point);
            let m = DVec3::new(-slope.x, -slope.y, 1.0).normalize();
            if bounces == 0 {
                counts.first[self.cosine_bin(self.wi.dot(m))] += 1;
            }
            let choice = if matches!(self.material, Material::Dielectric { .. }) { unit(random) } else { 0.0 };
            let scattered = self.material.scatter(direction, m, side, choice);
            (direction, side) = (scattered.direction, scattered.side);
            weight *= scattered.weight;
            end = tracer.next(&point, direction, side);
        }
        counts.lost += 1;
    }

    fn count(&self, w: DVec3, side: Side, weight: DVec3, bounces: u32, counts: &mut Counts) {
        let hemisphere = usize::from(side == Side::Below);
        let order = (bounces.max(1) as usize - 1).min(self.orders - 1);
        let polar = (w.z.abs().min(1.0).acos() / (0.5 * PI) * self.polar as f64) as usize;
        let azimuth = ((w.y.atan2(w.x) / (2.0 * PI) + 0.5) * self.azimuths as f64) as usize;
        let bin = ((hemisphere * self.orders + order) * self.polar + polar.min(self.polar - 1)) * self.azimuths
            + azimuth.min(self.azimuths - 1);
        for color in 0..3 {
            counts.energy[3 * bin + color] += weight[color];
            counts.squares[3 * bin + color] += weight[color] * weight[color];
        }
        let bounces = u64::from(bounces);
        counts.bounces[0] += bounces;
        counts.bounces[1] += bounces * bounces;
    }

    /// Area of all facets that face the light, seen from there, per area of the tile, by the cosine between the light and their normal.
    pub fn projected_areas(&self, tracer: &Tracer) -> Vec<f64> {
        let surface = tracer.surface();
        let rows: Vec<Vec<f64>> = (0..surface.ny())
            .into_par_iter()
            .map(|j| {
                let mut areas = vec![0.0; self.cosines];
                for i in 0..surface.nx() {
                    for s in surface.cell_slopes(i, j) {
                        let area = self.wi.z - s.x * self.wi.x - s.y * self.wi.y;
                        if area > 0.0 {
                            let cosine = area / (1.0 + s.length_squared()).sqrt();
                            areas[self.cosine_bin(cosine)] += area;
                        }
                    }
                }
                areas
            })
            .collect();
        let mut areas = vec![0.0; self.cosines];
        for row in rows {
            areas.iter_mut().zip(row).for_each(|(sum, area)| *sum += area / surface.facets() as f64);
        }
        areas
    }
}

impl Counts {
    /// All numbers in one list: walks, lost, both of `bounces`, then `first`, `energy` and `squares`.
    pub fn flat(&self) -> Vec<f64> {
        let whole = [self.walks, self.lost, self.bounces[0], self.bounces[1]];
        let whole = whole.iter().chain(&self.first).map(|&count| count as f64);
        whole.chain(self.energy.iter().copied()).chain(self.squares.iter().copied()).collect()
    }

    fn add(&mut self, other: &Self) {
        self.walks += other.walks;
        self.lost += other.lost;
        self.energy.iter_mut().zip(&other.energy).for_each(|(a, b)| *a += b);
        self.squares.iter_mut().zip(&other.squares).for_each(|(a, b)| *a += b);
        self.first.iter_mut().zip(&other.first).for_each(|(a, b)| *a += b);
        self.bounces.iter_mut().zip(&other.bounces).for_each(|(a, b)| *a += b);
    }
}
