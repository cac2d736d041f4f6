//! Masking of a profile by the reference quadrature: H, and with it Λ, and S = −H′.

use super::{Record, Source, oracle, over_shapes, references, slopes};
use crate::cases::Case;
use sgtd_core::masking::{MaskingIntegral, Rule};
use sgtd_core::profile::{Masking, Profile};
use std::f64::consts::FRAC_2_PI;

/// One argument in so many is integrated, to keep the time within bounds; which ones changes from shape to shape.
const THINNING: u64 = 12;

/// The range of a for which accuracy is promised.
const PROMISED: std::ops::RangeInclusive<f64> = 1e-8..=1e3;

fn arguments(case: Case, seed: u64) -> impl Iterator<Item = (Source, f64)> {
    let edges = [*PROMISED.start(), *PROMISED.end()].map(|a| (Source::Edge, a));
    edges
        .into_iter()
        .chain(slopes(case, seed).into_iter().filter(|(_, a)| PROMISED.contains(a)))
        .zip(seed..)
        .filter(|(_, k)| k % THINNING == 0)
        .map(|(argument, _)| argument)
}

/// H/a = Λ as everything else takes it.
pub fn lambda() -> Record {
    lambda_of("lambda", MaskingIntegral::at)
}

/// H/a = Λ by quadrature, of shapes with a closed form too.
pub fn lambda_by_quadrature() -> Record {
    lambda_of("lambda by quadrature", MaskingIntegral::by_quadrature)
}

fn lambda_of(what: &str, masking_at: fn(&MaskingIntegral, &dyn Profile, f64) -> Masking) -> Record {
    let mut record = over_shapes(what, |record, _, case, seed| {
        let (profile, oracle) = (case.profile(), oracle(case));
        let masking = MaskingIntegral::new(&profile, Rule::REFERENCE);
        let factor = FRAC_2_PI * oracle.normalization();
        for (source, a) in arguments(case, seed) {
            let want = factor * oracle.bracket_integral(a) / a;
            record.compare(source, masking_at(&masking, &profile, a).h / a, want, || format!("{case:?} a = {a:e}"));
        }
    });
    let mut last: Option<(Case, MaskingIntegral)> = None;
    for row in references("Lambda") {
        let (profile, a) = (row.case.profile(), row.argument);
        if last.as_ref().is_none_or(|(case, _)| *case != row.case) {
            last = Some((row.case, MaskingIntegral::new(&profile, Rule::REFERENCE)));
        }
        if let Some((_, masking)) = &last {
            let got = masking_at(masking, &profile, a).h / a;
            record.compare(Source::List, got, row.value, || format!("{:?} a = {a:e}", row.case));
        }
    }
    record
}

/// S.
pub fn share() -> Record {
    over_shapes("share", |record, _, case, seed| {
        let (profile, oracle) = (case.profile(), oracle(case));
        let masking = MaskingIntegral::new(&profile, Rule::REFERENCE);
        let factor = FRAC_2_PI * oracle.normalization();
        for (source, a) in arguments(case, seed + 3) {
            let want = factor * oracle.angle_integral(a);
            record.compare(source, masking.at(&profile, a).s, want, || format!("{case:?} a = {a:e}"));
        }
    })
}
