//! What a distribution is made from: a member of the family, a table, or a mixture of these.
//!
//! Every one of them is a [`Profile`] and a key; equal keys are equal distributions, so whoever holds tables can share them.

use crate::error::ParameterError;
use crate::family::shape::Shape;
use crate::family::skewed_t::SkewedT;
use crate::profile::resample::resample;
use crate::profile::table_file::{self, TableFile};
use crate::profile::tabulated::{Quantity, TableTail, TabulatedProfile};
use crate::profile::{MixtureProfile, Part, Profile};
use std::sync::Arc;

/// A radial distribution.
#[derive(Clone)]
pub struct Radial {
    profile: Arc<dyn Profile>,
    width: f64,
    key: Vec<u8>,
    table: Option<Arc<TabulatedProfile>>,
    kind: Kind,
}

/// What it is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A member of the family.
    Family,
    /// A table.
    Table,
    /// A weighted sum.
    Mixture,
}

/// A table as users give it.
#[derive(Debug, Clone, PartialEq)]
pub struct TableSource {
    /// Angles in degrees, or slopes.
    pub places: Vec<f64>,
    /// Are they angles?
    pub by_angles: bool,
    /// Values there.
    pub values: Vec<f64>,
    /// Name of a [`Quantity`].
    pub quantity: String,
    /// `power` or `cut`.
    pub tail: String,
    /// The exponent of the power; that of the last cell if it is left out.
    pub tail_exponent: Option<f64>,
    /// The knee, a slope; chosen if it is left out.
    pub knee: Option<f64>,
    /// The file that it is from, for errors; empty if it is from none.
    pub path: String,
}

fn key(kind: u8, numbers: impl IntoIterator<Item = f64>) -> Vec<u8> {
    std::iter::once(kind).chain(numbers.into_iter().flat_map(|number| number.to_bits().to_le_bytes())).collect()
}

impl Radial {
    /// A member of the family.
    pub fn family(shape: Shape) -> Self {
        let numbers = [shape.gamma(), shape.p(), shape.lambda(), shape.shift()];
        Self {
            profile: Arc::new(SkewedT::new(shape)),
            width: 1.0,
            key: key(b'f', numbers),
            table: None,
            kind: Kind::Family,
        }
    }

    /// A table.
    ///
    /// # Errors
    /// Names the file, the row, its value and the mend; see [`TabulatedProfile::with_knee`].
    pub fn table(source: &TableSource) -> Result<Self, ParameterError> {
        let table = tabulated(source).map_err(|error| match source.path.as_str() {
            "" => error,
            path => ParameterError::InFile { path: path.to_owned(), source: Box::new(error) },
        })?;
        Ok(Self::of_table(table))
    }

    fn of_table(table: TabulatedProfile) -> Self {
        let nodes = table.nodes().flat_map(|(x, f)| [x, f]);
        let numbers = [table.width(), table.knee(), table.tail_power().unwrap_or(0.0)].into_iter().chain(nodes);
        // what was given in another way has other derivatives
        let key = key(b't', table.given_as().into_iter().chain(numbers));
        let table = Arc::new(table);
        Self {
            key,
            width: table.width(),
            profile: Arc::clone(&table) as Arc<dyn Profile>,
            table: Some(table),
            kind: Kind::Table,
        }
    }

    /// A weighted sum: weights, roughnesses, and distributions.
    ///
    /// # Errors
    /// As [`MixtureProfile::new`].
    pub fn mixture(parts: &[(f64, f64, Self)]) -> Result<Self, ParameterError> {
        let mixture = MixtureProfile::new(
            parts
                .iter()
                .map(|(weight, scale, part)| Part {
                    weight: *weight,
                    scale: *scale,
                    profile: Arc::clone(&part.profile),
                })
                .collect(),
        )?;
        let mut bytes = key(b'm', [mixture.width()]);
        for ((_, _, radial), part) in parts.iter().zip(mixture.parts()) {
            bytes.extend(key(b'p', [part.weight, part.scale]));
            bytes.extend((radial.key.len() as u64).to_le_bytes());
            bytes.extend(&radial.key);
        }
        Ok(Self { width: mixture.width(), profile: Arc::new(mixture), key: bytes, table: None, kind: Kind::Mixture })
    }

    /// The same as a table of so many nodes.
    ///
    /// # Errors
    /// Another number of nodes than 2 to 1000.
    pub fn resampled(&self, nodes: usize) -> Result<Self, ParameterError> {
        Ok(Self::of_table(resample(self.profile.as_ref(), nodes)?.profile))
    }

    /// The profile, at unit roughness.
    pub fn profile(&self) -> &Arc<dyn Profile> {
        &self.profile
    }

    /// What it is made from.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The roughness at which a table or mixture is as it was given; 1 for the family.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// Bytes that are equal for equal distributions, and for no others.
    pub fn key(&self) -> &[u8] {
        &self.key
    }

    /// The table, if it is one.
    pub fn as_table(&self) -> Option<&TabulatedProfile> {
        self.table.as_deref()
    }
}

fn tabulated(source: &TableSource) -> Result<TabulatedProfile, ParameterError> {
    let TableSource { places, values, tail_exponent, knee, .. } = source;
    let quantity = Quantity::named(&source.quantity)?;
    let tail = match (source.tail.as_str(), tail_exponent) {
        ("power", exponent) => TableTail::Power(*exponent),
        ("cut", None) => TableTail::Cut,
        ("cut", Some(exponent)) => {
            return Err(ParameterError::Table {
                problem: format!("is cut behind its last row, but has a \"tail_exponent\" of {exponent}"),
                mend: "leave one of the two out",
            });
        }
        (other, _) => {
            return Err(ParameterError::UnknownName { name: "tail", given: other.to_owned(), known: "power, cut" });
        }
    };
    if source.by_angles {
        TabulatedProfile::from_angles(places, values, quantity, *knee, tail)
    } else {
        TabulatedProfile::of(places, values, quantity, *knee, tail)
    }
}

/// What a file says about a table; what is given beside it comes first.
///
/// # Errors
/// Names the file, the line and the mend.
pub fn read_table(
    path: &str,
    quantity: Option<&str>,
    tail: Option<&str>,
    tail_exponent: Option<f64>,
) -> Result<TableSource, ParameterError> {
    let TableFile { by_angles, places, values, quantity: said, cut, tail_exponent: its_exponent, knee } =
        table_file::read(path)?;
    let tail = tail.unwrap_or(if cut.unwrap_or(false) && tail_exponent.is_none() { "cut" } else { "power" });
    Ok(TableSource {
        places,
        by_angles,
        values,
        quantity: quantity.or(said).unwrap_or("D").to_owned(),
        tail: tail.to_owned(),
        tail_exponent: tail_exponent.or(if tail == "cut" { None } else { its_exponent }),
        knee,
        path: path.to_owned(),
    })
}
